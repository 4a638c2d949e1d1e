//! How often the motions for each object succeed, at each cell.

use std::collections::BTreeMap;

use dataflow::{Context, Inputs, Labels, Made, Outcome, Scope, Summary, Unit};
use lake::WriteArtifact;
use schemas::{
    executions::{self, Execution, Executions},
    success::wilson,
    trials::Trials,
};
use stage_dispatch::{DispatchError, EXECUTIONS};

/// Key of the one partition.
const ALL: &str = "all";

/// One unit, of all objects of which motions were to be sent.
pub(crate) fn units(scope: &Scope) -> Vec<Unit> {
    let sent = scope.partitions(EXECUTIONS).iter();
    let keys: Vec<&str> = sent.map(|executions| executions.key.as_str()).collect();
    if keys.is_empty() {
        return Vec::new();
    }
    let unit = Unit::new(ALL)
        .reading(EXECUTIONS, keys)
        .only_files(EXECUTIONS, [lake::table::FILE]);
    vec![unit]
}

/// Makes the table.
pub(crate) fn make(inputs: &Inputs, cx: &Context) -> Result<Outcome, DispatchError> {
    let mut rows = Vec::new();
    for artifact in inputs.artifacts(EXECUTIONS) {
        let sent: Executions = lake::table::read(artifact)?;
        rows.extend(of_object(&artifact.key, &sent));
    }
    cx.write(&rows)?;
    Ok(Outcome::Made(Made {
        labels: Labels::new(),
        metrics: metrics(&rows),
    }))
}

/// Says how often motions succeed, of whichever object.
pub(crate) fn describe(summary: &Summary) -> String {
    let [trials, successes, simulated, unknown, stopped] = [
        "trials_n",
        "successes_n",
        "simulated_n",
        "unknown_n",
        "stopped_n",
    ]
    .map(|name| summary.total(name));
    let by_people = if stopped > 0.0 {
        format!("; {stopped:.0} stopped by a person, which are no trials")
    } else {
        String::new()
    };
    if trials == 0.0 {
        return format!("no trial: no robot cell has carried out a motion{by_people}");
    }
    let [rate, low, high] =
        ["rate", "rate_low", "rate_high"].map(|name| 100.0 * summary.total(name));
    let succeed = if simulated >= trials {
        "succeed"
    } else if simulated > 0.0 {
        "succeed, some simulated"
    } else {
        "succeed on the robot"
    };
    let line = format!(
        "{successes:.0} of {trials:.0} {succeed}: {rate:.1} % (95 % CI {low:.1} to {high:.1}){by_people}"
    );
    // First, so that it is not cut.
    if unknown > 0.0 {
        return format!("{unknown:.0} unknown, look at the robot before going on; {line}");
    }
    line
}

/// Returns one row for each cell that was to move for an object, in the order of their names.
fn of_object(object: &str, executions: &[Execution]) -> Vec<Trials> {
    let mut by_cell: BTreeMap<(&str, bool), Trials> = BTreeMap::new();
    for execution in executions {
        let key = (execution.cell.as_str(), execution.simulated);
        let row = by_cell.entry(key).or_insert_with(|| Trials {
            object: object.to_owned(),
            cell: execution.cell.clone(),
            simulated: execution.simulated,
            gap: String::new(),
            outcomes_n: [0; executions::Outcome::ALL.len()],
        });
        if row.gap.is_empty() {
            row.gap.clone_from(&execution.gap);
        }
        for (n, outcome) in row.outcomes_n.iter_mut().zip(executions::Outcome::ALL) {
            *n += i64::from(outcome == execution.outcome);
        }
    }
    by_cell.into_values().collect()
}

/// The figures of all trials together.
fn metrics(rows: &[Trials]) -> BTreeMap<String, f64> {
    let sum = |number: &dyn Fn(&Trials) -> i64| rows.iter().map(number).sum::<i64>();
    let trials_n = sum(&Trials::trials_n);
    let successes_n = sum(&Trials::successes_n);
    let [low, high] = wilson(successes_n, trials_n);
    let mut objects: Vec<&str> = rows.iter().map(|row| row.object.as_str()).collect();
    objects.dedup();
    let simulated = |row: &Trials| if row.simulated { row.trials_n() } else { 0 };
    [
        ("objects_n", objects.len() as f64),
        ("trials_n", trials_n as f64),
        ("successes_n", successes_n as f64),
        ("simulated_n", sum(&simulated) as f64),
        (
            "unknown_n",
            sum(&|row| row.count(executions::Outcome::Unknown)) as f64,
        ),
        (
            "stopped_n",
            sum(&|row| row.count(executions::Outcome::Stopped)) as f64,
        ),
        ("rate", successes_n as f64 / trials_n.max(1) as f64),
        ("rate_low", low),
        ("rate_high", high),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into()
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
    fn rows_are_by_cell_and_what_was_not_sent_is_no_trial() {
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
        assert_eq!((real.trials_n(), real.successes_n()), (3, 2));
        assert_eq!((simulated.trials_n(), simulated.successes_n()), (1, 0));
        let summary = Summary {
            n_made: 1,
            totals: metrics(&rows),
            ..Summary::default()
        };
        assert_eq!(
            describe(&summary),
            "1 unknown, look at the robot before going on; 2 of 4 succeed, some simulated: 50.0 % (95 % CI 15.0 to 85.0); 1 stopped by a person, which are no trials"
        );
    }
}
