//! The min-weight metric of a grasp's wrenches.

use nalgebra::Vector6;

use crate::simplex;

/// The min-weight metric of wrenches, with its gradients.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MinWeight {
    /// The metric times the number of wrenches: 1 at most, more than 0 in force closure.
    pub(crate) normalized: f64,
    /// Gradient of [`MinWeight::normalized`] with respect to each wrench.
    gradients: Vec<Vector6<f64>>,
}

impl MinWeight {
    /// Returns the greatest least weight of a balance of the wrenches: `max l` over weights `aᵢ ≥ l` with `Σ aᵢ wᵢ = 0`
    /// and `Σ aᵢ = 1` (Li et al., *`FRoGGeR`*, 2023). It is more than 0 if and only if the wrenches span
    /// every direction and zero is inside their hull; less than 0 where a balance needs wrenches that pull.
    ///
    /// Returns `None` if no weights balance at all, pulling or not: where every force has a part in one direction.
    pub(crate) fn of(wrenches: &[Vector6<f64>]) -> Option<Self> {
        let n = wrenches.len();
        // With `aᵢ = sᵢ + l` the weights are variables that are not negative; l itself is the difference of two.
        let column = |wrench: &Vector6<f64>, sum: f64| {
            let mut column: Vec<f64> = wrench.iter().copied().collect();
            column.push(sum);
            column
        };
        let total: Vector6<f64> = wrenches.iter().sum();
        let mut columns: Vec<Vec<f64>> = wrenches.iter().map(|w| column(w, 1.0)).collect();
        columns.push(column(&total, n as f64));
        columns.push(column(&-total, -(n as f64)));
        let mut gain = vec![0.0; n + 2];
        (gain[n], gain[n + 1]) = (1.0, -1.0);
        let right = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let found = simplex::maximize(&columns, &right, &gain)?;
        let weights = found.x[..n].iter().map(|extra| extra + found.value);
        // The maximum changes by minus multiplier times variable with each entry of the equations.
        let multipliers = Vector6::from_row_slice(&found.dual[..6]);
        Some(Self {
            normalized: found.value * n as f64,
            gradients: weights
                .map(|weight| multipliers * (-weight * n as f64))
                .collect(),
        })
    }

    /// Returns the change of [`MinWeight::normalized`] with a change of one wrench.
    pub(crate) fn change(&self, wrench: usize, by: &Vector6<f64>) -> f64 {
        self.gradients[wrench].dot(by)
    }
}

#[cfg(test)]
mod tests {
    use approach::ContactModel;
    use nalgebra::{Point3, Vector3};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn metric(contacts: &[([f64; 3], [f64; 3])], friction: f64, edges: usize) -> Option<f64> {
        let all: Vec<Vector6<f64>> = contacts
            .iter()
            .flat_map(|(at, normal)| {
                let normal = Vector3::from(*normal).normalize();
                let contact_model = ContactModel {
                    center_in_object: Point3::origin(),
                    length_m: 1.0,
                    friction,
                    edges,
                };
                contact_model.wrenches(&Point3::from(*at), &normal, &normal)
            })
            .collect();
        MinWeight::of(&all).map(|metric| metric.normalized)
    }

    /// Six axes, both ways, have equal weights; without one of the twelve its opposite can have none.
    #[test]
    fn opposite_axes_balance_with_equal_weights() {
        let axes: Vec<Vector6<f64>> = (0..6)
            .flat_map(|axis| {
                let mut along = Vector6::zeros();
                along[axis] = 1.0;
                [along, -along]
            })
            .collect();
        let full = MinWeight::of(&axes).unwrap();
        assert!((full.normalized - 1.0).abs() < 1e-9);
        // One of 12 twice as long has half of its opposite's weight.
        let mut longer = axes.clone();
        longer[0] *= 2.0;
        let found = MinWeight::of(&longer).unwrap().normalized;
        // Its weight is l, its opposite's 2 l, those of the ten others l: 13 l = 1.
        assert!((found - 12.0 / 13.0).abs() < 1e-9, "{found}");
        let half = MinWeight::of(&axes[1..]).unwrap();
        assert!(half.normalized.abs() < 1e-9, "{}", half.normalized);
    }

