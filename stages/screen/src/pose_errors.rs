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

/// Sizes of the errors, from none to both: distance on the table, in millimeters, and yaw, in degrees.
const SIZES: [(f64, f64); 7] = [
    (0.0, 0.0),
    (2.0, 0.0),
    (5.0, 0.0),
    (10.0, 0.0),
    (0.0, 5.0),
    (0.0, 10.0),
    (5.0, 5.0),
];

/// The output `pose_errors`: whether motions hold where the object lies off its estimated pose.
pub struct PoseErrorTrials;

dataflow::metrics! {
    /// Metrics of the trials of an object's motions.
    pub struct PoseErrorMetrics {
        /// Number of motions that were tried.
        motions_n: Sum,
        /// Number of these that hold without an error.
        held_n: Sum,
        /// Number of those that hold with the object 5 mm and 5 degrees off.
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
        let motions = evenly(candidates.len(), config.robustness.pose_error_motions());
        let screening = screened.screening(config, cx.seed());
        let scenes = match screening.scenes(&config.scene, &motions) {
            Ok(scenes) => scenes,
            Err(err) => return screened.skip_or_fail(err),
        };
        let mut rows = PoseErrors::new();
        for (nth, &(position_mm, yaw_deg)) in SIZES.iter().enumerate() {
            let (position_m, yaw_rad) = (position_mm / 1000.0, f64::to_radians(yaw_deg));
            let config = ScreenConfig {
                pose_error: PoseError {
                    position_m,
                    yaw_rad,
                },
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

/// Returns at most `most` of `n` indices, evenly spaced from the first.
fn evenly(n: usize, most: usize) -> Vec<usize> {
    let every = n.div_ceil(most.max(1)).max(1);
    (0..n).step_by(every).take(most).collect()
}

impl PoseErrorMetrics {
    fn of(rows: &[PoseErrorTrial], motions_n: usize) -> Self {
        // One size after the other.
        let mut held = rows.chunks(motions_n.max(1)).map(|of_size| {
            let held = of_size.iter().filter(|row| row.verdict == Verdict::Held);
            held.count() as f64
        });
        Self {
            motions_n: motions_n as f64,
            held_n: held.next().unwrap_or_default(),
            off_held_n: held.last().unwrap_or_default(),
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
        assert_eq!(evenly(65, 8), [0, 9, 18, 27, 36, 45, 54, 63]);
        assert_eq!(evenly(3, 8), [0, 1, 2]);
        assert_eq!(evenly(9, 8), [0, 2, 4, 6, 8]);
        assert!(evenly(0, 8).is_empty() && evenly(5, 0).is_empty());
    }
}
