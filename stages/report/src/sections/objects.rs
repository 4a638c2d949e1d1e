//! Every object with its rates.

use std::collections::{BTreeMap, BTreeSet};

use charts::{Captions, Estimate, Estimates, Sample, histogram, intervals};
use schemas::{
    candidates::ObjectSplit,
    executions::Outcome,
    rollouts::Verdict,
    tally::{OutcomeClass, wilson},
};

use crate::{
    PageData,
    numbers::signed,
    table::{Cell, DataTable, Section},
};

/// More objects than this are drawn as a histogram.
const DRAWN: usize = 60;

/// Counts of one object.
#[derive(Debug, Clone, Copy, Default)]
#[expect(clippy::struct_field_names, reason = "they are counts")]
struct Row {
    candidates_n: i64,
    held_n: i64,
    draws_n: i64,
    steps_n: i64,
    trials_n: i64,
    succeeded_n: i64,
    shown_n: i64,
}

impl Row {
    /// Returns the cells of the counts and rates; missing where nothing was counted.
    fn cells(&self) -> [Cell; 9] {
        let (held, candidates) = (self.held_n as f64, self.candidates_n as f64);
        let per_success = self.steps_n as f64 / self.held_n.max(1) as f64;
        let when = |is_there: bool, cell: Cell| if is_there { cell } else { Cell::Missing };
        let is_screened = self.candidates_n > 0;
        let is_executed = self.trials_n > 0;
        [
            when(is_screened, Cell::share(held / candidates.max(1.0))),
            when(is_screened, Cell::interval(wilson(held, candidates))),
            when(is_screened, Cell::count(self.held_n)),
            when(is_screened, Cell::count(self.candidates_n)),
            when(self.draws_n > 0, Cell::count(self.draws_n)),
            when(
                self.held_n > 0,
                Cell::Number(per_success, format!("{per_success:.0}")),
            ),
            when(is_executed, Cell::count(self.succeeded_n)),
            when(is_executed, Cell::count(self.trials_n)),
            Cell::count(self.shown_n),
        ]
    }
}

fn rows(gathered: &PageData) -> BTreeMap<&str, Row> {
    let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
    for object in &gathered.objects {
        rows.entry(object).or_default();
    }
    for (object, rollouts) in &gathered.rollouts {
        let row = rows.entry(object).or_default();
        row.candidates_n += signed(rollouts.len());
        row.held_n += signed(
            rollouts
                .iter()
                .filter(|one| one.verdict == Verdict::Held)
                .count(),
        );
        row.steps_n += rollouts
            .iter()
            .map(|one| i64::from(one.measures.control_steps_n))
            .sum::<i64>();
    }
    for success in &gathered.successes {
        rows.entry(&success.object).or_default().draws_n += success.draws_n;
    }
    for (object, executions) in &gathered.executions {
        let row = rows.entry(object).or_default();
        let trials = executions.iter().filter(|one| one.outcome.is_trial());
        row.trials_n += signed(trials.count());
        let succeeded = executions
            .iter()
            .filter(|one| one.outcome == Outcome::Succeeded);
        row.succeeded_n += signed(succeeded.count());
    }
    for motion in &gathered.motions {
        rows.entry(&motion.object).or_default().shown_n += 1;
    }
    rows
}

pub(crate) fn section(gathered: &PageData) -> Section {
    let mut section = Section::new("objects", "By object");
    let rows = rows(gathered);
    if rows.is_empty() {
        section.say("No object is wired to this report.");
        return section;
    }
    let splits: BTreeSet<&str> = gathered
        .successes
        .iter()
        .filter_map(|success| success.object_split)
        .map(ObjectSplit::as_str)
        .collect();
    section.say(match (splits.contains("unseen"), splits.contains("seen")) {
        (true, true) => "Some of these objects were seen in training, others were not.",
        (true, false) => "None of these objects was seen in training.",
        (false, true) => "Every object was seen in training: this run says nothing of unseen ones.",
        (false, false) => "Whether an object was seen in training is not known here.",
    });
    section.say("A click on an object shows its motions. The interval is Wilson's: candidates of one object are sampled independently.");
    let table = table(gathered, &rows);
    let screened: Vec<(&str, Row)> = rows
        .iter()
        .filter(|(_, row)| row.candidates_n > 0)
        .map(|(name, row)| (*name, *row))
        .collect();
    section.chart(
        "Share of the candidates that succeed, by object",
        chart(&screened),
    );
    section.tables.push(table);
    section
}

/// Returns the table of all objects with their counts and rates.
fn table(gathered: &PageData, rows: &BTreeMap<&str, Row>) -> DataTable {
    let split_of: BTreeMap<&str, &str> = gathered
        .successes
        .iter()
        .filter_map(|success| Some((success.object.as_str(), success.object_split?.as_str())))
        .collect();
    let mut table = DataTable::new(
        "by_object",
        "Objects with their candidates, samples and executions",
        &[
            ("object", "Object"),
            ("split", "Split"),
            ("rate", "Hold"),
            ("interval", "95 % interval"),
            ("successes_n", "Held"),
            ("candidates_n", "Candidates"),
            ("draws_n", "Draws"),
            ("control_steps_per_success", "Steps per success"),
            ("succeeded_n", "Executions that succeed"),
            ("trials_n", "Executions"),
            ("motions_n", "Motions here"),
        ],
    );
    for (&object, row) in rows {
        let split = split_of.get(object);
        let mut cells = vec![
            Cell::Link {
                filter: "object",
                value: object.to_owned(),
                shown: object.to_owned(),
            },
            split.map_or(Cell::Missing, |split| Cell::text(*split)),
        ];
        cells.extend(row.cells());
        table.row(cells);
    }
    table
}

fn chart(rows: &[(&str, Row)]) -> Option<String> {
    let rate = |row: &Row| 100.0 * row.held_n as f64 / row.candidates_n.max(1) as f64;
    if rows.len() > DRAWN {
        let captions = Captions {
            title: "Objects by the share of their candidates that succeed",
            x: "share of the candidates [%]",
            y: "share of the objects [%]",
        };
        let sample = Sample {
            name: "objects".to_owned(),
            values: rows.iter().map(|(_, row)| rate(row)).collect(),
        };
        return histogram(&captions, 20, &[sample]);
    }
    let names: Vec<String> = rows.iter().map(|(name, _)| (*name).to_owned()).collect();
    let estimate = |row: &Row| {
        let [low, high] = wilson(row.held_n as f64, row.candidates_n as f64);
        Estimate {
            value: rate(row),
            low: 100.0 * low,
            high: 100.0 * high,
        }
    };
    let series = Estimates {
        name: "candidates".to_owned(),
        values: rows
            .iter()
            .map(|(name, row)| ((*name).to_owned(), estimate(row)))
            .collect(),
    };
    let captions = Captions {
        title: "Candidates that succeed, by object",
        x: "share of the candidates, with its 95 % interval [%]",
        y: "",
    };
    intervals(&captions, &names, &[series])
}
