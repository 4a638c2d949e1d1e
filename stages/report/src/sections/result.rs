//! The headline, with its interval and denominator, and the protocol beside it.

use std::collections::BTreeMap;

use schemas::{
    executions::Outcome,
    rates::{ALL_ORIGINS, Rate},
    rollouts::Verdict,
    tally::{OutcomeClass, wilson},
};

use crate::{
    PageData,
    numbers::{percent, signed},
    protocol,
    render::Head,
    table::{Cell, DataTable, Section},
};

/// Executions that count, by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[expect(clippy::struct_field_names, reason = "they are counts")]
pub(crate) struct TrialCounts {
    pub(crate) trials_n: i64,
    pub(crate) successes_n: i64,
    pub(crate) simulated_n: i64,
}

/// Counts the trials at cells.
pub(crate) fn trials(gathered: &PageData) -> TrialCounts {
    let all = gathered.executions.values().flatten();
    let trials: Vec<_> = all.filter(|one| one.outcome.is_trial()).collect();
    let count = |n: usize| signed(n);
    TrialCounts {
        trials_n: count(trials.len()),
        successes_n: count(
            trials
                .iter()
                .filter(|one| one.outcome == Outcome::Succeeded)
                .count(),
        ),
        simulated_n: count(trials.iter().filter(|one| one.simulated).count()),
    }
}

/// Motions of all objects from samples to accepted candidates.
#[expect(clippy::struct_field_names, reason = "they are counts")]
struct ScreeningCounts {
    objects_n: usize,
    /// Objects with an accepted motion.
    objects_accepted_n: usize,
    /// Samples, those refused before screening included, if they were counted.
    samples_n: Option<i64>,
    candidates_n: i64,
    accepted_n: i64,
}

impl ScreeningCounts {
    /// Counts the motions; `None` if nothing was screened.
    fn of(gathered: &PageData) -> Option<Self> {
        let mut by_object: BTreeMap<&str, [i64; 3]> = BTreeMap::new();
        for row in &gathered.successes {
            let counts = by_object.entry(&row.object).or_default();
            counts[0] += row.draws_n;
            counts[1] += row.verdicts.total_count();
            counts[2] += row.verdicts.success_count();
        }
        let is_counted = !by_object.is_empty();
        if !is_counted {
            for (object, rollouts) in &gathered.rollouts {
                let held = rollouts.iter().filter(|one| one.verdict == Verdict::Held);
                let counts = [0, signed(rollouts.len()), signed(held.count())];
                by_object.insert(object, counts);
            }
        }
        if by_object.is_empty() {
            return None;
        }
        let sum = |idx: usize| by_object.values().map(|counts| counts[idx]).sum::<i64>();
        let accepted = by_object.values().filter(|counts| counts[2] > 0);
        Some(Self {
            objects_n: by_object.len(),
            objects_accepted_n: accepted.count(),
            samples_n: is_counted.then(|| sum(0)),
            candidates_n: sum(1),
            accepted_n: sum(2),
        })
    }

    fn text(&self) -> String {
        let share = |n: i64| percent(self.accepted_n as f64 / n.max(1) as f64);
        let samples = self.samples_n.map_or(String::new(), |samples_n| {
            format!(", samples {}", share(samples_n))
        });
        format!(
            "simulated success: objects {} of {}{samples}, candidates {}",
            self.objects_accepted_n,
            self.objects_n,
            share(self.candidates_n)
        )
    }
}

/// Returns the headline, from samples to executions, and below it each rate with its interval.
pub(crate) fn head(gathered: &PageData) -> Head {
    let trials = trials(gathered);
    let screened = ScreeningCounts::of(gathered).map(|screened| screened.text());
    let place = if trials.simulated_n >= trials.trials_n {
        "simulated"
    } else if trials.simulated_n > 0 {
        "some simulated"
    } else {
        "on the robot"
    };
    let executions = format!("executions {} of {}", trials.successes_n, trials.trials_n);
    let headline = match (screened, trials.trials_n > 0) {
        (Some(screened), false) => screened,
        (Some(screened), true) if place == "simulated" => format!("{screened}, {executions}"),
        (Some(screened), true) => format!("{screened}; {place}: {executions}"),
        (None, true) => format!("{executions} succeed, {place}"),
        (None, false) => match (gathered.trajectories_n, gathered.demonstrations_n) {
            (Some(n), _) => format!("{n} trajectories; nothing was screened"),
            (None, Some(n)) => format!("{n} demonstrations; nothing was screened"),
            (None, None) => "nothing was screened".to_owned(),
        },
    };
    let mut lines = Vec::new();
    if trials.trials_n > 0 {
        let [low, high] = wilson(trials.successes_n as f64, trials.trials_n as f64);
        let rate = trials.successes_n as f64 / trials.trials_n as f64;
        lines.push(format!(
            "{} of {} executions succeed, {place}: {} (95 % CI {:.1} to {:.1})",
            trials.successes_n,
            trials.trials_n,
            percent(rate),
            100.0 * low,
            100.0 * high
        ));
    }
    for rate in gathered
        .rates
        .iter()
        .filter(|rate| rate.origin == ALL_ORIGINS)
    {
        lines.extend(rate_lines(rate));
    }
    lines.extend(protocol::line(gathered));
    Head {
        title: format!("{}: what was learned", gathered.facts.run.pipeline),
        headline: headline.replace('`', ""),
        below: lines
            .into_iter()
            .map(|line| line.replace('`', ""))
            .collect(),
    }
}

/// Returns the objects of a rate in words, after a comma; nothing if it is of all.
fn of_split(rate: &Rate) -> String {
    rate.object_split.map_or(String::new(), |split| {
        format!(", {} objects", split.as_str())
    })
}

