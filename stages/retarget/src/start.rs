//! Where to start a search: the hand laid onto the landmarks.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::{
    goal::Goal,
    hand::{Hand, Posture},
};

/// How far between its limits each joint stands in the starts tried: the paper's mid-range, an open
/// and a closed hand.
const BENDS: [f64; 3] = [0.5, 0.3, 0.7];

/// Returns postures from which to search for a step's answer when nothing is known before.
pub(crate) fn starts(hand: &Hand, goal: &Goal) -> Vec<Posture> {
    BENDS
        .iter()
        .map(|bend| {
            let q = hand
                .model
                .joints()
                .iter()
                .zip(hand.model.mid_range())
                .map(|(joint, middle)| {
                    if joint.lower.is_finite() && joint.upper.is_finite() {
                        joint.lower + bend * (joint.upper - joint.lower)
                    } else {
                        middle
                    }
                })
                .collect();
            laid_on(hand, q, goal)
        })
        .collect()
}

/// Returns the posture with these joint positions whose points lie nearest to the landmarks.
pub(crate) fn laid_on(hand: &Hand, q: Vec<f64>, goal: &Goal) -> Posture {
    let mut posture = Posture {
        object_from_palm: Isometry3::identity(),
        q,
    };
    let palm_from_links = hand.object_from_links(&posture);
    let pairs: Vec<(Point3<f64>, Point3<f64>, f64)> = hand
        .points
        .iter()
        .zip(&goal.points)
        .filter_map(|(point, goal)| {
            let point_in_palm = palm_from_links.get(point.link)? * point.point_in_link;
            Some((point_in_palm, goal.landmark, goal.weight.powi(2)))
        })
        .collect();
    posture.object_from_palm = align(&pairs);
    posture
}

/// Returns the rigid transform that takes the first points nearest to the second ones, by weight
/// (Kabsch, "A solution for the best rotation to relate two sets of vectors", 1976).
fn align(pairs: &[(Point3<f64>, Point3<f64>, f64)]) -> Isometry3<f64> {
    let total: f64 = pairs.iter().map(|(_, _, weight)| weight).sum();
    if total <= 0.0 {
        return Isometry3::identity();
    }
    let (mut from_mean, mut to_mean) = (Vector3::zeros(), Vector3::zeros());
    for (from, to, weight) in pairs {
        from_mean += from.coords * (weight / total);
        to_mean += to.coords * (weight / total);
    }
    let mut covariance = Matrix3::zeros();
    for (from, to, weight) in pairs {
        covariance += (to.coords - to_mean) * (from.coords - from_mean).transpose() * *weight;
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Isometry3::translation(0.0, 0.0, 0.0);
    };
    // A mirror image is not a rotation: turn the least certain direction around.
    let sign = (u * v_t).determinant().signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Isometry3::from_parts(Translation3::from(to_mean - rotation * from_mean), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_finds_the_transform_of_moved_points() {
        let moved = Isometry3::new(Vector3::new(0.3, -0.2, 0.1), Vector3::new(1.0, 2.0, -1.5));
        let pairs: Vec<_> = [
            [0.1, 0.0, 0.0],
            [0.0, 0.1, 0.02],
            [0.0, 0.0, 0.1],
            [0.05, 0.05, 0.0],
        ]
        .into_iter()
        .map(|p| (Point3::from(p), moved * Point3::from(p), 0.3))
        .collect();
        let found = align(&pairs);
        assert!((found.translation.vector - moved.translation.vector).norm() < 1e-12);
        assert!(found.rotation.angle_to(&moved.rotation) < 1e-9);
    }
}
