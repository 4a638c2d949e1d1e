//! Quality of a grasp: its resistance to any wrench.

use approach::{ContactModel, Touch};
use nalgebra::{Point3, Vector6};

use crate::hull::ball_radius;

/// Edges of a contact's linearized friction cone, `GraspIt`'s number.
const EDGES: usize = 8;

/// Returns the largest wrench in the worst direction that touching links withstand, relative to the sum of their normal
/// forces: the radius of the ball within the hull of the wrenches of unit forces along the edges of the friction cones,
/// torques about a center divided by a length (the L1 quality of Ferrari and Canny, 1992). 0 without force closure.
pub(crate) fn epsilon(
    touches: &[Touch],
    center: &Point3<f64>,
    length_m: f64,
    friction: f64,
) -> f64 {
    let contact_model = ContactModel {
        center_in_object: *center,
        length_m,
        friction,
        edges: EDGES,
    };
    let wrenches = touches.iter().flat_map(|touch| {
        let normal = &touch.normal_in_object;
        contact_model.wrenches(&touch.point_in_object, normal, normal)
    });
    let wrenches: Vec<Vector6<f64>> = wrenches.collect();
    ball_radius(&wrenches).map_or(0.0, |radius| radius.max(0.0))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn touch(at: [f64; 3], normal: [f64; 3]) -> Touch {
        Touch {
            link: 0,
            point_in_object: Point3::from(at),
            normal_in_object: Vector3::from(normal),
            gap_m: 0.0,
        }
    }

    /// Three contacts about a ring of radius r, its length: the forces across the ring come from friction alone.
    #[test]
    fn three_contacts_about_a_ring_are_force_closure_and_two_are_not() {
        let r = 0.05;
        let ring: Vec<Touch> = (0..3)
            .map(|k| {
                let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / 3.0).sin_cos();
                touch([r * cosine, r * sine, 0.0], [cosine, sine, 0.0])
            })
            .collect();
        let check = |friction: f64| epsilon(&ring, &Point3::origin(), r, friction);
        let [slippery, rough] = [0.2, 0.8].map(check);
        assert!(
            slippery > 0.01 && rough > 2.0 * slippery,
            "{slippery} {rough}"
        );
        // Along z no more than the friction of all three, which is μ per unit of normal force.
        assert!(slippery <= 0.2 + 1e-6);
        // Two points cannot resist a torque about the line between them.
        let two = [
            touch([r, 0.0, 0.0], [1.0, 0.0, 0.0]),
            touch([-r, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ];
        let found = epsilon(&two, &Point3::origin(), r, 0.8);
        assert!(found < 1e-5, "{found}");
        // All from one side hold nothing.
        let above: Vec<Touch> = [[r, 0.0, 0.0], [0.0, r, 0.0], [-r, -r, 0.0]]
            .into_iter()
            .map(|at| touch(at, [0.0, 0.0, 1.0]))
            .collect();
        assert!(epsilon(&above, &Point3::origin(), r, 0.8) <= 0.0);
        assert!(epsilon(&[], &Point3::origin(), r, 0.8) <= 0.0);
    }

    /// Six contacts in the middles of a cube's faces. A pure torque t, over r, is withstood by the contact at face k
    /// with
    /// μ times the part of t across k: in the worst direction, (1, 1, 1) / √3, each with μ √(2/3), along an edge of
    /// the eight.
    #[test]
    fn a_cube_held_from_six_sides_is_limited_by_its_friction() {
        let r = 0.05;
        let mut six = Vec::new();
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                six.push(touch(normal.map(|x| x * r), normal));
            }
        }
        for friction in [0.1, 0.2] {
            let found = epsilon(&six, &Point3::origin(), r, friction);
            let expected = friction * (2.0_f64 / 3.0).sqrt();
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
    }
}
