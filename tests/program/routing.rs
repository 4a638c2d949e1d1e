//! Dispatcher and cell as two programs connected by a third, a router, which may die at any moment.

use std::{
    env, fs,
    process::{Command, Stdio},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::{Duration, Instant},
};

use ::cell::{Counts, GoalOutcome, WatchEvent, Watcher};

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::{Lab, all_of},
};

#[test]
fn a_router_that_goes_away_before_the_answer_and_comes_back_changes_nothing() {
    let mut lab = Lab::behind_a_router();
    let router = lab.router();
    let cell = lab.cell(&["--fast", "--fault", "late_answer@2"]);
    let run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    lab.wait_until_taken(2);
    router.crash();
    thread::sleep(Duration::from_millis(500));
    let _router = lab.router();
    let ran = run.wait_with_output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let taken = lab.taken();
    let said = cell.end();
    assert!(said.contains("is there again"), "{said}");
    lab.hear(&said);
    let outcomes = lab.outcomes();
    assert!(!outcomes.contains_key("unknown"), "{outcomes:?}");
    assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
    assert_eq!(lab.over.len(), taken);
}

#[test]
fn a_router_that_stays_away_leaves_the_motion_unknown_and_the_next_run_finds_out() {
    let mut lab = Lab::behind_a_router();
    let router = lab.router();
    let mut cell = lab.cell(&["--fast", "--fault", "late_answer@2"]);
    let run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    lab.wait_until_taken(2);
    router.crash();
    let ran = run.wait_with_output().unwrap();
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    assert!(
        stderr(&ran).contains("is unknown; the robot may have moved"),
        "{}",
        stderr(&ran)
    );
    // The cell was there all the time, and comes back.
    let _router = lab.router();
    lab.wait_until_back(&mut cell);
    lab.dispatch_to_the_end(cell);
}

#[test]
fn motion_is_canceled_when_the_router_goes_away_and_reported_when_it_returns() {
    let mut lab = Lab::behind_a_router();
    let router = lab.router();
    let cell = lab.cell(&[]);
    let run = lab.dispatch().stderr(Stdio::piped()).spawn().unwrap();
    lab.wait_until_taken(1);
    thread::sleep(Duration::from_millis(300));
    router.crash();
    let ran = run.wait_with_output().unwrap();
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    lab.end(cell);
    assert_eq!(lab.over.len(), 1);
    assert!(lab.over[0].contains("no heartbeat"), "{}", lab.over[0]);
    let _router = lab.router();
    let cell = lab.cell(&["--fast"]);
    lab.dispatch_to_the_end(cell);
    let sql =
        "select message from executions where outcome = 'aborted' and message like 'no heart%'";
    let asked = lab.bench.ask(&["query", "--format", "csv", sql]);
    assert_eq!(stdout(&asked).lines().count(), 2, "{}", stdout(&asked));
}

#[test]
fn a_router_that_is_not_there_is_named() {
    let lake = tempfile::tempdir().unwrap();
    // Nothing listens on the first port.
    let refused = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["cell", "--connect", "tcp/127.0.0.1:1", "--lake"])
        .arg(lake.path())
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1));
    let said = stderr(&refused);
    assert!(said.contains("no connection to the router"), "{said}");
    assert!(said.contains("pipeline router --listen"), "{said}");
}

#[test]
fn a_second_cell_of_one_name_behind_one_router_does_not_start() {
    let mut lab = Lab::behind_a_router();
    let _router = lab.router();
    let cell = lab.cell(&["--fast"]);
    let refused = lab.refused_cell("cells/other");
    for part in ["another robot cell has the name `simulated`", "cell_name"] {
        assert!(refused.contains(part), "{refused}");
    }
    lab.dispatch_to_the_end(cell);
}

