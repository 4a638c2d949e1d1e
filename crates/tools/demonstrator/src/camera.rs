//! The cameras, the table's frame in the world, and the calibration files.

use std::fmt::Write;

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use spatial::{Camera, Pose, Table, World};

/// The camera whose frame is the world; it has no labels of its own.
pub(crate) const MASTER: &str = "840412060917";
/// The camera that has labels.
pub(crate) const LABELED: &str = "836212060125";
/// Name of the calibration.
pub(crate) const CALIBRATION: &str = "20000101_090000";

/// Focal lengths and principal point of the labeled camera, in pixels.
const FX: f64 = 613.4;
const FY: f64 = 612.6;
const PPX: f64 = 318.7;
const PPY: f64 = 243.2;

/// Positions of the cameras and the point that they look at, in the table's frame, in meters.
const MASTER_AT: [f64; 3] = [0.62, -0.62, 0.78];
const LABELED_AT: [f64; 3] = [1.38, 0.05, 0.72];
const MIDDLE: [f64; 3] = [0.58, 0.30, 0.05];

/// Poses of the labeled camera and the table in the world.
pub(crate) struct CameraRig {
    pub(crate) world_from_table: Pose<World, Table>,
    pub(crate) world_from_camera: Pose<World, Camera>,
}

impl CameraRig {
    /// Returns the one rig of all recordings.
    pub(crate) fn new() -> Self {
        let world_from_table = looking(MASTER_AT).inverse();
        Self {
            world_from_table,
            world_from_camera: world_from_table * looking(LABELED_AT),
        }
    }

    /// Returns `extrinsics.yml`: rows of rotation and translation, camera to world.
    pub(crate) fn extrinsics_yaml(&self) -> String {
        let mut text = String::from("extrinsics:\n");
        let entries = [
            (format!("'{LABELED}'"), rows(&self.world_from_camera)),
            (
                format!("'{MASTER}'"),
                rows(&Pose::<World, World>::identity()),
            ),
            ("apriltag".to_owned(), rows(&self.world_from_table)),
        ];
        for (name, rows) in entries {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "  {name}:");
            for number in rows {
                let _ = writeln!(text, "  - {number:?}");
            }
        }
        let _ = writeln!(text, "master: '{MASTER}'");
        text
    }

    /// Returns the pixel of a point in the labeled camera's frame.
    pub(crate) fn pixel(point_in_camera: &Point3<f64>) -> [f64; 2] {
        let p = point_in_camera;
        [FX * p.x / p.z + PPX, FY * p.y / p.z + PPY]
    }
}

/// Returns the file in `intrinsics/`.
pub(crate) fn intrinsics_yaml() -> String {
    let block = |name: &str| {
        format!("{name}:\n  fx: {FX:?}\n  fy: {FY:?}\n  ppx: {PPX:?}\n  ppy: {PPY:?}\n")
    };
    block("color") + &block("depth")
}

/// Returns a pose as the first three rows of its matrix.
pub(crate) fn rows<To, From>(pose: &Pose<To, From>) -> [f64; 12] {
    let matrix = pose.to_homogeneous();
    // `+ 0.0` turns −0 into 0.
    std::array::from_fn(|idx| matrix[(idx / 4, idx % 4)] + 0.0)
}

/// Returns the pose in the table's frame of a camera that looks at the middle, x right, y down.
fn looking<Eye>(from: [f64; 3]) -> Pose<Table, Eye> {
    let from = Vector3::from(from);
    let ahead = (Vector3::from(MIDDLE) - from).normalize();
    let right = ahead.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, ahead.cross(&right), ahead]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Pose::from_parts(from, rotation)
}
