//! Options of `kind = "views"`.

use std::path::PathBuf;

use depth_view::TablePlane;
use nalgebra::{Point3, UnitVector3, Vector3};
use options::{OptionFaults, above, options};

/// Largest difference of a direction's length from 1.
const UNIT_TOLERANCE: f64 = 1e-3;
/// Longest unit of a cloud, in meters.
const MAX_UNIT_M: f64 = 1000.0;

/// Options of `kind = "views"`.
#[options(also = Self::other_faults)]
pub struct ViewsConfig {
    /// Folder of a scene in BOP layout, with `scene_camera.json` and `depth`; or a cloud of points, `.ply` or `.npy`; or a
    /// recording of a depth camera in ROS 2, `.mcap` or the folder of rosbag2 with one
    #[option(path)]
    pub path: PathBuf,
    /// Name of the object where the files have none, which are a cloud, a recording, and a scene without masks or
    /// `scene_gt.json`; without it, the name of the file or folder
    #[option(default)]
    pub name: Option<String>,
    /// Numbers of the images that are read, in a recording counted from 0 in the order of time; empty: all of a scene, the
    /// first of a recording
    #[option(default)]
    pub images: Vec<u32>,
    /// Topic of a recording that is read, of depth images or of clouds; without it, the only one of depth images, or else
    /// the only one of clouds
    #[option(default)]
    pub topic: Option<String>,
    /// The table, if it is known, in the frame of the camera poses, of the camera if there are none, or of the cloud: unit
    /// vector against gravity, and the table's height along it (1, m); without it, it is searched in the images
    #[option(default)]
    pub table: Option<[f64; 4]>,
    /// Position of the camera in the cloud's frame (m): most clouds are in that of their camera
    #[option(default)]
    pub camera_m: [f64; 3],
    /// Length of the cloud's unit (m): 0.001 if it is in millimeters; of a recording, what a meter of its messages is
    #[option(default = 1.0, range = above(0.0, MAX_UNIT_M), why = "it is a unit of length")]
    pub unit_m: f64,
}

impl ViewsConfig {
    fn other_faults(&self, faults: &mut OptionFaults) {
        if let Some(name) = &self.name
            && (name.is_empty() || plain(name) != *name || name.len() > 100)
        {
            faults.note(
                "name",
                format!(
                    "is {name:?}, and must be up to 100 letters, digits, `_` and `-`: it names files"
                ),
            );
        }
        if let Some([x, y, z, height_m]) = self.table {
            let length = Vector3::new(x, y, z).norm();
            // NaN is no such length either.
            let is_unit = (length - 1.0).abs() <= UNIT_TOLERANCE;
            if !(is_unit && height_m.is_finite()) {
                faults.note(
                    "table",
                    format!(
                        "begins with a vector of length {length}, and must be a unit vector and a height in meters"
                    ),
                );
            }
        }
        if self.camera_m.iter().any(|number| !number.is_finite()) {
            faults.note("camera_m", "must be a position in meters");
        }
    }

    /// The table in the world's frame, if it is known.
    pub(crate) fn known_table(&self) -> Option<TablePlane> {
        let [x, y, z, height_m] = self.table?;
        let up = UnitVector3::try_new(Vector3::new(x, y, z), UNIT_TOLERANCE)?;
        Some(TablePlane { up, height_m })
    }

    /// Position of the camera in the cloud's frame, in meters.
    pub(crate) fn camera_in_world(&self) -> Point3<f64> {
        self.camera_m.into()
    }

    /// Returns the name of an object that the files do not name.
    pub(crate) fn object_name(&self) -> String {
        if let Some(name) = &self.name {
            return name.clone();
        }
        // A folder may be named `.` or `..`.
        let path = self.path.canonicalize();
        let path = path.as_ref().unwrap_or(&self.path);
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        match plain(&stem) {
            empty if empty.is_empty() => "object".to_owned(),
            name => name.chars().take(100).collect(),
        }
    }
}

/// Returns the text with every character that a partition's key cannot hold replaced by `_`.
fn plain(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    text.chars()
        .map(|c| if is_plain(c) { c } else { '_' })
        .collect()
}

#[cfg(test)]
mod tests {
    use options::Options;
    use serde_json::{Value, json};

    use super::*;

    fn parsed(more: &Value) -> Result<ViewsConfig, serde_json::Error> {
        let mut table = json!({"path": "scenes/000001"});
        for (key, value) in more.as_object().unwrap() {
            table[key] = value.clone();
        }
        serde_json::from_value(table)
    }

    #[test]
    fn refuses_values_that_are_none() {
        for (more, expected) in [
            (json!({"name": "a mug"}), "`name` is \"a mug\""),
            (json!({"name": ""}), "`name` is \"\""),
            (json!({"table": [0, 0, 2, 0.1]}), "a vector of length 2"),
            (json!({"table": [0, 0, 0, 0.1]}), "a vector of length 0"),
            (json!({"unit_m": 0.0}), "`unit_m` is 0.0"),
        ] {
            let said = parsed(&more).unwrap().check().unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
        for wrong in [
            json!({"table": [0, 0, 1]}),
            json!({"images": [-1]}),
            json!({"camera_m": "origin"}),
            json!({"scene": 3}),
        ] {
            assert!(parsed(&wrong).is_err(), "{wrong}");
        }
        let mut config = parsed(&json!({})).unwrap();
        config.camera_m[1] = f64::NAN;
        assert!(config.check().is_err());
        config.table = Some([f64::NAN; 4]);
        assert_eq!(config.faults().len(), 2);
    }

    #[test]
    fn an_object_without_a_name_is_called_after_its_file() {
        for (path, expected) in [
            ("scenes/mug 1.ply", "mug_1"),
            ("scenes/000001", "000001"),
            ("/", "object"),
        ] {
            let mut config = parsed(&json!({})).unwrap();
            config.path = path.into();
            assert_eq!(config.object_name(), expected);
        }
        assert_eq!(
            parsed(&json!({"name": "mug"})).unwrap().object_name(),
            "mug"
        );
    }
}
