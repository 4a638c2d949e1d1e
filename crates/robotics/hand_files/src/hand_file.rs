//! The file of a hand: its URDF, the points that follow a person's, its drives and the joints that close it.

use std::{
    collections::BTreeMap,
    fs,
    path::{Component, Path, PathBuf},
    str::FromStr,
};

use posture::{FollowedPoint, HandTable, PostureError};
use robot::RobotModel;
use schemas::demonstrations::Side;
use serde::Deserialize;
use toml_edit::{Array, InlineTable, Value};

use crate::HandFileError;

/// Stiffness of a proposed drive relative to its torque limit, in 1/rad: as the Allegro's, which gives its
/// whole torque at 2° from the command.
const STIFFNESS_OF_LIMIT: f64 = 20.0 / 0.7;
/// Damping of a proposed drive relative to its stiffness, in seconds: as the Allegro's.
const DAMPING_OF_STIFFNESS: f64 = 0.05;
/// Inertia of a proposed drive's rotor as felt at the joint, in kilogram square meters: the Allegro's.
const ARMATURE: f64 = 0.001;

/// Numbers of a drive, the first four of every one.
const DRIVE_KEYS: [&str; 6] = [
    "stiffness",
    "damping",
    "torque_limit",
    "armature",
    "stop_stiffness",
    "delay_s",
];

/// A robot hand, as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct HandFile {
    /// The URDF, relative to the folder of the file; none in a file that is used beside a URDF.
    pub urdf: Option<PathBuf>,
    /// The points and the landmarks that they follow.
    pub table: HandTable,
    /// Names of the joints that close the fingers; positive positions flex.
    pub flexion_joints: Option<Vec<String>>,
    /// Numbers of every finger joint's drive by their names in a stage's options, in SI units.
    pub drive: Option<BTreeMap<String, f64>>,
}

/// A hand file as TOML.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    urdf: Option<PathBuf>,
    side: Side,
    scale: f64,
    drive: Option<BTreeMap<String, f64>>,
    flexion_joints: Option<Vec<String>>,
    points: Vec<FollowedPoint>,
}

impl FromStr for HandFile {
    type Err = PostureError;

    /// Reads and checks a hand's file.
    ///
    /// # Errors
    ///
    /// Fails if the text is not such a file, or its points cannot be used.
    fn from_str(text: &str) -> Result<Self, PostureError> {
        let written: Written =
            toml_edit::de::from_str(text).map_err(|source| PostureError::InvalidHandTable {
                problem: source.to_string(),
            })?;
        let table = HandTable {
            side: written.side,
            scale: written.scale,
            points: written.points,
        };
        table.check()?;
        let mut values = written.drive.iter().flatten();
        if let Some((key, value)) = values.find(|(_, value)| !(**value >= 0.0 && value.is_finite()))
        {
            return Err(PostureError::InvalidHandTableValue {
                key: format!("drive.{key}"),
                problem: format!("{value} is not a number of a drive, expected 0 or more"),
            });
        }
        let mut keys = written.drive.iter().flat_map(BTreeMap::keys);
        if let Some(key) = keys.find(|key| !DRIVE_KEYS.contains(&key.as_str())) {
            return Err(PostureError::InvalidHandTableValue {
                key: format!("drive.{key}"),
                problem: format!("a drive has no such number, but {}", DRIVE_KEYS.join(", ")),
            });
        }
        Ok(Self {
            urdf: written.urdf,
            table,
            flexion_joints: written.flexion_joints,
            drive: written.drive,
        })
    }
}

impl HandFile {
    /// Reads a hand's file.
    ///
    /// # Errors
    ///
    /// Fails if the file cannot be read or used.
    pub fn read(path: &Path) -> Result<Self, HandFileError> {
        let text = fs::read_to_string(path).map_err(|source| HandFileError::ReadHandTable {
            path: path.to_owned(),
            source,
        })?;
        text.parse().map_err(|source| HandFileError::HandTable {
            path: path.to_owned(),
            source,
        })
    }

    /// Proposes the file of a robot from its tree: its points as [`HandTable::proposed`], the joints that turn
    /// about the axis of a finger's last joint as those that close it, and drives of the median torque limit
    /// that the URDF has for the fingers; `None` where no table can be proposed.
    ///
    /// It is a guess for people to check.
    pub fn proposed(model: &RobotModel, urdf: &Path) -> Option<Self> {
        let fingers = model.fingers();
        let closing = fingers
            .iter()
            .flat_map(|finger| model.closing_joints(finger));
        let closing = closing.filter_map(|joint| model.joints().get(joint));
        let names: Vec<String> = closing.map(|joint| joint.name.clone()).collect();
        let efforts = model.finger_efforts_nm();
        let drive = efforts.get(efforts.len() / 2).map(|&limit| {
            let stiffness = rounded(limit * STIFFNESS_OF_LIMIT);
            BTreeMap::from([
                ("stiffness".to_owned(), stiffness),
                (
                    "damping".to_owned(),
                    rounded(stiffness * DAMPING_OF_STIFFNESS),
                ),
                ("torque_limit".to_owned(), limit),
                ("armature".to_owned(), ARMATURE),
            ])
        });
        Some(Self {
            urdf: Some(urdf.to_owned()),
            table: HandTable::proposed(model)?,
            flexion_joints: (!names.is_empty()).then_some(names),
            drive,
        })
    }

