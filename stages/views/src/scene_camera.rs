//! The camera of an image: an entry of `scene_camera.json`.

use depth_view::Intrinsics;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::Value;
use spatial::{Camera, Pose, World};

use crate::error::Fault;

/// Largest skew that rounding leaves, in pixels.
const SKEW_PX: f64 = 1e-3;
/// Range of a focal length, in longer sides of the image: from 157 degrees of view to half a degree.
const FOCAL_SIDES: [f64; 2] = [0.1, 100.0];
/// A principal point is that of a turned image if it is farther from the middle than this along both sides, and as near
/// to it as that after the turn, as shares of a side.
const OFF_MIDDLE: f64 = 0.1;
const IN_MIDDLE: f64 = 0.02;
/// Largest error of a number that is written as 0 or 1.
const ROUNDED: f64 = 1e-6;
/// What fields are, for hints.
const MATRIX: &str = "give nine numbers row by row, in pixels: fx, 0, cx, 0, fy, cy, 0, 0, 1";
const SCALE: &str = "give the millimeters of the depth image's 1, e.g. 0.1 or 1.0";
const ROTATION: &str = "give nine numbers row by row, of rows of length 1 at right angles";
const OFFSET: &str = "give three numbers in millimeters";
/// Largest difference of a rotation's rows from being orthogonal and of unit length.
const ORTHOGONAL: f64 = 1e-3;

/// What an entry says of an image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SceneCamera {
    /// The matrix of intrinsics, row by row, in pixels.
    matrix: [f64; 9],
    /// Meters that the depth image's 1 stands for.
    pub(crate) depth_step_m: f64,
    /// Pose of the camera; `None` if the entry has none.
    pub(crate) world_from_camera: Option<Pose<World, Camera>>,
}

impl SceneCamera {
    /// Reads an entry.
    pub(crate) fn parse(entry: &Value) -> Result<Self, Fault> {
        let missing = |field: &str, hint| Fault::new(format!("`{field}` is missing"), hint);
        let matrix = numbers(entry, "cam_K", MATRIX)?;
        let scale = entry.get("depth_scale");
        let scale = scale.ok_or_else(|| missing("depth_scale", SCALE))?;
        let scale_mm = scale.as_f64().filter(|scale| (1e-9..1e9).contains(scale));
        let scale_mm = scale_mm.ok_or_else(|| {
            let scale = quoted(scale);
            let problem = format!("`depth_scale` is {scale}, expected a positive number");
            Fault::new(problem, SCALE)
        })?;
        Ok(Self {
            matrix: matrix.ok_or_else(|| missing("cam_K", MATRIX))?,
            depth_step_m: 1e-3 * scale_mm,
            world_from_camera: parse_pose(entry)?,
        })
    }

    /// Returns the intrinsics in an image of this many columns and rows.
    pub(crate) fn intrinsics(&self, size: [usize; 2]) -> Result<Intrinsics, Fault> {
        pinhole(&self.matrix, size, "cam_K")
    }
}

/// Returns the intrinsics in an image of this many columns and rows, from their matrix row by row; `key` is what it is
/// called.
pub(crate) fn pinhole(
    matrix: &[f64; 9],
    [width, height]: [usize; 2],
    key: &str,
) -> Result<Intrinsics, Fault> {
    let [fx, skew, cx, below, fy, cy, x, y, one] = *matrix;
    let largest = |numbers: &[f64]| numbers.iter().fold(0.0, |a, b| b.abs().max(a));
    if largest(&[below, x, y, one - 1.0]) > ROUNDED || skew.abs() > SKEW_PX {
        let problem = format!(
            "`{key}` is that of no rectified image: its skew is {skew} px, and 0, 0, 0, 1 are \
                 {below}, {x}, {y}, {one}"
        );
        return Err(Fault::new(problem, MATRIX));
    }
    let longest = width.max(height) as f64;
    let [least, most] = FOCAL_SIDES.map(|sides| sides * longest);
    let is_focal = |focal: &&f64| (least..=most).contains(*focal);
    if let Some(focal) = [fx, fy].iter().find(|focal| !is_focal(focal)) {
        return Err(Fault::new(
            format!("a focal length is {focal} px, expected {least} to {most} px"),
            "give it in pixels of this image, not in millimeters",
        ));
    }
    let sides = [width, height].map(|side| side as f64);
    let is_inside = |at: f64, side: f64| (-0.5..=side - 0.5).contains(&at);
    if !(is_inside(cx, sides[0]) && is_inside(cy, sides[1])) {
        return Err(Fault::new(
            format!(
                "the principal point ({cx}, {cy}) is outside of the image of {width} by {height} pixels"
            ),
            format!("give the `{key}` of an image of this size"),
        ));
    }
    let off = |at: f64, side: f64| (at / side - 0.5).abs();
    if off(cx, sides[0]).min(off(cy, sides[1])) > OFF_MIDDLE
        && off(cy, sides[0]).max(off(cx, sides[1])) < IN_MIDDLE
    {
        return Err(Fault::new(
            format!("the principal point ({cx}, {cy}) is that of an image turned by a quarter"),
            format!("turn `{key}` with the image: fx with fy, and cx with cy"),
        ));
    }
    Ok(Intrinsics {
        width,
        height,
        focal: [fx, fy],
        center: [cx, cy],
    })
}

