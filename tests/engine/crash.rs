//! `kill -9` at random moments.

use std::{
    collections::BTreeSet,
    env, fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::engine::{
    place::{CHAIN, Place, assert_same, chances, files_below, published, stdout, well},
    program_maps::Maps,
};

/// Time for random moments in the default suite; `PIPELINE_KILLS` asks for a number of them.
const TIME: Duration = Duration::from_secs(15);
/// Most kills when most come too late.
const MOST_KILLS: usize = 200;

/// Flags of the runs of the chain: threads, or a process for each unit.
const THREADS: &[&str] = &[];
const PROCESSES: &[&str] = &["--processes"];

#[test]
fn a_killed_run_is_finished_by_the_next_one() {
    kill_at_random(THREADS, TIME, Maps::Stages, "crash");
}

#[test]
fn a_killed_run_of_programs_is_finished_by_the_next_one() {
    kill_at_random(THREADS, TIME / 2, Maps::Programs, "crash of programs");
    kill_at_random(
        PROCESSES,
        TIME / 3,
        Maps::Programs,
        "crash of processes of programs",
    );
}

#[test]
fn a_killed_run_of_processes_is_finished_by_the_next_one() {
    kill_at_random(PROCESSES, TIME / 3, Maps::Stages, "crash of processes");
}

fn kill_at_random(flags: &[&str], time: Duration, maps: Maps, test: &str) {
    let mut rng = chances(test);
    let place = Place::with_inputs(&maps.of(CHAIN), 8);
    let expected = place.undisturbed(&[]);
    let mut undisturbed = undisturbed_time(&place, flags);
    let names = place.names_by_seed(&["split", "first", "second", "gather", "group"]);
    let n_kills: Option<usize> = env::var("PIPELINE_KILLS")
        .ok()
        .map(|count| count.parse().unwrap());
    let started = Instant::now();
    let (mut n_done, mut n_running) = (0, 0);
    // On a machine whose load falls, the first kills come too late; each brings the next one forward.
    let is_short = |n_done, n_running| n_running * 4 <= n_done && n_done < MOST_KILLS;
    while n_kills.map_or(
        started.elapsed() < time || is_short(n_done, n_running),
        |count| n_done < count,
    ) {
        let lake = place.path(&format!("lake_{n_done}"));
        place.take_log();
        // The next run may be killed as well.
        let n_in_a_row = rng.random_range(1..=2);
        for _ in 0..n_in_a_row {
            let moment = undisturbed.mul_f64(rng.random_range(0.0..1.1));
            if kill_after(&place, &lake, flags, moment, &mut rng) {
                n_running += 1;
            } else {
                // The machine may be less busy now.
                undisturbed = undisturbed.min(moment);
            }
            n_done += 1;
        }
        let context = format!("{n_done} kills, {}", lake.display());
        let cached = cached(&place, &lake);
        place.take_log();
        well(place.command_in(&lake, "run", flags));
        assert_same(&published(&lake), &expected, &context);
        let made = place.take_log();
        let made = made.iter().map(|execution| &names[&execution.seed]);
        let again: Vec<_> = made.filter(|unit| cached.contains(*unit)).collect();
        assert!(again.is_empty(), "{again:?} were made again: {context}");
        // A process that was left behind may still look around in it.
        let _left = fs::remove_dir_all(&lake);
    }
    println!(
        "{n_done} kills within {:.3} s each, {n_running} before the end",
        undisturbed.as_secs_f64()
    );
    assert!(
        n_running * 4 > n_done,
        "the kills come too late to say much"
    );
}

/// Duration of an undisturbed run.
fn undisturbed_time(place: &Place, flags: &[&str]) -> Duration {
    let lake = place.path("lake_undisturbed");
    let started = Instant::now();
    well(place.command_in(&lake, "run", flags));
    let took = started.elapsed();
    fs::remove_dir_all(lake).unwrap();
    took
}

/// Starts a run, reads its published files meanwhile, and kills it, or one of its processes.
/// Returns whether it was still running.
fn kill_after(
    place: &Place,
    lake: &Path,
    flags: &[&str],
    moment: Duration,
    rng: &mut ChaCha8Rng,
) -> bool {
    let started = Instant::now();
    let mut command = place.command_in(lake, "run", flags);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let mut run = command.spawn().unwrap();
    loop {
        check_tables(lake);
        let left = moment.saturating_sub(started.elapsed());
        if left.is_zero() {
            break;
        }
        thread::park_timeout(left.min(Duration::from_millis(2)));
    }
    let is_running = run.try_wait().unwrap().is_none();
    if let Some(unit) = a_child(&run, rng) {
        // The unit's process dies; its run may continue or fail.
        let mut kill = Command::new("kill");
        kill.args(["-KILL", &unit.to_string()]);
        kill.stderr(Stdio::null()).status().unwrap();
    } else {
        run.kill().unwrap();
    }
    run.wait().unwrap();
    check_tables(lake);
    is_running
}

/// One of the processes that a run has started, or none, so that the run itself is killed.
fn a_child(run: &Child, rng: &mut ChaCha8Rng) -> Option<u32> {
    let threads = PathBuf::from(format!("/proc/{}/task", run.id()));
    let mut children: Vec<u32> = Vec::new();
    for thread in fs::read_dir(threads).into_iter().flatten().flatten() {
        let text = fs::read_to_string(thread.path().join("children")).unwrap_or_default();
        children.extend(
            text.split_whitespace()
                .filter_map(|id| id.parse::<u32>().ok()),
        );
    }
    let chosen = rng.random_range(0..=children.len());
    children.get(chosen).copied()
}

/// Every file that a reader of tables would find is whole.
fn check_tables(lake: &Path) {
    for path in files_below(&lake.join("tables")) {
        // Partitions may go away between being listed and being read.
        let Ok(bytes) = fs::read(&path) else {
            continue;
        };
        let is_whole = bytes.len() > 8 && bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1");
        assert!(is_whole, "`{}` is half a table", path.display());
    }
}

/// Returns the units that are cached according to a plan, by stage and partition.
fn cached(place: &Place, lake: &Path) -> BTreeSet<(String, String)> {
    let plan = well(place.command_in(lake, "plan", &["--format", "json"]));
    let plan: Value = serde_json::from_str(&stdout(&plan)).unwrap();
    let mut cached = BTreeSet::new();
    for node in plan["nodes"].as_array().unwrap() {
        for unit in node["units"].as_array().into_iter().flatten() {
            if unit["state"] == "cached" {
                let word = |value: &Value| value.as_str().unwrap().to_owned();
                cached.insert((word(&node["node"]["stage"]), word(&unit["partition"])));
            }
        }
    }
    cached
}
