//! Cost of a training step at the paper's size, 32 clouds of 2000 points and 25 time samples, beside PyTorch of the
//! released model and beside candle's own operations.
//!
//! Every contender is a process of its own on two threads, asked for one step after the other in turn;
//! between its steps it waits for its input. `PIPELINE_PYTHON` names the Python that has `torch`,
//! `python3` where it is not set; without it the peer is skipped.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "training/contender.rs"]
mod contender;
mod limits;
#[path = "training/naive.rs"]
mod naive;
#[path = "training/ours.rs"]
mod ours;
mod python;

use std::{env, process::ExitCode, thread, time::Duration};

use contender::Contender;
use limits::Limits;
use mimalloc::MiMalloc;

/// As in the program.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Clouds of a step, points of a cloud.
const CLOUDS: usize = 32;
const POINTS: usize = 2000;
/// Threads of every contender.
const THREADS: usize = 2;
/// Steps of each contender; the first is not counted.
const ROUNDS: usize = 12;
/// Times between two steps, in which threads that spin come to rest.
const PAUSE: Duration = Duration::from_millis(400);
/// Argument with which this program is a contender itself.
const ROLE: &str = "--contender";
const HAND: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/data/robots/allegro_right.urdf"
);
/// Times that the released model in PyTorch takes longer, at least; and most memory, in MB.
const MIN_TIMES: f64 = 5.0;
const MAX_MB: f64 = 400.0;
/// Relative difference of a ratio of medians from run to run, with other programs beside.
const NOISE: f64 = 0.15;

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().collect();
    let role = arguments.iter().position(|argument| argument == ROLE);
    match role
        .and_then(|at| arguments.get(at + 1))
        .map(String::as_str)
    {
        Some("ours") => ours::serve(),
        Some("naive") => naive::serve(),
        Some(role) => {
            println!("no contender `{role}`");
            return ExitCode::FAILURE;
        }
        None => return race(),
    }
    ExitCode::SUCCESS
}

fn race() -> ExitCode {
    let mut contenders = vec![Contender::own("this crate", "ours").unwrap()];
    let peer = Contender::python("PyTorch, as released", "training/released_model.py");
    let naive = Contender::own("candle's operations", "naive");
    let has_peer = peer.is_ok();
    for contender in [peer, naive] {
        match contender {
            Ok(contender) => contenders.push(contender),
            Err(reason) => println!("skipped: {reason}"),
        }
    }
    for round in 0..ROUNDS {
        for contender in &mut contenders {
            thread::sleep(PAUSE);
            contender.step(round > 0);
        }
    }
    println!(
        "{CLOUDS} clouds of {POINTS} points, 25 time samples, {THREADS} threads, medians of {} steps",
        ROUNDS - 1
    );
    let figures: Vec<_> = contenders.into_iter().map(Contender::finish).collect();
    let ours = &figures[0];
    for figure in &figures {
        println!(
            "{:22} {:7.3} s of CPU ({:5.2} times), {:7.3} s of wall ({:5.2} times), {:6.0} MB at most",
            figure.name,
            figure.cpu_s,
            figure.cpu_s / ours.cpu_s,
            figure.wall_s,
            figure.wall_s / ours.wall_s,
            figure.peak_mb,
        );
    }
    let mut limits = Limits::with_noise(NOISE);
    if has_peer {
        let times = figures[1].cpu_s / ours.cpu_s;
        limits.keep("CPU of PyTorch as released over ours", times, MIN_TIMES..);
    }
    limits.keep("MB held by this crate", ours.peak_mb, ..=MAX_MB);
    limits.end()
}
