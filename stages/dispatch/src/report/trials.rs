//! Success rate of each object's motions, by cell.

use std::collections::BTreeMap;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum, Summary, Unit,
};
use lake::WriteArtifact;
use schemas::{
    Table,
    candidates::Candidates,
    draws::Draws,
    executions::{self, Execution, Executions},
    rollouts::{Rollouts, Verdict},
    tally::wilson,
    trials::{AllTrials, Trials},
};

use crate::{Dispatch, DispatchConfig};

/// Key of the one partition.
const ALL: &str = "all";

dataflow::metrics! {
    /// Metrics of all trials together.
    pub struct TrialsMetrics {
        /// Number of objects that were screened.
        objects_n: Sum,
        /// Number of those with a motion that was accepted.
        objects_accepted_n: Sum,
        /// Number of samples, those that were refused before screening included.
        samples_n: Sum,
        /// Number of candidates that were screened.
        candidates_n: Sum,
        /// Number of candidates that were accepted.
        accepted_n: Sum,
        /// Number of trials.
        trials_n: Sum,
        /// Number of those that succeed.
        successes_n: Sum,
        /// Number of those at a simulated cell.
        simulated_n: Sum,
        /// Number of motions of which nobody knows what became.
        unknown_n: Sum,
        /// Number of motions that a person stopped.
        stopped_n: Sum,
    }
    derived {
        rate: Self::rate,
        rate_low: |all| all.interval()[0],
        rate_high: |all| all.interval()[1],
    }
}

/// The report `trials`: how often motions succeed.
pub struct TrialsReport;

impl Output for TrialsReport {
    type Stage = Dispatch;
    type Metrics = TrialsMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = AllTrials::NAME;
    const SCHEMA: &'static str = AllTrials::VERSION;
    const PARTITION: &'static str = AllTrials::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<TrialsMetrics>> = Some(line);

    /// One unit, of all objects that were screened.
    fn units(_config: &DispatchConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let sent = scope.partitions(Executions::NAME).iter();
        let keys: Vec<&str> = sent.map(|executions| executions.key.as_str()).collect();
        if keys.is_empty() {
            return Ok(Vec::new());
        }
        let unit = [Executions::NAME, Rollouts::NAME, Candidates::NAME]
            .into_iter()
            .fold(Unit::new(ALL), |unit, artifact| {
                unit.reading(artifact, keys.clone())
                    .only_files(artifact, [lake::table::FILE, Draws::FILE])
            });
        Ok(vec![unit])
    }

    fn make(
        _config: &DispatchConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrialsMetrics>, BoxedDiagnostic> {
        let mut rows = Vec::new();
        for artifact in inputs.artifacts(Executions::NAME) {
            let sent: Executions = lake::table::read(artifact)?;
            rows.extend(of_object(artifact.key.as_str(), &sent));
        }
        let mut metrics = TrialsMetrics::of(&rows);
        for artifact in inputs.artifacts(Candidates::NAME) {
            metrics.samples_n += lake::table::read_draws(artifact)?.len() as f64;
        }
        for artifact in inputs.artifacts(Rollouts::NAME) {
            metrics.add_screened(&lake::table::read(artifact)?);
        }
        cx.write(&rows)?;
        Ok(Outcome::Made(metrics))
    }
}

/// Says how much succeeds, from samples to executions.
fn line(summary: &Summary<TrialsMetrics>) -> String {
    let all = &summary.metrics;
    let percent = |of_n: f64| 100.0 * all.accepted_n / of_n.max(1.0);
    let screened = format!(
        "objects {:.0}/{:.0}, samples {:.0} %, candidates {:.0} %",
        all.objects_accepted_n,
        all.objects_n,
        percent(all.samples_n),
        percent(all.candidates_n)
    );
    let executions = format!("executions {:.0}/{:.0}", all.successes_n, all.trials_n);
    let executed = if all.trials_n == 0.0 {
        "; no robot cell has executed a motion".to_owned()
    } else if all.simulated_n >= all.trials_n {
        format!(", {executions} simulated")
    } else if all.simulated_n > 0.0 {
        format!("; {executions}, some simulated")
    } else {
        format!("; {executions} on the robot")
    };
    let stopped = match all.stopped_n {
        0.0 => String::new(),
        stopped_n => format!("; {stopped_n:.0} stopped by a person, which are no trials"),
    };
    let line = format!("{screened}{executed}{stopped}");
    // First, so that it is not cut.
    if all.unknown_n > 0.0 {
        return format!(
            "{:.0} unknown, look at the robot before going on; {line}",
            all.unknown_n
        );
    }
    line
}

/// Returns one row for each cell that was to move for an object, in the order of their names.
fn of_object(object: &str, executions: &[Execution]) -> Vec<Trials> {
    let mut by_cell: BTreeMap<(&str, bool), Vec<&Execution>> = BTreeMap::new();
    for execution in executions {
        let key = (execution.cell.as_str(), execution.simulated);
        by_cell.entry(key).or_default().push(execution);
    }
    let row = |((cell, simulated), executions): ((&str, bool), Vec<&Execution>)| {
        let gap = executions
            .iter()
            .find(|execution| !execution.gap.is_empty());
        Trials {
            object: object.to_owned(),
            cell: cell.to_owned(),
            simulated,
            gap: gap.map_or(String::new(), |execution| execution.gap.clone()),
            outcomes: executions.iter().map(|e| (e.outcome, 1)).collect(),
        }
    };
    by_cell.into_iter().map(row).collect()
}

impl TrialsMetrics {
    fn of(rows: &[Trials]) -> Self {
        let sum = |number: &dyn Fn(&Trials) -> i64| rows.iter().map(number).sum::<i64>() as f64;
        Self {
            trials_n: sum(&|row| row.outcomes.total_count()),
            successes_n: sum(&|row| row.outcomes.success_count()),
            simulated_n: sum(&|row| {
                if row.simulated {
                    row.outcomes.total_count()
                } else {
                    0
                }
            }),
            unknown_n: sum(&|row| row.outcomes.count(executions::Outcome::Unknown)),
            stopped_n: sum(&|row| row.outcomes.count(executions::Outcome::Stopped)),
            objects_n: 0.0,
            objects_accepted_n: 0.0,
            samples_n: 0.0,
            candidates_n: 0.0,
            accepted_n: 0.0,
        }
    }

