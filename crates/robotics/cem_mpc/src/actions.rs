//! Actions: numbers from −1 to 1 that command palm and fingers for one control step.

use motion::HandState;
use nalgebra::{UnitQuaternion, Vector3};
use robot::RobotModel;
use spatial::{Object, Pose};

/// Numbers that move the palm.
const PALM: usize = 6;

/// Greatest speeds of a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Speeds {
    /// That of the palm's origin along each axis, in m/s.
    pub palm: f64,
    /// That of the palm about each axis, in rad/s.
    pub turn: f64,
    /// That of a joint, in rad/s (m/s if prismatic).
    pub joint: f64,
}

/// Meaning of an action's numbers: the speed of the palm along each of the object's axes and about it, and that of each
/// joint's command.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Actions {
    /// Speed of the palm's origin for a number of 1, in m/s.
    speed_m_per_s: f64,
    /// Its angular speed, in rad/s.
    turn_rad_per_s: f64,
    /// Speed of a joint's command, in rad/s (m/s if prismatic).
    joint_per_s: f64,
    /// Duration of a control step in seconds.
    control_s: f64,
    /// Least and greatest position of each joint.
    joints: Vec<[f64; 2]>,
}

impl Actions {
    /// Returns the actions of a hand whose numbers stand for these speeds.
    pub(crate) fn new(hand: &RobotModel, speeds: &Speeds, control_s: f64) -> Self {
        let joints = hand.joints().iter();
        Self {
            speed_m_per_s: speeds.palm,
            turn_rad_per_s: speeds.turn,
            joint_per_s: speeds.joint,
            control_s,
            joints: joints.map(|joint| [joint.lower, joint.upper]).collect(),
        }
    }

    /// Returns the length of an action.
    pub(crate) fn len(&self) -> usize {
        PALM + self.joints.len()
    }

    /// Returns the command of an action after another command.
    pub(crate) fn command(&self, before: &HandState<Object>, action: &[f64]) -> HandState<Object> {
        let (palm, fingers) = action.split_at(PALM);
        let number = |idx: usize| palm.get(idx).copied().unwrap_or(0.0);
        let moved = Vector3::new(number(0), number(1), number(2));
        let turned = Vector3::new(number(3), number(4), number(5));
        let turn = UnitQuaternion::from_scaled_axis(turned * self.turn_rad_per_s * self.control_s);
        let at = before.frame_from_palm;
        let step = self.joint_per_s * self.control_s;
        let q = before.q_rad.iter().zip(fingers).zip(&self.joints);
        HandState {
            frame_from_palm: Pose::from_parts(
                at.translation.vector + moved * self.speed_m_per_s * self.control_s,
                turn * at.rotation,
            ),
            q_rad: q
                .map(|((q, number), [lower, upper])| (q + number * step).max(*lower).min(*upper))
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
    fn an_action_moves_palm_and_joints_by_its_speeds_and_no_joint_beyond_its_limits() {
        let hand = RobotModel::from_urdf(HAND).unwrap();
        let speeds = Speeds {
            palm: 1.0,
            turn: 1.5,
            joint: 5.0,
        };
        let actions = Actions::new(&hand, &speeds, 0.02);
        assert_eq!(actions.len(), 7);
        let start = HandState {
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(0.1, 0.2, 0.3),
                Vector3::new(0.0, 0.4, 0.0),
            )),
            q_rad: vec![1.0],
        };
        let held = actions.command(&start, &[0.0; 7]);
        assert_eq!(held, start);
        let moved = actions.command(&start, &[1.0, 0.0, -0.5, 0.0, 1.0, 0.0, -1.0]);
        let place = moved.frame_from_palm.translation.vector;
        assert!((place - Vector3::new(0.12, 0.2, 0.29)).norm() < 1e-12);
        let angle = moved.frame_from_palm.rotation.scaled_axis();
        assert!((angle - Vector3::new(0.0, 0.43, 0.0)).norm() < 1e-12);
        assert!((moved.q_rad[0] - 0.9).abs() < 1e-12);
        let mut closed = start;
        for _ in 0..8 {
            closed = actions.command(&closed, &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        }
        assert_eq!(closed.q_rad, [1.5]);
    }
}
