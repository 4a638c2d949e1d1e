//! Success rate of each object's motions, by cell.

use std::collections::BTreeMap;

use dataflow::{Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum, Summary, Unit};
use lake::WriteArtifact;
use schemas::{
    Table,
    executions::{self, Execution, Executions},
    tally::wilson,
    trials::{AllTrials, Trials},
};
use stage_dispatch::{Dispatch, DispatchConfig, DispatchError};

/// Key of the one partition.
const ALL: &str = "all";

dataflow::metrics! {
    /// Metrics of all trials together.
    pub struct TrialsMetrics {
        /// Number of objects.
        objects_n: Sum,
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
    type Error = DispatchError;

    const ARTIFACT: &'static str = AllTrials::NAME;
    const SCHEMA: &'static str = AllTrials::VERSION;
    const PARTITION: &'static str = AllTrials::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<TrialsMetrics>> = Some(line);

    /// One unit, of all objects of which motions were to be sent.
    fn units(_config: &DispatchConfig, scope: &Scope) -> Result<Vec<Unit>, DispatchError> {
        let sent = scope.partitions(Executions::NAME).iter();
        let keys: Vec<&str> = sent.map(|executions| executions.key.as_str()).collect();
        if keys.is_empty() {
            return Ok(Vec::new());
        }
        let unit = Unit::new(ALL)
            .reading(Executions::NAME, keys)
            .only_files(Executions::NAME, [lake::table::FILE]);
        Ok(vec![unit])
    }

    fn make(
        _config: &DispatchConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrialsMetrics>, DispatchError> {
        let mut rows = Vec::new();
        for artifact in inputs.artifacts(Executions::NAME) {
            let sent: Executions = lake::table::read(artifact)?;
            rows.extend(of_object(artifact.key.as_str(), &sent));
        }
        cx.write(&rows)?;
        Ok(Outcome::Made(TrialsMetrics::of(&rows)))
    }
}

/// Says how often motions succeed, of whichever object.
fn line(summary: &Summary<TrialsMetrics>) -> String {
    let all = &summary.metrics;
    let by_people = if all.stopped_n > 0.0 {
        format!(
            "; {:.0} stopped by a person, which are no trials",
            all.stopped_n
        )
    } else {
        String::new()
    };
    if all.trials_n == 0.0 {
        return format!("no trial: no robot cell has carried out a motion{by_people}");
    }
    let rate = 100.0 * all.rate();
    let [low, high] = all.interval().map(|end| 100.0 * end);
    let succeed = if all.simulated_n >= all.trials_n {
        "succeed"
    } else if all.simulated_n > 0.0 {
        "succeed, some simulated"
    } else {
        "succeed on the robot"
    };
    let line = format!(
        "{:.0} of {:.0} {succeed}: {rate:.1} % (95 % CI {low:.1} to {high:.1}){by_people}",
        all.successes_n, all.trials_n
    );
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
        let mut objects: Vec<&str> = rows.iter().map(|row| row.object.as_str()).collect();
        objects.dedup();
        Self {
            objects_n: objects.len() as f64,
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
        }
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
        let summary = Summary::made(&[TrialsMetrics::of(&rows)]);
        assert_eq!(
            line(&summary),
            "1 unknown, look at the robot before going on; 2 of 4 succeed, some simulated: 50.0 % (95 % CI 15.0 to 85.0); 1 stopped by a person, which are no trials"
        );
    }
}