    /// Counts the screened candidates of an object.
    fn add_screened(&mut self, of_object: &Rollouts) {
        let verdicts = of_object.iter().map(|rollout| rollout.verdict);
        let accepted_n = verdicts.filter(|verdict| *verdict == Verdict::Held).count();
        self.objects_n += 1.0;
        self.objects_accepted_n += f64::from(accepted_n > 0);
        self.candidates_n += of_object.len() as f64;
        self.accepted_n += accepted_n as f64;
    }

    /// Share of the trials that succeed.
    fn rate(&self) -> f64 {
        self.successes_n / self.trials_n.max(1.0)
    }

    /// The 95 % interval of that share.
    fn interval(&self) -> [f64; 2] {
        wilson(self.successes_n, self.trials_n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn execution(cell: &str, simulated: bool, outcome: executions::Outcome) -> Execution {
        Execution {
            goal_id: "00ff".to_owned(),
            candidate_id: "can-0".to_owned(),
            cell: cell.to_owned(),
            simulated,
            gap: "mass".to_owned(),
            accepted: true,
            outcome,
            message: String::new(),
            duration_s: 1.0,
            tracking_error_rad: 0.0,
            lift_m: 0.0,
        }
    }

    #[test]
    fn rows_are_by_cell_and_count_only_sent_motions() {
        use executions::Outcome::{Aborted, Rejected, Stopped, Succeeded, Unknown};
        let mut all: Vec<Execution> = [Rejected, Succeeded, Succeeded, Unknown, Stopped]
            .map(|outcome| execution("lab", false, outcome))
            .into();
        all[0].gap = String::new();
        all.push(execution("lab", true, Aborted));
        let rows = of_object("can", &all);
        let [real, simulated] = &rows[..] else {
            panic!("{rows:?}");
        };
        assert!(!real.simulated && simulated.simulated);
        assert_eq!(real.gap, "mass");
        assert_eq!(
            (real.outcomes.total_count(), real.outcomes.success_count()),
            (3, 2)
        );
        assert_eq!(
            (
                simulated.outcomes.total_count(),
                simulated.outcomes.success_count()
            ),
            (1, 0)
        );
        assert_eq!(
            said(&TrialsMetrics::of(&rows)),
            "1 unknown, look at the robot before going on; objects 1/2, samples 10 %, candidates 40 %; executions 2/4, some simulated; 1 stopped by a person, which are no trials"
        );
    }

    /// The line of two objects of which one has accepted motions: 4 of 10 candidates, of 40 samples.
    fn said(trials: &TrialsMetrics) -> String {
        line(&Summary::made(&[TrialsMetrics {
            objects_n: 2.0,
            objects_accepted_n: 1.0,
            samples_n: 40.0,
            candidates_n: 10.0,
            accepted_n: 4.0,
            ..trials.clone()
        }]))
    }

    #[test]
    fn the_line_leads_with_what_was_screened() {
        let of = |executions: &[Execution]| said(&TrialsMetrics::of(&of_object("can", executions)));
        let succeeded = |simulated| execution("lab", simulated, executions::Outcome::Succeeded);
        let screened = "objects 1/2, samples 10 %, candidates 40 %";
        assert_eq!(
            of(&[succeeded(true)]),
            format!("{screened}, executions 1/1 simulated")
        );
        assert_eq!(
            of(&[succeeded(false)]),
            format!("{screened}; executions 1/1 on the robot")
        );
        assert_eq!(
            of(&[]),
            format!("{screened}; no robot cell has executed a motion")
        );
    }
}