/// Says whether an entry has a camera's pose, right or wrong.
pub(crate) fn has_pose(entry: &Value) -> bool {
    entry.get("cam_R_w2c").is_some() || entry.get("cam_t_w2c").is_some()
}

fn parse_pose(entry: &Value) -> Result<Option<Pose<World, Camera>>, Fault> {
    let rotation: Option<[f64; 9]> = numbers(entry, "cam_R_w2c", ROTATION)?;
    let offset_mm: Option<[f64; 3]> = numbers(entry, "cam_t_w2c", OFFSET)?;
    let (rotation, offset_mm) = match (rotation, offset_mm) {
        (None, None) => return Ok(None),
        (Some(rotation), Some(offset_mm)) => (rotation, offset_mm),
        _ => {
            return Err(Fault::new(
                "`cam_R_w2c` or `cam_t_w2c` is missing",
                "give both, or neither",
            ));
        }
    };
    let matrix = Matrix3::from_row_slice(&rotation);
    let off = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if off > ORTHOGONAL {
        let problem = format!("`cam_R_w2c` is no rotation: its rows are off by {off:.4}");
        return Err(Fault::new(problem, ROTATION));
    }
    if matrix.determinant() < 0.0 {
        return Err(Fault::new(
            "`cam_R_w2c` is a reflection: its determinant is −1",
            "use right-handed frames: x right, y down, z forward of a camera",
        ));
    }
    // The nearest rotation to nine rounded numbers.
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&matrix));
    let camera_from_world: Pose<Camera, World> =
        Pose::from_parts(Vector3::from(offset_mm) * 1e-3, rotation);
    Ok(Some(camera_from_world.inverse()))
}

/// Returns the numbers of a field; `None` if there is no such field.
fn numbers<const N: usize>(
    entry: &Value,
    field: &str,
    hint: &str,
) -> Result<Option<[f64; N]>, Fault> {
    let Some(value) = entry.get(field) else {
        return Ok(None);
    };
    let list = value.as_array().map(|list| list.iter().map(Value::as_f64));
    let numbers: Option<Vec<f64>> = list.and_then(Iterator::collect);
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.map(Some).ok_or_else(|| {
        let problem = format!("`{field}` is {}, expected {N} numbers", quoted(value));
        Fault::new(problem, hint)
    })
}

