//! Cost of a run on the machine that drives it while a scheduler's jobs make its units: memory, processor time,
//! requests to the depot and queries, for 1,000, 10,000 and 100,000 units.
//!
//! `cargo bench --bench cluster`, with `TMPDIR=/dev/shm` where that has 3 GB free. The scheduler is one of a hundred
//! nodes that run nothing: the results were made before, and this bench puts a worker's files (orders read, results,
//! ends) into the depot, a few thousand units a second.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;
#[path = "../own_stages/stages.rs"]
mod own_stages;

use std::{
    collections::BTreeMap,
    env, fs,
    io::Read,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Child, Command, ExitCode, Stdio},
    thread,
    time::{Duration, Instant},
};

use dataflow::{Digest, Event, UnitName};
use limits::Limits;
use serde_json::Value;
use tempfile::TempDir;

/// Variable with which this program is the pipeline's program, not the bench.
const AS_PROGRAM: &str = "OWN_STAGES_AS_PROGRAM";

/// Numbers of units.
const N_UNITS: [usize; 3] = [1_000, 10_000, 100_000];

/// Nodes of the cluster, and jobs that one of them takes at once.
const N_NODES: usize = 100;
const AT_ONCE: usize = 2;

/// Time that a job takes on a node.
const JOB_TIME: Duration = Duration::from_millis(500);

/// Time between looks at the cluster and at the run.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Time that a unit is said to have taken: jobs are as small as they get.
const UNIT_TIME: Duration = Duration::from_secs(46);

/// Greatest growth of the cost per unit, as a factor, with ten times as many units.
const MAX_TIMES_MORE: f64 = 1.3;

/// Relative difference of processor time from run to run.
const NOISE: f64 = 0.2;

fn main() -> ExitCode {
    if env::var_os(AS_PROGRAM).is_some() {
        return pipeline::command_line(&own_stages::kinds_with(|_| 1));
    }
    println!(
        "{:>8} {:>6} {:>8} {:>8} {:>12} {:>14} {:>16} {:>14}",
        "units",
        "jobs",
        "arrays",
        "queries",
        "memory, MB",
        "CPU, ms/unit",
        "requests/unit",
        "wall, s"
    );
    let costs = N_UNITS.map(|n_units| {
        let cost = Lab::new(n_units).measure();
        println!(
            "{:>8} {:>6} {:>8} {:>8} {:>12.1} {:>14.3} {:>16.2} {:>14.1}",
            n_units,
            cost.n_jobs,
            cost.n_arrays,
            cost.n_queries,
            cost.memory_b / 1e6,
            1e3 * cost.cpu_s / n_units as f64,
            cost.n_requests / n_units as f64,
            cost.wall_s
        );
        cost
    });
    let [few, more, most] = &costs;
    let [n_few, n_more, n_most] = N_UNITS.map(|n_units| n_units as f64);
    let mut limits = Limits::with_noise(NOISE);
    let unit_b = |cost: &Cost, n_units: f64| (cost.memory_b - few.memory_b) / (n_units - n_few);
    println!(
        "memory of a unit beyond the first 1,000: {:.1} KB",
        unit_b(most, n_most) / 1e3
    );
    limits.keep(
        "memory of a unit, 100,000 over 10,000",
        unit_b(most, n_most) / unit_b(more, n_more),
        ..=MAX_TIMES_MORE,
    );
    limits.keep(
        "CPU of a unit, 100,000 over 10,000",
        (most.cpu_s / n_most) / (more.cpu_s / n_more),
        ..=MAX_TIMES_MORE,
    );
    limits.keep(
        "requests of a unit, 100,000 over 10,000",
        (most.n_requests / n_most) / (more.n_requests / n_more),
        ..=MAX_TIMES_MORE,
    );
    limits.end()
}

/// Cost of a run.
struct Cost {
    n_jobs: usize,
    n_arrays: usize,
    n_queries: usize,
    memory_b: f64,
    cpu_s: f64,
    n_requests: f64,
    wall_s: f64,
}

/// A depot with results, and a machine that does not know them.
struct Lab {
    folder: TempDir,
    n_units: usize,
}

