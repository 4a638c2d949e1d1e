//! The stage: the rollouts of one object's candidates.

use std::collections::BTreeMap;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum,
    Unit,
};
use lake::{SiblingTable, WriteArtifact};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    objects::Object,
    rollouts::{Rollout, Rollouts, Verdict},
    smoothness::{CandidateSmoothness, ExecutedSmoothness, Smoothness, SmoothnessTable},
    tally::Tally,
};
use screening::Judgment;
use simulation::{Flexion, ProtocolName, TraceMode, check_hand};

use crate::{
    ScreenConfig, ScreenError,
    by_verdict::ByVerdict,
    pose_errors::PoseErrorTrials,
    recording::{self, record},
    robustness::RobustnessTrials,
    screening_inputs::{ScreeningInputs, units},
};

/// Judges candidate motions in physics.
pub struct Screen;

dataflow::metrics! {
    /// Metrics of an object's rollouts.
    pub struct ScreenMetrics {
        /// Number of candidates.
        candidates_n: Sum,
        /// Number of those that succeed.
        accepted_n: Sum,
        /// Steps of control that physics took.
        control_steps_n: Sum,
        /// Processor time of all rollouts, in seconds.
        cpu_s: Sum,
        /// Number of candidates of each verdict.
        verdicts_n: ByVerdict,
    }
}

impl Stage for Screen {
    type Config = ScreenConfig;

    const KIND: &'static str = "screen";
    const ABOUT: &'static str = "Judges candidate motions in physics";
    const INPUTS: &'static [&'static str] = &[Candidates::NAME, Object::NAME];
    const OUTPUTS: Outputs<Self> = &[
        &Self,
        &SiblingTable::<Self, SmoothnessTable>::OUTPUT,
        &RobustnessTrials,
        &PoseErrorTrials,
    ];

    /// Checks that the hand can be read, and be simulated as the options say.
    fn prepare(config: &ScreenConfig) -> Result<(), BoxedDiagnostic> {
        let config = config.resolved();
        let hand = robot_meshes::load(&config.hand)?.model;
        check_hand(&config.scene, &hand)
            .and_then(|()| Flexion::new(&config.protocol, &hand).map(drop))
            .map_err(|source| ScreenError::Options {
                path: config.hand.clone(),
                source,
            })?;
        Ok(())
    }
}

impl Output for Screen {
    type Stage = Self;
    type Metrics = ScreenMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Rollouts::NAME;
    const SCHEMA: &'static str = Rollouts::VERSION;
    const PARTITION: &'static str = Rollouts::PARTITION;

    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["robustness", "pose_errors_per_object"]);

    fn units(config: &ScreenConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let candidates = scope.non_empty(Candidates::NAME, "to screen")?;
        units(config, scope, candidates)
    }

    fn make(
        config: &ScreenConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ScreenMetrics>, BoxedDiagnostic> {
        let Some(screened) = ScreeningInputs::read(inputs, cx)? else {
            return Ok(Outcome::skipped("object missing"));
        };
        let config = &config.resolved();
        let screening = screened.screening(config, cx.seed());
        let scenes = match screening.build_scenes() {
            Ok(scenes) => scenes,
            Err(err) => return screened.skip_or_fail(err),
        };
        let judged = screening.judge(&scenes, |share| cx.progress(share, "in physics"));
        let (found, cpu_s) = match judged {
            Ok(judged) => judged,
            Err(err) => return screened.skip_or_fail(err),
        };
        let candidates = screened.candidates.candidates.iter().zip(&found);
        let (rollouts, smoothness): (Rollouts, SmoothnessTable) = candidates
            .map(|(of, found)| {
                (
                    row(of, config.protocol.name, found.as_ref()),
                    smoothness(of, found.as_ref()),
                )
            })
            .unzip();

        cx.write(&rollouts)?;
        cx.write(&smoothness)?;
        let context = recording::RecordingContext {
            urdf: &screened.xml,
            model: &screened.hand,
            object: &screened.object,
        };
        let verdicts: Vec<Verdict> = rollouts.iter().map(|rollout| rollout.verdict).collect();
        let shown = accepted(&verdicts).take(config.recorded_per_object);
        let failed_n = config.recorded_failures_per_object;
        for idx in shown.chain(failures(&verdicts).into_iter().take(failed_n)) {
            // Equal arguments give an equal rollout: it is run again, now with its trace.
            match screening.rollout(&scenes, idx, TraceMode::Trace) {
                Ok(rollout) => record(&context, &rollouts[idx], &rollout, cx.folder())?,
                Err(err) => return screened.skip_or_fail(err),
            }
        }
        Ok(Outcome::Made(ScreenMetrics::of(&rollouts, cpu_s)))
    }
}

