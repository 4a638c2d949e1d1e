//! The headline, with its interval and denominator, and the protocol beside it.

use schemas::{
    executions::Outcome,
    rates::ALL_ORIGINS,
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

/// Returns the headline: what robot cells did, or else what held in simulation, or else what there is.
pub(crate) fn head(gathered: &PageData) -> Head {
    let trials = trials(gathered);
    let mut lines = Vec::new();
    if trials.trials_n > 0 {
        let [low, high] = wilson(trials.successes_n as f64, trials.trials_n as f64);
        let rate = trials.successes_n as f64 / trials.trials_n as f64;
        let place = if trials.simulated_n >= trials.trials_n {
            "succeed"
        } else if trials.simulated_n > 0 {
            "succeed, some simulated"
        } else {
            "succeed on the robot"
        };
        lines.push(format!(
            "{} of {} {place}: {} (95 % CI {:.1} to {:.1})",
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
        let split = rate.object_split.map_or(String::new(), |split| {
            format!(", {} objects", split.as_str())
        });
        lines.push(format!(
            "{} of candidates hold (95 % CI {:.0} to {:.0}; mean of {} objects; {} of {} candidates; `{}`{split})",
            percent(rate.candidate_rate_mean),
            100.0 * rate.candidate_rate_low,
            100.0 * rate.candidate_rate_high,
            rate.objects_n,
            rate.successes_n,
            rate.candidates_n,
            rate.generator,
        ));
        lines.push(format!(
            "{} of draws hold (95 % CI {:.0} to {:.0}; {} of {} draws; `{}`{split})",
            percent(rate.draw_rate_mean),
            100.0 * rate.draw_rate_low,
            100.0 * rate.draw_rate_high,
            rate.successes_n,
            rate.draws_n,
            rate.generator,
        ));
    }
    if lines.is_empty() && !gathered.rollouts.is_empty() {
        let n = gathered.rollouts.values().flatten().count();
        let held_n = gathered.rollouts.values().flatten();
        let held_n = held_n
            .filter(|one| one.verdict == schemas::rollouts::Verdict::Held)
            .count();
        lines.push(format!("{held_n} of {n} candidates hold"));
    }
    if lines.is_empty() {
        lines.push(match (gathered.trajectories_n, gathered.demonstrations_n) {
            (Some(n), _) => format!("{n} trajectories; nothing was screened"),
            (None, Some(n)) => format!("{n} demonstrations; nothing was screened"),
            (None, None) => "nothing was screened".to_owned(),
        });
    }
    let headline = lines.remove(0);
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
        let interval = wilson(trials.successes_n as f64, trials.trials_n as f64);
        let is_simulated = trials.simulated_n >= trials.trials_n;
        let how = if is_simulated {
            "executed by a simulated cell with other physics and errors drawn for each motion; Wilson's interval, \
             no evidence for other objects"
        } else {
            "executed by a robot cell; Wilson's interval"
        };
        table.row([
            Cell::text("executions that succeed"),
            Cell::share(trials.successes_n as f64 / trials.trials_n as f64),
            Cell::interval(interval),
            Cell::count(trials.successes_n),
            Cell::count(trials.trials_n),
            Cell::text(how),
        ]);
    }
    for rate in &gathered.rates {
        let split = rate.object_split.map_or(String::new(), |split| {
            format!(", {} objects", split.as_str())
        });
        let origin = if rate.origin == ALL_ORIGINS {
            "all origins".to_owned()
        } else {
            format!("origin {}", rate.origin)
        };
        let of = format!("{}, {origin}{split}", rate.generator);
        for (what, mean, ends, n) in [
            (
                "candidates that hold",
                rate.candidate_rate_mean,
                [rate.candidate_rate_low, rate.candidate_rate_high],
                rate.candidates_n,
            ),
            (
                "draws that hold",
                rate.draw_rate_mean,
                [rate.draw_rate_low, rate.draw_rate_high],
                rate.draws_n,
            ),
        ] {
            table.row([
                Cell::text(format!("{what} ({of})")),
                Cell::share(mean),
                Cell::interval(ends),
                Cell::count(rate.successes_n),
                Cell::count(n),
                Cell::text(format!(
                    "simulated; mean of {} objects' rates, interval by resampling objects",
                    rate.objects_n
                )),
            ]);
        }
    }
    if let Some([trials_n, held_n]) = gathered.robustness.filter(|[n, _]| *n > 0) {
        table.row([
            Cell::text("trials of accepted motions that hold under drawn errors"),
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