impl Lab {
    fn new(n_units: usize) -> Self {
        let lab = Self {
            folder: TempDir::new().unwrap(),
            n_units,
        };
        for folder in [
            "inputs",
            "slow",
            "gate",
            "depot",
            "commands",
            "fake",
            "elsewhere",
        ] {
            fs::create_dir(lab.path(folder)).unwrap();
        }
        for number in 0..n_units {
            let name = format!("inputs/p{number:06}.bin");
            fs::write(lab.path(&name), number.to_le_bytes()).unwrap();
        }
        fs::write(lab.path("slow/slow.bin"), "slow").unwrap();
        for (name, script) in [
            // As Slurm's commands; `queue` is what the cluster shows.
            (
                "sbatch",
                "for word in \"$@\"; do case $word in\n--array=0-*) last=${word#--array=0-} ;;\n\
                 --job-name=*) name=${word#--job-name=} ;;\nesac; done\n\
                 cat > \"$FAKE/script\"\necho $((last + 1)) > \"$FAKE/new\"\n\
                 mv \"$FAKE/new\" \"$FAKE/$name.array\"\necho 17\n",
            ),
            (
                "squeue",
                "echo >> \"$FAKE/queries\"\ncat \"$FAKE/queue\" 2> /dev/null\nexit 0\n",
            ),
            ("scancel", "exit 0\n"),
            ("scontrol", "echo 'MaxArraySize = 1001'\n"),
        ] {
            let path = lab.path("commands").join(name);
            fs::write(&path, format!("#!/bin/sh\n{script}")).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        lab
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A run over the files of a folder, in a lake of its own.
    fn run(&self, inputs: &str, lake: &str) -> Command {
        let path = self.path(&format!("{inputs}.toml"));
        let inputs = self.path(inputs);
        let text = format!(
            "seed = 7\n\n[stages.split]\nkind = \"split\"\nroot = \"{}\"\n",
            inputs.display()
        );
        fs::write(&path, text).unwrap();
        // The pipeline is known by its name.
        let of_all = self.path("graph.toml");
        fs::rename(path, &of_all).unwrap();
        let mut run = Command::new(env::current_exe().unwrap());
        run.env(AS_PROGRAM, "1").env_remove("PIPELINE_DEPOT");
        run.arg("run").arg(of_all);
        run.arg("--lake").arg(self.path(lake));
        run.stdout(Stdio::null()).stderr(Stdio::piped());
        run
    }

    /// Makes the results, and hides them; makes a slow unit on another machine, and has that make all the
    /// others by jobs.
    fn measure(&self) -> Cost {
        let depot = self.path("depot");
        let mut made = self.run("inputs", "first");
        ended(made.env("PIPELINE_DEPOT", &depot).spawn().unwrap());
        // Results that the run could not send within its patience.
        let mut push = Command::new(env::current_exe().unwrap());
        push.env(AS_PROGRAM, "1").env("PIPELINE_DEPOT", &depot);
        push.arg("push").arg("--lake").arg(self.path("first"));
        push.stdout(Stdio::null()).stderr(Stdio::piped());
        ended(push.spawn().unwrap());
        for folder in ["units", "runs"] {
            fs::rename(depot.join(folder), self.path("elsewhere").join(folder)).unwrap();
        }

        let mut slow = self.run("slow", "second");
        let slow = slow.env("OWN_STAGES_GATE", self.path("gate")).spawn();
        thread::sleep(UNIT_TIME);
        fs::remove_dir(self.path("gate")).unwrap();
        ended(slow.unwrap());

        let mut cluster = Cluster::new(self);
        let started = Instant::now();
        let paths = env::var("PATH").unwrap();
        let paths = format!("{}:{paths}", self.path("commands").display());
        let mut run = self.run("inputs", "second");
        run.args(["--on", "slurm"])
            .env("PIPELINE_DEPOT", &depot)
            .env("PIPELINE_EXECUTORS", self.path("executors.toml"))
            .env("FAKE", self.path("fake"))
            .env("PATH", paths);
        let mut run = run.spawn().unwrap();
        let process = PathBuf::from(format!("/proc/{}", run.id()));
        let (mut memory_b, mut cpu_s) = (0.0, 0.0);
        let mut said = run.stderr.take().unwrap();
        let said = thread::spawn(move || {
            let mut text = String::new();
            said.read_to_string(&mut text).unwrap();
            text
        });
        let status = loop {
            if let Some(found) = Usage::of(&process) {
                memory_b = found.memory_b;
                cpu_s = found.cpu_s;
            }
            if let Some(status) = run.try_wait().unwrap() {
                break status;
            }
            cluster.go_on();
            thread::park_timeout(LOOK_EVERY);
        };
        let said = said.join().unwrap();
        assert!(status.success(), "{said}");
        let shared = said.lines().find(|line| line.starts_with("depot "));
        let n_requests = shared.and_then(|line| {
            let (before, _) = line.split_once(" requests")?;
            before.rsplit(' ').next()?.parse().ok()
        });
        let queries = fs::read_to_string(self.path("fake/queries")).unwrap();
        assert_eq!(cluster.n_made, self.n_units, "{said}");
        Cost {
            n_jobs: cluster.arrays.values().map(Vec::len).sum(),
            n_arrays: cluster.arrays.len(),
            n_queries: queries.lines().count(),
            memory_b,
            cpu_s,
            n_requests: n_requests.unwrap(),
            wall_s: started.elapsed().as_secs_f64(),
        }
    }
}

/// Waits for a program that must succeed.
fn ended(program: Child) {
    let output = program.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}

/// Resources that a process has used so far.
struct Usage {
    memory_b: f64,
    cpu_s: f64,
}

impl Usage {
    /// Reads it from the process's folder in `/proc`; `None` once it has ended.
    fn of(process: &Path) -> Option<Self> {
        let status = fs::read_to_string(process.join("status")).ok()?;
        let line = status
            .lines()
            .find_map(|line| line.strip_prefix("VmHWM:"))?;
        let kib: f64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
        let stat = fs::read_to_string(process.join("stat")).ok()?;
        // Behind the name of the program; times are in hundredths of a second.
        let (_, fields) = stat.rsplit_once(") ")?;
        let times = fields.split(' ').skip(11).take(2);
        let ticks: f64 = times.filter_map(|time| time.parse::<f64>().ok()).sum();
        Some(Self {
            memory_b: kib * 1024.0,
            cpu_s: ticks / 100.0,
        })
    }
}

/// A job of an array.
#[derive(Clone, Copy, PartialEq)]
enum Job {
    Waiting,
    Running { node: usize, since: Instant },
    Over { node: usize },
}

/// Nodes that run nothing.
struct Cluster<'a> {
    lab: &'a Lab,
    /// The jobs of arrays by name.
    arrays: BTreeMap<String, Vec<Job>>,
    /// Numbers of jobs that each node runs.
    loads: Vec<usize>,
    n_made: usize,
}

impl<'a> Cluster<'a> {
    fn new(lab: &'a Lab) -> Self {
        Self {
            lab,
            arrays: BTreeMap::new(),
            loads: vec![0; N_NODES],
            n_made: 0,
        }
    }

