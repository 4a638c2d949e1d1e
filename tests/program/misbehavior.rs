//! A cell in Python that misbehaves in one of many ways: nothing moves without permission or twice, and what
//! is told is what the cell itself wrote down.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Output,
};

use serde_json::Value;
use tempfile::TempDir;

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::Lab,
    python::{PythonCell, program_at, python},
};

/// What a run does at a cell that misbehaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Expected {
    /// It sends nothing, and ends with code 1.
    Nothing,
    /// It sends nothing, and every motion is a row that says why.
    Infeasible,
    /// It sends the first goal at most, and ends with code 1.
    First,
    /// The cell's present state refuses: it ends with code 1, and nothing moved.
    NotNow,
    /// The cell refuses each motion: rows.
    Refused,
    /// It believes what the cell signs: rows, or code 1 where the cell is busy with what it refused.
    Believed,
    /// Nobody knows the end of the last goal: it ends with code 1, and sends nothing more.
    Unknown,
    /// As unknown; the next run learns the end and goes on.
    Recovered,
    /// It is as if nothing were wrong.
    Harmless,
}

/// The cell, and what it writes down.
struct MisbehavingCell {
    journal: PathBuf,
    _cell: PythonCell,
}

impl MisbehavingCell {
    fn start(python: &str, lab: &Lab, journal: &Path, kind: &str) -> Self {
        let program = program_at(python, "tests/program/misbehaving/cell.py");
        Self {
            journal: journal.to_owned(),
            _cell: PythonCell::start(program, lab, journal, &["--misbehave", kind]),
        }
    }

    /// Lines of two words that the cell has written.
    fn lines(&self, file: &str) -> Vec<(String, String)> {
        let text = fs::read_to_string(self.journal.join(file)).unwrap_or_default();
        let words = |line: &str| {
            let (first, second) = line.split_once(' ').unwrap();
            (first.to_owned(), second.to_owned())
        };
        text.lines().map(words).collect()
    }

    /// Goals that came, with what the cell had said of being simulated.
    fn transmissions(&self) -> Vec<(String, String)> {
        self.lines("transmissions")
    }
}

fn run(lab: &Lab) -> Output {
    let mut command = lab.dispatch();
    for value in [
        "dispatch.answer_timeout_s=5.0",
        "dispatch.result_timeout_s=10.0",
        "dispatch.per_object=1",
    ] {
        command.args(["--set", value]);
    }
    command.output().unwrap()
}

/// The rows of the lake that were sent, with their outcomes.
fn rows(lab: &Lab) -> Vec<(String, String)> {
    if !lab.bench.lake().join("tables/executions").exists() {
        return Vec::new();
    }
    let sql = "select goal_id, outcome, simulated from executions where goal_id != ''";
    let asked = lab.bench.ask(&["query", "--format", "json", sql]);
    let word = |row: &Value, name: &str| row[name].as_str().unwrap().to_owned();
    let rows = stdout(&asked);
    let rows = rows.lines().map(|line| {
        let row: Value = serde_json::from_str(line).unwrap();
        assert_eq!(row["simulated"], true, "{row}");
        (word(&row, "goal_id"), word(&row, "outcome"))
    });
    rows.collect()
}

/// Objects of the lake, of each of which one motion is sent.
fn objects_n(lab: &Lab) -> usize {
    let objects = lab.bench.lake().join("every/objects");
    fs::read_dir(objects).unwrap().count()
}

/// Tries the dispatcher at a cell that misbehaves in each of these ways.
fn check(kinds: &[(&str, Expected)]) {
    let Some(python) = python(&["numpy", "zenoh", "blake3", "cryptography"]) else {
        return;
    };
    let journals = TempDir::new().unwrap();
    for &(kind, expected) in kinds {
        let lab = Lab::of_few_objects();
        let cell = MisbehavingCell::start(&python, &lab, &journals.path().join(kind), kind);
        let ran = run(&lab);
        check_run(kind, expected, &ran, &lab, &cell);
        if expected == Expected::Recovered {
            // Each goal once more.
            let mut again = run(&lab);
            for _ in 0..objects_n(&lab) {
                if again.status.code() != Some(0) {
                    again = run(&lab);
                }
            }
            check_run(kind, Expected::Harmless, &again, &lab, &cell);
        }
        let once: BTreeMap<String, usize> =
            cell.lines("executed")
                .into_iter()
                .fold(BTreeMap::new(), |mut counts, (id, _)| {
                    *counts.entry(id).or_default() += 1;
                    counts
                });
        // A cell that forgets what it has accepted executes the repetition of an unanswered goal.
        if kind != "loses_goals_keeps_key" {
            assert!(once.values().all(|&n| n == 1), "{kind}: {once:?}");
        }
    }
}

