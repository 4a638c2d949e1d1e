//! Poses and points as numbers of a file.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;
use serde_json::Value;
use spatial::quaternion_xyzw;

use crate::error::CalibrationError;

/// Largest difference from 0 and 1 of products of a matrix's rows, which are rounded.
const ORTHOGONAL: f64 = 1e-3;

const POINT: &str = "give x, y and z in meters";
const QUATERNION: &str = "give x, y, z and w, w last, of length 1";
const MATRIX: &str = "give four rows of four numbers: [R t] row by row, then [0, 0, 0, 1]";
const POSE: &str = "give `position_m` and `quaternion_xyzw`, or `matrix`";

/// The fields of a pose.
#[derive(Debug, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a pose: `position_m` and `quaternion_xyzw`, or `matrix`"
)]
pub(crate) struct PoseFields {
    position_m: Option<Value>,
    quaternion_xyzw: Option<Value>,
    matrix: Option<Value>,
}

impl PoseFields {
    /// Reads a pose; `at` names the measurement and the field.
    pub(crate) fn read(&self, at: &str) -> Result<Isometry3<f64>, CalibrationError> {
        match (&self.position_m, &self.quaternion_xyzw, &self.matrix) {
            (Some(position), Some(quaternion), None) => {
                let [x, y, z] = numbers(&format!("{at}.position_m"), position, POINT)?;
                let rotation = rotation(&format!("{at}.quaternion_xyzw"), quaternion)?;
                Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
            }
            (None, None, Some(rows)) => matrix(&format!("{at}.matrix"), rows),
            (position, quaternion, matrix) => {
                let named = [
                    ("position_m", position),
                    ("quaternion_xyzw", quaternion),
                    ("matrix", matrix),
                ];
                let given: Vec<String> = named
                    .iter()
                    .filter(|(_, value)| value.is_some())
                    .map(|(name, _)| format!("`{name}`"))
                    .collect();
                let given = if given.is_empty() {
                    "no field".to_owned()
                } else {
                    given.join(" and ")
                };
                Err(wrong(at, format!("a pose with {given} is none"), POSE))
            }
        }
    }
}

/// Reads a point.
pub(crate) fn point(at: &str, value: &Value) -> Result<Point3<f64>, CalibrationError> {
    numbers(at, value, POINT).map(Point3::from)
}

fn rotation(at: &str, value: &Value) -> Result<UnitQuaternion<f64>, CalibrationError> {
    let found = quaternion_xyzw(numbers(at, value, QUATERNION)?);
    found.map_err(|err| wrong(at, err.to_string(), QUATERNION))
}

fn matrix(at: &str, value: &Value) -> Result<Isometry3<f64>, CalibrationError> {
    // Rows, or one after the other.
    let rows = value.as_array();
    let rows = rows.filter(|rows| !rows.is_empty() && rows.iter().all(Value::is_array));
    let values = match rows {
        Some(rows) if rows.len() == 4 => {
            let row = |row: &Value| numbers::<4>(at, row, MATRIX);
            let rows: Result<Vec<[f64; 4]>, CalibrationError> = rows.iter().map(row).collect();
            rows?.concat()
        }
        Some(rows) => {
            let problem = format!("it has {} rows, expected 4", rows.len());
            return Err(wrong(at, problem, MATRIX));
        }
        None => numbers::<16>(at, value, MATRIX)?.to_vec(),
    };
    let matrix = nalgebra::Matrix4::from_row_iterator(values);
    let last: [f64; 4] = matrix.row(3).transpose().into();
    let is_last = last
        .iter()
        .zip([0.0, 0.0, 0.0, 1.0])
        .all(|(found, expected)| (found - expected).abs() < ORTHOGONAL);
    if !is_last {
        let problem = format!("the last row is {last:?}, expected [0, 0, 0, 1]");
        return Err(wrong(at, problem, MATRIX));
    }
    let rotation: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
    check_rotation(at, &rotation)?;
    let offset: Vector3<f64> = matrix.fixed_view::<3, 1>(0, 3).into();
    // The nearest rotation to nine rounded numbers.
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Ok(Isometry3::from_parts(offset.into(), rotation))
}

fn check_rotation(at: &str, rotation: &Matrix3<f64>) -> Result<(), CalibrationError> {
    let products = rotation * rotation.transpose();
    let square = products.trace() / 3.0;
    let off = (products - Matrix3::identity() * square).amax();
    let problem = if off > ORTHOGONAL * square.max(1.0) {
        format!("it is no rotation: products of its rows are off by {off:.4}")
    } else if (square - 1.0).abs() > 2.0 * ORTHOGONAL {
        let length = square.sqrt();
        format!("it is no rotation: its rows have length {length:.4}, expected 1")
    } else if rotation.determinant() < 0.0 {
        "it is left-handed: its determinant is −1".to_owned()
    } else {
        return Ok(());
    };
    Err(wrong(
        at,
        problem,
        "give a right-handed rotation without scale",
    ))
}

/// Reads a list of numbers.
fn numbers<const N: usize>(
    at: &str,
    value: &Value,
    hint: &'static str,
) -> Result<[f64; N], CalibrationError> {
    let Some(list) = value.as_array() else {
        let problem = format!("it is {}, expected {N} numbers", shown(value));
        return Err(wrong(at, problem, hint));
    };
    let mut found = Vec::new();
    for entry in list {
        let Some(number) = entry.as_f64() else {
            let problem = format!("{} is no number", shown(entry));
            return Err(wrong(at, problem, hint));
        };
        found.push(number);
    }
    let n = found.len();
    let numbers = found.try_into().ok();
    numbers.ok_or_else(|| wrong(at, format!("it has {n} numbers, expected {N}"), hint))
}

/// Longest text of a value in a message, in characters.
const SHOWN: usize = 40;

fn shown(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= SHOWN {
        return format!("`{text}`");
    }
    let start: String = text.chars().take(SHOWN).collect();
    format!("`{start}…`")
}

fn wrong(at: &str, problem: String, hint: &'static str) -> CalibrationError {
    CalibrationError::Number {
        at: at.to_owned(),
        problem,
        hint,
    }
}