    #[test]
    fn two_antipodal_points_balance_equally_and_three_about_a_ring_do_too() {
        // Weights are all 1/n: by symmetry the sum of the wrenches is zero.
        let x = 0.04;
        let two = [
            ([x, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ([-x, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ];
        assert!((metric(&two, 0.5, 4).unwrap() - 1.0).abs() < 1e-9);
        let ring: Vec<([f64; 3], [f64; 3])> = (0..3)
            .map(|k| {
                let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / 3.0).sin_cos();
                ([x * cosine, x * sine, 0.0], [cosine, sine, 0.0])
            })
            .collect();
        assert!((metric(&ring, 0.5, 4).unwrap() - 1.0).abs() < 1e-9);
        // All from one side: forces with a sum of 1 cannot have a sum of 0.
        let one_sided = [
            ([0.0, 0.0, x], [0.0, 0.0, 1.0]),
            ([x, 0.0, x], [0.0, 0.0, 1.0]),
            ([0.0, x, x], [0.0, 0.0, 1.0]),
        ];
        assert_eq!(metric(&one_sided, 0.5, 4), None);
    }

    /// Against two antipodal contacts, the second moved off the line so that the cones just do not see each other.
    #[test]
    fn force_closure_ends_where_the_line_between_two_contacts_leaves_the_cones() {
        let metric_at = |off: f64| {
            let (x, friction) = (0.05, 0.5);
            // The line from the first to the second rises by `off` per unit; both normals stay along x. Cone edges
            // are at 0, 90, 180 and 270 degrees about the normal, so that the slope at the edge is the friction.
            let contacts = [
                ([x, 0.0, off * x], [1.0, 0.0, 0.0]),
                ([-x, 0.0, -off * x], [-1.0, 0.0, 0.0]),
            ];
            metric(&contacts, friction, 4).unwrap()
        };
        assert!(metric_at(0.0) > 0.9);
        assert!(metric_at(0.45) > 0.0, "{}", metric_at(0.45));
        assert!(metric_at(0.55) < 0.0, "{}", metric_at(0.55));
    }

    /// A random ascent over the weights that balance comes near the maximum from below.
    #[test]
    fn no_weights_tried_at_random_do_better_and_the_best_come_near() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for _ in 0..10 {
            let n = 10;
            let wrenches: Vec<Vector6<f64>> = (0..n)
                .map(|_| Vector6::from_fn(|_, _| rng.random::<f64>() * 2.0 - 1.0))
                .collect();
            let exact = MinWeight::of(&wrenches).unwrap().normalized;
            // Balances are a particular one plus the null space of the seven equations.
            let mut equations = nalgebra::DMatrix::zeros(7, n);
            for (column, wrench) in wrenches.iter().enumerate() {
                equations.view_mut((0, column), (6, 1)).copy_from(wrench);
                equations[(6, column)] = 1.0;
            }
            let mut right = nalgebra::DVector::zeros(7);
            right[6] = 1.0;
            let svd = equations.clone().svd(true, true);
            let particular = svd.solve(&right, 1e-12).unwrap();
            let inverse = equations.clone().pseudo_inverse(1e-12).unwrap();
            let null = nalgebra::DMatrix::identity(n, n) - inverse * &equations;
            let mut best = particular.min() * n as f64;
            let mut at = particular.clone();
            let mut size = 1.0;
            for _ in 0..20_000 {
                let random = nalgebra::DVector::from_fn(n, |_, _| rng.random::<f64>() - 0.5);
                let trial = &at + &null * random * size;
                if trial.min() * n as f64 > best {
                    best = trial.min() * n as f64;
                    at = trial;
                    size *= 1.5;
                } else {
                    size = (size * 0.98_f64).max(1e-7);
                }
            }
            assert!(best <= exact + 1e-7, "{best} {exact}");
            assert!(best > exact - 0.05 * (1.0 + exact.abs()), "{best} {exact}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_metric() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let wrenches: Vec<Vector6<f64>> = (0..16)
            .map(|_| Vector6::from_fn(|_, _| rng.random::<f64>() * 2.0 - 1.0))
            .collect();
        let metric = MinWeight::of(&wrenches).unwrap();
        for wrench in 0..16 {
            for axis in 0..6 {
                const H: f64 = 1e-6;
                let mut by = Vector6::zeros();
                by[axis] = H;
                let moved = |sign: f64| {
                    let mut all = wrenches.clone();
                    all[wrench] += by * sign;
                    MinWeight::of(&all).unwrap().normalized
                };
                let expected = (moved(1.0) - moved(-1.0)) / 2.0;
                let found = metric.change(wrench, &by);
                assert!(
                    (found - expected).abs() < 1e-9,
                    "{wrench} {axis}: {found} {expected}"
                );
            }
        }
    }
}
