//! The pregrasp: the grasp, backed off and opened.

use motion::HandState;
use posture::Environment;
use spatial::Object;

use crate::{ApproachConfig, ApproachError, HandBody};

/// Shares of the opening that are tried, the widest first.
const OPENINGS: [f64; 5] = [1.0, 0.75, 0.5, 0.25, 0.0];
/// Shares of the way back that are tried, the farthest first.
const WAYS_BACK: [f64; 4] = [1.0, 0.5, 0.25, 0.0];

/// Returns the hand before a grasp: its palm backed off along its approach, its fingers opened, within the joints'
/// limits. Where it would be in the object or the table, its fingers open less, and then its palm backs off less; the
/// least deep if none is clear.
///
/// # Errors
///
/// Fails if there is not one position per joint.
pub fn pregrasp(
    body: &HandBody,
    environment: &Environment,
    grasp: &HandState<Object>,
    config: &ApproachConfig,
) -> Result<HandState<Object>, ApproachError> {
    let mut best: Option<(HandState<Object>, f64)> = None;
    for (back, share) in WAYS_BACK
        .iter()
        .flat_map(|back| OPENINGS.map(|share| (back, share)))
    {
        let mut hand = body.backed_off(grasp, back * config.back_off_m);
        for &joint in body.flexion() {
            let opened = hand.q_rad[joint] - share * config.opening_rad;
            let limits = &body.model().joints()[joint];
            hand.q_rad[joint] = opened.max(limits.lower.min(hand.q_rad[joint]));
        }
        let depth_m = body.clearance(environment, &hand)?.depth_m();
        if depth_m <= 0.0 {
            return Ok(hand);
        }
        if best.as_ref().is_none_or(|(_, least_m)| depth_m < *least_m) {
            best = Some((hand, depth_m));
        }
    }
    Ok(best.map_or_else(|| grasp.clone(), |(hand, _)| hand))
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
        let mut grasp = HandState {
            frame_from_palm: Pose::from_parts([0.1, 0.4, 0.3], turn),
            q_rad: vec![0.5; body.model().dof()],
        };
        let (near, far) = (body.flexion()[0], body.flexion()[1]);
        grasp.q_rad[near] = -0.1;
        let found = pregrasp(&body, &fixture::environment(), &grasp, &config).unwrap();
        let by =
            found.frame_from_palm.translation.vector - grasp.frame_from_palm.translation.vector;
        let expected = turn * *body.axes().approach_in_palm * -0.05;
        assert!((by - expected).norm() < 1e-12, "{by}");
        assert!(by.y < -0.049, "{by}");
        assert_eq!(found.q_rad[near], body.model().joints()[near].lower);
        assert!((found.q_rad[far] - 0.1).abs() < 1e-12);
        assert_eq!(found.q_rad[0], 0.5);
    }
    #[test]
    fn fingers_that_would_open_into_the_table_open_less() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let config = ApproachConfig {
            back_off_m: 0.0,
            opening_rad: 1.0,
            ..ApproachConfig::default()
        };
        // The palm looks along x, its fingers bent from downward to forward, just above the table beside the box.
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let mut grasp = HandState {
            frame_from_palm: Pose::from_parts([-0.4, 0.0, 0.4], down),
            q_rad: body.open(),
        };
        for &joint in body.flexion() {
            grasp.q_rad[joint] = 0.9;
        }
        let height_m = body.clearance(&environment, &grasp).unwrap().table_m;
        let lower = Vector3::new(0.0, 0.0, 0.002 - height_m);
        grasp.frame_from_palm = grasp.frame_from_palm.translated(&lower);
        let found = pregrasp(&body, &environment, &grasp, &config).unwrap();
        assert!(body.clearance(&environment, &found).unwrap().least_m() >= 0.0);
        let opened = grasp.q_rad[body.flexion()[0]] - found.q_rad[body.flexion()[0]];
        assert!(opened < 0.99, "{opened}");
    }
    #[test]
    fn a_palm_that_would_back_off_into_the_table_backs_off_less() {
        let (body, environment) = (fixture::body(), fixture::environment());
        let config = ApproachConfig {
            back_off_m: 0.1,
            ..ApproachConfig::default()
        };
        // The palm looks up, far from the box, 4 cm above the table.
        let up = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2);
        let mut grasp = HandState {
            frame_from_palm: Pose::from_parts([-0.5, 0.0, 0.3], up),
            q_rad: body.open(),
        };
        let height_m = body.clearance(&environment, &grasp).unwrap().table_m;
        let lower = Vector3::new(0.0, 0.0, 0.04 - height_m);
        grasp.frame_from_palm = grasp.frame_from_palm.translated(&lower);
        let found = pregrasp(&body, &environment, &grasp, &config).unwrap();
        assert!(body.clearance(&environment, &found).unwrap().least_m() >= 0.0);
        let gone =
            grasp.frame_from_palm.translation.vector - found.frame_from_palm.translation.vector;
        assert!((gone.norm() - 0.025).abs() < 1e-9, "{gone}");
    }
}