fn check_run(kind: &str, expected: Expected, ran: &Output, lab: &Lab, cell: &MisbehavingCell) {
    let said = stderr(ran);
    let code = ran.status.code();
    let sent = cell.transmissions();
    let mut ids: Vec<&str> = sent.iter().map(|(_, id)| id.as_str()).collect();
    ids.sort_unstable();
    ids.dedup();
    assert!(
        sent.iter()
            .all(|(told, _)| told == "true" || told == "none"),
        "{kind}: {sent:?}"
    );
    // What others say stays on its line.
    assert!(
        !said.contains(['\u{202e}', '\u{1b}', '\u{7}']),
        "{kind}: {said}"
    );
    assert!(
        said.lines().all(|line| line.chars().count() < 2000),
        "{kind}: {said}"
    );
    let executed: BTreeMap<String, String> = cell.lines("executed").into_iter().collect();
    let rows = rows(lab);
    for (id, outcome) in &rows {
        match outcome.as_str() {
            "succeeded" | "failed" | "aborted" => {
                assert_eq!(executed.get(id), Some(outcome), "{kind}: {id}");
            }
            "rejected" if kind != "refuses_but_executes" => {
                assert!(!executed.contains_key(id), "{kind}: {id}");
            }
            _ => {}
        }
    }
    match expected {
        Expected::Nothing => {
            assert_eq!((code, sent.len()), (Some(1), 0), "{kind}: {said}");
        }
        Expected::Infeasible => {
            assert_eq!((code, sent.len()), (Some(0), 0), "{kind}: {said}");
            assert!(
                said.contains(&format!("{} infeasible", objects_n(lab))),
                "{kind}: {said}"
            );
        }
        Expected::First => {
            assert_eq!(code, Some(1), "{kind}: {said}");
            assert!(sent.len() <= 1, "{kind}: {sent:?}");
        }
        Expected::NotNow => {
            assert_eq!((code, ids.len()), (Some(1), 1), "{kind}: {said}");
            assert!(said.contains("nothing moved"), "{kind}: {said}");
        }
        Expected::Believed => {
            assert!(matches!(code, Some(0 | 1)), "{kind}: {said}");
            assert!(!said.contains("1 succeed"), "{kind}: {said}");
        }
        Expected::Refused => {
            assert_eq!(code, Some(0), "{kind}: {said}");
            assert!(said.contains("refused by the cell"), "{kind}: {said}");
        }
        Expected::Unknown | Expected::Recovered => {
            assert_eq!((code, ids.len()), (Some(1), 1), "{kind}: {said}");
            assert!(said.contains("the robot may have moved"), "{kind}: {said}");
            assert!(rows.is_empty(), "{kind}: {rows:?}");
        }
        Expected::Harmless => {
            assert_eq!(code, Some(0), "{kind}: {said}");
            assert_eq!(rows.len(), objects_n(lab), "{kind}: {rows:?}");
        }
    }
}

use Expected::{
    Believed, First, Harmless, Infeasible, NotNow, Nothing, Recovered, Refused, Unknown,
};

#[test]
fn permission_is_asked_before_every_transmission() {
    check(&[
        ("real_from_second_goal", First),
        ("real_from_second_capabilities", First),
        ("real_on_retransmission", Unknown),
        ("simulated_missing", Nothing),
        ("simulated_as_text", Nothing),
    ]);
}

#[test]
fn a_cell_that_changes_is_sent_nothing_more() {
    check(&[
        ("stopped_from_second_goal", First),
        ("palm_speed_lowered", First),
        ("palm_speed_lowered_after_goal", First),
        ("other_robot_from_second_goal", First),
        ("other_journal_after_goal", First),
        ("other_journal_before_report", Unknown),
    ]);
}

