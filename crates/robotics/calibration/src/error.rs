//! Errors of calibration.

use std::fmt;

use crate::{
    conventions::Reading,
    hand_eye::CameraMount,
    measurements::{MAX_FILE_BYTES, MAX_MEASUREMENTS},
};

/// A field of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// A point in the frame of the robot's base.
    InBase,
    /// A point in the frame of the camera.
    InCamera,
    /// The flange's pose by the robot.
    Flange,
    /// The board's pose by the camera.
    Board,
}

impl Field {
    /// Returns the name of what it measures.
    fn measured(self) -> &'static str {
        match self {
            Self::InBase | Self::InCamera => "points",
            Self::Flange | Self::Board => "poses",
        }
    }
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::InBase => "in_base_m",
            Self::InCamera => "in_camera_m",
            Self::Flange => "base_from_flange",
            Self::Board => "camera_from_board",
        })
    }
}

/// Why measurements give no pose of a camera.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// The file is larger than measurements are.
    #[error("the file has more than {} MiB", MAX_FILE_BYTES / (1 << 20))]
    LargeFile,
    /// The file is no text.
    #[error("the file is no text in UTF-8")]
    NoText(#[source] std::str::Utf8Error),
    /// The text is not JSON, or has other fields.
    #[error("the file does not hold measurements")]
    Json(#[source] serde_json::Error),
    /// The file has no measurements, or two kinds.
    #[error("the file has {found}, expected `points` or `poses`")]
    Kind {
        /// What it has.
        found: &'static str,
    },
    /// The file does not say where the camera is.
    #[error("`camera` is missing")]
    NoMount,
    /// Points were touched for a camera that moves.
    #[error("`camera` is \"wrist\", and `points` are of a camera that stands still")]
    PointsOfWrist,
    /// The numbers of a field are wrong.
    #[error("{at}: {problem}")]
    Number {
        /// The measurement and the field.
        at: String,
        /// What is wrong.
        problem: String,
        /// What to do.
        hint: &'static str,
    },
    /// There are too few measurements.
    #[error("there are {n} measurements, and at least 3 are needed")]
    TooFew {
        /// Their number.
        n: usize,
    },
    /// There are too many measurements.
    #[error("there are {n} measurements, more than {MAX_MEASUREMENTS}")]
    TooMany {
        /// Their number.
        n: usize,
    },
    /// A number is NaN or infinite.
    #[error("`{field}` of measurement {number} is not finite")]
    NotFinite {
        /// The field.
        field: Field,
        /// The measurement, from 1.
        number: usize,
    },
    /// Positions are farther away than robots and cameras measure.
    #[error("`{field}`{} is up to {distance_m:.0} m away: positions are in meters", also(*.other))]
    TooFar {
        /// The field.
        field: Field,
        /// Another field for which that is so.
        other: Option<Field>,
        /// The largest distance, in meters.
        distance_m: f64,
    },
    /// Two measurements are one.
    #[error("`{field}` of measurements {first} and {second} is the same")]
    Twice {
        /// The field.
        field: Field,
        /// The first measurement, from 1.
        first: usize,
        /// The second measurement, from 1.
        second: usize,
    },
    /// The points lie on a line.
    #[error(
        "the points of `{field}` lie on a line: they spread by {:.1} mm along it and by {:.1} mm across",
        along_m * 1e3,
        across_m * 1e3
    )]
    Collinear {
        /// The frame.
        field: Field,
        /// Their standard deviation along the line, in meters.
        along_m: f64,
        /// Their standard deviation across it, in meters.
        across_m: f64,
    },
    /// Distances between points differ by a factor.
    #[error("points are {} times as far apart in `in_base_m` as in `in_camera_m`", figures(*.factor))]
    Scale {
        /// The factor.
        factor: f64,
    },
    /// An axis of one of the frames is mirrored.
    #[error(
        "the points are mirrored: {:.1} mm RMS remain, and {:.1} mm if an axis of one frame points the other way",
        rms_m * 1e3,
        mirrored_rms_m * 1e3
    )]
    Mirrored {
        /// Residual of the best rotation, in meters.
        rms_m: f64,
        /// Residual of the best reflection, in meters.
        mirrored_rms_m: f64,
    },
    /// The robot has turned about one axis.
    #[error(
        "the flange turns by up to {about_deg:.1}° about {} of the {frame}, and by {others_deg:.1}° about other axes: \
         at least {least_deg:.0}° are needed",
        axis_text(*.axis)
    )]
    OneAxis {
        /// The frame of the axis.
        frame: &'static str,
        /// The axis.
        axis: [f64; 3],
        /// Largest rotation about it, in degrees.
        about_deg: f64,
        /// Largest rotation about another axis, in degrees.
        others_deg: f64,
        /// Least rotation about another axis, in degrees.
        least_deg: f64,
    },
    /// The poses agree far better if they are read otherwise.
    #[error("the poses agree {factor:.0} times better with {reading}")]
    Convention {
        /// Where the file says that the camera is.
        mount: CameraMount,
        /// The better reading.
        reading: Reading,
        /// The factor.
        factor: f64,
    },
    /// The poses agree far better if the board has another size.
    #[error(
        "the board seems {factor:.3} times as large as its detector assumes: {:.1} mm RMS remain, and {:.1} mm with \
         that size",
        given_m * 1e3,
        rms_m * 1e3
    )]
    BoardScale {
        /// The factor.
        factor: f64,
        /// Residual with the assumed size, in meters.
        given_m: f64,
        /// Residual with the other, in meters.
        rms_m: f64,
    },
    /// No pose was found.
    #[error("the measurements do not determine a pose")]
    NoSolution,
}

