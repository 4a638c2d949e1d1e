//! A process that does one training step at a time, on request.

use std::{
    env, fs,
    io::{BufRead, stdin},
    process::Command,
    thread,
    time::Instant,
};

use crate::{
    CLOUDS, HAND, POINTS, ROLE, THREADS,
    python::{self, Script},
};

/// A running contender and the times of its steps.
pub(crate) struct Contender {
    name: &'static str,
    script: Script,
    wall_s: Vec<f64>,
    cpu_s: Vec<f64>,
}

/// Times and memory of a contender.
pub(crate) struct Figure {
    pub(crate) name: &'static str,
    pub(crate) wall_s: f64,
    pub(crate) cpu_s: f64,
    pub(crate) peak_mb: f64,
}

impl Contender {
    /// Starts this program again in a role.
    pub(crate) fn own(name: &'static str, role: &str) -> Result<Self, String> {
        let program = env::current_exe().map_err(|err| err.to_string())?;
        let mut command = Command::new(&program);
        command
            .args([ROLE, role])
            .env("RAYON_NUM_THREADS", THREADS.to_string())
            .envs(threads_of(role));
        let script = Script::of(command, &program, "training.rs");
        Self::start(name, script.map_err(|err| err.to_string())?)
    }

    /// Starts a script in Python.
    pub(crate) fn python(name: &'static str, script: &str) -> Result<Self, String> {
        let sizes = [CLOUDS, POINTS].map(|size| size.to_string());
        let arguments = [HAND, sizes[0].as_str(), sizes[1].as_str()];
        let script = Script::start(&python::name(), script, &arguments, THREADS)?;
        Self::start(name, script)
    }

    fn start(name: &'static str, mut script: Script) -> Result<Self, String> {
        let said = script
            .ask("start")
            .map_err(|reason| format!("{name}, {reason}"))?;
        assert_eq!(said, "ready");
        Ok(Self {
            name,
            script,
            wall_s: Vec::new(),
            cpu_s: Vec::new(),
        })
    }

    /// Asks for a step.
    pub(crate) fn step(&mut self, counts: bool) {
        let answer = self.ask("step");
        let numbers: Vec<f64> = answer
            .split_whitespace()
            .map(|number| number.parse().unwrap())
            .collect();
        if counts {
            self.wall_s.push(numbers[0]);
            self.cpu_s.push(numbers[1]);
        }
    }

    /// Ends the process and gives the medians.
    pub(crate) fn finish(mut self) -> Figure {
        let peak_kb: f64 = self.ask("peak").parse().unwrap();
        Figure {
            name: self.name,
            wall_s: median(self.wall_s),
            cpu_s: median(self.cpu_s),
            peak_mb: peak_kb / 1000.0,
        }
    }

    fn ask(&mut self, what: &str) -> String {
        self.script.ask_again(what)
    }
}

/// The contender's side: answers each line with the seconds that `step` took, until there are no more.
pub(crate) struct Server {
    started: (Instant, f64),
}

impl Server {
    /// Says that steps can be asked for, and waits for the first.
    pub(crate) fn ready() -> Option<Self> {
        let mut first = String::new();
        stdin().lock().read_line(&mut first).unwrap();
        println!("ready");
        wait().then(|| Self { started: now() })
    }

    /// Answers with what passed since the last request, and waits for the next.
    pub(crate) fn answer(&mut self, loss: f32) -> bool {
        let (wall, cpu) = now();
        let (wall_before, cpu_before) = self.started;
        println!(
            "{} {} {loss}",
            (wall - wall_before).as_secs_f64(),
            cpu - cpu_before
        );
        let more = wait();
        self.started = now();
        more
    }
}

/// Waits for the next request, and answers those for the peak of memory.
fn wait() -> bool {
    let mut line = String::new();
    loop {
        line.clear();
        stdin().lock().read_line(&mut line).unwrap();
        match line.trim() {
            "" => return false,
            "peak" => println!("{}", peak_kb()),
            _ => return true,
        }
    }
}

/// Wall time, and CPU seconds of all threads of this process.
fn now() -> (Instant, f64) {
    // It writes the time down when a thread lets go.
    thread::yield_now();
    let tasks = fs::read_dir("/proc/self/task").unwrap();
    let ns = tasks.filter_map(|task| {
        // The scheduler's own count, finer than the ticks of `stat`.
        let text = fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    (Instant::now(), ns.sum::<f64>() / 1e9)
}

fn peak_kb() -> String {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    line.and_then(|line| line.split_whitespace().nth(1))
        .unwrap()
        .to_owned()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Returns the variable that sets candle's threads, as the program does before it trains; the naive contender keeps
/// candle's own.
fn threads_of(role: &str) -> Option<(&'static str, &'static str)> {
    (role == "ours").then_some(("CANDLE_NUM_THREADS", "1"))
}
