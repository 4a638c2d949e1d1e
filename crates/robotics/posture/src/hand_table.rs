//! A hand table: the landmark that each point of the robot follows, as TOML.

use std::str::FromStr;

use schemas::demonstrations::{KEYPOINT_NAMES, Side};
use serde::{Deserialize, Serialize};

use crate::PostureError;

/// Largest size of a robot hand relative to a person's.
const MAX_SCALE: f64 = 100.0;
/// Greatest weight of a point.
const HEAVIEST: f64 = 1e6;
/// Greatest distance of a point from its link's frame along an axis, and largest fingertip, in
/// meters.
const MAX_DISTANCE_M: f64 = 10.0;

/// Landmarks that the points of a robot hand follow.
///
/// ```
/// let table: posture::HandTable = r#"
///     side = "right"
///     scale = 1.1
///     points = [
///         { keypoint = "thumb_tip", link = "link_15.0_tip", weight = 1.0, tip_radius_m = 0.012 },
///         { keypoint = "index_tip", link = "link_3.0_tip", weight = 1.0, tip_radius_m = 0.012 },
///         { keypoint = "wrist", link = "base_link", offset_m = [0.0, 0.0, -0.095], weight = 0.3 },
///     ]
/// "#.parse()?;
/// assert_eq!(table.points[2].offset_m[2], -0.095);
/// # Ok::<(), posture::PostureError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandTable {
    /// Side of the robot hand; demonstrations of the other hand are skipped.
    pub side: Side,
    /// Size of the robot hand relative to the person's: landmarks are scaled by it about the wrist.
    pub scale: f64,
    /// The points, at least three.
    pub points: Vec<FollowedPoint>,
}

/// A point of the robot and the landmark that it follows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FollowedPoint {
    /// Name of the landmark, one of [`KEYPOINT_NAMES`].
    pub keypoint: String,
    /// Link of the robot.
    pub link: String,
    /// The point in the link's frame, xyz in meters.
    #[serde(default)]
    pub offset_m: [f64; 3],
    /// Weight of the distance between the point and the landmark; it multiplies the distance before
    /// it is squared. A point of weight 0 on the palm only gives the place of a fixed wrist.
    pub weight: f64,
    /// Marks a fingertip and gives the radius of the sphere about the point, in meters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tip_radius_m: Option<f64>,
}

impl FollowedPoint {
    /// Returns the landmark's index among the 21; none if no landmark has its name.
    pub fn keypoint_idx(&self) -> Option<usize> {
        KEYPOINT_NAMES
            .iter()
            .position(|name| *name == self.keypoint)
    }

    /// Returns the landmark's index, of the point of this number in its table.
    pub(crate) fn require_keypoint(&self, idx: usize) -> Result<usize, PostureError> {
        self.keypoint_idx()
            .ok_or_else(|| PostureError::InvalidHandTableValue {
                key: format!("points[{idx}]"),
                problem: format!(
                    "there is no keypoint `{}`, expected one of: {}",
                    self.keypoint,
                    KEYPOINT_NAMES.join(", ")
                ),
            })
    }
}

impl FromStr for HandTable {
    type Err = PostureError;

    /// Reads and checks a table.
    ///
    /// # Errors
    ///
    /// Fails if the text is not such a table, fewer than three points are given, a landmark is
    /// unknown, or a number makes no sense.
    fn from_str(text: &str) -> Result<Self, PostureError> {
        let table: Self =
            toml_edit::de::from_str(text).map_err(|source| PostureError::InvalidHandTable {
                problem: source.to_string(),
            })?;
        table.check()?;
        Ok(table)
    }
}

impl HandTable {
    /// Checks the constraints that types cannot express.
    ///
    /// # Errors
    ///
    /// Fails if fewer than three points are given, a landmark is unknown, or a number makes no sense.
    pub fn check(&self) -> Result<(), PostureError> {
        let bad = |key: String, problem: String| {
            Err(PostureError::InvalidHandTableValue { key, problem })
        };
        if !(self.scale > 0.0 && self.scale <= MAX_SCALE) {
            let problem = format!(
                "{:?} is not a size, expected more than 0 and at most {MAX_SCALE}",
                self.scale
            );
            return bad("scale".to_owned(), problem);
        }
        if self.points.len() < 3 {
            let problem = format!(
                "{} points cannot fix a hand, expected at least 3",
                self.points.len()
            );
            return bad("points".to_owned(), problem);
        }
        for (idx, point) in self.points.iter().enumerate() {
            let key = format!("points[{idx}]");
            point.require_keypoint(idx)?;
            if !(0.0..=HEAVIEST).contains(&point.weight) {
                let problem = format!("`weight` must be at least 0 and at most {HEAVIEST}");
                return bad(key, problem);
            }
            if !point.offset_m.iter().all(|x| x.abs() <= MAX_DISTANCE_M) {
                let problem =
                    format!("`offset_m` must be at most {MAX_DISTANCE_M} m along each axis");
                return bad(key, problem);
            }
            let is_radius = |radius| (0.0..=MAX_DISTANCE_M).contains(&radius);
            if point.tip_radius_m.is_some_and(|radius| !is_radius(radius)) {
                let problem =
                    format!("`tip_radius_m` must be at least 0 and at most {MAX_DISTANCE_M}");
                return bad(key, problem);
            }
        }
        if self.points.iter().all(|point| point.weight == 0.0) {
            return bad("points".to_owned(), "every weight is 0".to_owned());
        }
        Ok(())
    }

