//! The losses (section III-C of the paper), each a scalar.

use candle_core::Tensor;
use nalgebra::Point3;
use rayon::prelude::*;

use crate::{
    CgfError,
    config::Contact,
    network::constant,
    precision::{narrow, narrow_all},
};

/// `L_q`: mean over the outputs of squared errors, weighted over the rows.
///
/// `outputs` and `targets` are `(rows, width)`, `row_weights` `(rows, 1)` with sum 1.
pub(crate) fn squared_error(
    outputs: &Tensor,
    targets: &Tensor,
    row_weights: &Tensor,
) -> Result<Tensor, CgfError> {
    let width = outputs.dim(1)? as f64;
    let terms = (outputs - targets)?.sqr()?.broadcast_mul(row_weights)?;
    Ok((terms.sum_all()? / width)?)
}

/// `L_j`: mean over the links of squared distances in m², weighted over the rows.
///
/// `origins` and `targets` are `(rows, 3 links)` in meters, `row_weights` `(rows, 1)` with sum 1.
pub(crate) fn squared_distance(
    origins: &Tensor,
    targets: &Tensor,
    row_weights: &Tensor,
) -> Result<Tensor, CgfError> {
    Ok((squared_error(origins, targets, row_weights)? * 3.0)?)
}

/// `L_KL`: divergence of `N(mean, exp(log_variance))` from `N(0, 1)` in nats, to be made small.
///
/// Both are `(batch, latent)`; the result is averaged over the batch (Kingma and Welling,
/// *Auto-Encoding Variational Bayes*, 2014, appendix B). The paper prints the opposite sign.
pub(crate) fn kl_divergence(mean: &Tensor, log_variance: &Tensor) -> Result<Tensor, CgfError> {
    let terms = (((mean.sqr()? + log_variance.exp()?)? - log_variance)? - 1.0)?;
    Ok((terms.sum(1)? * 0.5)?.mean_all()?)
}

/// `L_contact`: mean over the fingertips of the squared distance from contact, in m².
///
/// `tips` is `(tips, 3)`, with a gradient where they are predicted; `surfaces` gives the object's
/// points for each of them. The nearest point is searched off the tape.
pub(crate) fn contact(
    tips: &Tensor,
    surfaces: &[&[Point3<f64>]],
    contact: Contact,
    tip_radius_m: f64,
) -> Result<Tensor, CgfError> {
    let centers = tips.to_vec2::<f32>()?;
    let nearest: Vec<f32> = centers
        .par_iter()
        .zip(surfaces)
        .flat_map_iter(|(center, surface)| narrow_all(nearest(center, surface).coords.as_slice()))
        .collect();
    let nearest = constant(nearest, &[centers.len(), 3])?.to_device(tips.device())?;
    let squares = (tips - nearest)?.sqr()?.sum(1)?;
    let terms = match contact {
        Contact::TouchCenter | Contact::Demonstrated => squares,
        // Away from zero the root has a derivative.
        Contact::TouchSurface => ((squares + 1e-10)?.sqrt()? - tip_radius_m)?.sqr()?,
    };
    Ok(terms.mean_all()?)
}

fn nearest(center: &[f32], surface: &[Point3<f64>]) -> Point3<f64> {
    let center = Point3::from(nalgebra::Vector3::from_iterator(
        center.iter().map(|&x| f64::from(x)),
    ));
    let mut best = (f64::INFINITY, center);
    for point in surface {
        let distance = (point - center).norm_squared();
        if distance < best.0 {
            best = (distance, *point);
        }
    }
    best.1
}

/// Returns weights of rows with sum 1: `first` rows of each motion have `weight`, the others 1.
pub(crate) fn row_weights(
    batch: usize,
    first: usize,
    others: usize,
    weight: f64,
) -> Result<Tensor, CgfError> {
    let one = |idx: usize| if idx < first { weight } else { 1.0 };
    let total: f64 = (0..first + others).map(one).sum::<f64>() * batch as f64;
    let values =
        (0..batch).flat_map(|_| (0..first + others).map(move |idx| narrow(one(idx) / total)));
    constant(values.collect(), &[batch * (first + others), 1])
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Tensor, Var};
    use nalgebra::Point3;

    use super::{contact, kl_divergence, row_weights, squared_error};
    use crate::config::Contact;

    /// Compares the tape's gradient with central differences within `tolerance` of the largest.
    fn check(at: &[f32], shape: (usize, usize), loss: impl Fn(&Tensor) -> Tensor, tolerance: f32) {
        let tensor = |x: &[f32]| Tensor::from_slice(x, shape, &Device::Cpu).unwrap();
        let var = Var::from_tensor(&tensor(at)).unwrap();
        let grads = loss(var.as_tensor()).backward().unwrap();
        let found: Vec<f32> = grads
            .get(&var)
            .unwrap()
            .flatten_all()
            .unwrap()
            .to_vec1()
            .unwrap();
        let largest = found.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
        let h = 1e-2;
        for k in 0..at.len() {
            let mut moved = at.to_vec();
            let mut value = |x: f32| {
                moved[k] = x;
                loss(&tensor(&moved)).to_scalar::<f32>().unwrap()
            };
            let expected = (value(at[k] + h) - value(at[k] - h)) / (2.0 * h);
            assert!(
                (expected - found[k]).abs() < tolerance * largest,
                "{k}: {expected} {}",
                found[k]
            );
        }
    }

    #[test]
    fn gradients_equal_central_differences() {
        let at = [0.3, -0.7, 1.1, 0.2, -0.4, 0.9];
        let ones = Tensor::ones((2, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
        let weights = row_weights(1, 1, 1, 3.0).unwrap();
        check(
            &at,
            (2, 3),
            |x| squared_error(x, &ones, &weights).unwrap(),
            1e-3,
        );
        check(
            &at,
            (2, 3),
            |x| kl_divergence(x, &(ones.clone() * 0.3).unwrap()).unwrap(),
            1e-3,
        );
        check(&at, (2, 3), |x| kl_divergence(&ones, x).unwrap(), 1e-3);
        let surface = [Point3::new(0.0, 0.0, 0.0), Point3::new(5.0, 5.0, 5.0)];
        for kind in [Contact::TouchCenter, Contact::TouchSurface] {
            check(
                &at,
                (2, 3),
                |x| contact(x, &[&surface, &surface], kind, 0.4).unwrap(),
                1e-3,
            );
        }
    }

    #[test]
    fn kl_divergence_is_zero_for_the_prior_alone() {
        let zeros = Tensor::zeros((4, 3), candle_core::DType::F32, &Device::Cpu).unwrap();
        let ones = zeros.ones_like().unwrap();
        assert_eq!(
            kl_divergence(&zeros, &zeros)
                .unwrap()
                .to_scalar::<f32>()
                .unwrap(),
            0.0
        );
        assert!(
            kl_divergence(&ones, &zeros)
                .unwrap()
                .to_scalar::<f32>()
                .unwrap()
                > 0.0
        );
        assert!(
            kl_divergence(&zeros, &ones)
                .unwrap()
                .to_scalar::<f32>()
                .unwrap()
                > 0.0
        );
    }
}
