//! Whether the poses are given as the file says.

use std::fmt;

use nalgebra::{Isometry3, UnitQuaternion};
use spatial::quaternion_xyzw;

use crate::{
    error::{CalibrationError, Field},
    hand_eye::{CameraMount, thinned},
    loops::{Loop, cost},
    park_martin,
};

/// A reading of poses other than the given one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// The flange's poses are inverted, or the board's. Either has the same residual: a loop that closes also does
    /// backward, with the poses of camera and board exchanged. For the same reason both inverted cannot be told.
    pub inverted: bool,
    /// The first number of the flange's quaternions is `w`.
    pub flange_scalar_first: bool,
    /// The first number of the board's quaternions is `w`.
    pub board_scalar_first: bool,
}

impl Reading {
    /// Returns every reading but the given one.
    fn others() -> impl Iterator<Item = Self> {
        (1..8).map(|number| Self {
            inverted: number & 1 > 0,
            flange_scalar_first: number & 2 > 0,
            board_scalar_first: number & 4 > 0,
        })
    }

    fn read(self, mount: CameraMount, it: &Loop) -> Loop {
        let flange = |flange: &Isometry3<f64>| {
            if self.flange_scalar_first {
                scalar_first(flange)
            } else {
                *flange
            }
        };
        let a = match mount {
            CameraMount::Fixed => flange(&it.a.inverse()).inverse(),
            CameraMount::Wrist => flange(&it.a),
        };
        Loop {
            a: if self.inverted { a.inverse() } else { a },
            b: if self.board_scalar_first {
                scalar_first(&it.b)
            } else {
                it.b
            },
        }
    }
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (flange, board) = (Field::Flange, Field::Board);
        let inverted = format!("`{flange}` or `{board}` inverted");
        let scalar_first = match (self.flange_scalar_first, self.board_scalar_first) {
            (true, true) => format!("quaternions as wxyz of `{flange}` and `{board}`"),
            (true, false) => format!("quaternions as wxyz of `{flange}`"),
            (false, true) => format!("quaternions as wxyz of `{board}`"),
            (false, false) => return f.write_str(&inverted),
        };
        if self.inverted {
            write!(f, "{inverted}, and {scalar_first}")
        } else {
            f.write_str(&scalar_first)
        }
    }
}

/// Factor by which another reading must lower the residual.
const FAR_BETTER: f64 = 10.0;
/// Residual below which no other reading is considered, in meters.
const GOOD_M: f64 = 1e-5;
/// Poses from which readings are judged.
const JUDGED_BY_N: usize = 20;

/// Refuses poses that another reading makes agree far better.
pub(crate) fn check_conventions(
    mount: CameraMount,
    loops: &[Loop],
) -> Result<(), CalibrationError> {
    let loops = thinned(loops, JUDGED_BY_N);
    let rms_m = |loops: &[Loop]| {
        let solution = park_martin::solve(loops)?;
        Some((cost(loops, &solution) / loops.len() as f64).sqrt())
    };
    let given = rms_m(&loops).ok_or(CalibrationError::NoSolution)?;
    if given < GOOD_M {
        return Ok(());
    }
    let mut best = (given / FAR_BETTER, None);
    for reading in Reading::others() {
        let read: Vec<Loop> = loops.iter().map(|it| reading.read(mount, it)).collect();
        if let Some(found) = rms_m(&read)
            && found < best.0
        {
            best = (found, Some(reading));
        }
    }
    match best {
        (found, Some(reading)) => Err(CalibrationError::Convention {
            mount,
            reading,
            factor: given / found.max(GOOD_M),
        }),
        (_, None) => Ok(()),
    }
}

/// Returns the pose whose quaternion has the numbers of another, the first of which is `w`.
fn scalar_first(given: &Isometry3<f64>) -> Isometry3<f64> {
    let [w, x, y, z]: [f64; 4] = given.rotation.coords.into();
    // The same numbers have the same length.
    let rotation = quaternion_xyzw([x, y, z, w]);
    let rotation = rotation.unwrap_or_else(|_| UnitQuaternion::identity());
    Isometry3::from_parts(given.translation, rotation)
}
