//! Units made elsewhere: by a prefix that waits, and by a scheduler's jobs. The scheduler is a fake one of
//! four scripts, which loses jobs when a test asks for it; `slurm.rs` has Slurm itself. `PIPELINE_KILLS`
//! sets how often a run is killed.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::PathBuf,
    process::{Child, Command, Output, Stdio},
    thread,
    time::{Duration, Instant},
};

use rand::Rng;
use tempfile::TempDir;

use crate::cluster::workers;
use crate::engine::place::{
    CHAIN, LONG, Place, Running, assert_same, chances, files_below, free_port, name, number, put,
    stderr, stdout, well,
};
use crate::folder;

/// The scheduler's commands, by name.
const COMMANDS: [(&str, &str); 4] = [
    ("sbatch", include_str!("elsewhere/sbatch")),
    ("squeue", include_str!("elsewhere/squeue")),
    ("scancel", include_str!("elsewhere/scancel")),
    ("scontrol", include_str!("elsewhere/scontrol")),
];

/// A depot and a scheduler.
pub(crate) struct Cluster {
    folder: TempDir,
}

impl Cluster {
    pub(crate) fn new() -> Self {
        let cluster = Self {
            folder: folder::in_memory(),
        };
        for folder in ["depot", "commands", "fake", "scratch"] {
            fs::create_dir(cluster.path(folder)).unwrap();
        }
        for (name, script) in COMMANDS {
            let path = cluster.path("commands").join(name);
            put(&path, script.as_bytes());
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        cluster
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Lets a command use the depot and the fake scheduler.
    pub(crate) fn with(&self, mut command: Command) -> Command {
        let path = std::env::var("PATH").unwrap();
        let path = format!("{}:{path}", self.path("commands").display());
        command
            .env("PIPELINE_DEPOT", self.path("depot"))
            .env("PIPELINE_EXECUTORS", self.path("executors.toml"))
            .env("TMPDIR", self.path("scratch"))
            .env("FAKE", self.path("fake"))
            .env("PATH", path);
        command
    }

    fn run(&self, machine: &Place, arguments: &[&str]) -> Output {
        let arguments = [&["--on", "slurm"], arguments].concat();
        well(self.with(machine.command("run", &arguments)))
    }

    /// The lines that the scheduler's commands have noted which begin with a word.
    pub(crate) fn calls(&self, word: &str) -> Vec<String> {
        let calls = fs::read_to_string(self.path("fake/calls")).unwrap_or_default();
        let lines = calls.lines().filter(|line| line.starts_with(word));
        lines.map(str::to_owned).collect()
    }

    /// Asserts that a run has left no message and no worker's lake.
    pub(crate) fn assert_tidy(&self) {
        assert_eq!(
            files_below(&self.path("depot/messages")),
            [] as [PathBuf; 0]
        );
        assert_eq!(files_below(&self.path("scratch")), [] as [PathBuf; 0]);
    }
}

impl Drop for Cluster {
    /// Ends workers that are left, as a scheduler does: they would wait for the depot.
    fn drop(&mut self) {
        for process in workers(&self.path("depot")) {
            let _killed = Command::new("kill").args(["-9", &process]).status();
        }
    }
}

fn machine() -> Place {
    Place::with_inputs(CHAIN, 6)
}

/// A machine with five stages, and their number of units: `PIPELINE_PARTS` sets how many partitions three of
/// them have, `PIPELINE_PART_BYTES` how large these are.
pub(crate) fn graph() -> (Place, usize) {
    let n_parts = number("PIPELINE_PARTS", 6);
    let place = Place::with_inputs(CHAIN, n_parts);
    let n_bytes = number("PIPELINE_PART_BYTES", 0);
    if n_bytes > 0 {
        for part in 0..n_parts {
            let bytes: Vec<u8> = (0..n_bytes)
                .map(|at| ((at * (part + 1)) >> 3) as u8)
                .collect();
            place.input(&name(part), &bytes);
        }
    }
    (place, 3 * n_parts + 2)
}

#[test]
fn jobs_and_processes_behind_a_prefix_give_the_bytes_of_threads() {
    let cluster = Cluster::new();
    let (place, n_units) = graph();
    let started = Instant::now();
    cluster.run(&place, &[]);
    let took = started.elapsed();
    assert_eq!(place.take_log().len(), n_units);
    // What is shown is there; other files are in the depot until they are asked for.
    assert_eq!(
        well(cluster.with(place.bare(&place.lake(), "pull")))
            .status
            .code(),
        Some(0)
    );
    let expected = place.undisturbed(&[]);
    assert_same(&place.published(), &expected, "jobs");
    assert_eq!(cluster.calls("submit").len(), 5, "one for each output");
    let n_queries = cluster.calls("query").len();
    let n_most = 5 + usize::try_from(took.as_secs()).unwrap();
    assert!(n_queries <= n_most, "{n_queries} queries in {took:?}");
    cluster.assert_tidy();

    let other = Cluster::new();
    let scratch = other.path("scratch");
    put(
        &other.path("executors.toml"),
        format!(
            "[box]\nlaunch = [\"nice\"]\nscratch = \"{}\"\nat_once = 2\n",
            scratch.display()
        )
        .as_bytes(),
    );
    let lake = place.path("lake_behind_a_prefix");
    well(other.with(place.command_in(&lake, "run", &["--on", "box"])));
    assert_eq!(place.take_log().len(), n_units);
    well(other.with(place.bare(&lake, "pull")));
    assert_same(
        &crate::engine::place::published(&lake),
        &expected,
        "a prefix",
    );
    other.assert_tidy();

    let lake = place.path("lake_of_processes");
    well(place.command_in(&lake, "run", &["--processes"]));
    assert_same(
        &crate::engine::place::published(&lake),
        &expected,
        "processes",
    );
}

/// A machine reached by `ssh`, its server stopped when this is dropped.
struct Sshd {
    server: Child,
    folder: TempDir,
}

impl Sshd {
    /// Starts it; where it cannot run, says so and returns `None`.
    fn start() -> Option<Self> {
        let folder = folder::in_memory();
        let path = |name: &str| folder.path().join(name).display().to_string();
        for key in ["host", "own"] {
            let mut made = Command::new("ssh-keygen");
            made.args(["-q", "-t", "ed25519", "-N", "", "-f", &path(key)]);
            if !made.status().is_ok_and(|status| status.success()) {
                measured_data::print_skipped("no `ssh-keygen`");
                return None;
            }
        }
        // Where it lowers its rights; its package makes it at the machine's start.
        let _there = fs::create_dir_all("/run/sshd");
        let port = free_port();
        let mut server = Command::new("/usr/sbin/sshd");
        server.args(["-D", "-e", "-f", "/dev/null", "-h", &path("host")]);
        for option in [
            format!("Port={port}"),
            "ListenAddress=127.0.0.1".to_owned(),
            format!("AuthorizedKeysFile={}", path("own.pub")),
            "StrictModes=no".to_owned(),
            "PidFile=none".to_owned(),
        ] {
            server.args(["-o", &option]);
        }
        let said = fs::File::create(path("said")).unwrap();
        let Ok(server) = server.stderr(said).stdin(Stdio::null()).spawn() else {
            measured_data::print_skipped("no `/usr/sbin/sshd`");
            return None;
        };
        let config = format!(
            "Host node\nHostName 127.0.0.1\nPort {port}\nIdentityFile {}\nIdentitiesOnly yes\n\
             BatchMode yes\nConnectTimeout 5\nStrictHostKeyChecking no\nUserKnownHostsFile /dev/null\nLogLevel ERROR\n",
            path("own")
        );
        put(&folder.path().join("config"), config.as_bytes());
        let mut machine = Self { server, folder };
        let until = Instant::now() + LONG;
        while !machine.answers() {
            let ended = machine.server.try_wait().unwrap();
            if ended.is_some() || Instant::now() > until {
                let said = fs::read_to_string(machine.folder.path().join("said")).unwrap();
                measured_data::print_skipped(&format!("nobody may come by `ssh`: {said}"));
                return None;
            }
            thread::sleep(Duration::from_millis(200));
        }
        Some(machine)
    }

    fn answers(&self) -> bool {
        let mut ssh = Command::new("ssh");
        let ssh = ssh.arg("-F").arg(self.config()).args(["node", "true"]);
        ssh.output().is_ok_and(|output| output.status.success())
    }

    fn config(&self) -> PathBuf {
        self.folder.path().join("config")
    }
}

impl Drop for Sshd {
    fn drop(&mut self) {
        let _killed = self.server.kill();
        let _ended = self.server.wait();
    }
}

#[test]
fn a_machine_behind_ssh_gives_the_bytes_of_threads() {
    let Some(node) = Sshd::start() else { return };
    let cluster = Cluster::new();
    let (place, _) = graph();
    let table = format!(
        "[node]\nlaunch = [\"ssh\", \"-F\", \"{}\", \"node\"]\nscratch = \"{}\"\nat_once = 4\n",
        node.config().display(),
        cluster.path("scratch").display()
    );
    put(&cluster.path("executors.toml"), table.as_bytes());
    well(cluster.with(place.command("run", &["--on", "node"])));
    assert_eq!(place.take_log(), [], "this machine made nothing");
    well(cluster.with(place.bare(&place.lake(), "pull")));
    assert_same(&place.published(), &place.undisturbed(&[]), "ssh");
    cluster.assert_tidy();
}

#[test]
fn short_units_stay_here_and_arrays_are_as_small_as_the_scheduler_wants() {
    let cluster = Cluster::new();
    let place = Place::with_inputs(CHAIN, 400);
    let mut run = cluster.with(place.command("run", &["--on", "slurm", "--until", "split"]));
    well({
        run.env("MOST", "20");
        run
    });
    let calls = cluster.calls("submit");
    let sizes = calls.iter().map(|call| call.rsplit(' ').next().unwrap());
    let sizes: Vec<&str> = sizes.collect();
    assert_eq!(sizes, ["20", "20", "18"], "58 jobs of seven units");
    assert_eq!(place.take_log().len(), 400);
    // How long they take is known of these.
    let place = machine();
    place.run_well(&["--until", "split"]);
    place.take_log();
    cluster.run(&place, &["--until", "split", "--set", "split.add=1"]);
    assert_eq!(place.take_log().len(), 6);
    assert_eq!(cluster.calls("submit").len(), 3);
}

#[test]
fn what_is_lost_is_tried_again_but_not_for_ever() {
    for (n_lost, code) in [("2", 0), ("9", 1)] {
        let (cluster, said) = run_six_units("LOSE", n_lost, code);
        assert!(
            said.contains("ended as FAILED and left no result"),
            "{said}"
        );
        assert_eq!(cluster.calls("submit").len(), 3, "{said}");
        assert_eq!(said.contains("was lost 3 times"), code == 1, "{said}");
    }
}

#[test]
fn a_job_that_others_displaced_or_whose_machine_was_lost_costs_no_try() {
    for state in ["PREEMPTED", "NODE_FAIL"] {
        let (cluster, said) = six_units(&[("LOSE", "4"), ("AS", state)], "", 0);
        assert_eq!(cluster.calls("submit").len(), 5, "{said}");
        assert!(said.contains(&format!("ended as {state}")), "{said}");
    }
}

#[test]
fn what_cannot_succeed_is_tried_once_and_the_message_names_cause_and_option() {
    let resources = "\n[stages.split.resources]\nmemory_gb = 2\ntime_min = 3\ncores = 64\n";
    let memory = [
        "needed more than 2 GB",
        "raise `memory_gb` in `resources` of `[stages.split]` in `",
    ];
    let time = [
        "needed more than 3 min 00 s",
        "raise `time_min` in `resources` of `[stages.split]` in `",
    ];
    for (trouble, parts, n_cancels) in [
        ([("LOSE", "9"), ("AS", "TIMEOUT")], time, 0),
        ([("LOSE", "9"), ("AS", "OUT_OF_MEMORY")], memory, 0),
        (
            [
                ("LOSE", "9"),
                ("SAID", "slurmstepd: error: Exceeded job memory limit"),
            ],
            memory,
            0,
        ),
        (
            [("WAIT", "PartitionConfig"), ("AS", "")],
            [
                "6 units wait (PartitionConfig)",
                "which ask for `cores = 64`, `memory_gb = 2`",
            ],
            1,
        ),
        (
            [
                ("REFUSE", "Requested node configuration is not available"),
                ("AS", ""),
            ],
            [
                "`slurm` takes no jobs: ",
                "Requested node configuration is not available",
            ],
            1,
        ),
    ] {
        let (cluster, said) = six_units(&trouble, resources, 1);
        let n_tried = cluster.calls("try").len();
        assert_eq!(n_tried, 1, "{trouble:?}: {said}");
        assert_eq!(
            cluster.calls("cancel").len(),
            n_cancels,
            "{trouble:?}: {said}"
        );
        for part in parts {
            assert!(said.contains(part), "{trouble:?}: {part}: {said}");
        }
        assert_eq!(
            said.contains("its log is `"),
            trouble[0].0 == "LOSE",
            "{said}"
        );
    }
}

#[test]
fn a_job_that_somebody_holds_stays_held() {
    let cluster = Cluster::new();
    let place = machine();
    let arguments = ["--on", "slurm", "--until", "split"];
    let mut run = cluster.with(place.command("run", &arguments));
    run.env("WAIT", "JobHeldUser");
    let mut run = Running::start(run);
    run.wait_for_line("why they wait", |line| {
        line.ends_with("6 units wait (JobHeldUser)")
    });
    thread::sleep(Duration::from_secs(10));
    assert_eq!(run.child.try_wait().unwrap(), None);
    assert_eq!(cluster.calls("submit").len(), 1);
    let mut interrupt = Command::new("kill");
    interrupt.args(["-INT", &run.child.id().to_string()]);
    well(interrupt);
    assert_eq!(run.finish().0, Some(130));
}

#[test]
fn resources_of_a_stage_reach_the_scheduler_and_doctor_asks_for_them() {
    let cluster = Cluster::new();
    let mut pipeline = CHAIN.replace("[stages.first]", "resources = RESOURCES\n[stages.first]");
    let resources = "{ cores = 2, partition = \"short\", account = \"lab\", qos = \"high\", constraint = \"a100\", \
                     gres = \"gpu:a100:1\", environment = [\"export LOADED=yes\", \"echo loaded\"] }";
    pipeline = pipeline.replace("RESOURCES", resources);
    let place = Place::with_inputs(&pipeline, 2);
    cluster.run(&place, &["--until", "split"]);
    let said = cluster.calls("words").concat();
    for word in [
        "--cpus-per-task=2",
        "--partition=short",
        "--account=lab",
        "--qos=high",
        "--constraint=a100",
        "--gres=gpu:a100:1",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    let logs = files_below(&cluster.path("depot/logs"));
    assert!(
        logs.iter()
            .all(|log| fs::read_to_string(log).unwrap().contains("loaded"))
    );
    let doctor = cluster.with(place.command("doctor", &["--on", "slurm"]));
    let said = stdout(&well(doctor));
    assert!(
        said.contains("slurm, split") && said.contains("takes jobs with its resources"),
        "{said}"
    );
    let mut doctor = cluster.with(place.command("doctor", &["--on", "slurm"]));
    doctor.env("REFUSE", "Invalid partition name specified");
    let said = stdout(&doctor.output().unwrap());
    assert!(
        said.contains("refuses jobs with `cores = 2`, `partition = \"short\"`"),
        "{said}"
    );
}

#[test]
fn a_unit_that_fails_lets_the_others_go_on_and_all_failures_are_listed() {
    let chain = CHAIN.replace(
        "[stages.first]",
        "max_skipped_fraction = 0.0\n[stages.first]",
    );
    for (keep_going, n_made) in [(true, 4), (false, 0)] {
        let cluster = Cluster::new();
        let table = format!("[slurm]\nkeep_going = {keep_going}\n");
        put(&cluster.path("executors.toml"), table.as_bytes());
        let place = Place::with_inputs(&chain, 6);
        let arguments = ["--on", "slurm", "--until", "split"];
        let mut run = Running::start(cluster.with(place.held(&arguments)));
        for number in 0..6 {
            run.wait_for(&place, &name(number));
        }
        // What they read has changed: two fail.
        for number in [1, 4] {
            place.input(&name(number), b"another");
            place.let_go(&name(number));
        }
        if keep_going {
            run.wait_for_line("a failure", |line| line.starts_with("fail   split.parts"));
            for number in [0, 2, 3, 5] {
                place.let_go(&name(number));
            }
        }
        let (code, said) = run.finish();
        assert_eq!(code, Some(1), "{said}");
        // As a scheduler does whose jobs are canceled.
        for process in workers(&cluster.path("depot")) {
            let _killed = Command::new("kill").args(["-9", &process]).status();
        }
        let other = Place::with_inputs(&chain, 6);
        for number in [1, 4] {
            other.input(&name(number), b"another");
        }
        well(cluster.with(other.command("run", &["--until", "split"])));
        assert_eq!(other.take_log().len(), 6 - n_made, "{said}");
        if keep_going {
            assert!(
                said.contains("error: 2 of 6 units of `split.parts` failed:"),
                "{said}"
            );
            assert_eq!(said.matches(".log` shows its log").count(), 2, "{said}");
        }
    }
}

#[test]
fn units_that_are_short_and_out_already_are_taken_over() {
    let cluster = Cluster::new();
    let place = machine();
    // How long they take is known.
    well(cluster.with(place.command("run", &["--until", "split"])));
    place.take_log();
    put(&cluster.path("fake/hold"), b"");
    let forced = [
        "--on",
        "slurm",
        "--until",
        "split",
        "--set",
        "split.table=false",
    ];
    let other = machine();
    let mut run = Running::start(cluster.with(other.command("run", &forced)));
    run.wait_for_line("its jobs are out", |line| line.starts_with("queue "));
    run.child.kill().unwrap();
    run.finish();
    let mut again = Running::start(cluster.with(place.command("run", &forced)));
    again.wait_for_line("it goes on", |line| line.starts_with("adopt  split.parts"));
    fs::remove_file(cluster.path("fake/hold")).unwrap();
    let (code, said) = again.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(place.take_log().len() + other.take_log().len(), 6, "{said}");
    assert_eq!(cluster.calls("submit").len(), 1, "{said}");
}

/// Runs a stage of six units on a scheduler with this trouble, and expects that all are made or, with an
/// exit code, none; returns what was said.
fn run_six_units(trouble: &str, value: &str, code: i32) -> (Cluster, String) {
    six_units(&[(trouble, value)], "", code)
}

/// The same with several troubles, and more in the pipeline file.
fn six_units(troubles: &[(&str, &str)], more: &str, code: i32) -> (Cluster, String) {
    let cluster = Cluster::new();
    let place = Place::with_inputs(&format!("{CHAIN}{more}"), 6);
    let arguments = ["--on", "slurm", "--until", "split"];
    let mut run = cluster.with(place.command("run", &arguments));
    let ran = run.envs(troubles.iter().copied()).output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(code), "{said}");
    assert_eq!(place.take_log().len(), if code == 0 { 6 } else { 0 });
    cluster.assert_tidy();
    (cluster, said)
}

#[test]
fn a_submission_that_fails_is_tried_again_but_not_for_ever() {
    for (fail, code) in [("4", 0), ("5", 1)] {
        let (cluster, said) = run_six_units("FAIL", fail, code);
        assert_eq!(cluster.calls("try").len(), 5, "{said}");
        assert_eq!(
            said.contains("`slurm` takes no jobs: `sbatch` failed: sbatch: error: Batch job"),
            code == 1,
            "{said}"
        );
    }
}

#[test]
fn jobs_that_run_in_the_schedulers_books_alone_are_lost() {
    let cluster = Cluster::new();
    put(&cluster.path("executors.toml"), b"[slurm]\nbegin_s = 2\n");
    let place = machine();
    let arguments = ["--on", "slurm", "--until", "split"];
    let mut run = cluster.with(place.command("run", &arguments));
    run.env("PHANTOM", "1");
    let said = stderr(&well(run));
    assert!(
        said.contains("is said to run on `fake`, where nothing has begun for 2 s"),
        "{said}"
    );
    assert_eq!(cluster.calls("submit").len(), 2, "{said}");
    assert_eq!(cluster.calls("cancel").len(), 1, "{said}");
    assert_eq!(place.take_log().len(), 6);
    cluster.assert_tidy();
}

#[test]
fn a_worker_that_dies_while_its_job_is_said_to_run_is_lost() {
    let cluster = Cluster::new();
    put(
        &cluster.path("executors.toml"),
        b"[slurm]\nheartbeat_timeout_s = 5\n",
    );
    let place = Place::with_inputs(CHAIN, 2);
    let mut run = Running::start(cluster.with(place.held(&["--on", "slurm", "--until", "split"])));
    // Longer than it may be silent: its signs keep it.
    run.wait_for(&place, "p000");
    thread::sleep(Duration::from_secs(8));
    assert_eq!(cluster.calls("submit").len(), 1);
    put(&cluster.path("fake/frozen"), b"");
    let workers = workers(&cluster.path("depot"));
    assert_eq!(workers.len(), 2);
    for process in workers {
        let mut kill = Command::new("kill");
        kill.args(["-9", &process]);
        well(kill);
    }
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let until = Instant::now() + LONG;
    while cluster.calls("submit").len() < 2 {
        let ended = run.child.try_wait().unwrap();
        assert!(
            ended.is_none() && Instant::now() < until,
            "nothing was submitted again: {}",
            run.finish().1
        );
        thread::park_timeout(Duration::from_millis(50));
    }
    fs::remove_file(cluster.path("fake/frozen")).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("is said to run on `fake`, where nothing has been heard for 5 s"),
        "{said}"
    );
    assert!(cluster.calls("cancel").len() <= 2, "{said}");
}

/// Starts a run of the units that the tests of two runs have in common.
fn start(cluster: &Cluster, place: &Place) -> Running {
    let arguments = ["--on", "slurm", "--until", "split"];
    Running::start(cluster.with(place.command("run", &arguments)))
}

/// Starts a run whose jobs wait.
fn held(cluster: &Cluster, place: &Place) -> Running {
    put(&cluster.path("fake/hold"), b"");
    let mut run = start(cluster, place);
    run.wait_for_line("its jobs are out", |line| line.starts_with("queue "));
    run
}

/// Whether a run says that it waits for another.
fn waits(line: &str) -> bool {
    line.starts_with("wait   split.parts: made by jobs of another run")
}

/// Starts a run whose jobs wait, and one that waits for them.
fn same_units(cluster: &Cluster, first: &Place, second: &Place) -> (Running, Running) {
    let one = held(cluster, first);
    let mut other = start(cluster, second);
    other.wait_for_line("it waits", waits);
    (one, other)
}

/// Waits until a run takes over the jobs of one that died, which then end.
fn takes_over(cluster: &Cluster, mut run: Running, places: [&Place; 2]) {
    run.wait_for_line("it goes on", |line| line.starts_with("adopt  split.parts"));
    fs::remove_file(cluster.path("fake/hold")).unwrap();
    let (code, said) = run.finish();
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(cluster.calls("submit").len(), 1, "{said}");
    let n_made: usize = places.map(|place| place.take_log().len()).iter().sum();
    assert_eq!(n_made, 6);
    cluster.assert_tidy();
}

#[test]
fn of_two_runs_of_the_same_units_one_waits_for_the_others_jobs() {
    let cluster = Cluster::new();
    let [first, second] = [(); 2].map(|()| machine());
    let (one, other) = same_units(&cluster, &first, &second);
    assert_eq!(cluster.calls("submit").len(), 1);
    fs::remove_file(cluster.path("fake/hold")).unwrap();
    for run in [one, other] {
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{said}");
    }
    assert_eq!(first.take_log().len() + second.take_log().len(), 6);
    assert_eq!(cluster.calls("submit").len(), 1);
    cluster.assert_tidy();
}

#[test]
fn a_run_that_waits_takes_over_the_jobs_of_one_that_dies() {
    let cluster = Cluster::new();
    let [first, second] = [(); 2].map(|()| machine());
    let (mut one, other) = same_units(&cluster, &first, &second);
    one.child.kill().unwrap();
    one.finish();
    takes_over(&cluster, other, [&first, &second]);
}

#[test]
fn the_jobs_of_a_run_that_died_on_another_machine_are_taken_over() {
    let cluster = Cluster::new();
    let [first, second] = [(); 2].map(|()| machine());
    let mut one = held(&cluster, &first);
    one.child.kill().unwrap();
    one.finish();
    // Nothing tells this machine that a process of another has ended.
    let drivers = fs::read_dir(cluster.path("depot/messages/drivers")).unwrap();
    let drivers: Vec<PathBuf> = drivers.map(|it| it.unwrap().path()).collect();
    assert_eq!(drivers.len(), 1);
    let heartbeat = fs::read_to_string(&drivers[0]).unwrap();
    let mut heartbeat: serde_json::Value = serde_json::from_str(&heartbeat).unwrap();
    heartbeat["host"] = "elsewhere".into();
    put(&drivers[0], heartbeat.to_string().as_bytes());

    let mut other = start(&cluster, &second);
    other.wait_for_line("it waits", |line| {
        waits(line) && line.ends_with("on `elsewhere`; taken over after 45 s without a heartbeat")
    });
    takes_over(&cluster, other, [&first, &second]);
}

#[test]
fn a_failure_is_not_tried_again_and_its_log_is_named() {
    let cluster = Cluster::new();
    let place = machine();
    let mut run = cluster.with(place.command("run", &["--on", "slurm"]));
    // Written while it is made: the job fails, and so would another.
    let failed = run
        .env("OWN_STAGES_LOG", place.path("no/folder/log"))
        .output()
        .unwrap();
    let said = stderr(&failed);
    assert_eq!(failed.status.code(), Some(1), "{said}");
    assert_eq!(cluster.calls("submit").len(), 1, "{said}");
    for part in [
        "error: 6 of 6 units of `split.parts` failed:",
        "stage `split` failed at `p005`: ",
        "less ",
        ".log` shows its log",
    ] {
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn another_build_refuses_orders_and_names_the_crate() {
    let cluster = Cluster::new();
    let place = machine();
    // The jobs' program is another than that of the run.
    let sbatch = cluster.path("commands/sbatch");
    let script = fs::read_to_string(&sbatch).unwrap();
    let script = script.replace(
        "SLURM_ARRAY_TASK_ID=",
        "OWN_STAGES_CODE=split=2 SLURM_ARRAY_TASK_ID=",
    );
    put(&sbatch, script.as_bytes());
    let refused = cluster
        .with(place.command("run", &["--on", "slurm"]))
        .output()
        .unwrap();
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(
        said.contains("is not made by this build, whose code differs in: own_stages"),
        "{said}"
    );
    assert_eq!(place.take_log(), []);
}

#[test]
fn a_killed_run_goes_on_with_the_jobs_that_it_left() {
    let mut rng = chances("kills of a run with jobs");
    for kill in 0..number::<usize>("PIPELINE_KILLS", 3) {
        let cluster = Cluster::new();
        let place = machine();
        put(&cluster.path("fake/hold"), b"");
        let arguments = ["--on", "slurm", "--until", "first"];
        let mut run = Running::start(cluster.with(place.command("run", &arguments)));
        let until = Instant::now() + LONG;
        while cluster.calls("query").is_empty() {
            assert!(Instant::now() < until, "nothing was submitted");
            thread::park_timeout(Duration::from_millis(5));
        }
        // In the middle of what it does, which is made while it is dead or after.
        thread::sleep(Duration::from_millis(rng.random_range(0..50)));
        if kill % 2 == 1 {
            fs::remove_file(cluster.path("fake/hold")).unwrap();
            thread::sleep(Duration::from_millis(rng.random_range(0..3000)));
        }
        run.child.kill().unwrap();
        run.finish();
        let again = cluster.with(place.command("run", &arguments));
        let again = Running::start(again);
        thread::sleep(Duration::from_millis(300));
        let _there = fs::remove_file(cluster.path("fake/hold"));
        let (code, said) = again.finish();
        assert_eq!(code, Some(0), "{said}");
        assert_eq!(place.take_log().len(), 12, "nothing is made twice: {said}");
        if kill % 2 == 0 {
            assert!(said.contains("adopt  split.parts"), "{said}");
            assert_eq!(cluster.calls("submit").len(), 2, "{said}");
        }
        cluster.assert_tidy();
    }
}

#[test]
fn collection_beside_a_run_by_jobs_forgets_nothing() {
    for round in 0..number::<usize>("PIPELINE_ROUNDS", 3) {
        let cluster = Cluster::new();
        let place = Place::with_inputs(CHAIN, 12);
        let add = format!("first.add={round}");
        let mut run = place.command("run", &["--on", "slurm", "--set", &add]);
        run.env("OWN_STAGES_TAKES", "300");
        let mut run = Running::start(cluster.with(run));
        while run.child.try_wait().unwrap().is_none() {
            let _there = cluster
                .with(place.bare(&place.lake(), "gc"))
                .output()
                .unwrap();
        }
        let (code, said) = run.finish();
        assert_eq!(code, Some(0), "{said}");
        well(cluster.with(place.bare(&place.lake(), "verify")));
    }
}

#[test]
fn an_interrupt_cancels_what_was_submitted() {
    let cluster = Cluster::new();
    let place = machine();
    put(&cluster.path("fake/hold"), b"");
    let mut run = Running::start(cluster.with(place.command("run", &["--on", "slurm"])));
    run.wait_for_line("where its units wait", |line| line.starts_with("queue "));
    let mut interrupt = Command::new("kill");
    well({
        interrupt.args(["-INT", &run.child.id().to_string()]);
        interrupt
    });
    let (code, said) = run.finish();
    assert_eq!(code, Some(130), "{said}");
    assert_eq!(cluster.calls("cancel").len(), 1, "{said}");
    fs::remove_file(cluster.path("fake/hold")).unwrap();
    cluster.run(&place, &["--until", "split"]);
    assert_eq!(place.take_log().len(), 6);
    cluster.assert_tidy();
}

/// Parts, and something that must not be done twice for each.
pub(crate) const ACTS: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"

[stages.act]
kind = "act"
inputs.parts = "split.parts"
"#;

#[test]
fn what_moves_a_robot_stays_here_and_is_done_on_one_machine_alone() {
    let cluster = Cluster::new();
    let [first, second] = [(); 2].map(|()| Place::with_inputs(ACTS, 3));
    // It begins, and ends in the middle.
    let mut run = cluster.with(first.command("run", &["--on", "slurm"]));
    let failed = run.env("OWN_STAGES_FAIL", "acting").output().unwrap();
    assert_eq!(failed.status.code(), Some(1), "{}", stderr(&failed));
    let acted = |place: &Place| {
        let log = place.take_log();
        log.iter().filter(|made| made.kind == "act").count()
    };
    assert_eq!(acted(&first), 1, "never tried again by itself");
    assert_eq!(cluster.calls("submit").len(), 1, "the parts alone");
    let refused = cluster.with(second.command("run", &[])).output().unwrap();
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("moves a robot, and a lake on `"), "{said}");
    assert_eq!(acted(&second), 0);
    // A copy of the lake has its results, and not its claims.
    let copy = first.path("copy_of_the_lake");
    let mut copied = Command::new("cp");
    copied.arg("-a").arg(first.lake()).arg(&copy);
    well(copied);
    let refused = cluster.with(first.command_in(&copy, "run", &[])).output();
    let said = stderr(&refused.unwrap());
    assert!(said.contains("moves a robot, and a lake on `"), "{said}");
    assert_eq!(acted(&first), 0);
    // The machine that claimed it goes on.
    well(cluster.with(first.command("run", &[])));
    assert_eq!(acted(&first), 3);
    well(cluster.with(second.command("run", &[])));
    assert_eq!(acted(&second), 0, "it has the results");
    // Without the depot nobody can know.
    let third = Place::with_inputs(ACTS, 4);
    fs::remove_dir_all(cluster.path("depot")).unwrap();
    let alone = ["--depot-down", "alone"];
    let refused = cluster.with(third.command("run", &alone)).output().unwrap();
    let said = stderr(&refused);
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot be known"), "{said}");
    assert_eq!(acted(&third), 0);
}

#[test]
fn wrong_names_and_missing_depots_are_told() {
    let cluster = Cluster::new();
    let place = machine();
    for (arguments, parts) in [
        (
            vec!["--on", "slurn"],
            ["no executor `slurn` is known", "known are: slurm"],
        ),
        (
            vec!["--on", "slurm", "--processes"],
            ["cannot be used with", "--processes"],
        ),
    ] {
        let refused = cluster
            .with(place.command("run", &arguments))
            .output()
            .unwrap();
        assert_eq!(refused.status.code(), Some(2));
        for part in parts {
            assert!(stderr(&refused).contains(part), "{}", stderr(&refused));
        }
    }
    let refused = place.command("run", &["--on", "slurm"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        stderr(&refused).contains("export PIPELINE_DEPOT="),
        "{}",
        stderr(&refused)
    );
    let doctor = cluster
        .with(place.command("doctor", &["--on", "slurm"]))
        .output()
        .unwrap();
    let said = stdout(&doctor);
    assert!(said.contains("a worker on `"), "{said}{}", stderr(&doctor));
    cluster.assert_tidy();
}