    /// Takes what was submitted, ends jobs that have run, begins others, and shows all of them.
    fn go_on(&mut self) {
        for entry in fs::read_dir(self.lab.path("fake")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|ending| ending == "array") {
                let n_jobs = fs::read_to_string(&path).unwrap();
                let name = path.file_stem().unwrap().to_str().unwrap();
                let jobs = vec![Job::Waiting; n_jobs.trim().parse().unwrap()];
                self.arrays.insert(name.to_owned(), jobs);
                fs::remove_file(path).unwrap();
            }
        }
        let mut queue = String::new();
        let (lab, loads) = (self.lab, &mut self.loads);
        for (name, jobs) in &mut self.arrays {
            for (idx, job) in jobs.iter_mut().enumerate() {
                match *job {
                    Job::Waiting => {
                        let free = loads.iter().position(|load| *load < AT_ONCE);
                        if let Some(node) = free {
                            loads[node] += 1;
                            let since = Instant::now();
                            *job = Job::Running { node, since };
                        }
                    }
                    Job::Running { node, since } if since.elapsed() > JOB_TIME => {
                        self.n_made += lab.leave_results(name, idx);
                        loads[node] -= 1;
                        *job = Job::Over { node };
                    }
                    Job::Running { .. } | Job::Over { .. } => {}
                }
                let (state, node) = match *job {
                    Job::Waiting => ("PENDING", String::new()),
                    Job::Running { node, .. } => ("RUNNING", format!("n{node:03}")),
                    Job::Over { node } => ("COMPLETED", format!("n{node:03}")),
                };
                queue.push_str(&format!("{name}|{idx}|{state}|{node}|None\n"));
            }
        }
        let new = self.lab.path("fake/queue.new");
        fs::write(&new, queue).unwrap();
        fs::rename(new, self.lab.path("fake/queue")).unwrap();
    }
}

impl Lab {
    /// Leaves in the depot the files of a worker that makes the orders of a job; returns their number.
    fn leave_results(&self, array: &str, idx: usize) -> usize {
        let messages = self.path("depot/messages");
        let put = |path: PathBuf, bytes: &[u8]| {
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        };
        put(
            messages.join("here").join(array).join(idx.to_string()),
            b"node",
        );
        let orders = messages.join("orders").join(array).join(idx.to_string());
        let orders: Value = serde_json::from_slice(&fs::read(orders).unwrap()).unwrap();
        let orders = orders["orders"].as_array().unwrap();
        for order in orders {
            let fingerprint: Digest = serde_json::from_value(order["fingerprint"].clone()).unwrap();
            let unit: UnitName = serde_json::from_value(order["unit"].clone()).unwrap();
            let digits = fingerprint.to_hex();
            let record = format!("units/{}/{digits}.json", &digits[..2]);
            let to = self.path("depot").join(&record);
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            fs::rename(self.path("elsewhere").join(record), to).unwrap();
            let end = Event::UnitDone {
                unit,
                fingerprint,
                made_now: true,
                skipped: None,
            };
            let end = serde_json::to_vec(&end).unwrap();
            put(messages.join("ends").join(array).join(digits), &end);
        }
        orders.len()
    }
}