#[test]
fn only_a_dispatcher_with_a_certificate_moves_a_networked_cell() {
    let mut lab = Lab::on_a_network();
    let _router = lab.router();
    let cell = lab.cell(&["--fast"]);
    // The rules let a cell ask whether there is another of its name.
    let refused = lab.refused_cell("cells/other");
    assert!(refused.contains("another robot cell has"), "{refused}");
    let stranger = lab.dispatch().output().unwrap();
    assert_eq!(stranger.status.code(), Some(2), "{}", stderr(&stranger));
    assert!(
        stderr(&stranger).contains("needs an access file"),
        "{}",
        stderr(&stranger)
    );
    let viewer = lab.dispatch_as("viewer").output().unwrap();
    assert_eq!(viewer.status.code(), Some(1), "{}", stderr(&viewer));
    for part in ["did not answer", "access rules", "viewer.json5"] {
        assert!(stderr(&viewer).contains(part), "{}", stderr(&viewer));
    }
    assert_eq!(lab.taken(), 0);
    let dispatcher = lab.dispatch_as("dispatcher").output().unwrap();
    assert_eq!(dispatcher.status.code(), Some(0), "{}", stderr(&dispatcher));
    let taken = lab.taken();
    lab.end(cell);
    assert!(taken > 0 && lab.over.len() == taken);
    assert_eq!(all_of(&lab.outcomes()), taken as u64);
    // Who asks is no reason to ask again.
    let again = lab.dispatch_as("viewer").output().unwrap();
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
}

/// Watches until all goals are over and no more messages come.
fn watch(endpoint: &str, over: &AtomicBool) -> (Vec<GoalOutcome>, Counts) {
    let wait = Duration::from_secs(20);
    let mut watcher = Watcher::start(None, endpoint, "simulated", wait).unwrap();
    let mut outcomes = Vec::new();
    while !over.load(Ordering::Relaxed) {
        if let Some(WatchEvent::Outcome(outcome)) = watcher.next(Duration::from_millis(100)) {
            outcomes.push(outcome);
        }
    }
    (outcomes, watcher.counts())
}

/// Twenty seconds, or as many as `PIPELINE_WATCH_S` says: `PIPELINE_WATCH_S=600 cargo test --release
/// --workspace --test suite -- --nocapture routing::watcher`.
#[test]
fn watcher_misses_no_result_when_the_router_is_killed() {
    let seconds = env::var("PIPELINE_WATCH_S").map_or(20.0, |text| text.parse().unwrap());
    let mut lab = Lab::behind_a_router();
    let mut router = lab.router();
    let cell = lab.cell(&[]);
    let begun = Instant::now();
    let wait_until = |share: f64| {
        let left = seconds * share - begun.elapsed().as_secs_f64();
        thread::sleep(Duration::from_secs_f64(left.max(0.0)));
    };
    let over = AtomicBool::new(false);
    let (early, late) = thread::scope(|scope| {
        let (lab, over) = (&lab, &over);
        let early = scope.spawn(|| watch(&lab.endpoint, over));
        let sending = scope.spawn(|| {
            for attempt in 1.. {
                let attempt = format!("dispatch.attempt={attempt}");
                let mut run = lab.dispatch();
                run.args(["--set", &attempt]).stderr(Stdio::null());
                let mut run = run.spawn().unwrap();
                while run.try_wait().unwrap().is_none() {
                    thread::sleep(Duration::from_millis(20));
                    if begun.elapsed().as_secs_f64() > seconds {
                        run.kill().unwrap();
                        run.wait().unwrap();
                        return attempt;
                    }
                }
            }
            unreachable!("attempts do not end")
        });
        wait_until(0.2);
        let late = scope.spawn(|| watch(&lab.endpoint, over));
        for share in [0.4, 0.7] {
            wait_until(share);
            router.crash();
            thread::sleep(Duration::from_secs(1));
            router = lab.router();
        }
        println!("{}", sending.join().unwrap());
        // The motion without a waiting client is aborted, held for a while and reported.
        thread::sleep(Duration::from_secs(3));
        over.store(true, Ordering::Relaxed);
        (early.join().unwrap(), late.join().unwrap())
    });
    lab.end(cell);
    let taken = fs::read_to_string(lab.journal().join("taken")).unwrap();
    let taken: Vec<&str> = taken.lines().skip(1).collect();
    println!("{} goals in {seconds} s", taken.len());
    for (who, (outcomes, counts)) in [("early", &early), ("late", &late)] {
        println!("{who} {counts:?}");
        let ids: Vec<&str> = outcomes.iter().map(|o| o.goal_id.as_str()).collect();
        assert_eq!(ids, taken, "{who}");
        assert_eq!((counts.gaps_n, counts.unreadable_n), (0, 0), "{who}");
        assert!(counts.recovered_n > 0, "{who}: {counts:?}");
    }
    assert!(taken.len() > 2 && lab.over.len() == taken.len());
    // No goal was over twice.
    lab.outcomes();
}