#[test]
fn a_cell_that_does_not_fit_is_sent_nothing() {
    check(&[
        ("stopped_missing", Nothing),
        ("stopped_from_start", Nothing),
        ("palm_missing", Nothing),
        ("workspace_inverted", Nothing),
        ("other_robot", Nothing),
        ("other_joints", Nothing),
        ("other_cell_name", Nothing),
        ("other_journal_named", Nothing),
        ("palm_too_slow", Infeasible),
        ("tiny_max_goal_bytes", Infeasible),
    ]);
}

#[test]
fn a_cell_that_cannot_be_read_is_sent_nothing() {
    check(&[
        ("clock_5_s_ahead", Nothing),
        ("clock_5_s_behind", Nothing),
        ("protocol_4", Nothing),
        ("protocol_6", Nothing),
        ("capabilities_unreadable", Nothing),
        ("capabilities_of_2_mb", Nothing),
        ("unsigned_answers", Nothing),
        ("signs_without_parameters", Nothing),
        ("signs_another_key_queried", Nothing),
        ("upper_case_journal", Nothing),
    ]);
}

#[test]
fn refusals_are_no_failures() {
    check(&[
        ("executes_another_forever", NotNow),
        ("refuses_estop", NotNow),
        ("refuses_busy", NotNow),
        ("refuses_storage", NotNow),
        ("refuses_stopped", NotNow),
        ("refuses_limits", Refused),
        ("refuses_object", Refused),
        ("refuses_but_executes", Believed),
        ("hostile_refusal", NotNow),
    ]);
}

#[test]
fn answers_that_are_lost_doubled_or_odd_are_no_harm() {
    check(&[
        ("hostile_gap", Harmless),
        ("unknown_field", Harmless),
        ("loses_first_transmission", Harmless),
        ("executes_without_answer", Harmless),
        ("loses_goals_keeps_key", Harmless),
        ("reports_then_forgets", Harmless),
        ("two_equal_answers", Harmless),
        ("says_known_of_new", Harmless),
        ("outcome_aborted", Harmless),
    ]);
}

#[test]
fn what_a_cell_says_beside_its_report_is_no_report() {
    check(&[
        ("hostile_message", Harmless),
        ("false_outcome_published", Harmless),
        ("false_results", Harmless),
        ("never_answers_cancel", Harmless),
        ("answers_cancel_while_moving", Harmless),
        ("report_of_70_mb_has_line", Harmless),
    ]);
}

#[test]
fn an_acceptance_that_does_not_hold_leaves_the_outcome_unknown() {
    check(&[
        ("second_answerer", Unknown),
        ("accepts_then_denies", Unknown),
        ("executes_then_denies", Unknown),
        ("accepts_never_executes", Unknown),
        ("accepted_of_other_bytes", Unknown),
    ]);
}

#[test]
fn the_next_run_learns_what_the_first_could_not() {
    check(&[
        ("executes_without_any_answer", Recovered),
        ("accepted_by_another_key", Recovered),
        ("two_different_answers", Recovered),
        ("answer_not_on_page", Recovered),
        ("answer_unreadable", Recovered),
        ("answer_of_2_mb", Recovered),
        ("never_taken_once", Recovered),
    ]);
}

#[test]
fn a_report_that_contradicts_itself_is_not_believed() {
    check(&[
        ("no_samples", Unknown),
        ("frozen", Unknown),
        ("lift_minus_5", Unknown),
        ("lift_1e308", Unknown),
        ("lift_1e300", Unknown),
        ("lift_not_a_number", Unknown),
        ("times_back", Unknown),
        ("joints_order", Unknown),
        ("narrow", Unknown),
        ("short", Unknown),
        ("samples_not_numbers", Unknown),
        ("samples_n_wrong", Unknown),
    ]);
}

#[test]
fn a_report_of_something_else_is_not_believed() {
    check(&[
        ("commands_of_another_goal", Unknown),
        ("palm_elsewhere", Unknown),
        ("object_elsewhere", Unknown),
        ("object_rises_alone", Unknown),
        ("report_of_another_goal", Unknown),
        ("report_unknown", Unknown),
        ("report_unreadable", Unknown),
        ("report_without_message", Unknown),
        ("outcome_not_on_page", Unknown),
        ("outcome_rejected", Unknown),
    ]);
}

#[test]
fn a_report_that_does_not_arrive_leaves_the_outcome_unknown() {
    check(&[
        ("report_of_70_mb", Unknown),
        ("first_line_only", Unknown),
        ("never_answers_result", Unknown),
    ]);
}
