//! Messages built from the parts of a motion: joints, link poses, meshes, landmarks.
//!
//! The frames of a recording form one tree, named by [`TABLE`], [`OBJECT`] and the hand's links:
//! `table` holds `object` and the hand's root link; every other link hangs below its parent link,
//! as in the URDF. A motion's first step has the stamp [`START_NS`].

mod contacts;
mod scene;

pub use contacts::{
    CONTACT_FORCES, CONTACTS, ContactForce, METERS_PER_NEWTON, contact_forces, contact_markers,
};
pub use scene::{RecordingScene, SceneStep, fixed_links, moving_links};

use nalgebra::Point3;

use super::{
    ColorRgba, Duration, Header, JointState, JointTrajectory, JointTrajectoryPoint, Marker,
    MarkerArray, Point, Pose, PoseStamped, Quaternion, Text, Time, Transform, TransformStamped,
    Vector3,
};

/// Stamp of a motion's first step: one second, because viewers take a stamp of zero for "unknown".
pub const START_NS: i64 = NS_PER_S;

/// Frame of the table: z up, z = 0 its surface.
pub const TABLE: &str = "table";
/// Frame of the object: its mesh's own.
pub const OBJECT: &str = "object";

/// Topic of the measured or planned [`joint_state`].
pub const JOINT_STATES: &str = "/joint_states";
/// Topic of the [`joint_state`] that was commanded at the times of the measured one.
pub const JOINT_COMMANDS: &str = "/joint_commands";
/// Topic of the commanded [`joint_trajectory`].
pub const JOINT_TRAJECTORY: &str = "/joint_trajectory";
/// Topic of the commanded [`joint_trajectory`] of the arm that carries the hand.
pub const ARM_TRAJECTORY: &str = "/arm_trajectory";
/// Topic of the poses that change.
pub const TF: &str = "/tf";
/// Topic of the poses that do not.
pub const TF_STATIC: &str = "/tf_static";
/// Topic of the robot's URDF.
pub const ROBOT_DESCRIPTION: &str = "/robot_description";
/// Topic of shapes to draw.
pub const MARKERS: &str = "/markers";
/// Topic of the palm's pose at the grasp, in the object frame.
pub const GRASP_POSE: &str = "/grasp_pose";

const NS_PER_S: i64 = 1_000_000_000;

/// Color of the grasped object.
pub const OBJECT_COLOR: ColorRgba = color(0.85, 0.65, 0.35);
/// Color of a person's landmarks.
pub const LANDMARK_COLOR: ColorRgba = color(0.25, 0.55, 0.95);

const fn color(r: f32, g: f32, b: f32) -> ColorRgba {
    ColorRgba { r, g, b, a: 1.0 }
}

/// Returns the stamp of a moment `time_s` seconds after a motion's first step, in nanoseconds,
/// rounded to the nearest.
#[expect(
    clippy::cast_possible_truncation,
    reason = "motions last seconds; rounding a time beyond 292 years saturates"
)]
pub fn stamp_ns(time_s: f64) -> i64 {
    START_NS + (time_s * 1e9).round() as i64
}

/// Returns nanoseconds as whole seconds and the rest.
fn split(time_ns: i64) -> (i32, u32) {
    let seconds = i32::try_from(time_ns.div_euclid(NS_PER_S)).unwrap_or(i32::MAX);
    let rest = u32::try_from(time_ns.rem_euclid(NS_PER_S)).unwrap_or(0);
    (seconds, rest)
}

/// Returns a header of `frame` at `time_ns`.
pub fn header(time_ns: i64, frame: &str) -> Header {
    let (sec, nanosec) = split(time_ns);
    Header {
        stamp: Time { sec, nanosec },
        frame_id: frame.to_owned(),
    }
}

/// Returns joint positions, in radians, and velocities, in rad/s or empty if unknown, for
/// [`JOINT_STATES`].
pub fn joint_state(
    time_ns: i64,
    joints: &[String],
    q_rad: &[f64],
    q_velocity_rad_per_s: &[f64],
) -> JointState {
    JointState {
        header: header(time_ns, ""),
        name: joints.to_vec(),
        position: q_rad.to_vec(),
        velocity: q_velocity_rad_per_s.to_vec(),
        ..JointState::default()
    }
}

/// A joint command at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint<'a> {
    /// Seconds since the start.
    pub time_s: f64,
    /// Positions in radians.
    pub q_rad: &'a [f64],
    /// Velocities in rad/s, or empty if not commanded.
    pub velocity_rad_per_s: &'a [f64],
    /// Accelerations in rad/s², or empty if not commanded.
    pub acceleration_rad_per_s2: &'a [f64],
}

impl<'a> TrajectoryPoint<'a> {
    /// Returns a command with positions only.
    pub fn positions(time_s: f64, q_rad: &'a [f64]) -> Self {
        Self {
            time_s,
            q_rad,
            velocity_rad_per_s: &[],
            acceleration_rad_per_s2: &[],
        }
    }
}

