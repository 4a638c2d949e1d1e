//! The Python of the cell's README, as it is printed there.

use std::{
    env,
    io::{BufRead, BufReader},
    process::{Command, Stdio},
};

use crate::cell_lab::Lab;

const README: &str = include_str!("../../crates/cell/README.md");
/// The endpoint in it.
const PRINTED: &str = "tcp/127.0.0.1:7447";
/// Lines of a program that can be read at a glance.
const LINES: usize = 22;

#[test]
fn the_readme_shows_what_happens_at_a_cell() {
    let Ok(python) = env::var("PIPELINE_PYTHON") else {
        println!("skipped: `PIPELINE_PYTHON` names no Python");
        return;
    };
    let has = Command::new(&python)
        .args(["-c", "import numpy, zenoh"])
        .status();
    if !has.is_ok_and(|status| status.success()) {
        println!("skipped: `{python}` has no `zenoh` and `numpy`");
        return;
    }
    let (_, rest) = README.split_once("```python\n").unwrap();
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
