//! An interrupt while a robot moves: its motion is canceled, and the canceled motion is neither
//! counted as a failure nor repeated without a request.

use std::{
    io::{BufRead, BufReader},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::{Lab, all_of},
};

/// Exit code that a shell gives an interrupted program.
const INTERRUPTED: Option<i32> = Some(130);

fn signal(process: &Child, name: &str) {
    let id = process.id().to_string();
    let sent = Command::new("kill").args([name, &id]).status().unwrap();
    assert!(sent.success());
}

/// Dispatches to a cell in real time until the middle of the second motion.
fn in_motion(lab: &Lab) -> Child {
    let run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    lab.wait_until_taken(2);
    thread::sleep(Duration::from_millis(400));
    run
}

/// The number in the only row of an answer.
fn number(lab: &Lab, sql: &str) -> i64 {
    let asked = lab.bench.ask(&["query", "--format", "csv", sql]);
    let text = stdout(&asked);
    text.lines().nth(1).unwrap().parse().unwrap()
}

#[test]
fn interrupted_motion_is_canceled_reported_and_resent_only_on_request() {
    for name in ["-INT", "-TERM"] {
        let mut lab = Lab::new();
        let cell = lab.cell(&[]);
        let run = in_motion(&lab);
        signal(&run, name);
        let ran = run.wait_with_output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), INTERRUPTED, "{name}: {said}");
        assert!(said.contains("stop   motion `"), "{name}: {said}");
        assert!(
            said.contains("at cell `simulated`: the robot stands"),
            "{said}"
        );
        assert!(said.contains("dispatch.resume_stopped=true"), "{said}");
        lab.end(cell);
        assert!(lab.over[1].contains("stopped: canceled"), "{:?}", lab.over);

        // The next run goes on behind it.
        let cell = lab.cell(&["--fast"]);
        let ran = lab.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        assert!(
            stderr(&ran).contains("1 stopped by a person"),
            "{}",
            stderr(&ran)
        );
        let taken = lab.taken();
        let outcomes = lab.outcomes();
        assert_eq!(outcomes.get("stopped"), Some(&1), "{outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
        let sql = "select sum(stopped_n) as n from trials";
        assert_eq!(number(&lab, sql), 1);
        let sql = "select sum(trials_n) as n from trials";
        assert_eq!(number(&lab, sql), i64::try_from(taken).unwrap() - 1);

        // At a rerun it is not repeated without a request.
        let fresh = || {
            let mut run = lab.dispatch();
            run.args(["--fresh", "dispatch"]);
            run
        };
        let ran = fresh().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        assert_eq!(lab.taken(), taken);
        for _ in 0..2 {
            let mut run = fresh();
            run.args(["--set", "dispatch.resume_stopped=true"]);
            let ran = run.output().unwrap();
            assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
            // It alone, and once.
            assert_eq!(lab.taken(), taken + 1);
        }
        let outcomes = lab.outcomes();
        assert!(!outcomes.contains_key("stopped"), "{outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
        lab.end(cell);
        lab.outcomes();
    }
}

#[test]
fn an_unanswered_cancellation_names_its_cell_and_warns() {
    let lab = Lab::new();
    let cell = lab.cell(&[]);
    for twice in [false, true] {
        let attempt = format!("dispatch.attempt={}", 1 + u32::from(twice));
        let taken = lab.taken();
        let mut run = lab.dispatch();
        run.args(["--set", &attempt]).stderr(Stdio::piped());
        let mut run = run.spawn().unwrap();
        lab.wait_until_taken(taken + 1);
        cell.signal("-STOP");
        signal(&run, "-INT");
        let mut said = String::new();
        let mut lines = BufReader::new(run.stderr.take().unwrap()).lines();
        let asked = Instant::now();
        for line in lines.by_ref() {
            let line = line.unwrap();
            said += &format!("{line}\n");
            if twice && line.contains("canceled, waiting up to 5.0 s") {
                signal(&run, "-INT");
            }
        }
        let waited = asked.elapsed();
        assert_eq!(run.wait().unwrap().code(), INTERRUPTED, "{said}");
        let told = if twice {
            "left without the cell's answer, the robot may still move"
        } else {
            "the robot may still move: no answer within 5.0"
        };
        assert!(said.contains(told), "{said}");
        let most = if twice { 4 } else { 15 };
        assert!(waited < Duration::from_secs(most), "{waited:?}: {said}");
        cell.signal("-CONT");
        // Without heartbeats, it aborts the motion.
        thread::sleep(Duration::from_secs(2));
    }
}