/// Returns commands for joints, for [`JOINT_TRAJECTORY`].
pub fn joint_trajectory<'a>(
    time_ns: i64,
    joints: &[String],
    points: impl IntoIterator<Item = TrajectoryPoint<'a>>,
) -> JointTrajectory {
    JointTrajectory {
        header: header(time_ns, ""),
        joint_names: joints.to_vec(),
        points: points
            .into_iter()
            .map(|point| {
                let (sec, nanosec) = split(stamp_ns(point.time_s) - START_NS);
                JointTrajectoryPoint {
                    positions: point.q_rad.to_vec(),
                    velocities: point.velocity_rad_per_s.to_vec(),
                    accelerations: point.acceleration_rad_per_s2.to_vec(),
                    time_from_start: Duration { sec, nanosec },
                    ..JointTrajectoryPoint::default()
                }
            })
            .collect(),
    }
}

/// Returns a robot's URDF, for [`ROBOT_DESCRIPTION`].
pub fn robot_description(urdf: &str) -> Text {
    Text {
        data: urdf.to_owned(),
    }
}

/// Returns the pose of frame `child` in frame `parent`.
pub fn transform_stamped<Parent, Child>(
    time_ns: i64,
    parent: &str,
    child: &str,
    parent_from_child: &spatial::Pose<Parent, Child>,
) -> TransformStamped {
    let Pose {
        position,
        orientation,
    } = pose(parent_from_child);
    TransformStamped {
        header: header(time_ns, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: Vector3 {
                x: position.x,
                y: position.y,
                z: position.z,
            },
            rotation: orientation,
        },
    }
}

/// Returns a pose in the frame `frame`.
pub fn pose_stamped<Frame, Other>(
    time_ns: i64,
    frame: &str,
    frame_from_other: &spatial::Pose<Frame, Other>,
) -> PoseStamped {
    PoseStamped {
        header: header(time_ns, frame),
        pose: pose(frame_from_other),
    }
}

/// Returns a pose as ROS writes it, with `w ≥ 0`.
pub fn pose<To, From>(to_from_from: &spatial::Pose<To, From>) -> Pose {
    let t = to_from_from.translation.vector;
    let [x, y, z, w] = spatial::xyzw(&to_from_from.rotation);
    Pose {
        position: Point {
            x: t.x,
            y: t.y,
            z: t.z,
        },
        orientation: Quaternion { x, y, z, w },
    }
}

/// Returns a mesh to draw in `frame`, in meters, for [`MARKERS`]. Triangles with an invalid vertex
/// index are left out.
pub fn mesh_marker(
    time_ns: i64,
    frame: &str,
    vertices_m: &[[f64; 3]],
    triangles: &[[u32; 3]],
    color: ColorRgba,
) -> Marker {
    let corner = |idx: u32| {
        vertices_m
            .get(idx as usize)
            .map(|&[x, y, z]| Point { x, y, z })
    };
    Marker {
        r#type: Marker::TRIANGLE_LIST,
        scale: Vector3 {
            x: 1.0,
            y: 1.0,
            z: 1.0,
        },
        points: triangles
            .iter()
            .filter_map(|&[a, b, c]| Some([corner(a)?, corner(b)?, corner(c)?]))
            .flatten()
            .collect(),
        ..marker(time_ns, frame, "mesh", color)
    }
}

/// Returns points to draw as spheres of `diameter_m` in `frame`, in meters, for [`MARKERS`]; `name`
/// distinguishes several sets in one frame, e.g. `landmarks` and `contacts`.
pub fn points_marker(
    time_ns: i64,
    frame: &str,
    name: &str,
    points_m: &[Point3<f64>],
    diameter_m: f64,
    color: ColorRgba,
) -> Marker {
    Marker {
        r#type: Marker::SPHERE_LIST,
        scale: Vector3 {
            x: diameter_m,
            y: diameter_m,
            z: diameter_m,
        },
        points: points_m
            .iter()
            .map(|p| Point {
                x: p.x,
                y: p.y,
                z: p.z,
            })
            .collect(),
        ..marker(time_ns, frame, name, color)
    }
}

/// Returns markers as one message.
pub fn markers(markers: impl IntoIterator<Item = Marker>) -> MarkerArray {
    MarkerArray {
        markers: markers.into_iter().collect(),
    }
}

fn marker(time_ns: i64, frame: &str, name: &str, color: ColorRgba) -> Marker {
    Marker {
        header: header(time_ns, frame),
        ns: name.to_owned(),
        color,
        frame_locked: true,
        ..Marker::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_begin_at_one_second_and_round_to_nanoseconds() {
        assert_eq!(stamp_ns(0.0), 1_000_000_000);
        let stamp = header(stamp_ns(2.5 + 1.4e-9), "").stamp;
        assert_eq!(
            stamp,
            Time {
                sec: 3,
                nanosec: 500_000_001
            }
        );
    }
}
