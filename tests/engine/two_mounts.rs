//! A folder that two machines mount, as two mounts of it by `sshfs` on this one: neither sees the locks
//! of the other. Without `sshfs` and `sftp-server` (Debian's packages `sshfs` and
//! `openssh-sftp-server`) these tests skip, saying so. `PIPELINE_ROUNDS` sets how often both run.

use std::{
    collections::BTreeMap,
    fs::{self, Permissions},
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use tempfile::TempDir;

use crate::engine::place::{CHAIN, LONG, Place, number, put, stderr, stdout};
use crate::folder;

/// The program to which `sshfs` speaks, here without a network between.
const SERVER: &str = "/usr/lib/openssh/sftp-server";

/// A folder and two mounts of it.
struct Shared {
    folder: TempDir,
    mounts: Vec<PathBuf>,
}

impl Shared {
    /// Mounts a folder twice; says why not, if it cannot be done here.
    fn new() -> Option<Self> {
        let mut shared = Self {
            folder: folder::in_memory(),
            mounts: Vec::new(),
        };
        let has_sshfs = Command::new("sshfs").arg("--version").output().is_ok();
        if !has_sshfs || !Path::new(SERVER).exists() || !Path::new("/dev/fuse").exists() {
            measured_data::print_skipped("no `sshfs`, `sftp-server` or `/dev/fuse`");
            return None;
        }
        fs::create_dir(shared.path("served")).unwrap();
        let server = shared.path("server");
        put(&server, format!("#!/bin/sh\nexec {SERVER}\n").as_bytes());
        fs::set_permissions(&server, Permissions::from_mode(0o755)).unwrap();
        for name in ["one", "two"] {
            let mount = shared.path(name);
            fs::create_dir(&mount).unwrap();
            let mut sshfs = Command::new("sshfs");
            sshfs
                .arg("-o")
                .arg(format!("ssh_command={}", server.display()))
                .arg(format!("any:{}", shared.path("served").display()))
                .arg(&mount)
                .stdin(Stdio::null());
            let mounted = sshfs.output().unwrap();
            if !mounted.status.success() {
                measured_data::print_skipped(&format!("cannot mount: {}", stderr(&mounted)));
                return None;
            }
            shared.mounts.push(mount);
        }
        let seen = shared.path("served/seen");
        put(&seen, b"");
        let until = Instant::now() + LONG;
        while !shared
            .mounts
            .iter()
            .all(|mount| mount.join("seen").exists())
        {
            assert!(Instant::now() < until, "the mounts do not come up");
            thread::park_timeout(Duration::from_millis(10));
        }
        fs::remove_file(seen).unwrap();
        Some(shared)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        for mount in &self.mounts {
            let mut unmount = Command::new("fusermount3");
            let _gone = unmount.arg("-uz").arg(mount).status();
        }
    }
}

#[test]
fn two_machines_share_a_depot_on_a_folder_without_common_locks() {
    let Some(shared) = Shared::new() else { return };
    let machines = [(); 2].map(|()| Place::with_inputs(CHAIN, 8));
    for round in 0..number::<usize>("PIPELINE_ROUNDS", 4) {
        let values = [
            format!("first.add={}", round % 250),
            format!("second.add={}", round / 250),
        ];
        let arguments = ["--set", &values[0], "--set", &values[1]];
        let runs: Vec<_> = machines
            .iter()
            .zip(&shared.mounts)
            .map(|(machine, mount)| {
                let mut run = machine.command("run", &arguments);
                run.env("PIPELINE_DEPOT", mount)
                    .stdout(Stdio::null())
                    .stderr(Stdio::piped());
                run.spawn().unwrap()
            })
            .collect();
        for run in runs {
            let output = run.wait_with_output().unwrap();
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(0), "{said}");
            assert!(!said.contains("warn "), "{said}");
        }
        let mut made: BTreeMap<_, usize> = BTreeMap::new();
        for execution in machines.iter().flat_map(Place::take_log) {
            *made.entry((execution.seed, execution.output)).or_default() += 1;
        }
        let most = made.values().max().copied().unwrap_or(0);
        assert!(most <= 2, "a unit was made {most} times: {made:?}");
    }
    let mut verify = machines[0].bare(&machines[0].lake(), "verify");
    verify
        .arg("--depot")
        .env("PIPELINE_DEPOT", shared.path("served"));
    let verified = verify.output().unwrap();
    assert_eq!(verified.status.code(), Some(0), "{}", stdout(&verified));
}

#[test]
fn a_lake_on_a_folder_without_common_locks_is_told_and_kept_to_one_machine() {
    let Some(shared) = Shared::new() else { return };
    let machine = Place::with_inputs(CHAIN, 2);
    let lake = shared.mounts[0].join("lake");
    let run = || machine.command_in(&lake, "run", &[]).output().unwrap();
    let first = run();
    let said = stderr(&first);
    assert_eq!(first.status.code(), Some(0), "{said}");
    assert!(
        said.contains("on `fuse.sshfs`, whose locks hold on this machine only"),
        "{said}"
    );
    assert!(said.contains("export PIPELINE_DEPOT="), "{said}");
    let doctor = machine.command_in(&lake, "doctor", &[]).output().unwrap();
    let said = stdout(&doctor) + &stderr(&doctor);
    assert!(
        said.contains("`fuse.sshfs` keeps them on this machine"),
        "{said}"
    );
    // Another machine wrote to it first.
    put(&lake.join("locks/machine"), b"another");
    let mut changed = machine.command_in(&lake, "run", &["--set", "first.add=9"]);
    let refused = changed.output().unwrap();
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    for part in [
        "is that of the machine `another`",
        "locks/machine",
        "PIPELINE_DEPOT",
    ] {
        assert!(said.contains(part), "{said}");
    }
}
