//! Trials of motions, accepted or not, where the object lies off its estimated pose.

use dataflow::{BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Scope, Sum, Unit};
use lake::WriteArtifact;
use schemas::{
    Table,
    candidates::Candidates,
    pose_errors::{PoseErrorTrial, PoseErrors},
    rollouts::Verdict,
};
use screening::PoseError;

use crate::{
    Screen, ScreenConfig,
    screening_inputs::{ScreeningInputs, units},
};

/// Size of an error: distance on the table, in millimeters, and yaw, in degrees.
type Size = (f64, f64);
const NONE: Size = (0.0, 0.0);
/// The size of which the stage's line tells.
pub(crate) const BOTH: Size = (5.0, 5.0);
const SIZES: [Size; 7] = [
    NONE,
    (2.0, 0.0),
    (5.0, 0.0),
    (10.0, 0.0),
    (0.0, 5.0),
    (0.0, 10.0),
    BOTH,
];

/// The output `pose_errors`: whether motions succeed where the object lies off its estimated pose.
pub struct PoseErrorTrials;

dataflow::metrics! {
    /// Metrics of the trials of an object's motions.
    pub struct PoseErrorMetrics {
        /// Number of motions that were tried.
        motions_n: Sum,
        /// Number of these that succeed without an error.
        held_n: Sum,
        /// Number of those that succeed with the object off by both distance and yaw.
        off_held_n: Sum,
        /// Steps of control that physics took.
        control_steps_n: Sum,
    }
}

impl Output for PoseErrorTrials {
    type Stage = Screen;
    type Metrics = PoseErrorMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = PoseErrors::NAME;
    const SCHEMA: &'static str = PoseErrors::VERSION;
    const PARTITION: &'static str = PoseErrors::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&[
        "recorded_per_object",
        "recorded_failures_per_object",
        "robustness",
        "pose_noise",
        "pose_error",
    ]);

    fn units(config: &ScreenConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        units(config, scope, scope.partitions(Candidates::NAME))
    }

    fn make(
        config: &ScreenConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<PoseErrorMetrics>, BoxedDiagnostic> {
        let Some(screened) = ScreeningInputs::read(inputs, cx)? else {
            return Ok(Outcome::skipped("object missing"));
        };
        let config = &config.resolved();
        let candidates = &screened.candidates.candidates;
        let motions = evenly(candidates.len(), config.pose_errors_per_object);
        if motions.is_empty() {
            // No scene has to settle.
            cx.write(&PoseErrors::new())?;
            return Ok(Outcome::Made(PoseErrorMetrics::of(&[], 0)));
        }
        let screening = screened.screening(config, cx.seed());
        let scenes = match screening.build_scenes() {
            Ok(scenes) => scenes,
            Err(err) => return screened.skip_or_fail(err),
        };
        let mut rows = PoseErrors::new();
        for (nth, &size) in SIZES.iter().enumerate() {
            let (position_m, yaw_rad) = in_si(size);
            let config = ScreenConfig {
                pose_error: PoseError {
                    position_m,
                    yaw_rad,
                },
                pose_noise: 0.0,
                ..config.clone()
            };
            let screening = screened.screening(&config, cx.seed());
            let verdicts = match screening.verdicts(&scenes, &motions) {
                Ok(verdicts) => verdicts,
                Err(err) => return screened.skip_or_fail(err),
            };
            rows.extend(motions.iter().zip(verdicts).map(
                |(&motion, (verdict, control_steps_n))| PoseErrorTrial {
                    candidate_id: candidates[motion].candidate_id.clone(),
                    position_m,
                    yaw_rad,
                    verdict,
                    control_steps_n: i64::from(control_steps_n),
                },
            ));
            cx.progress(
                (nth + 1) as f64 / SIZES.len() as f64,
                "with the object off its pose",
            );
        }
        cx.write(&rows)?;
        Ok(Outcome::Made(PoseErrorMetrics::of(&rows, motions.len())))
    }
}

/// Returns a size in meters and radians.
fn in_si((position_mm, yaw_deg): Size) -> (f64, f64) {
    (position_mm / 1000.0, yaw_deg.to_radians())
}

/// Returns `most` of `n` indices, or all, evenly spaced from the first.
fn evenly(n: usize, most: usize) -> Vec<usize> {
    let chosen_n = most.min(n);
    (0..chosen_n).map(|idx| idx * n / chosen_n).collect()
}

impl PoseErrorMetrics {
    fn of(rows: &[PoseErrorTrial], motions_n: usize) -> Self {
        let held = |size: Size| {
            let held = rows.iter().filter(|row| {
                row.verdict == Verdict::Held && (row.position_m, row.yaw_rad) == in_si(size)
            });
            held.count() as f64
        };
        Self {
            motions_n: motions_n as f64,
            held_n: held(NONE),
            off_held_n: held(BOTH),
            control_steps_n: rows.iter().map(|row| row.control_steps_n as f64).sum(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_are_spread_over_the_candidates() {
        assert_eq!(evenly(64, 8), [0, 8, 16, 24, 32, 40, 48, 56]);
        assert_eq!(evenly(65, 8), [0, 8, 16, 24, 32, 40, 48, 56]);
        assert_eq!(evenly(3, 8), [0, 1, 2]);
        assert_eq!(evenly(9, 4), [0, 2, 4, 6]);
        assert_eq!(evenly(9, 8), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert!(evenly(0, 8).is_empty() && evenly(5, 0).is_empty());
    }
}