/// Returns the rates of candidates, if there are any, and of samples in a line each, with their intervals and
/// denominators.
fn rate_lines(rate: &Rate) -> Vec<String> {
    let split = of_split(rate);
    let by_candidate = rate.by_candidate().map(|[mean, low, high]| {
        format!(
            "{} of candidates succeed (95 % CI {:.0} to {:.0}; mean of {} objects; {} of {} candidates; `{}`{split})",
            percent(mean),
            100.0 * low,
            100.0 * high,
            rate.objects_n,
            rate.successes_n,
            rate.candidates_n,
            rate.generator,
        )
    });
    let [mean, low, high] = rate.by_draw();
    let by_draw = format!(
        "{} of samples succeed (95 % CI {:.0} to {:.0}; {} of {} samples; `{}`{split})",
        percent(mean),
        100.0 * low,
        100.0 * high,
        rate.successes_n,
        rate.draws_n,
        rate.generator,
    );
    by_candidate.into_iter().chain([by_draw]).collect()
}

/// Returns the row of the executions that count.
fn executions_row(trials: &TrialCounts) -> [Cell; 6] {
    let (successes, n) = (trials.successes_n as f64, trials.trials_n as f64);
    let is_simulated = trials.simulated_n >= trials.trials_n;
    let how = if is_simulated {
        "executed by a simulated cell with other physics and new errors for each motion; Wilson's interval, \
         no evidence for other objects"
    } else {
        "executed by a robot cell; Wilson's interval"
    };
    [
        Cell::text("executions that succeed"),
        Cell::share(successes / n),
        Cell::interval(wilson(successes, n)),
        Cell::count(trials.successes_n),
        Cell::count(trials.trials_n),
        Cell::text(how),
    ]
}

/// Returns the rows of a rate, by candidate and by sample.
fn rate_rows(rate: &Rate) -> [[Cell; 6]; 2] {
    let origin = if rate.origin == ALL_ORIGINS {
        "all origins".to_owned()
    } else {
        format!("origin {}", rate.origin)
    };
    let of = format!("{}, {origin}{}", rate.generator, of_split(rate));
    [
        (
            "candidates that succeed",
            rate.by_candidate(),
            rate.candidates_n,
        ),
        ("samples that succeed", Some(rate.by_draw()), rate.draws_n),
    ]
    .map(|(what, rate_of, n)| {
        let missing = || [Cell::Missing, Cell::Missing];
        let cells = |[mean, low, high]: [f64; 3]| [Cell::share(mean), Cell::interval([low, high])];
        let [mean, interval] = rate_of.map_or_else(missing, cells);
        [
            Cell::text(format!("{what} ({of})")),
            mean,
            interval,
            Cell::count(rate.successes_n),
            Cell::count(n),
            Cell::text(format!(
                "simulated; mean of {} objects' rates, interval by resampling objects",
                rate.objects_n
            )),
        ]
    })
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("result", "Result");
    let trials = trials(gathered);
    let mut table = DataTable::new(
        "figures",
        "Rates with their intervals and denominators",
        &[
            ("measure", "Measure"),
            ("rate", "Rate"),
            ("interval", "95 % interval"),
            ("successes_n", "Successes"),
            ("n", "Of"),
            ("how", "How"),
        ],
    );
    if trials.trials_n > 0 {
        table.row(executions_row(&trials));
    }
    for rate in &gathered.rates {
        for row in rate_rows(rate) {
            table.row(row);
        }
    }
    if let Some([trials_n, held_n]) = gathered.robustness.filter(|[n, _]| *n > 0) {
        table.row([
            Cell::text("trials of accepted motions that succeed under sampled errors"),
            Cell::share(held_n as f64 / trials_n as f64),
            Cell::Missing,
            Cell::count(held_n),
            Cell::count(trials_n),
            Cell::text("simulated; errors of pose, friction, mass and delay"),
        ]);
    }
    if table.rows.is_empty() {
        section.say("Nothing was screened or executed in this run: there is no rate to show.");
    } else {
        section.tables.push(table);
    }
    match protocol::protocol(gathered) {
        Some(protocol) => section.tables.push(protocol),
        None => {
            section.say("No screen is wired to this report, so that there is no protocol to name.");
        }
    }
    section
}

#[cfg(test)]
mod tests {
    use schemas::executions::Execution;

    use super::*;

    #[test]
    fn trials_on_a_robot_are_told_from_simulated_ones() {
        let execution = |simulated, outcome| Execution {
            goal_id: "goal".to_owned(),
            candidate_id: "candidate".to_owned(),
            cell: "cell".to_owned(),
            simulated,
            gap: String::new(),
            accepted: true,
            outcome,
            message: String::new(),
            duration_s: 1.0,
            tracking_error_rad: 0.0,
            lift_m: 0.0,
        };
        let gathered = |simulated: [bool; 2]| {
            let outcomes = [Outcome::Succeeded, Outcome::Failed];
            let all = simulated.into_iter().zip(outcomes);
            let mut all: Vec<_> = all
                .map(|(place, outcome)| execution(place, outcome))
                .collect();
            // The cell refused it: no trial.
            all.push(execution(false, Outcome::Rejected));
            PageData {
                executions: [("box".to_owned(), all)].into(),
                ..PageData::default()
            }
        };
        for (simulated, simulated_n, place) in [
            ([true, true], 2, "simulated"),
            ([true, false], 1, "some simulated"),
            ([false, false], 0, "on the robot"),
        ] {
            let gathered = gathered(simulated);
            let expected = TrialCounts {
                trials_n: 2,
                successes_n: 1,
                simulated_n,
            };
            assert_eq!(trials(&gathered), expected);
            let headline = head(&gathered).headline;
            assert_eq!(headline, format!("executions 1 of 2 succeed, {place}"));
        }
    }
}
