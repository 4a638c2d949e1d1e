//! Actions: numbers from −1 to 1 that command palm and fingers for one control step.

use nalgebra::{UnitQuaternion, Vector3};
use robot::RobotModel;
use simulation::HandCommand;
use spatial::Pose;

/// Numbers that move the palm.
const PALM: usize = 6;
/// Range of a joint without limits, in radians, both ways from 0.
const FREE_RANGE_RAD: f64 = std::f64::consts::PI;

/// What the numbers of an action stand for: three speeds along the object's axes, three about them, and a position of
/// each joint.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Actions {
    /// Speed of the palm's origin for a number of 1, in m/s.
    speed_m_per_s: f64,
    /// Its angular speed, in rad/s.
    turn_rad_per_s: f64,
    /// Duration of a control step in seconds.
    control_s: f64,
    /// Middle and half of each joint's range.
    joints: Vec<[f64; 2]>,
}

impl Actions {
    /// Returns the actions of a hand.
    pub(crate) fn new(
        hand: &RobotModel,
        speed_m_per_s: f64,
        turn_rad_per_s: f64,
        control_s: f64,
    ) -> Self {
        let joints = hand.joints().iter().map(|joint| {
            let [lower, upper] = [joint.lower, joint.upper]
                .map(|limit| limit.clamp(-FREE_RANGE_RAD, FREE_RANGE_RAD));
            [0.5 * (lower + upper), 0.5 * (upper - lower)]
        });
        Self {
            speed_m_per_s,
            turn_rad_per_s,
            control_s,
            joints: joints.collect(),
        }
    }

    /// Returns how many numbers an action has.
    pub(crate) fn len(&self) -> usize {
        PALM + self.joints.len()
    }

    /// Returns the action that holds the palm where it is, and the fingers at these positions.
    pub(crate) fn holding(&self, q: &[f64]) -> Vec<f64> {
        let fingers = q.iter().zip(&self.joints);
        let fingers = fingers.map(|(q, [middle, half])| {
            if *half > 0.0 {
                ((q - middle) / half).clamp(-1.0, 1.0)
            } else {
                0.0
            }
        });
        std::iter::repeat_n(0.0, PALM).chain(fingers).collect()
    }

    /// Returns the command of an action after another command.
    pub(crate) fn command(&self, before: &HandCommand, action: &[f64]) -> HandCommand {
        let (palm, fingers) = action.split_at(PALM);
        let number = |idx: usize| palm.get(idx).copied().unwrap_or(0.0);
        let moved = Vector3::new(number(0), number(1), number(2));
        let turned = Vector3::new(number(3), number(4), number(5));
        let turn = UnitQuaternion::from_scaled_axis(turned * self.turn_rad_per_s * self.control_s);
        let at = before.object_from_palm;
        let q = fingers.iter().zip(&self.joints);
        HandCommand {
            object_from_palm: Pose::from_parts(
                at.translation.vector + moved * self.speed_m_per_s * self.control_s,
                turn * at.rotation,
            ),
            q: q.map(|(number, [middle, half])| middle + number * half)
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    const HAND: &str = r#"<robot name="h"><link name="palm"/><link name="tip"/>
        <joint name="j" type="revolute"><parent link="palm"/><child link="tip"/><axis xyz="1 0 0"/>
        <limit lower="-0.5" upper="1.5" effort="1" velocity="1"/></joint></robot>"#;

    #[test]
    fn an_action_moves_the_palm_by_its_speeds_and_sends_the_joints_within_their_limits() {
        let hand = RobotModel::from_urdf(HAND).unwrap();
        let actions = Actions::new(&hand, 1.0, 1.5, 0.02);
        assert_eq!(actions.len(), 7);
        let start = HandCommand {
            object_from_palm: Pose::new(Isometry3::new(
                Vector3::new(0.1, 0.2, 0.3),
                Vector3::new(0.0, 0.4, 0.0),
            )),
            q: vec![1.0],
        };
        let held = actions.command(&start, &actions.holding(&start.q));
        assert_eq!(held.object_from_palm, start.object_from_palm);
        assert!((held.q[0] - 1.0).abs() < 1e-12);
        let moved = actions.command(&start, &[1.0, 0.0, -0.5, 0.0, 1.0, 0.0, -1.0]);
        let place = moved.object_from_palm.translation.vector;
        assert!((place - Vector3::new(0.12, 0.2, 0.29)).norm() < 1e-12);
        let angle = moved.object_from_palm.rotation.scaled_axis();
        assert!((angle - Vector3::new(0.0, 0.43, 0.0)).norm() < 1e-12);
        assert_eq!(moved.q, [-0.5]);
    }
}
