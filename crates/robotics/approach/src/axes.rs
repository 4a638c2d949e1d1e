//! Grasp axes of a hand: the direction that its palm faces, and the point where its fingers meet.

use nalgebra::{Point3, Unit, Vector3};
use robot::{Finger, RobotModel};
use spatial::Palm;

use crate::ApproachError;

/// Grasp axes of a hand, in the frame of its root link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandAxes {
    /// The direction in which the palm goes toward an object: across the open fingers, to the side to which they
    /// bend.
    pub approach_in_palm: Unit<Vector3<f64>>,
    /// The direction in which the open fingers point.
    pub forward_in_palm: Unit<Vector3<f64>>,
    /// The middle between the thumb's tip and the others' in a typical grasp, in meters.
    pub center_in_palm: Point3<f64>,
}

impl HandAxes {
    /// Reads the axes off the hand's tree and a typical grasp of it, whose joints are `grasp_q`.
    ///
    /// # Errors
    ///
    /// Fails if the robot has no finger beside a thumb, if its fingers do not bend, or if there is not one position
    /// per joint.
    pub fn of(model: &RobotModel, grasp_q: &[f64]) -> Result<Self, ApproachError> {
        let layout = model.hand_layout().ok_or(ApproachError::NoPalmSide)?;
        let thumb = layout.thumb.as_ref().ok_or(ApproachError::NoPalmSide)?;
        let joints = model.joints();
        let open = model.link_poses::<Palm>(|joint| joints[joint].nearest_zero());
        let closing = model.forward_kinematics::<Palm>(grasp_q)?;
        let tip = |poses: &[spatial::Pose<Palm, robot::Link>], finger: &Finger| {
            poses[finger.tip_link] * Point3::from(finger.tip_offset_m)
        };
        let n = layout.fingers.len() as f64;
        let mean = |of: &dyn Fn(&Finger) -> Vector3<f64>| {
            layout.fingers.iter().map(of).sum::<Vector3<f64>>() / n
        };
        let forward =
            mean(&|finger| tip(&open, finger).coords - open[finger.links[0]].translation.vector);
        let forward = Unit::try_new(forward, 1e-6).ok_or(ApproachError::NoPalmSide)?;
        let bending = mean(&|finger| tip(&closing, finger) - tip(&open, finger));
        let across = bending - *forward * bending.dot(&forward);
        let tips = mean(&|finger| tip(&closing, finger).coords);
        Ok(Self {
            approach_in_palm: Unit::try_new(across, 1e-6).ok_or(ApproachError::NoPalmSide)?,
            forward_in_palm: forward,
            center_in_palm: Point3::from((tips + tip(&closing, thumb).coords) / 2.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn allegro_grasps_along_x_with_fingers_along_z() {
        let axes = HandAxes::of(&fixture::hand(), &fixture::GRASP_Q).unwrap();
        assert!(
            axes.approach_in_palm.angle(&Vector3::x()) < 0.15,
            "{axes:?}"
        );
        assert!(axes.forward_in_palm.angle(&Vector3::z()) < 0.15, "{axes:?}");
        // Between thumb and fingers: in front of the palm, around the height of the knuckles.
        let center = axes.center_in_palm;
        assert!(center.x > 0.03 && center.x < 0.12, "{center}");
        assert!(center.z > 0.0 && center.z < 0.12, "{center}");
        assert!(center.y.abs() < 0.05, "{center}");
    }

    #[test]
    fn a_robot_without_fingers_is_refused() {
        let model = RobotModel::from_urdf(
            r#"<robot name="h"><link name="palm"/><link name="tip"/>
              <joint name="j" type="revolute"><parent link="palm"/><child link="tip"/>
              <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#,
        )
        .unwrap();
        assert!(matches!(
            HandAxes::of(&model, &[0.0]),
            Err(ApproachError::NoPalmSide)
        ));
    }
}
