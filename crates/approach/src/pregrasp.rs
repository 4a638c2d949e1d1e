//! The pregrasp: the grasp, backed off and opened.

use spatial::Object;

use crate::{ApproachConfig, HandBody, HandPose};

/// Returns the hand before a grasp: its palm backed off along its approach, its fingers opened, within the joints'
/// limits.
pub fn pregrasp(
    body: &HandBody,
    grasp: &HandPose<Object>,
    config: &ApproachConfig,
) -> HandPose<Object> {
    let mut hand = body.backed_off(grasp, config.back_off_m);
    for &joint in body.flexion() {
        let opened = hand.q_rad[joint] - config.opening_rad;
        hand.q_rad[joint] = opened.max(body.model().joints()[joint].lower);
    }
    hand
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use spatial::Pose;

    use super::*;
    use crate::fixture;

    #[test]
    fn a_pregrasp_is_behind_the_grasp_with_open_fingers_within_their_limits() {
        let body = fixture::body();
        let config = ApproachConfig {
            back_off_m: 0.05,
            opening_rad: 0.4,
            ..ApproachConfig::default()
        };
        // A quarter turn about z takes the palm's x to the object's y.
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        let mut grasp = HandPose {
            frame_from_palm: Pose::from_parts([0.1, 0.2, 0.3], turn),
            q_rad: vec![0.5; body.model().dof()],
        };
        let (near, far) = (body.flexion()[0], body.flexion()[1]);
        grasp.q_rad[near] = -0.1;
        let found = pregrasp(&body, &grasp, &config);
        let by =
            found.frame_from_palm.translation.vector - grasp.frame_from_palm.translation.vector;
        let expected = turn * *body.axes().approach_in_palm * -0.05;
        assert!((by - expected).norm() < 1e-12, "{by}");
        assert!(by.y < -0.049, "{by}");
        assert_eq!(found.q_rad[near], body.model().joints()[near].lower);
        assert!((found.q_rad[far] - 0.1).abs() < 1e-12);
        assert_eq!(found.q_rad[0], 0.5);
    }
}