    /// Returns the table as TOML, one point per line.
    pub fn to_toml(&self) -> String {
        let point = |point: &FollowedPoint| {
            let offset = if point.offset_m.iter().all(|x| x.abs() <= 0.0) {
                String::new()
            } else {
                let [x, y, z] = point.offset_m;
                format!(", offset_m = [{x:?}, {y:?}, {z:?}]")
            };
            let tip = point
                .tip_radius_m
                .map(|radius| format!(", tip_radius_m = {radius:?}"))
                .unwrap_or_default();
            let [keypoint, link] = [&point.keypoint, &point.link].map(toml_edit::Value::from);
            let weight = point.weight;
            format!(
                "    {{ keypoint = {keypoint}, link = {link}{offset}, weight = {weight:?}{tip} }},\n"
            )
        };
        let points: String = self.points.iter().map(point).collect();
        format!(
            "side = {:?}\nscale = {:?}\npoints = [\n{points}]\n",
            self.side.as_str(),
            self.scale
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = r#"
        side = "left"
        scale = 1.5
        points = [
            { keypoint = "thumb_tip", link = "t", weight = 1.0, tip_radius_m = 0.01 },
            { keypoint = "index_tip", link = "i", weight = 1.0 },
            { keypoint = "wrist", link = "p", offset_m = [0.0, 1e-3, -0.1], weight = 0.3 },
        ]
    "#;

    #[test]
    fn a_table_is_written_as_it_is_read() {
        let table: HandTable = TABLE.parse().unwrap();
        assert_eq!((table.side, table.scale), (Side::Left, 1.5));
        assert_eq!(table.points[0].keypoint_idx(), Some(4));
        assert_eq!(table.to_toml().parse::<HandTable>().unwrap(), table);
    }

    #[test]
    fn any_number_is_written_as_it_is_read() {
        let mut table: HandTable = TABLE.parse().unwrap();
        let mut number = 0.1_f64;
        for _ in 0..2000 {
            // Steps through numbers of all digits (Knuth, TAOCP 2, section 3.2.1).
            number = (number * 9301.0 + 0.233_333_333_333_333_34).fract();
            table.scale = 0.5 + number;
            table.points[0].weight = number;
            table.points[1].offset_m = [number, -number, number * 1e-9];
            let read: HandTable = table.to_toml().parse().unwrap();
            assert_eq!(read, table);
        }
    }

    #[test]
    fn any_link_name_is_written_as_it_is_read() {
        let mut table: HandTable = TABLE.parse().unwrap();
        for name in [
            "",
            "a\"b",
            "it's",
            "a\\b\nc",
            "\u{1}\u{7f}",
            "t\u{301}",
            "指",
        ] {
            table.points[1].link = name.to_owned();
            let written = table.to_toml();
            let read = written.parse::<HandTable>();
            assert_eq!(read.unwrap(), table, "{written}");
        }
    }

    #[test]
    fn invalid_tables_are_refused() {
        let refused = |from: &str, to: &str| {
            assert!(TABLE.contains(from));
            let err = TABLE.replacen(from, to, 1).parse::<HandTable>();
            err.unwrap_err().to_string()
        };
        assert!(refused("1.5", "0.0").contains("`scale`"));
        assert!(refused("1.5", "nan").contains("`scale`"));
        assert!(refused("index_tip", "toe").contains("`toe`"));
        assert!(refused("weight = 0.3", "weight = -1.0").contains("`points[2]`"));
        assert!(refused("0.01 }", "inf }").contains("`points[0]`"));
        assert!(refused("1e-3", "1e200").contains("`points[2]`"));
        assert!(refused("1e-3", "nan").contains("`points[2]`"));
        assert!(refused("weight = 0.3", "weight = 1e200").contains("`points[2]`"));
        assert!(refused("scale", "size").contains("`size`"));
        let one = "side = \"left\"\nscale = 1.0\npoints = []\n".parse::<HandTable>();
        assert!(one.unwrap_err().to_string().contains("at least 3"));
    }
}
