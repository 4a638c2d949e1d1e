//! The Python of the cell's README, as it is printed there, and the cell and the dispatcher in Python that
//! were made by it.

use std::{
    env, fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
};

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::Lab,
};

const README: &str = include_str!("../../crates/cell/README.md");
/// The endpoint in it.
const PRINTED: &str = "tcp/127.0.0.1:7447";
/// Lines of a program that can be read at a glance.
const LINES: usize = 22;

/// The Python to use, if it has these modules; else it is said why nothing is tried.
pub(crate) fn python(modules: &[&str]) -> Option<String> {
    let Ok(python) = env::var("PIPELINE_PYTHON") else {
        measured_data::print_skipped("`PIPELINE_PYTHON` names no Python");
        return None;
    };
    let imports = modules.iter().map(|module| format!("import {module}\n"));
    let imports: String = imports.collect();
    let has = Command::new(&python).args(["-c", &imports]).status();
    if has.is_ok_and(|status| status.success()) {
        return Some(python);
    }
    measured_data::print_skipped(&format!("`{python}` lacks one of {modules:?}"));
    None
}

/// A program of the examples in Python.
fn example(python: &str, name: &str) -> Command {
    program_at(python, &format!("crates/cell/examples/python/{name}"))
}

/// A program in Python, by its path in the project.
pub(crate) fn program_at(python: &str, path: &str) -> Command {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut program = Command::new(python);
    program.arg("-B").arg("-u").arg(root.join(path));
    program.current_dir(root);
    program
}

/// A cell in Python, which ends with the test.
pub(crate) struct PythonCell(Child);

impl PythonCell {
    /// Starts a cell's program where the lab's cell listens, and waits until it serves.
    pub(crate) fn start(
        mut program: Command,
        lab: &Lab,
        journal: &Path,
        arguments: &[&str],
    ) -> Self {
        let mut cell = program
            .args(["--listen", &lab.endpoint])
            .args(["--hand", "data/robots/allegro_right.urdf", "--journal"])
            .arg(journal)
            .args(arguments)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut said = BufReader::new(cell.stdout.take().unwrap());
        said.read_line(&mut line).unwrap();
        assert_eq!(line.trim(), lab.endpoint);
        Self(cell)
    }
}

