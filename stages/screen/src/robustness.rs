//! Trials of accepted motions under drawn errors.

use dataflow::{BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Scope, Sum, Unit};
use lake::{ReadInputs, WriteArtifact};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use schemas::{
    Table,
    robustness::{Robustness, RobustnessTable, TrialVerdict},
    rollouts::{Rollouts, Verdict},
    tally::Tally,
};
use simulation::{SceneConfig, SimulationError};

use crate::{
    Screen, ScreenConfig, ScreenError,
    config::RobustnessConfig,
    screened::{Screened, units},
    verdicts::Screening,
};

/// The output `robustness`: how often accepted motions hold under drawn errors.
pub struct RobustnessTrials;

dataflow::metrics! {
    /// Metrics of the trials of an object's motions.
    pub struct RobustnessMetrics {
        /// Number of motions that were tried.
        motions_n: Sum,
        /// Number of their trials.
        trials_n: Sum,
        /// Number of the trials that held.
        held_n: Sum,
        /// Number of motions that held in all their trials.
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
    const OPTIONS: OptionsUsed =
        OptionsUsed::Except(&["recorded_per_object", "recorded_failures_per_object"]);

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
        let Some(screened) = Screened::read(inputs, cx)? else {
            return Ok(Outcome::skipped("object missing"));
        };
        let config = &config.resolved();
        let RobustnessConfig { trials, .. } = config.robustness;
        let motions = tried(&rollouts, &screened, config.robustness.per_object)?;
        let rows = if motions.is_empty() || trials == 0 {
            RobustnessTable::new()
        } else {
            let progress = |share: f64| cx.progress(share, "under sampled errors");
            let screening = screened.screening(config, cx.seed());
            match robustness(config, &screening, &motions, cx.seed(), progress) {
                Ok(rows) => rows,
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
    screened: &Screened,
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

/// Tries motions of an object under errors that are drawn once for all of them.
fn robustness(
    config: &ScreenConfig,
    screening: &Screening<'_>,
    motions: &[usize],
    seed: u64,
    progress: impl Fn(f64),
) -> Result<RobustnessTable, SimulationError> {
    let RobustnessConfig { trials, .. } = config.robustness;
    let mut verdicts: Vec<Vec<(TrialVerdict, i64)>> =
        vec![Vec::with_capacity(trials); motions.len()];
    let mut steps_n = vec![0; motions.len()];
    for trial in 0..trials {
        let drawn = drawn_scene(config, seed, trial);
        let scenes = screening.scenes(&drawn, motions)?;
        let tried = screening.verdicts(&scenes, motions)?;
        for (idx, (verdict, control_steps_n)) in tried.into_iter().enumerate() {
            verdicts[idx].push((TrialVerdict(verdict), 1));
            steps_n[idx] += i64::from(control_steps_n);
        }
        progress((trial + 1) as f64 / trials as f64);
    }
    let rows = motions.iter().zip(verdicts).zip(steps_n);
    Ok(rows
        .map(|((&motion, verdicts), control_steps_n)| Robustness {
            candidate_id: screening.candidate(motion).candidate_id.clone(),
            trials: verdicts.into_iter().collect::<Tally<TrialVerdict>>(),
            control_steps_n,
        })
        .collect())
}

/// Returns the scene of one trial of an object.
fn drawn_scene(config: &ScreenConfig, seed: u64, trial: usize) -> SceneConfig {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // The first ones draw the pose noise of candidates.
    rng.set_stream(u64::MAX - trial as u64);
    config.robustness.errors.sample(&config.scene, &mut rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    #[test]
    fn each_trial_of_each_seed_has_its_own_errors() {
        let config = config::fixture();
        let drawn = |seed: u64, trial: usize| drawn_scene(&config, seed, trial);
        assert_eq!(drawn(7, 0), drawn(7, 0));
        assert_ne!(drawn(7, 0), drawn(7, 1));
        assert_ne!(drawn(7, 0), drawn(8, 0));
        assert_ne!(drawn(7, 0), config.scene);
    }
}
