//! Dispatcher and cell as two programs over a real socket, each of which may die at any moment: no
//! motion is executed twice, and none is reported as done that is not.

use std::{
    fs,
    net::TcpListener,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::program::{
    bench::{Bench, stderr, stdout},
    cell_lab::{Lab, all_of, screened},
};

#[test]
fn remote_cell_executes_accepted_motions_and_remembers_them() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let taken = lab.taken();
    // At a second request, the cell reports its results and moves nothing.
    let again = lab
        .dispatch()
        .args(["--fresh", "dispatch"])
        .output()
        .unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    let said = format!("{taken} done before");
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
            said.contains("is unknown; the robot may have moved"),
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
        said.contains("is unknown; the robot may have moved"),
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
fn unreadable_or_contradictory_report_leaves_the_motion_unknown() {
    for (fault, said, row) in [
        ("garbled_answer@2", "cannot be read", None),
        ("garbled_report@2", "cannot be read", Some("cannot be read")),
        (
            "wrong_report@2",
            "reported rise -5 m",
            Some("reported rise -5 m"),
        ),
    ] {
        let mut lab = Lab::new();
        let cell = lab.cell(&["--fast", "--fault", fault]);
        let ran = lab.dispatch().output().unwrap();
        let text = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {text}");
        for part in [
            "outcome of motion `",
            "the robot may have moved",
            "(goal ",
            said,
            "look at the robot",
        ] {
            assert!(text.contains(part), "{fault}: {text}");
        }
        assert_eq!(lab.taken(), 2, "{fault}: nothing more is sent");
        // Nothing was stored as done; after a person has checked, the same command continues.
        let ran = lab.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{fault}: {}", stderr(&ran));
        let taken = lab.taken();
        lab.end(cell);
        let outcomes = lab.outcomes();
        assert_eq!(all_of(&outcomes), taken as u64, "{fault}: {outcomes:?}");
        let sql = "select message from executions where outcome = 'unknown'";
        let asked = lab.bench.ask(&["query", "--format", "csv", sql]);
        let unknown = stdout(&asked);
        let expected = 1 + usize::from(row.is_some());
        assert_eq!(unknown.lines().count(), expected, "{fault}: {unknown}");
        assert!(unknown.contains(row.unwrap_or_default()), "{unknown}");
    }
}

#[test]
fn a_motion_that_was_sent_is_named_when_its_cell_is_gone_or_another() {
    let mut lab = Lab::new();
    let cell = lab.cell(&["--fast", "--fault", "die_in_motion@2"]);
    assert_eq!(lab.dispatch().output().unwrap().status.code(), Some(1));
    lab.end(cell);
    let named = |text: &str| {
        for part in ["outcome of motion `", "the robot may have moved", "(goal "] {
            assert!(text.contains(part), "{text}");
        }
    };
    // Nobody is there.
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    named(&stderr(&ran));
    // Another is, which never took it: that says nothing.
    let journal = lab.bench.lake().join("cells/other");
    let other = lab.cell(&["--fast", "--journal", journal.to_str().unwrap()]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    named(&stderr(&ran));
    assert!(
        stderr(&ran).contains("the one that answers has"),
        "{}",
        stderr(&ran)
    );
    assert!(other.end().lines().all(|line| !line.starts_with("goal")));
    assert_eq!(lab.taken(), 2);
}

#[test]
fn cell_states_its_access_rules() {
    let lab = Lab::new();
    let cell = lab.cell(&["--fast"]);
    let said = cell.end();
    assert!(
        said.contains("any program on this machine can drive the robot"),
        "{said}"
    );
}

#[test]
fn an_endpoint_that_cannot_be_used_is_refused_before_any_stage_works() {
    let bench = Bench::new();
    for (cell, part) in [
        ("tls/localhost:7447", "needs an access file"),
        ("tcp/10.0.0.7:7447", "not protected"),
    ] {
        let ran = bench.run(&["--set", &format!("dispatch.cell={cell}")]);
        assert_eq!(ran.status.code(), Some(2), "{}", stderr(&ran));
        let said = stderr(&ran);
        assert!(said.contains(part) && said.contains("hint: "), "{said}");
        let runs = bench.ask(&["runs"]);
        assert!(stderr(&runs).contains("no run in the lake"));
    }
}

#[test]
fn cell_with_a_full_disk_rejects_goals_with_the_reason() {
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
    assert!(said.contains("nothing moved"), "{said}");
    lab.end(cell);
    // The accepted motion was executed and reported, though its report could not be stored.
    let before = lab.over.len();
    assert!(before > 0);
    // The next run continues from there, and resends nothing.
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
    // No folder of runs.
    fs::write(other.join("runs"), b"").unwrap();
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

#[test]
fn two_runs_at_once_have_a_cell_each() {
    let benches = [Bench::after(screened()), Bench::after(screened())];
    let runs = benches.each_ref().map(|bench| {
        let mut run = bench.command("run", &[]);
        run.stderr(Stdio::piped()).spawn().unwrap()
    });
    for run in runs {
        let ran = run.wait_with_output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    }
}

#[test]
fn a_port_that_is_taken_is_named_with_the_way_out() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", taken.local_addr().unwrap());
    let lake = tempfile::tempdir().unwrap();
    for command in ["cell", "router"] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args([command, "--listen", &endpoint, "--lake"])
            .arg(lake.path());
        let refused = program.output().unwrap();
        let said = stderr(&refused);
        assert_eq!(refused.status.code(), Some(1), "{command}: {said}");
        let told = format!("another program listens on `{endpoint}` already");
        assert!(said.contains(&told), "{command}: {said}");
        assert!(said.contains("`--listen tcp/127.0.0.1:0`"), "{said}");
    }
    // A run whose cell is asked to listen there says how to use another address.
    let bench = Bench::new();
    let listen = format!("dispatch.listen={endpoint}");
    let refused = bench.run(&["--set", &listen]);
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(
        said.contains("`--set dispatch.listen=tcp/127.0.0.1:0`"),
        "{said}"
    );
}