impl Drop for PythonCell {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

#[test]
fn python_cell_executes_goals_and_contradictions_are_not_successes() {
    let Some(python) = python(&["numpy", "zenoh", "blake3", "cryptography"]) else {
        return;
    };
    let lab = Lab::new();
    let journals = tempfile::tempdir().unwrap();
    let kinds = [
        "no_samples",
        "frozen",
        "lift_minus_5",
        "lift_1e308",
        "times_back",
        "joints_order",
        "narrow",
        "short",
        "second_answerer",
    ];
    for (attempt, kind) in (1..).zip(kinds) {
        let journal = journals.path().join(kind);
        let _cell = PythonCell::start(
            example(&python, "cell.py"),
            &lab,
            &journal,
            &["--contradict", kind],
        );
        let mut run = lab.dispatch();
        run.arg("--set").arg(format!("dispatch.attempt={attempt}"));
        let ran = run.output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{kind}: {said}");
        assert!(
            said.contains("is unknown; the robot may have moved"),
            "{kind}: {said}"
        );
        assert!(
            !lab.bench.lake().join("tables/executions").exists(),
            "{kind}"
        );
    }
    let honest = journals.path().join("honest");
    let _cell = PythonCell::start(example(&python, "cell.py"), &lab, &honest, &[]);
    let mut run = lab.dispatch();
    run.args(["--set", "dispatch.attempt=20"]);
    let ran = run.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let outcomes = lab.outcomes();
    assert!(outcomes.contains_key("succeeded"), "{outcomes:?}");
    assert_eq!(outcomes.len(), 1, "{outcomes:?}");
}

#[test]
fn a_dispatcher_in_python_has_a_saved_goal_carried_out_once() {
    let Some(python) = python(&["numpy", "zenoh", "blake3", "cryptography"]) else {
        return;
    };
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    lab.end(cell);
    let held = lab.over.iter().find(|line| line.contains("succeeded"));
    let id = held.unwrap().split_whitespace().nth(1).unwrap().to_owned();
    let folder = tempfile::tempdir().unwrap();
    let goal = folder.path().join("saved.goal");
    fs::copy(lab.journal().join(format!("{id}.goal")), &goal).unwrap();
    page_opens_a_goal_and_signs_an_answer(&python, &goal, &id);
    // Another cell, which knows nothing of it.
    let journal = folder.path().join("journal");
    let cell = lab.cell(&["--fast", "--journal", journal.to_str().unwrap()]);
    for _ in 0..2 {
        let mut program = example(&python, "dispatcher.py");
        program.arg(&goal).args(["--connect", &lab.endpoint]);
        let ran = program.output().unwrap();
        let said = stdout(&ran);
        assert_eq!(ran.status.code(), Some(0), "{said}{}", stderr(&ran));
        assert!(said.starts_with("succeeded"), "{said}");
    }
    let said = cell.end();
    assert_eq!(
        said.lines().filter(|line| line.starts_with("goal")).count(),
        1,
        "{said}"
    );
}

/// The bytes of a cell's messages as the page has them, against the module of the examples.
fn page_opens_a_goal_and_signs_an_answer(python: &str, goal: &Path, id: &str) {
    const CHECK: &str = r#"
import pathlib, sys, types, zenoh
from wire import Goal, Key, answer_text, split, verifies

data = pathlib.Path(sys.argv[1]).read_bytes()
found = Goal(data)
seal, address, motion, rows = opened(data)
assert [seal, motion] == [found.seal, found.head], motion
assert all(map(np.array_equal, rows, [found.carried, found.hand]))
def resealed(motion):
    """The same address and a motion of other bytes, both sealed anew."""
    return types.SimpleNamespace(motion=motion, id=digest(motion)[:32])
broken = {"digest": data[:-1] + b"x", "protocol": data.replace(b":5,", b":4,", 1), "malformed": b"{}"}
other = Key(pathlib.Path(sys.argv[1] + ".other"))
broken["dispatcher"] = found.sent_by(other, **address)
broken["dispatcher"] = broken["dispatcher"].replace(split(broken["dispatcher"])[0]["signature"].encode(), b"00" * 64)
deep = b"[" * 100_000 + b"\n"
fewer = found.motion.replace(b'"points_n":', b'"points_n":-')
malformed = [Goal.sent_by(resealed(motion), other, **address) for motion in (found.motion + b"x" * 8, fewer, deep)]
for code, wrong in [*broken.items(), *(("malformed", message) for message in [*malformed, deep])]:
    try:
        opened(wrong)
        raise SystemExit(f"{code}: taken")
    except Refused as refused:
        assert refused.args[0] == code, (code, refused.args)

said = []
class Query:
    key_expr, parameters, payload = "cgf/cell/lab/goal", "nonce=5f", zenoh.ZBytes(data)
    def reply(self, key, content):
        said.append(content)
    def drop(self):
        said.append("over")
answer(Query(), other.pair, b"{}\n")
head, content = split(said[0])
assert content == b"{}\n" and said[1] == "over" and head["asked"] == digest(data)
text = answer_text(Query.key_expr, Query.parameters, head["asked"], content)
assert verifies(other.public, text, head["signature"]) and head["journal"] == other.public
print(address["goal_id"])
"#;
    let (_, rest) = README.split_once("In Python these are the bytes").unwrap();
    let (_, program) = rest.split_once("```python\n").unwrap();
    let (program, _) = program.split_once("```").unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let ran = Command::new(python)
        .args(["-B", "-c", &format!("{program}{CHECK}")])
        .arg(goal)
        .env("PYTHONPATH", root.join("crates/cell/examples/python"))
        .output()
        .unwrap();
    assert_eq!(stdout(&ran).trim(), id, "{}", stderr(&ran));
}

#[test]
fn readme_shows_the_messages_of_a_cell() {
    let Some(python) = python(&["numpy", "zenoh"]) else {
        return;
    };
    let (_, rest) = README.split_once("Watch it from Python").unwrap();
    let (_, rest) = rest.split_once("```python\n").unwrap();
    let (program, _) = rest.split_once("```").unwrap();
    assert!(program.lines().count() <= LINES);
    assert_eq!(program.matches(PRINTED).count(), 1);

    let lab = Lab::new();
    let cell = lab.cell(&[]);
    let mut watching = Command::new(&python)
        .args(["-u", "-c", &program.replace(PRINTED, &lab.endpoint)])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(watching.stdout.take().unwrap()).lines();
    let mut next = |holds: &str| {
        let found = lines.find_map(|line| line.ok().filter(|line| line.contains(holds)));
        found.unwrap_or_else(|| panic!("no line with {holds}"))
    };
    // What the cell did before, and what it measures while it rests.
    next("\"results_n\":0");
    let resting = next("cgf/cell/simulated/state");
    assert!(resting.contains("'goal_id': ''"), "{resting}");
    assert!(resting.contains("[0. 0. 0. 0. 0. 0. 0. 1.]"), "{resting}");
    let mut run = lab.dispatch().stderr(Stdio::null()).spawn().unwrap();
    let outcome = next("/outcome");
    assert!(outcome.contains("'result_n': 0"), "{outcome}");
    for process in [&mut run, &mut watching] {
        process.kill().unwrap();
        process.wait().unwrap();
    }
    drop(cell);
}
