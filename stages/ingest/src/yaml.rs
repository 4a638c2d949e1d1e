//! The dataset's YAML files as typed structs.
//!
//! Serial numbers and ids stay strings, whether quoted or not. The parser works on a budget, a few
//! times what the largest real file needs: a document that is deep, endless or grows when its
//! aliases are expanded is refused as soon as it has used it up.

use std::collections::BTreeMap;

use dataflow::SourceFile;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use schemas::demonstrations::Side;
use serde::{Deserialize, de::DeserializeOwned};
use spatial::Pose;

use crate::error::RecordingError;

/// Largest accepted difference of a stored rotation matrix from an orthonormal one: poses estimated
/// from video have been published with 0.0074.
const ORTHONORMAL_TOLERANCE: f64 = 0.02;
/// Difference from an orthonormal matrix below which numbers of 8 bytes cannot tell.
const CONVERGED: f64 = 1e-15;

/// Maximum number of accepted scalars, lists and maps of a document; `extrinsics.yml` has 130, of eight cameras
/// and the tag.
const MAX_NODES: usize = 10_000;
/// Maximum number of accepted lists and maps within each other; the real files have three.
const MAX_DEPTH: usize = 16;
/// Maximum number of accepted aliases, and of accepted anchors; the real files have none.
const MAX_ALIASES: usize = 16;

/// Why a YAML file could not be read.
#[derive(Debug, thiserror::Error)]
pub enum YamlError {
    /// The bytes are not UTF-8.
    #[error("not UTF-8")]
    NotUtf8,
    /// The text is not YAML, lacks a key or has another type.
    #[error("{0}")]
    Parse(String),
}

/// `meta.yml`: what one recording holds.
#[derive(Debug, Deserialize)]
pub(crate) struct Meta {
    /// Cameras in order.
    pub(crate) serials: Vec<String>,
    /// Images per camera.
    pub(crate) num_frames: u64,
    /// Id of the calibration of the cameras.
    pub(crate) extrinsics: String,
    /// Numbers of the objects in the scene.
    pub(crate) ycb_ids: Vec<u32>,
    /// Index in `ycb_ids` of the object that is grasped.
    pub(crate) ycb_grasp_ind: usize,
    /// Sides of the hands.
    pub(crate) mano_sides: Vec<String>,
    /// Ids of the calibrations of the hands.
    #[serde(default)]
    pub(crate) mano_calib: Vec<String>,
}

impl Meta {
    /// Returns the hand that grasps; `None` if it is not one, or of no known side.
    pub(crate) fn hand(&self) -> Option<Side> {
        match self.mano_sides.as_slice() {
            [side] => Side::parse(side),
            _ => None,
        }
    }
}

/// The calibration: where the cameras and the tags are.
#[derive(Debug, Deserialize)]
pub(crate) struct Extrinsics {
    /// The pose of each camera and tag, `[R|t]`, row by row, in meters: of `DexYCB` in the world, of `HO-Cap` in the
    /// master camera's frame.
    pub(crate) extrinsics: BTreeMap<String, [f64; 12]>,
}

impl Extrinsics {
    /// Returns the pose of a camera or a tag.
    ///
    /// # Errors
    ///
    /// Fails with the name of the file that it was read from if it is not there, or is not a rotation and translation.
    pub(crate) fn pose<To, From>(
        &self,
        name: &str,
        file: &SourceFile,
    ) -> Result<Pose<To, From>, RecordingError> {
        let value = |what: String| RecordingError::Value {
            what,
            file: file.name.clone(),
        };
        let rows = self.extrinsics.get(name);
        let rows = rows.ok_or_else(|| value(format!("no pose of `{name}`")))?;
        pose(rows).ok_or_else(|| value(format!("`{name}` is not a rotation and a translation")))
    }
}

/// `mano.yml`: the shape of a person's hand.
#[derive(Debug, Deserialize)]
pub(crate) struct HandShape {
    /// The ten numbers of the hand model.
    pub(crate) betas: [f64; 10],
}