/// Example of a file, for hints.
const EXAMPLE: &str = "write `{\"camera\": \"fixed\", \"poses\": [{\"base_from_flange\": {\"position_m\": [x, y, z], \
                       \"quaternion_xyzw\": [x, y, z, w]}, \"camera_from_board\": {…}}, …]}` or `{\"points\": \
                       [{\"in_base_m\": [x, y, z], \"in_camera_m\": [x, y, z]}, …]}`";

impl CalibrationError {
    /// Returns what to do, if there is something.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            Self::Scale { factor } => scale_hint(*factor),
            Self::Convention { mount, reading, .. } => reading_hint(*mount, *reading),
            Self::TooFar { field, .. } => {
                format!("divide {} in millimeters by 1000", field.measured())
            }
            Self::Twice { field, .. } => format!(
                "remove one, or correct it: {} must be measured at different places",
                field.measured()
            ),
            Self::TooMany { .. } => {
                format!("keep at most {MAX_MEASUREMENTS}, far apart from each other")
            }
            other => other.fixed_hint()?.to_owned(),
        })
    }

    /// As [`Self::hint`], where it does not depend on numbers.
    fn fixed_hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::LargeFile | Self::NoText(_) | Self::Json(_) | Self::Kind { .. } => EXAMPLE,
            Self::NoMount => {
                "add `\"camera\": \"fixed\"` if the camera stands still and the board is on the flange, or \
                 `\"camera\": \"wrist\"` if the camera is on the flange and the board stands still"
            }
            Self::PointsOfWrist => "measure `poses` of the flange and of a board",
            Self::Number { hint, .. } => hint,
            Self::TooFew { .. } => "4 are checked against each other; 10 or more are better",
            Self::Collinear { .. } => {
                "touch points that are spread over the space in which the robot grasps, at different heights"
            }
            Self::Mirrored { .. } => {
                "frames are right-handed: a camera's x is right, y down and z forward; change the sign of one axis"
            }
            Self::OneAxis { .. } => {
                "tilt the flange between poses, by 30° or more about two different axes"
            }
            Self::BoardScale { .. } => {
                "measure a square of the printed board, and give its size to the board's detector"
            }
            // There is nothing to do, or it depends on numbers.
            Self::NotFinite { .. }
            | Self::NoSolution
            | Self::Scale { .. }
            | Self::Convention { .. }
            | Self::TooFar { .. }
            | Self::Twice { .. }
            | Self::TooMany { .. } => return None,
        })
    }
}

fn also(other: Option<Field>) -> String {
    other.map_or_else(String::new, |field| format!(" or `{field}`"))
}

/// A factor with three digits.
fn figures(factor: f64) -> String {
    match factor {
        factor if factor >= 100.0 => format!("{factor:.0}"),
        factor if factor >= 0.1 => format!("{factor:.3}"),
        factor => format!("{factor:.2e}"),
    }
}

fn axis_text([x, y, z]: [f64; 3]) -> String {
    // `+ 0.0` turns −0 into 0.
    let [x, y, z] = [x, y, z].map(|number| (number * 100.0).round() / 100.0 + 0.0);
    format!("[{x:.2}, {y:.2}, {z:.2}]")
}

/// Relative difference of a factor from a power of ten that is meant by it.
const NEAR: f64 = 0.2;

fn scale_hint(factor: f64) -> String {
    let (field, factor) = if factor > 1.0 {
        (Field::InBase, factor)
    } else {
        (Field::InCamera, 1.0 / factor)
    };
    for (unit, per_meter) in [("millimeters", 1000.0), ("centimeters", 100.0)] {
        if (factor / per_meter - 1.0).abs() < NEAR {
            return format!("`{field}` seems to be in {unit}: divide it by {per_meter}");
        }
    }
    "both are in meters: check the depths of the camera, and that each pair is of one point"
        .to_owned()
}

fn reading_hint(mount: CameraMount, reading: Reading) -> String {
    let mut parts = Vec::new();
    if reading.flange_scalar_first || reading.board_scalar_first {
        parts.push("quaternions are x, y, z, w: some programs write w first".to_owned());
    }
    if reading.inverted {
        let other = match mount {
            CameraMount::Fixed => "wrist",
            CameraMount::Wrist => "fixed",
        };
        parts.push(format!(
            "`base_from_flange` is the flange's pose in the frame of the base, `camera_from_board` the board's in that \
             of the camera, as `solvePnP` gives it; if they are that, write `\"camera\": \"{other}\"`"
        ));
    }
    parts.join("; ")
}