/// Returns the row of a candidate, judged by a protocol.
pub fn row(candidate: &Candidate, protocol: ProtocolName, found: Option<&Judgment>) -> Rollout {
    let infeasible = Rollout {
        protocol: Some(protocol.as_str().to_owned()),
        ..Rollout::unsimulated(candidate, Verdict::Infeasible)
    };
    match found {
        None => infeasible,
        Some(found) => Rollout {
            verdict: found.verdict,
            measures: found.measures,
            ..infeasible
        },
    }
}

/// Returns the smoothness of a candidate.
fn smoothness(candidate: &Candidate, found: Option<&Judgment>) -> CandidateSmoothness {
    CandidateSmoothness {
        candidate_id: candidate.candidate_id.clone(),
        drawn: found.map_or_else(Smoothness::default, |found| found.smoothness),
        executed: ExecutedSmoothness(found.and_then(|found| found.executed)),
    }
}

impl ScreenMetrics {
    fn of(rollouts: &[Rollout], cpu_s: f64) -> Self {
        let verdicts: Tally<Verdict> = rollouts.iter().map(|r| (r.verdict, 1)).collect();
        Self {
            candidates_n: rollouts.len() as f64,
            accepted_n: verdicts.success_count() as f64,
            control_steps_n: rollouts
                .iter()
                .map(|r| f64::from(r.measures.control_steps_n))
                .sum(),
            cpu_s,
            verdicts_n: verdicts,
        }
    }
}

/// Returns the numbers of the rollouts that succeed.
fn accepted(verdicts: &[Verdict]) -> impl Iterator<Item = usize> {
    (0..verdicts.len()).filter(|&idx| verdicts[idx] == Verdict::Held)
}

/// Returns the numbers of the failed rollouts that have a trace: the first of each verdict, then the second
/// ones.
fn failures(verdicts: &[Verdict]) -> Vec<usize> {
    let mut counts: BTreeMap<Verdict, usize> = BTreeMap::new();
    let mut failures: Vec<(usize, usize)> = Vec::new();
    for (idx, verdict) in verdicts.iter().enumerate() {
        match verdict {
            Verdict::Held
            | Verdict::Limit
            | Verdict::Table
            | Verdict::EarlyContact
            | Verdict::Diverged
            | Verdict::Infeasible => {}
            Verdict::KnockedOver
            | Verdict::NotGrasped
            | Verdict::Slipped
            | Verdict::Dropped
            | Verdict::TooDeep
            | Verdict::Overloaded => {
                let count = counts.entry(*verdict).or_default();
                failures.push((*count, idx));
                *count += 1;
            }
        }
    }
    failures.sort_unstable();
    failures.into_iter().map(|(_, idx)| idx).collect()
}

#[cfg(test)]
mod tests {
    use motion::{HandRates, Motion, Step};
    use schemas::candidates::DrawSource;
    use spatial::Pose;

    use super::*;

    #[test]
    fn a_motion_that_the_hand_cannot_execute_is_a_row_of_its_candidate() {
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::identity(),
            q_rad: vec![0.0],
            rates: HandRates::zero(1),
        };
        let candidate = Candidate {
            candidate_id: "b".to_owned(),
            generator: "test".to_owned(),
            source: DrawSource::replayed("b"),
            latent: Vec::new(),
            table_from_object: Pose::identity(),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: Motion::new(&["j"], vec![step(0.0), step(1.0)]).unwrap(),
        };
        let row = row(&candidate, ProtocolName::FullContact, None);
        assert_eq!(
            (row.candidate_id.as_str(), row.verdict),
            ("b", Verdict::Infeasible)
        );
        assert_eq!(row.source, candidate.source);
        assert_eq!(row.protocol.as_deref(), Some("full_contact"));
        assert_eq!(
            (row.measures.control_steps_n, row.measures.skipped_steps_n),
            (0, None)
        );
    }

    #[test]
    fn failures_are_one_of_each_reason_before_a_second_of_any() {
        use Verdict::{Diverged, Dropped, Held, KnockedOver, NotGrasped, Table, TooDeep};
        let verdicts = [
            Table,
            NotGrasped,
            Held,
            NotGrasped,
            Diverged,
            TooDeep,
            KnockedOver,
            TooDeep,
            Held,
            Dropped,
        ];
        assert_eq!(failures(&verdicts), [1, 5, 6, 9, 3, 7]);
        assert_eq!(accepted(&verdicts).collect::<Vec<_>>(), [2, 8]);
    }
}