    /// Returns the file as TOML, one point per line.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        let mut put = |key: &str, value: Value| text.push_str(&format!("{key} = {value}\n"));
        if let Some(urdf) = &self.urdf {
            put("urdf", urdf.to_string_lossy().into_owned().into());
        }
        if let Some(drive) = self.drive_table() {
            put("drive", drive.into());
        }
        if let Some(joints) = &self.flexion_joints {
            put("flexion_joints", joints.iter().collect::<Array>().into());
        }
        text + &self.table.to_toml()
    }

    /// Returns the URDF's path, of the hand whose file is at `path`.
    pub(crate) fn urdf_from(&self, path: &Path) -> Option<PathBuf> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let joined = folder.join(self.urdf.as_ref()?);
        // Without `..`, where that is the same file.
        let mut short = PathBuf::new();
        for part in joined.components() {
            match part {
                Component::ParentDir if short.file_name().is_some() => {
                    short.pop();
                }
                part => short.push(part),
            }
        }
        let is_same = short.canonicalize().ok() == joined.canonicalize().ok();
        Some(if is_same { short } else { joined })
    }

    /// Returns the fingertips, the thumb's last: the link of each, and the radius in meters of its contact
    /// sphere.
    pub(crate) fn tips(&self) -> Vec<(&str, f64)> {
        let tips = self.table.points.iter().filter_map(|point| {
            let radius_m = point.tip_radius_m?;
            let is_thumb = point.keypoint.starts_with("thumb");
            Some((is_thumb, point.link.as_str(), radius_m))
        });
        let mut tips: Vec<(bool, &str, f64)> = tips.collect();
        tips.sort_by_key(|&(is_thumb, ..)| is_thumb);
        tips.into_iter()
            .map(|(_, link, radius_m)| (link, radius_m))
            .collect()
    }

    /// Returns the drive as a stage's options have it.
    pub(crate) fn drive_table(&self) -> Option<InlineTable> {
        let drive = self.drive.as_ref()?;
        let numbers = DRIVE_KEYS.iter();
        Some(
            numbers
                .filter_map(|&name| Some((name, *drive.get(name)?)))
                .collect(),
        )
    }
}

/// Rounds to two digits.
fn rounded(value: f64) -> f64 {
    let unit = 10_f64.powf(value.abs().log10().floor() - 1.0);
    let digits = (value / unit).round();
    // A division is exact where the unit's inverse is a whole number.
    if unit < 1.0 {
        digits / (1.0 / unit).round()
    } else {
        digits * unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HANDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data/hands/");

    fn shipped(name: &str) -> HandFile {
        HandFile::read(Path::new(&format!("{HANDS}{name}.toml"))).unwrap()
    }

    #[test]
    fn a_file_is_written_as_it_is_read() {
        let mut hand = shipped("allegro_right");
        assert_eq!(hand.to_toml().parse::<HandFile>().unwrap(), hand);
        (hand.urdf, hand.drive, hand.flexion_joints) = (None, None, None);
        assert_eq!(hand.to_toml(), hand.table.to_toml());
        assert_eq!(hand.to_toml().parse::<HandFile>().unwrap(), hand);
    }

    #[test]
    fn the_urdf_stands_beside_the_file() {
        let hand = shipped("allegro_right");
        let path = |path: &str| hand.urdf_from(Path::new(path)).unwrap();
        let given = format!("{HANDS}allegro_right.toml");
        let short = path(&given);
        assert!(
            short.ends_with("data/robots/allegro_right.urdf"),
            "{short:?}"
        );
        assert!(!short.to_string_lossy().contains("hands"), "{short:?}");
        assert!(short.is_file());
    }

    #[test]
    fn the_thumb_is_the_last_tip() {
        let names: Vec<String> = [3, 7, 11, 15].map(|n| format!("link_{n}.0_tip")).into();
        let hand = shipped("allegro_right");
        assert_eq!(
            hand.tips().iter().map(|tip| tip.0).collect::<Vec<_>>(),
            names
        );
        assert!(hand.tips().iter().all(|tip| tip.1 == 0.012));
        let shadow = shipped("shadow_right");
        assert_eq!(shadow.tips().last().unwrap(), &("thtip", 0.008));
    }

    #[test]
    fn a_proposed_drive_is_the_urdfs() {
        let urdf = format!("{HANDS}../robots/allegro_right.urdf");
        let model = RobotModel::from_urdf(&fs::read_to_string(urdf).unwrap()).unwrap();
        let proposed = HandFile::proposed(&model, Path::new("hand.urdf")).unwrap();
        let mut shipped = shipped("allegro_right");
        assert_eq!(proposed.drive, shipped.drive);
        let mut joints = proposed.flexion_joints.clone().unwrap();
        joints.sort();
        shipped.flexion_joints.as_mut().unwrap().sort();
        assert_eq!(Some(joints), shipped.flexion_joints);
        assert_eq!(rounded(1.234), 1.2);
        assert_eq!(rounded(0.0567), 0.057);
        assert_eq!(rounded(571.4), 570.0);
    }
}