/// Reads a YAML document.
pub(crate) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, YamlError> {
    let text = std::str::from_utf8(bytes).map_err(|_not_utf8| YamlError::NotUtf8)?;
    let options = serde_saphyr::options! {
        budget: serde_saphyr::budget! {
            max_nodes: MAX_NODES,
            max_events: 4 * MAX_NODES,
            max_recorded_anchor_events: 4 * MAX_NODES,
            max_depth: MAX_DEPTH,
            max_aliases: MAX_ALIASES,
            max_anchors: MAX_ALIASES,
            max_documents: 1,
        },
        // The place would be drawn below the message, which is all that is kept.
        with_snippet: false,
    };
    serde_saphyr::from_str_with_options(text, options).map_err(|err| {
        let message = err.to_string();
        YamlError::Parse(message.lines().next().unwrap_or_default().to_owned())
    })
}

/// Reads `[R|t]`, row by row, with the rotation nearest to `R`; `None` if `R` is not orthonormal
/// within 0.02, is a mirror image, or a number is not finite.
pub(crate) fn pose<To, From>(rows: &[f64; 12]) -> Option<Pose<To, From>> {
    let [a, b, c, x, d, e, f, y, g, h, i, z] = *rows;
    let mut matrix = Matrix3::new(a, b, c, d, e, f, g, h, i);
    let mut deviation = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    // A NaN deviation fails the comparison too.
    let is_rotation = deviation <= ORTHONORMAL_TOLERANCE && matrix.determinant() > 0.0;
    if !(is_rotation && x.is_finite() && y.is_finite() && z.is_finite()) {
        return None;
    }
    // Higham, *Computing the Polar Decomposition*, 1986, section 3.
    // A step takes a stretch of 1 + e to 1 + e²/2, a difference (of which the largest number is a
    // third or more) from d to d²/4: two steps for rotations rounded to 4 bytes, four at most.
    while deviation > CONVERGED {
        matrix = (matrix + matrix.try_inverse()?.transpose()) * 0.5;
        deviation = 2.25 * deviation.powi(2);
    }
    let rotation = Rotation3::from_matrix_unchecked(matrix);
    Some(Pose::from_parts(
        [x, y, z],
        UnitQuaternion::from_rotation_matrix(&rotation),
    ))
}

#[cfg(test)]
mod tests {
    use spatial::{Camera, World};

    use super::*;

    #[test]
    fn ids_of_digits_stay_text() {
        let text = "serials: [836212060125, '840412060917']\nnum_frames: 3\n\
                    extrinsics: 20200702_151821\nycb_ids: [1, 11]\nycb_grasp_ind: 0\n\
                    mano_sides: [right]\nmano_calib: [x]\n";
        let meta: Meta = parse(text.as_bytes()).unwrap();
        assert_eq!(meta.serials, ["836212060125", "840412060917"]);
        assert_eq!(meta.extrinsics, "20200702_151821");
    }

    const META: &str = "serials: [a]\nnum_frames: 3\nextrinsics: e\nycb_ids: [1]\n\
                        ycb_grasp_ind: 0\nmano_sides: [right]\n";

    /// Returns why a document of either kind is refused; soon, even on a busy machine.
    fn refusal(bytes: &[u8]) -> [String; 2] {
        let started = std::time::Instant::now();
        let said = [
            parse::<Meta>(bytes).unwrap_err().to_string(),
            parse::<Extrinsics>(bytes).unwrap_err().to_string(),
        ];
        let elapsed = started.elapsed();
        assert!(elapsed.as_secs_f64() < 10.0, "{elapsed:?}: {said:?}");
        said
    }

    #[test]
    fn refuses_a_megabyte_of_anything_soon() {
        let megabyte = |text: &str| text.repeat((1 << 20) / text.len());
        for text in [
            megabyte("["),
            megabyte("{"),
            megabyte("{a: "),
            megabyte("- "),
            megabyte("? "),
            megabyte("a: "),
            megabyte("- - "),
            megabyte("a\n"),
            megabyte("\n"),
            megabyte("#"),
            megabyte("'"),
            megabyte("\"\\\\"),
            megabyte("&a "),
            megabyte("*a "),
            megabyte("!a "),
            megabyte("--- a\n"),
            megabyte("%YAML 1.2\n"),
            megabyte("a: 1\n"),
            megabyte("? a\n"),
            megabyte("|\n a\n"),
            megabyte("\t"),
            megabyte("\u{feff}"),
            format!("serials: [{}]", megabyte("x, ")),
            format!("extrinsics: {{{}}}", megabyte("x: [1], ")),
            format!("extrinsics: {{x: [{}]}}", megabyte("1, ")),
            format!("extrinsics: [{}]", megabyte("&a x, *a, ")),
        ] {
            refusal(text.as_bytes());
        }
        // One line as deep as a line can be indented.
        let mut deep = String::new();
        for n in 0..1400 {
            deep += &" ".repeat(n);
            deep += "a:\n";
        }
        refusal(deep.as_bytes());
    }