/// Returns the start of a value's text.
fn quoted(value: &Value) -> String {
    let text = value.to_string();
    let start: String = text.chars().take(60).collect();
    if start.len() < text.len() {
        start + "…"
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn entry() -> Value {
        json!({
            "cam_K": [600.0, 0.0, 319.5, 0.0, 610.0, 239.5, 0.0, 0.0, 1.0],
            "depth_scale": 0.1,
            "cam_R_w2c": [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            "cam_t_w2c": [0.0, 0.0, 500.0],
        })
    }

    #[test]
    fn an_entry_is_read_in_meters() {
        let camera = SceneCamera::parse(&entry()).unwrap();
        assert_eq!(camera.depth_step_m, 1e-4);
        let pose = camera.world_from_camera.unwrap();
        let camera_in_world = pose.translation.vector;
        assert!((camera_in_world - Vector3::new(0.0, 0.0, -0.5)).norm() < 1e-12);
        // The camera's x is the world's −y: cam_R_w2c has what the world's axes are in the camera.
        assert!((pose.rotation * Vector3::x() + Vector3::y()).norm() < 1e-12);
        let intrinsics = camera.intrinsics([640, 480]).unwrap();
        assert_eq!(intrinsics.focal, [600.0, 610.0]);
        assert_eq!(intrinsics.center, [319.5, 239.5]);
        let mut bare = entry();
        let fields = bare.as_object_mut().unwrap();
        fields.retain(|field, _| !field.ends_with("w2c"));
        let camera = SceneCamera::parse(&bare).unwrap();
        assert_eq!((camera.world_from_camera, has_pose(&bare)), (None, false));
    }

    #[test]
    fn says_what_is_wrong_with_other_entries() {
        for (field, value, expected) in [
            ("cam_K", json!(null), "`cam_K` is null, expected 9 numbers"),
            (
                "cam_K",
                json!([[600, 0, 320], [0, 600, 240], [0, 0, 1]]),
                "expected 9 numbers",
            ),
            (
                "cam_K",
                json!([600, 600, 320, 240]),
                "expected 9 numbers; give nine",
            ),
            (
                "cam_K",
                json!([0, 0, 320, 0, 600, 240, 0, 0, 1]),
                "focal length is 0 px",
            ),
            (
                "cam_K",
                json!([600, 0, 320, 0, -600, 240, 0, 0, 1]),
                "focal length is -600 px",
            ),
            (
                "cam_K",
                json!([4.2, 0, 320, 0, 4.2, 240, 0, 0, 1]),
                "expected 64 to 64000 px; give it in pixels",
            ),
            (
                "cam_K",
                json!([600, 0.5, 320, 0, 600, 240, 0, 0, 1]),
                "its skew is 0.5 px",
            ),
            (
                "cam_K",
                json!([600, 0, 0, 0, 600, 0, 320, 240, 1]),
                "skew is 0 px, and 0, 0, 0, 1 are 0, 320, 240, 1; give nine numbers row by row",
            ),
            (
                "cam_K",
                json!([600, 0, 320, 5, 600, 240, 0, 0, 1]),
                "that of no rectified image",
            ),
            (
                "cam_K",
                json!([600, 0, 320, 0, 600, 240, 0, 0, 0]),
                "that of no rectified image",
            ),
            (
                "cam_K",
                json!([600, 0, 960, 0, 600, 540, 0, 0, 1]),
                "(960, 540) is outside",
            ),
            (
                "cam_K",
                json!([600, 0, 240, 0, 600, 320, 0, 0, 1]),
                "turned by a quarter",
            ),
            (
                "depth_scale",
                json!("1.0"),
                "`depth_scale` is \"1.0\", expected",
            ),
            (
                "depth_scale",
                json!(0),
                "`depth_scale` is 0, expected a positive",
            ),
            (
                "depth_scale",
                json!(-1.0),
                "expected a positive number; give the millimeters",
            ),
            (
                "cam_R_w2c",
                json!([1, 0, 0, 0, 1, 0, 0, 0, -1]),
                "reflection",
            ),
            (
                "cam_R_w2c",
                json!([1, 0, 0, 0, 1, 0, 0, 0, 1.1]),
                "is no rotation",
            ),
            (
                "cam_R_w2c",
                json!([0, 0, 0, 0, 0, 0, 0, 0, 0]),
                "is no rotation",
            ),
            (
                "cam_R_w2c",
                json!([0, 0, 0, 1]),
                "`cam_R_w2c` is [0,0,0,1], expected 9",
            ),
            ("cam_t_w2c", json!("0 0 500"), "`cam_t_w2c` is"),
            ("cam_t_w2c", json!([0, 0, null]), "expected 3 numbers"),
        ] {
            let mut entry = entry();
            entry[field] = value;
            let camera = SceneCamera::parse(&entry);
            let said = camera.and_then(|camera| camera.intrinsics([640, 480]));
            let said = said.unwrap_err().reason();
            assert!(said.contains(expected), "{expected}: {said}");
        }
        for (field, expected) in [
            ("cam_K", "`cam_K` is missing"),
            ("depth_scale", "`depth_scale` is missing"),
            ("cam_R_w2c", "`cam_R_w2c` or"),
            ("cam_t_w2c", "`cam_t_w2c` is missing"),
        ] {
            let mut entry = entry();
            entry.as_object_mut().unwrap().remove(field);
            let said = SceneCamera::parse(&entry).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
        assert!(SceneCamera::parse(&json!([1, 2])).is_err());
    }
}
