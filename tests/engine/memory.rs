//! Memory does not grow with the bytes of a lake.

use std::{
    fs::{self, File},
    io::Write,
    os::unix::fs::FileExt,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

use crate::engine::place::Place;

const MIB: u64 = 1 << 20;

/// Stages that keep every byte they read: artifacts have twice the bytes of the input files.
const TWO_STAGES: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.map]
kind = "map"
inputs.parts = "split.parts"
add = 1

[stages.gather]
kind = "gather"
inputs.parts = "map.parts"
"#;

/// Makes a place whose lake comes to hold artifacts of `total` bytes in eight files.
fn place(total: u64) -> Place {
    let place = Place::new(TWO_STAGES);
    for number in 0_u8..4 {
        let path = place.inputs().join(format!("p{number}.txt"));
        let mut file = File::create(path).unwrap();
        file.write_all(&[b'a' + 2 * number]).unwrap();
        // The rest is a hole in the file, which reads as zeros.
        file.write_all_at(b"z", total / 8 - 1).unwrap();
    }
    place
}

/// Runs a command well and returns the most memory that it had resident, in bytes.
fn peak(mut command: Command) -> u64 {
    command.stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    loop {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        peak = peak.max(kib.unwrap_or(0) * 1024);
        if let Some(status) = child.try_wait().unwrap() {
            assert_eq!(status.code(), Some(0), "{command:?}");
            return peak;
        }
        thread::park_timeout(Duration::from_millis(1));
    }
}

/// A command and what it does.
type Named = (&'static str, fn(&Place) -> Command);

fn compare(commands: &[Named]) {
    let (small, large) = (place(64 * MIB), place(640 * MIB));
    for (what, command) in commands {
        let [small, large] = [&small, &large].map(|place| peak(command(place)));
        println!("{what}: {} and {} MiB", small / MIB, large / MIB);
        assert!(
            large < small + 64 * MIB,
            "{what} takes {} MiB for 64 MiB of artifacts and {} MiB for 640",
            small / MIB,
            large / MIB
        );
    }
}

#[test]
fn a_run_takes_no_more_memory_for_more_bytes() {
    compare(&[
        ("run", |place| place.command("run", &[])),
        ("run that finds everything", |place| {
            place.command("run", &[])
        }),
        ("run that reads everything", |place| {
            place.command("run", &["--set", "gather.min_bytes=1"])
        }),
    ]);
}

#[test]
fn verifying_takes_no_more_memory_for_more_bytes() {
    compare(&[
        ("run", |place| place.command("run", &["--until", "split"])),
        ("verify", |place| place.bare(&place.lake(), "verify")),
    ]);
}
