//! Dispatcher and cell as two programs over a real socket, of which each may die at any moment: no
//! motion is executed twice, and none is said to be done that is not.

use std::{
    fs,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::{
    bench::{stderr, stdout},
    cell_lab::{Lab, all_of},
};

#[test]
fn a_cell_elsewhere_executes_what_was_accepted_and_knows_it_when_it_is_asked_again() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let taken = lab.taken();
    // Asked anew, the cell tells what it did, and does nothing.
    let again = lab
        .dispatch()
        .args(["--fresh", "dispatch"])
        .output()
        .unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    let said = format!("{taken} the cell had executed before and did not again");
    assert!(stderr(&again).contains(&said), "{}", stderr(&again));
    assert_eq!(lab.taken(), taken);
    lab.end(cell);
    let outcomes = lab.outcomes();
    assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
    assert_eq!(lab.over.len(), taken);
}

#[test]
fn a_cell_that_dies_with_a_goal_leaves_it_unknown_and_the_next_run_goes_on() {
    for fault in [
        "die_before_answer@2",
        "die_after_answer@2",
        "die_in_motion@2",
    ] {
        let mut lab = Lab::new();
        let cell = lab.cell(&["--fast", "--fault", fault]);
        let ran = lab.dispatch().output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {said}");
        assert!(
            said.contains("is unknown, the robot may have moved"),
            "{said}"
        );
        assert!(said.contains("look at the robot"), "{said}");
        lab.end(cell);
        let cell = lab.cell(&["--fast"]);
        let ran = lab.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{fault}: {}", stderr(&ran));
        let taken = lab.taken();
        lab.end(cell);
        let outcomes = lab.outcomes();
        assert_eq!(outcomes.get("unknown"), Some(&1), "{fault}: {outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{fault}: {outcomes:?}");
        // Of all but the unknown one the cell has seen the end.
        assert_eq!(lab.over.len() + 1, taken, "{fault}");
    }
}

#[test]
fn answers_that_are_lost_late_or_doubled_change_nothing() {
    let mut lab = Lab::new();
    let faults = [
        "lose_answer@1",
        "double_answer@3",
        "lose_result@4",
        "late_answer@5",
    ];
    let mut arguments = vec!["--fast"];
    for fault in faults {
        arguments.extend(["--fault", fault]);
    }
    let cell = lab.cell(&arguments);
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_dispatcher_killed_at_fifty_moments_sends_nothing_twice() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    for number in 0..50 {
        // Another moment each time, over the second in which it starts and sends.
        let pause = Duration::from_millis(20 + number * 389 % 900);
        let mut run = lab.dispatch().stderr(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        while started.elapsed() < pause && run.try_wait().unwrap().is_none() {
            thread::sleep(Duration::from_millis(1));
        }
        let _gone = run.kill();
        run.wait().unwrap();
    }
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_cell_that_hangs_is_unknown_and_tells_when_it_goes_on() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast", "--fault", "late_answer@2"]);
    let mut run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    // Stopped while it is late with the answer to its second goal.
    lab.wait_until_taken(2);
    cell.signal("-STOP");
    let ended = run.wait().unwrap();
    assert_eq!(ended.code(), Some(1));
    cell.signal("-CONT");
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_cell_that_never_answers_is_unknown_in_time_and_the_next_run_finds_out() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast", "--fault", "never_answer@2"]);
    let started = Instant::now();
    let ran = lab.dispatch().output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert!(
        said.contains("is unknown, the robot may have moved"),
        "{said}"
    );
    // Five seconds for the answer, and the program's own time.
    assert!(
        started.elapsed() < Duration::from_secs(30),
        "{:?}",
        started.elapsed()
    );
    assert_eq!(lab.taken(), 2);
    lab.end(cell);
    // It had moved after all, and the one that is started after it knows.
    assert_eq!(lab.over.len(), 2);
    let cell = lab.cell(&["--fast"]);
    lab.dispatch_to_the_end(cell);
}

#[test]
fn a_cell_whose_disk_is_full_takes_nothing_more_and_says_why() {
    let allowed = Command::new("unshare").args(["-rm", "true"]).status();
    if !allowed.is_ok_and(|status| status.success()) {
        println!("skipped: no user namespaces here");
        return;
    }
    let mut lab = Lab::new();
    let journal = lab.bench.lake().join("small");
    fs::create_dir(&journal).unwrap();
    let mut shell = Command::new("unshare");
    let script = "mount -t tmpfs -o size=1m none \"$JOURNAL\"; exec \"$@\"";
    shell
        .args(["-rm", "sh", "-euc", script, "sh"])
        .arg(env!("CARGO_BIN_EXE_pipeline"))
        .env("JOURNAL", &journal);
    let arguments = ["--fast", "--journal", journal.to_str().unwrap()];
    let cell = lab.cell_of(shell, &arguments);
    let ran = lab.dispatch().output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot write down"), "{said}");
    assert!(said.contains("nothing of it has moved"), "{said}");
    lab.end(cell);
    // What was taken was carried out and told, though its report could not be kept.
    let before = lab.over.len();
    assert!(before > 0);
    // The next run goes on from there, and sends nothing again.
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    lab.end(cell);
    let outcomes = lab.outcomes();
    for wrong in ["rejected", "unknown"] {
        assert!(!outcomes.contains_key(wrong), "{outcomes:?}");
    }
    assert!(lab.over.len() > before);
    assert_eq!(all_of(&outcomes), lab.over.len() as u64);
}

#[test]
fn a_lake_that_cannot_be_read_is_named_where_an_object_is_looked_for() {
    let mut lab = Lab::new();
    let other = lab.bench.lake().join("other");
    fs::create_dir(&other).unwrap();
    // No folder of tables.
    fs::write(other.join("tables"), b"").unwrap();
    let cell = lab.cell_in(&other, &["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let said = cell.end();
    assert!(said.contains("cannot look for it in the lake"), "{said}");
    lab.hear(&said);
    assert!(lab.over.is_empty());
    let sql = "select message from executions where outcome = 'rejected'";
    let asked = lab.bench.ask(&["query", "--format", "csv", sql]);
    assert!(
        stdout(&asked).contains("cannot look for it in the lake"),
        "{}",
        stdout(&asked)
    );
}

#[test]
fn two_cells_do_not_share_a_journal() {
    let lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let refused = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["cell", "--fast", "--listen", "tcp/127.0.0.1:0", "--lake"])
        .arg(lab.bench.lake())
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
    assert!(
        stderr(&refused).contains("cell's journal"),
        "{}",
        stderr(&refused)
    );
    drop(cell);
}