    #[test]
    fn refuses_keys_given_twice() {
        let twice = format!("{META}num_frames: 4\n");
        let [said, _] = refusal(twice.as_bytes());
        assert!(
            said.contains("duplicate") && said.contains("num_frames"),
            "{said}"
        );
        let cameras = "extrinsics:\n  a: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n";
        let (_, camera) = cameras.split_once('\n').unwrap();
        let [_, said] = refusal(format!("{cameras}{camera}").as_bytes());
        assert!(said.contains("duplicate"), "{said}");
    }

    #[test]
    fn refuses_binary_and_tab_indented_files() {
        assert!(parse::<Meta>(META.as_bytes()).is_ok());
        for bad in [&[0xff_u8, 0xfe][..], &[0xc0, 0x80], &[0xed, 0xa0, 0x80]] {
            let [said, _] = refusal(&[META.as_bytes(), bad].concat());
            assert_eq!(said, "not UTF-8");
        }
        refusal(META.replace("[a]", "\n\t- a").as_bytes());
        refusal(META.replace("[a]", "[a\0b]").as_bytes());
        refusal(b"");
    }

    #[test]
    fn refuses_numbers_that_a_recording_cannot_have() {
        for (key, value) in [
            ("num_frames", "-1"),
            ("num_frames", "1e3"),
            ("num_frames", "99999999999999999999"),
            ("num_frames", "x"),
            ("ycb_ids", "[-1]"),
            ("ycb_ids", "[4294967296]"),
            ("ycb_ids", "1"),
            ("ycb_grasp_ind", "-1"),
            ("ycb_grasp_ind", "[0]"),
            ("mano_sides", "right"),
        ] {
            let lines = META.lines().map(|line| match line.split_once(':') {
                Some((found, _)) if found == key => format!("{key}: {value}\n"),
                _ => format!("{line}\n"),
            });
            refusal(lines.collect::<String>().as_bytes());
        }
        for numbers in ["[1, 2]", "[]", "1", "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, x]"] {
            refusal(format!("extrinsics: {{a: {numbers}}}").as_bytes());
        }
        let not_finite = "extrinsics: {a: [1, 0, 0, .inf, 0, 1, 0, 0, 0, 0, 1, .nan]}";
        if let Ok(read) = parse::<Extrinsics>(not_finite.as_bytes()) {
            assert!(pose::<World, Camera>(&read.extrinsics["a"]).is_none());
        }
    }

    #[test]
    fn refuses_a_document_that_grows() {
        let mut text = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n".to_owned();
        for level in 1..12 {
            let copies = vec![format!("*a{}", level - 1); 10].join(", ");
            text = format!("{text}a{level}: &a{level} [{copies}]\n");
        }
        refusal(text.as_bytes());
    }

    #[test]
    fn refuses_a_matrix_that_is_not_a_rotation() {
        let mirrored = [-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        assert!(pose::<World, Camera>(&mirrored).is_none());
        assert!(pose::<World, Camera>(&[f64::NAN; 12]).is_none());
        assert!(pose::<World, Camera>(&[0.0; 12]).is_none());
        assert!(pose::<World, Camera>(&[1.0; 12]).is_none());
    }

    #[test]
    fn takes_the_rotation_nearest_to_a_rounded_one() {
        let turn = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        // A symmetric stretch leaves the nearest rotation as it is.
        let stretch = Matrix3::new(1.003, 0.001, 0.0, 0.001, 0.998, -0.002, 0.0, -0.002, 1.0);
        let m = turn.matrix() * stretch;
        let rows = [
            m.m11, m.m12, m.m13, 0.1, m.m21, m.m22, m.m23, 0.2, m.m31, m.m32, m.m33, 0.3,
        ];
        let found = pose::<World, Camera>(&rows).unwrap();
        assert!(
            found
                .rotation
                .angle_to(&UnitQuaternion::from_rotation_matrix(&turn))
                < 1e-9
        );
    }
}
