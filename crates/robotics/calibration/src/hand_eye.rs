//! The pose of a camera from poses of a calibration board.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use spatial::{Base, Camera, Pose};

use crate::{
    agreement::{Agreement, Residual},
    board_scale::check_board_scale,
    calibrated::{Board, BoardPose, Calibration, CameraPose, Flange},
    checks::{check_count, check_poses},
    conventions::check_conventions,
    error::CalibrationError,
    loops::{Gap, Loop},
    park_martin, refine,
    rotations::check_rotations,
};

/// Where a camera is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraMount {
    /// It stands still and sees a board on the flange: eye to hand.
    Fixed,
    /// It is on the flange and sees a board that stands still: eye in hand.
    Wrist,
}

/// Poses of flange and board at one posture of the robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePair {
    /// The flange's pose by the robot.
    pub base_from_flange: Pose<Base, Flange>,
    /// The board's pose by the camera.
    pub camera_from_board: Pose<Camera, Board>,
}

/// Fewest poses of which each can be left out.
const LEAVE_ONE_OUT_N: usize = 4;
/// Most poses between all of which motions are taken; of more, as many with equal steps between them.
const MOTIONS_OF_N: usize = 100;

/// Returns the pose of a camera from at least 3 poses with rotations about different axes.
///
/// The start is in closed form (Park and Martin 1994); then the poses of camera and board take the least squares of
/// the differences between the board's measured and predicted poses, in which 0.2° count as 1 mm.
///
/// # Errors
///
/// Fails if there are fewer than 3 or too many poses, if the rotations are about one axis, if a pose occurs twice, if a
/// number is not finite or no position in meters, or if another convention explains the poses far better.
pub fn calibrate_by_poses(
    mount: CameraMount,
    pairs: &[PosePair],
) -> Result<Calibration, CalibrationError> {
    check_count(pairs.len())?;
    check_poses(pairs)?;
    let loops: Vec<Loop> = pairs.iter().map(|pair| as_loop(mount, pair)).collect();
    let some = thinned(&loops, MOTIONS_OF_N);
    check_rotations(mount, &some)?;
    check_conventions(mount, &loops)?;
    let start = park_martin::solve(&some).ok_or(CalibrationError::NoSolution)?;
    check_board_scale(&loops, &start)?;
    let solution = refine::refine(&loops, start);
    let residual = |gap: Gap| Residual {
        offset_m: gap.offset.norm(),
        rotation_rad: Some(gap.rotation.norm()),
    };
    let residuals = loops.iter().map(|it| residual(it.gap(&solution)));
    let held_out = if loops.len() < LEAVE_ONE_OUT_N {
        Vec::new()
    } else {
        let gaps = refine::held_out(&loops, &solution).into_iter();
        gaps.map(|gap| gap.map(residual)).collect()
    };
    let (camera, board) = poses(mount, solution.x, solution.y);
    Ok(Calibration {
        camera,
        board: Some(board),
        residuals: Agreement(residuals.collect()),
        held_out,
    })
}

fn as_loop(mount: CameraMount, pair: &PosePair) -> Loop {
    let base_from_flange = *pair.base_from_flange;
    Loop {
        a: match mount {
            CameraMount::Fixed => base_from_flange.inverse(),
            CameraMount::Wrist => base_from_flange,
        },
        b: *pair.camera_from_board,
    }
}

fn poses(mount: CameraMount, x: Isometry3<f64>, y: Isometry3<f64>) -> (CameraPose, BoardPose) {
    match mount {
        CameraMount::Fixed => (
            CameraPose::Fixed(Pose::new(x)),
            BoardPose::OnFlange(Pose::new(y)),
        ),
        CameraMount::Wrist => (
            CameraPose::Wrist(Pose::new(x)),
            BoardPose::Still(Pose::new(y)),
        ),
    }
}

/// Returns at most `most` loops, with equal steps between them.
pub(crate) fn thinned(loops: &[Loop], most: usize) -> Vec<Loop> {
    let n = loops.len().min(most);
    let idx = |part: usize| part * loops.len() / n.max(1);
    (0..n)
        .filter_map(|part| loops.get(idx(part)).copied())
        .collect()
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::Measurements;

    /// The rotation of the start is that of another implementation of the paper's method, on poses with noise. Its offset
    /// is another: it counts rotations of the board as the camera sees them, and ours as the robot has them.
    #[test]
    fn the_start_has_the_rotation_of_park_and_martin() {
        let golden: Value =
            serde_json::from_str(include_str!("../tests/golden/golden.json")).unwrap();
        for (name, text) in [
            ("fixed", include_str!("../tests/golden/fixed.json")),
            ("wrist", include_str!("../tests/golden/wrist.json")),
        ] {
            let Measurements::Poses { mount, pairs } =
                Measurements::parse(text.as_bytes()).unwrap()
            else {
                panic!("{name} has no poses");
            };
            let loops: Vec<Loop> = pairs.iter().map(|pair| as_loop(mount, pair)).collect();
            let found = park_martin::solve(&loops).unwrap().x.to_homogeneous();
            let theirs = golden[name]["opencv_park"].as_array().unwrap();
            for (idx, number) in theirs.iter().enumerate().filter(|(idx, _)| idx % 4 < 3) {
                let (ours, theirs) = (found[(idx / 4, idx % 4)], number.as_f64().unwrap());
                assert!(
                    (ours - theirs).abs() < 1e-9,
                    "{name} {idx}: {ours} {theirs}"
                );
            }
        }
    }
}
