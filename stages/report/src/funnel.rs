//! The funnel from recordings to executions: number and losses of each step, with reasons.

use std::collections::BTreeMap;

use charts::{Bars, Captions, bars};
use schemas::{
    Table, demonstrations::Demonstration, executions::Outcome, rollouts::Verdict,
    tally::OutcomeClass, trajectories::Trajectory,
};

use crate::{
    PageData,
    numbers::{signed, words},
    table::{Cell, DataTable, Section},
};

/// Most reasons that are named at a step.
const REASONS: usize = 6;

/// A step of the funnel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Step {
    pub(crate) name: &'static str,
    pub(crate) n: i64,
    /// Losses from the step before, by reason; empty where a step makes more of less.
    pub(crate) lost: Vec<(String, i64)>,
}

/// Returns the steps with known numbers, in their order.
pub(crate) fn steps(gathered: &PageData) -> Vec<Step> {
    let mut steps = Vec::new();
    let left_out = |input: &str| -> Vec<(String, i64)> {
        let reasons = gathered.facts.left_out.get(input).into_iter().flatten();
        sorted(
            reasons
                .map(|(reason, n)| (reason.clone(), signed(*n)))
                .collect(),
        )
    };
    let sum = |lost: &[(String, i64)]| lost.iter().map(|(_, n)| n).sum::<i64>();
    let mut step = |name: &'static str, n: i64, lost: Vec<(String, i64)>| {
        steps.push(Step { name, n, lost });
    };
    if let Some(n) = gathered.demonstrations_n {
        let lost = left_out(Demonstration::NAME);
        step("recordings", signed(n) + sum(&lost), Vec::new());
        step("demonstrations", signed(n), lost);
    }
    if let Some(n) = gathered.trajectories_n {
        step("trajectories", signed(n), left_out(Trajectory::NAME));
    }
    if let Some(draws) = &gathered.draws {
        let refused = draws
            .refused
            .iter()
            .map(|(&reason, &n)| (reason.to_owned(), n));
        let lost = sorted(refused.collect());
        step("samples", draws.candidates_n + sum(&lost), Vec::new());
        step("candidates", draws.candidates_n, lost);
    }
    let verdicts = verdicts(gathered);
    let accepted_n = verdicts.get(&Verdict::Held).copied().unwrap_or_default();
    if !gathered.rollouts.is_empty() {
        let failed = verdicts
            .iter()
            .filter(|(verdict, _)| **verdict != Verdict::Held);
        let lost = failed
            .map(|(verdict, &n)| (words(verdict.as_str()), n))
            .collect();
        step("accepted", accepted_n, sorted(lost));
    }
    if !gathered.executions.is_empty() {
        let all: Vec<Outcome> = gathered
            .executions
            .values()
            .flatten()
            .map(|execution| execution.outcome)
            .collect();
        let n = |outcome: Outcome| signed(all.iter().filter(|one| **one == outcome).count());
        let refused_n = n(Outcome::Rejected);
        let sent_n = signed(all.len()) - refused_n;
        let mut lost = vec![(
            "not chosen: each object's most robust are sent".to_owned(),
            accepted_n - signed(all.len()),
        )];
        lost.push(("refused before anything moved".to_owned(), refused_n));
        lost.retain(|(_, n)| *n > 0);
        step("sent", sent_n, lost);
        let failed = Outcome::ALL
            .iter()
            .filter(|one| !matches!(one, Outcome::Succeeded | Outcome::Rejected));
        let lost: Vec<(String, i64)> = failed
            .map(|&outcome| (words(outcome.word()), n(outcome)))
            .filter(|(_, n)| *n > 0)
            .collect();
        step("succeeded", n(Outcome::Succeeded), sorted(lost));
    }
    steps
}

/// Counts rollouts by verdict.
pub(crate) fn verdicts(gathered: &PageData) -> BTreeMap<Verdict, i64> {
    let mut verdicts: BTreeMap<Verdict, i64> = BTreeMap::new();
    for rollout in gathered.rollouts.values().flatten() {
        *verdicts.entry(rollout.verdict).or_default() += 1;
    }
    verdicts
}

/// The most frequent first.
fn sorted(mut lost: Vec<(String, i64)>) -> Vec<(String, i64)> {
    lost.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    lost
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("funnel", "From recordings to executions");
    let steps = steps(gathered);
    if steps.is_empty() {
        section.say("No recordings, samples or rollouts are wired to this report.");
        return section;
    }
    section.say(
        "Numbers that each step of the pipeline received and lost. Samples come from the \
         learned function, not from trajectories, so nothing is lost there.",
    );
    let mut table = DataTable::new(
        "funnel",
        "Steps and losses",
        &[
            ("step", "Step"),
            ("n", "Number"),
            ("lost_n", "Lost"),
            ("reasons", "Why"),
        ],
    );
    for step in &steps {
        let lost_n: i64 = step.lost.iter().map(|(_, n)| n).sum();
        let named = step.lost.iter().take(REASONS);
        let mut reasons: Vec<String> = named.map(|(reason, n)| format!("{n} {reason}")).collect();
        let others_n: i64 = step.lost.iter().skip(REASONS).map(|(_, n)| n).sum();
        if others_n > 0 {
            reasons.push(format!("{others_n} for other reasons"));
        }
        table.row([
            Cell::text(step.name),
            Cell::count(step.n),
            if step.lost.is_empty() {
                Cell::Missing
            } else {
                Cell::count(lost_n)
            },
            Cell::text(reasons.join("; ")),
        ]);
    }
    let captions = Captions {
        title: "From recordings to executions",
        x: "number",
        y: "",
    };
    let names: Vec<String> = steps.iter().map(|step| step.name.to_owned()).collect();
    let series = Bars {
        name: String::new(),
        values: steps
            .iter()
            .map(|step| (step.name.to_owned(), step.n as f64))
            .collect(),
    };
    section.chart(
        "Number of items at each step",
        bars(&captions, &names, &[series]),
    );
    section.tables.push(table);
    section
}
