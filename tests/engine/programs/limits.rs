//! Programs that flood their output, hang, take too much memory, or are interrupted: they end with all their
//! processes.

use std::{
    fs,
    path::Path,
    process::Command,
    thread,
    time::{Duration, Instant},
};

use super::{fails, numbers, place, table, texts};
use crate::engine::place::{LONG, Running, put, well};

#[test]
fn a_program_that_floods_its_output_is_killed() {
    let errors = place("yes this is what it prints forever >&2");
    let said = fails(
        &errors,
        &[],
        &[
            "printed more than 32 MB to stderr",
            "it was killed",
            "print less",
        ],
    );
    assert!(said.lines().count() < 40, "{said}");
    for entry in fs::read_dir(errors.lake().join("logs")).unwrap() {
        assert!(entry.unwrap().metadata().unwrap().len() < 40 << 20);
    }
    let one_line = place("yes | tr -d '\\n'");
    fails(&one_line, &[], &["printed more than 32 MB to stdout"]);
    let progress = place("yes 'progress 0.5 still at it' | head -n 1000000");
    fails(
        &progress,
        &[],
        &[
            "printed more than 100000 lines of progress",
            "one for each percent",
        ],
    );
}

#[test]
fn a_program_that_hangs_is_killed_with_all_its_processes() {
    let hangs =
        "sleep 1000 & echo $! >> PIDS; setsid sleep 1000 & echo $! >> PIDS; echo $$ >> PIDS; ";
    for (end, message) in [
        ("wait", "did not end within 1 s (`timeout_s`)"),
        ("sleep 1000", "did not end within 1 s (`timeout_s`)"),
        ("exit 0", "ended and left processes behind"),
    ] {
        for flags in [&[][..], &["--processes"]] {
            let place = place("true");
            let pids = place.path("pids");
            let script = format!("{hangs}{end}").replace("PIDS", &pids.display().to_string());
            put(&place.path("break.sh"), script.as_bytes());
            let flags = [flags, &["--set", "lines.timeout_s=1", "--jobs", "1"]].concat();
            fails(
                &place,
                &flags,
                &[message, "it was killed with all its processes"],
            );
            all_ended(&pids, 3);
        }
    }
}

/// Waits until none of the processes named in a file lives.
fn all_ended(pids: &Path, at_least: usize) {
    let text = fs::read_to_string(pids).unwrap();
    let pids: Vec<u32> = text.lines().map(|line| line.parse().unwrap()).collect();
    assert!(pids.len() >= at_least, "{pids:?}");
    let until = Instant::now() + LONG;
    for pid in pids {
        while is_alive(pid) {
            assert!(Instant::now() < until, "process {pid} lives on");
            thread::park_timeout(Duration::from_millis(5));
        }
    }
}

fn is_alive(pid: u32) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat
        .rsplit_once(") ")
        .and_then(|(_, after)| after.chars().next());
    state.is_some_and(|state| state != 'Z')
}

#[test]
fn a_program_that_takes_too_much_memory_is_killed() {
    // A text that doubles, in a process of its own.
    let place = place("sh -c 'x=xxxxxxxx; while :; do x=$x$x; done'");
    fails(
        &place,
        &["--set", "lines.memory_mb=50"],
        &[
            "MB of memory, more than 50 (`memory_mb`)",
            "raise `memory_mb`",
        ],
    );
}

#[test]
fn an_interrupted_run_ends_its_programs_with_all_their_processes() {
    let hangs =
        "sleep 1000 & echo $! >> PIDS; setsid sleep 1000 & echo $! >> PIDS; echo $$ >> PIDS; wait";
    for flags in [&["--jobs", "1"][..], &["--jobs", "1", "--processes"]] {
        for signal in ["-INT", "-KILL"] {
            let place = place("true");
            let pids = place.path("pids");
            let script = hangs.replace("PIDS", &pids.display().to_string());
            put(&place.path("break.sh"), script.as_bytes());
            let mut run = Running::start(place.command("run", flags));
            let until = Instant::now() + LONG;
            while fs::read_to_string(&pids)
                .unwrap_or_default()
                .lines()
                .count()
                < 3
            {
                assert!(Instant::now() < until && run.child.try_wait().unwrap().is_none());
                thread::park_timeout(Duration::from_millis(5));
            }
            let mut kill = Command::new("kill");
            kill.args([signal, &run.child.id().to_string()]);
            well(kill);
            let (code, said) = run.finish();
            assert_eq!(code, (signal == "-INT").then_some(130), "{said}");
            all_ended(&pids, 3);
            let path = table(
                &place,
                vec![("length_m", numbers(&[1.5])), ("name", texts(&["a"]))],
            );
            put(
                &place.path("break.sh"),
                format!("cp {path} out/part.parquet").as_bytes(),
            );
            place.run_well(flags);
            let verified = place.bare(&place.lake(), "verify");
            well(verified);
        }
    }
}
