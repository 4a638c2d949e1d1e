//! Trials of accepted motions under drawn errors.

use dataflow::{BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Scope, Sum, Unit};
use lake::{ReadInputs, WriteArtifact};
use schemas::{
    Table,
    candidates::Candidates,
    robustness::{Robustness, RobustnessTable, TrialVerdict},
    rollouts::{Rollouts, Verdict},
};
use screening::MotionTrials;

use crate::{
    Screen, ScreenConfig, ScreenError,
    config::RobustnessConfig,
    screening_inputs::{ScreeningInputs, units},
};

/// The output `robustness`: how often accepted motions succeed under drawn errors.
pub struct RobustnessTrials;

dataflow::metrics! {
    /// Metrics of the trials of an object's motions.
    pub struct RobustnessMetrics {
        /// Number of motions that were tried.
        motions_n: Sum,
        /// Number of their trials.
        trials_n: Sum,
        /// Number of the trials that succeeded.
        held_n: Sum,
        /// Number of motions that succeeded in all their trials.
        always_n: Sum,
        /// Steps of control that physics took.
        control_steps_n: Sum,
    }
}

impl Output for RobustnessTrials {
    type Stage = Screen;
    type Metrics = RobustnessMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = RobustnessTable::NAME;
    const SCHEMA: &'static str = RobustnessTable::VERSION;
    const PARTITION: &'static str = RobustnessTable::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&[
        "recorded_per_object",
        "recorded_failures_per_object",
        "pose_errors_per_object",
    ]);

    fn units(config: &ScreenConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let rollouts = scope.partitions(Rollouts::NAME);
        let units = units(config, scope, rollouts)?.into_iter().zip(rollouts);
        let unit = |(unit, rollouts): (Unit, &dataflow::Partition)| {
            unit.reading(Rollouts::NAME, [&rollouts.key])
                .only_files(Rollouts::NAME, [lake::table::FILE])
        };
        Ok(units.map(unit).collect())
    }

    fn make(
        config: &ScreenConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<RobustnessMetrics>, BoxedDiagnostic> {
        let rollouts: Rollouts = inputs.one()?;
        let Some(screened) = ScreeningInputs::read(inputs, cx)? else {
            return Ok(Outcome::skipped("object missing"));
        };
        let config = &config.resolved();
        let RobustnessConfig {
            trials,
            per_object,
            errors,
        } = &config.robustness;
        let motions = tried(&rollouts, &screened, *per_object)?;
        let rows = if motions.is_empty() || *trials == 0 {
            RobustnessTable::new()
        } else {
            let progress = |share: f64| cx.progress(share, "under sampled errors");
            let screening = screened.screening(config, cx.seed());
            match screening.trials(&motions, *trials, errors, progress) {
                Ok(tried) => rows(&screened.candidates, &motions, tried),
                Err(err) => return screened.skip_or_fail(err),
            }
        };
        cx.write(&rows)?;
        Ok(Outcome::Made(RobustnessMetrics::of(&rows)))
    }
}

impl RobustnessMetrics {
    fn of(rows: &[Robustness]) -> Self {
        let sum = |number: fn(&Robustness) -> i64| rows.iter().map(number).sum::<i64>() as f64;
        Self {
            motions_n: rows.len() as f64,
            trials_n: sum(|row| row.trials.total_count()),
            held_n: sum(|row| row.trials.success_count()),
            always_n: sum(|row| i64::from(row.trials.total_count() == row.trials.success_count())),
            control_steps_n: sum(|row| row.control_steps_n),
        }
    }
}

/// Returns the first accepted motions, by their numbers among the candidates.
fn tried(
    rollouts: &Rollouts,
    screened: &ScreeningInputs,
    per_object: usize,
) -> Result<Vec<usize>, ScreenError> {
    let held = rollouts
        .iter()
        .filter(|rollout| rollout.verdict == Verdict::Held);
    held.take(per_object)
        .map(|rollout| {
            let mut candidates = screened.candidates.candidates.iter();
            let found = candidates.position(|of| of.candidate_id == rollout.candidate_id);
            found.ok_or_else(|| ScreenError::UnknownCandidate {
                partition: screened.candidates.object.clone(),
                candidate: rollout.candidate_id.clone(),
            })
        })
        .collect()
}

/// Returns the rows of motions, of their trials.
fn rows(candidates: &Candidates, motions: &[usize], tried: Vec<MotionTrials>) -> RobustnessTable {
    let rows = motions.iter().zip(tried);
    rows.map(|(&motion, tried)| {
        let verdicts = tried.verdicts.into_iter();
        Robustness {
            candidate_id: candidates.candidates[motion].candidate_id.clone(),
            trials: verdicts.map(|verdict| (TrialVerdict(verdict), 1)).collect(),
            control_steps_n: tried.control_steps_n,
        }
    })
    .collect()
}
