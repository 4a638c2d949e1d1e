//! Goal of one step: target positions of the hand's points, and clearances.

use nalgebra::Point3;
use posture::{Environment, Hand, KEYPOINTS};

use crate::RetargetingConfig;

/// Goal of one step.
#[derive(Debug, Clone)]
pub(crate) struct Goal {
    /// Targets of the hand's points.
    pub(crate) points: Vec<PointGoal>,
    /// Distance that links keep from the object, in meters.
    pub(crate) clearance_m: f64,
}

/// Target of one point of the hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PointGoal {
    /// The scaled landmark in the object frame, smoothed over time if configured: the point's
    /// target.
    pub(crate) landmark: Point3<f64>,
    /// The scaled landmark as recorded, from which errors are measured.
    pub(crate) shown: Point3<f64>,
    /// Weight of the distance to it.
    pub(crate) weight: f64,
    /// Desired distance from the surface and its weight.
    pub(crate) contact: Option<ContactGoal>,
}

/// Desired distance of a fingertip from the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ContactGoal {
    /// Signed distance of its center, in meters.
    pub(crate) distance_m: f64,
    /// Weight of the difference.
    pub(crate) weight: f64,
}

/// Returns what a step asks of the hand, `to_grasp_s` seconds before the grasp: `shown_m` are the
/// landmarks as they were shown, `keypoints_m` those that are followed.
pub(crate) fn goal(
    hand: &Hand,
    environment: &Environment,
    config: &RetargetingConfig,
    shown_m: &[[f64; 3]; KEYPOINTS],
    keypoints_m: &[[f64; 3]; KEYPOINTS],
    to_grasp_s: f64,
) -> Goal {
    let clearance_m = config.clearance_m * posture::openness(to_grasp_s, config.closing_time_s);
    let place =
        |keypoints_m: &[[f64; 3]; KEYPOINTS], keypoint: usize| Point3::from(keypoints_m[keypoint]);
    let scaled = |keypoints_m: &[[f64; 3]; KEYPOINTS], keypoint: usize| {
        let wrist = place(keypoints_m, 0);
        wrist + (place(keypoints_m, keypoint) - wrist) * hand.scale
    };
    let points = hand
        .points
        .iter()
        .map(|point| {
            let keypoint = place(keypoints_m, point.keypoint);
            let mut goal = PointGoal {
                landmark: scaled(keypoints_m, point.keypoint),
                shown: scaled(shown_m, point.keypoint),
                weight: point.weight,
                contact: None,
            };
            if let Some(radius_m) = point.tip_radius_m {
                // The person's tip tells, at the person's own scale.
                let share = posture::contact_share(
                    environment.signed_distance(&keypoint).distance_m,
                    config.contact_distance_m,
                );
                if share > 0.0 {
                    if config.contact_weight > 0.0 {
                        goal.weight *= 1.0 - share * (1.0 - config.contact_position_factor);
                    }
                    goal.contact = Some(ContactGoal {
                        distance_m: radius_m + clearance_m,
                        weight: share * config.contact_weight,
                    });
                }
            }
            goal
        })
        .collect();
    Goal {
        points,
        clearance_m,
    }
}
