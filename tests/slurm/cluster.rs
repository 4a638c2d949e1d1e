//! A Slurm of two nodes on the loopback interface, of Debian's packages `slurm-wlm` and `munge`, as root.

use std::{
    fs,
    net::TcpListener,
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::atomic::{AtomicU16, Ordering},
};

use tempfile::TempDir;

use crate::folder;

/// Starts, stops and kills it.
const SCRIPT: &str = include_str!("slurm.sh");

/// Its programs that must be there.
const PROGRAMS: [&str; 4] = ["slurmctld", "slurmd", "sbatch", "munged"];

/// Ports that a scheduler takes: the controller's, the one that its nodes have in common, and one for each node.
const PORTS: u16 = 4;

/// Ports that no outgoing connection is given, by Linux's default.
const PORT_RANGE: std::ops::Range<u16> = 20_000..32_000;

/// Schedulers that are tried, each on ports of its own: another program may take a free port before the daemons do.
const TRIES: usize = 3;

/// Groups of ports that this process has taken.
static TAKEN: AtomicU16 = AtomicU16::new(0);

/// A Slurm of two nodes, stopped when it is dropped.
pub(crate) struct Slurm {
    folder: TempDir,
    port: String,
}

impl Slurm {
    /// Starts it; where it cannot run, says so and returns `None`.
    pub(crate) fn start() -> Option<Self> {
        let has = |program: &str| {
            let mut found = Command::new("sh");
            found.args(["-c", &format!("command -v {program}")]);
            let found = found.stdout(Stdio::null()).status();
            found.is_ok_and(|status| status.success())
        };
        let is_root = fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0);
        if !PROGRAMS.into_iter().all(has) || !is_root {
            measured_data::print_skipped("no `slurmctld`, `slurmd` and `munged`, or not root");
            return None;
        }
        let mut said = String::new();
        for _ in 0..TRIES {
            match Self::new().started() {
                Ok(slurm) => return Some(slurm),
                Err(complaint) => said = complaint,
            }
        }
        measured_data::print_skipped(&format!("Slurm does not start: {said}"));
        None
    }

    /// Lays out its folder.
    fn new() -> Self {
        let folder = folder::in_memory();
        // Its jobs are no processes of this one: what they read must be open to them.
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
        fs::write(folder.path().join("slurm.sh"), SCRIPT).unwrap();
        // A job that no machine runs is given up sooner than after five minutes.
        let table =
            "[slurm]\nbegin_s = 20\n[srun]\nlaunch = [\"srun\", \"-n1\", \"-Q\"]\nat_once = 4\n";
        fs::write(folder.path().join("executors.toml"), table).unwrap();
        let port = free_ports().to_string();
        Self { folder, port }
    }

    /// Starts its daemons; returns what they complained of if they do not come up.
    fn started(self) -> Result<Self, String> {
        self.call(&["start"]).map(|()| self)
    }

    /// Calls the script; returns what it complained of if it fails.
    fn call(&self, words: &[&str]) -> Result<(), String> {
        let mut script = Command::new("bash");
        let (what, rest) = words.split_first().unwrap();
        script.arg(self.folder.path().join("slurm.sh")).arg(what);
        script.arg(self.dir()).arg(&self.port).args(rest);
        // Its daemons keep stdout and stderr open.
        let said = self.folder.path().join("said");
        script
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(fs::File::create(&said).unwrap());
        if script.status().unwrap().success() {
            return Ok(());
        }
        Err(fs::read_to_string(said).unwrap())
    }

    /// Kills a daemon: `slurmctld`, or a node's, `slurmd.n1`.
    pub(crate) fn kill(&self, daemon: &str) {
        self.call(&["kill", daemon]).unwrap();
    }

    /// Starts a daemon again, which goes on with the jobs that it knew.
    pub(crate) fn start_again(&self, daemon: &str) {
        self.call(&["again", daemon]).unwrap();
    }

    fn dir(&self) -> PathBuf {
        self.folder.path().join("slurm")
    }

    /// Its configuration, which its processes have in `SLURM_CONF`.
    pub(crate) fn conf(&self) -> PathBuf {
        self.dir().join("slurm.conf")
    }

    /// Lets a command use the depot and Slurm.
    pub(crate) fn with(&self, depot: &Path, mut command: Command) -> Command {
        command
            .env("PIPELINE_DEPOT", depot)
            .env(
                "PIPELINE_EXECUTORS",
                self.folder.path().join("executors.toml"),
            )
            .env("SLURM_CONF", self.conf());
        command
    }
}

impl Drop for Slurm {
    fn drop(&mut self) {
        // It has ended by itself.
        let _ended = self.call(&["stop"]);
    }
}

/// The first of [`PORTS`] ports in a row that nobody listens on, and that no other scheduler of this process has.
fn free_ports() -> u16 {
    let n_groups = (PORT_RANGE.end - PORT_RANGE.start) / PORTS;
    // Two processes that test at once begin at different ones.
    let own = u16::try_from(std::process::id() % u32::from(n_groups)).unwrap();
    let mut groups = (0..n_groups).map(|_| {
        let nth = own.wrapping_add(TAKEN.fetch_add(1, Ordering::Relaxed));
        PORT_RANGE.start + PORTS * (nth % n_groups)
    });
    let is_free = |first: &u16| {
        (*first..first + PORTS).all(|port| TcpListener::bind(("127.0.0.1", port)).is_ok())
    };
    groups.find(is_free).expect("free ports")
}

/// Processes with a variable in their environment, by their numbers.
pub(crate) fn processes_with(variable: &str, value: &Path) -> Vec<String> {
    let wanted = format!("{variable}={}", value.display());
    let all = fs::read_dir("/proc").unwrap();
    let names = all.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    let found = names.filter(|process| words(process, "environ").contains(&wanted));
    found.collect()
}

/// The workers that use a depot, by their numbers.
pub(crate) fn workers(depot: &Path) -> Vec<String> {
    let mut workers = processes_with("PIPELINE_DEPOT", depot);
    workers.retain(|process| words(process, "cmdline").contains(&"--scratch".to_owned()));
    workers
}

/// The texts of a file of a process that has ended or has them.
pub(crate) fn words(process: &str, file: &str) -> Vec<String> {
    let bytes = fs::read(Path::new("/proc").join(process).join(file)).unwrap_or_default();
    let words = bytes.split(|byte| *byte == 0);
    words
        .map(|word| String::from_utf8_lossy(word).into_owned())
        .collect()
}
