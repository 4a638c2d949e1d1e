//! The rotation that brings vectors nearest to others.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Most sweeps of a decomposition of three by three numbers.
const MAX_SWEEPS: usize = 1000;

/// The alignment of one set of vectors with another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alignment {
    /// The rotation that brings the vectors nearest to the others.
    pub(crate) rotation: UnitQuaternion<f64>,
    /// Sum of the products of the others with the rotated vectors.
    pub(crate) product: f64,
    /// The same sum with the best reflection.
    pub(crate) mirrored_product: f64,
}

/// Returns the alignment for the correlation `Σ to fromᵀ`, by its singular values and vectors; reflections are
/// excluded (Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, IEEE
/// Transactions on Pattern Analysis and Machine Intelligence 1991, equation 40). `None` if a number is not finite.
pub(crate) fn align(correlation: &Matrix3<f64>) -> Option<Alignment> {
    if !correlation.iter().all(|number| number.is_finite()) {
        return None;
    }
    let svd = correlation.try_svd(true, true, 5.0 * f64::EPSILON, MAX_SWEEPS)?;
    // The paper's U, D and V.
    let (u, d, v_t) = (svd.u?, svd.singular_values, svd.v_t?);
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let (most, least) = (d.x + d.y, d.z);
    Some(Alignment {
        rotation: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
        product: most + sign * least,
        mirrored_product: most - sign * least,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn correlation(turn: &UnitQuaternion<f64>, vectors: &[Vector3<f64>]) -> Matrix3<f64> {
        let products = vectors.iter().map(|from| turn * from * from.transpose());
        products.sum()
    }

    #[test]
    fn a_rotation_is_found_whatever_the_vectors_lie_in() {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        for turn in [
            UnitQuaternion::identity(),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -2.0, 1.1)),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.0, std::f64::consts::PI, 0.0)),
        ] {
            for vectors in [
                vec![x, y, z],
                vec![x, y],
                vec![x * 1e-3, y, x + y],
                vec![z * 20.0, z + y * 0.1],
            ] {
                let found = align(&correlation(&turn, &vectors)).unwrap();
                assert!(found.rotation.angle_to(&turn) < 1e-12, "{vectors:?}");
            }
        }
        assert!(align(&Matrix3::repeat(f64::NAN)).is_none());
    }
}
