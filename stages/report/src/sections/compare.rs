//! Several runs side by side.

use std::collections::BTreeSet;

use schemas::{
    rates::{ALL_ORIGINS, Rate},
    rollouts::Verdict,
};

use crate::{
    PageData,
    funnel::{steps, verdicts},
    numbers::{percent, words},
    render::NamedRun,
    sections::result,
    table::{Cell, DataTable, Section},
};

/// Returns the section of several runs; `None` of one.
pub(crate) fn section(runs: &[NamedRun<'_>]) -> Option<Section> {
    if runs.len() < 2 {
        return None;
    }
    let mut section = Section::new("runs", "Runs side by side");
    section.say("The sections below are of the first of these runs.");
    section.tables.push(figures(runs));
    section.tables.push(objects(runs));
    Some(section)
}

fn table(id: &'static str, caption: &str, first: (&str, &str), runs: &[NamedRun<'_>]) -> DataTable {
    let mut columns = vec![first];
    columns.extend(
        runs.iter()
            .map(|run| (run.name.as_str(), run.name.as_str())),
    );
    DataTable::new(id, caption, &columns)
}

fn figures(runs: &[NamedRun<'_>]) -> DataTable {
    let mut table = table("runs", "Figures of each run", ("figure", "Figure"), runs);
    let mut put = |name: String, of: &dyn Fn(&PageData) -> Cell| {
        let mut row = vec![Cell::text(name)];
        row.extend(runs.iter().map(|run| of(run.gathered)));
        table.row(row);
    };
    put("pipeline".to_owned(), &|run| {
        Cell::text(&run.facts.run.pipeline)
    });
    put("seed".to_owned(), &|run| {
        Cell::text(run.facts.run.seed.to_string())
    });
    put("executions that succeed".to_owned(), &executions);
    put("candidates that succeed".to_owned(), &|run| {
        success(run, Rate::by_candidate)
    });
    put("samples that succeed".to_owned(), &|run| {
        success(run, |rate| Some(rate.by_draw()))
    });
    let mut names: Vec<&str> = Vec::new();
    for step in runs.iter().flat_map(|run| steps(run.gathered)) {
        if !names.contains(&step.name) {
            names.push(step.name);
        }
    }
    for name in names {
        put(name.to_owned(), &|run| {
            let all = steps(run);
            let step = all.iter().find(|step| step.name == name);
            step.map_or(Cell::Missing, |step| Cell::count(step.n))
        });
    }
    for verdict in Verdict::ALL.into_iter().filter(|one| *one != Verdict::Held) {
        let is_known = runs
            .iter()
            .any(|run| verdicts(run.gathered).contains_key(&verdict));
        if is_known {
            put(format!("fail: {}", words(verdict.as_str())), &|run| {
                Cell::count(verdicts(run).get(&verdict).copied().unwrap_or_default())
            });
        }
    }
    table
}

/// Returns the share of a run's executions that succeed.
fn executions(run: &PageData) -> Cell {
    let trials = result::trials(run);
    if trials.trials_n == 0 {
        return Cell::Missing;
    }
    Cell::text(format!(
        "{} ({} of {})",
        percent(trials.successes_n as f64 / trials.trials_n as f64),
        trials.successes_n,
        trials.trials_n
    ))
}

/// Returns a rate of a run over all origins, given its mean and the ends of its interval.
fn success(run: &PageData, ends: fn(&Rate) -> Option<[f64; 3]>) -> Cell {
    let rate = run.rates.iter().find(|rate| rate.origin == ALL_ORIGINS);
    rate.and_then(ends)
        .map_or(Cell::Missing, |[mean, low, high]| {
            Cell::text(format!(
                "{} ({:.0} to {:.0})",
                percent(mean),
                100.0 * low,
                100.0 * high
            ))
        })
}

fn objects(runs: &[NamedRun<'_>]) -> DataTable {
    let mut table = table(
        "runs_by_object",
        "Share of each object's candidates that succeed, by run",
        ("object", "Object"),
        runs,
    );
    let objects: BTreeSet<&str> = runs
        .iter()
        .flat_map(|run| run.gathered.rollouts.keys())
        .map(String::as_str)
        .collect();
    for object in objects {
        let mut row = vec![Cell::text(object)];
        row.extend(runs.iter().map(|run| {
            let Some(rollouts) = run
                .gathered
                .rollouts
                .get(object)
                .filter(|all| !all.is_empty())
            else {
                return Cell::Missing;
            };
            let held_n = rollouts
                .iter()
                .filter(|one| one.verdict == Verdict::Held)
                .count();
            Cell::share(held_n as f64 / rollouts.len() as f64)
        }));
        table.row(row);
    }
    table
}
