//! Speed and accuracy of the retargeting solver, beside `dex_retargeting` and beside the same
//! algorithm, SLSQP, without Python.
//!
//! `PIPELINE_PEER_DATA` names the folder of the three recorded problems, `HAND_position.npz`;
//! `PIPELINE_REAL_DATA` the folder with the hands' URDFs in `urdf`; `PIPELINE_PYTHON` the Python that
//! has `dex_retargeting` 0.5.0 and the wheel, `python3` where it is not set. What is missing is skipped.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "retargeting/batch.rs"]
mod batch;
mod limits;
#[path = "retargeting/ours.rs"]
mod ours;
#[path = "retargeting/peer.rs"]
mod peer;
#[path = "retargeting/problem.rs"]
mod problem;
mod python;
#[path = "retargeting/slsqp.rs"]
mod slsqp;

use std::{cell::RefCell, process::ExitCode, time::Instant};

use limits::Limits;
use nalgebra::Point3;
use ours::{FAST, Objective, TIGHT, best_of, points_at, true_minimum};
use peer::Peer;
use posture::{NoTerms, Posture, SearchOptions, Solver};
use problem::{HANDS, Problem};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// Frames that one side does before it is the other's turn.
const CHUNK: usize = 27;
/// Times that our side does each chunk; the first finds cold caches, and counts too.
const REPEATS: usize = 5;
/// λ of the paper's objective, which does not state it.
const LAMBDA: f64 = 0.04;
/// Relative difference of a ratio of medians from run to run: by a third with other programs
/// beside.
const NOISE: f64 = 0.35;

fn main() -> ExitCode {
    let mut limits = Limits::with_noise(NOISE);
    for (name, urdf, least) in HANDS {
        match Problem::read(name, urdf) {
            Ok(problem) => {
                race(&problem, least, &mut limits);
                minima(&problem, Objective::Peer);
                minima(&problem, Objective::Paper(LAMBDA));
            }
            Err(reason) => println!("{name}: skipped, {reason}"),
        }
    }
    if let Err(reason) = batch::race(&mut limits) {
        println!("a recording in one call: skipped, {reason}");
    }
    limits.end()
}

/// One way to retarget: its answers and its times.
#[derive(Default)]
struct Lane {
    us: Vec<f64>,
    cpu_us: f64,
    path: Vec<Posture>,
}

/// Runs all ways over the frames, chunk by chunk in turn, and prints their times and answers.
fn race(problem: &Problem, least: f64, limits: &mut Limits) {
    let mut peer = Peer::start(problem);
    let n = problem.targets.len();
    println!("\n{}, {n} frames", problem.name);
    reproduce(problem);
    let mut solver = Solver::new(&problem.hand);
    let other = RefCell::new(Solver::new(&problem.hand));
    let start = problem.hand.within_limits(&problem.peer_before[0]);
    let [mut ours, mut tight, mut theirs, mut whole, mut as_peer] =
        [(); 5].map(|()| Lane::default());
    let mut iterations = Vec::new();
    for first in (0..n).step_by(CHUNK) {
        let frames = first..(first + CHUNK).min(n);
        if let Ok(peer) = &mut peer {
            for (us, posture) in peer.retarget(problem, &problem.targets[frames.clone()]) {
                theirs.us.push(us);
                theirs.cpu_us += us;
                theirs.path.push(posture);
            }
        }
        for repeat in 0..REPEATS {
            let cpu_us = 1e6 * cpu_time::thread_s();
            let mut found = sequence(
                problem,
                &mut solver,
                frames.clone(),
                ours.path.last().unwrap_or(&start),
                &FAST,
            );
            ours.cpu_us += (1e6 * cpu_time::thread_s() - cpu_us) / REPEATS as f64;
            ours.us.append(&mut found.us);
            if repeat + 1 == REPEATS {
                ours.path.append(&mut found.path);
                iterations.append(&mut found.iterations);
            }
        }
        let mut found = sequence(
            problem,
            &mut solver,
            frames.clone(),
            tight.path.last().unwrap_or(&start),
            &TIGHT,
        );
        tight.us.append(&mut found.us);
        tight.path.append(&mut found.path);
        for (lane, value) in [
            (&mut as_peer, slsqp::Value::AsThePeer),
            (&mut whole, slsqp::Value::Whole),
        ] {
            for frame in frames.clone() {
                let before = lane.path.last().unwrap_or(&start).clone();
                let started = Instant::now();
                let found = slsqp::retarget(problem, &other, frame, &before, value);
                lane.us.push(started.elapsed().as_secs_f64() * 1e6);
                lane.path.push(found);
            }
        }
    }
    tight.cpu_us = tight.us.iter().sum();
    as_peer.cpu_us = as_peer.us.iter().sum();
    whole.cpu_us = whole.us.iter().sum();
    println!(
        "{:<36} {:>10} {:>10} {:>10} {:>10} {:>10} {:>8} {:>8} {:>12}",
        "",
        "us median",
        "us mean",
        "us p95",
        "times",
        "times mean",
        "mean F",
        "|ddq|",
        "over limits"
    );
    let reference = &theirs;
    for (name, lane) in [
        ("solver", &ours),
        ("solver, full convergence", &tight),
        ("SLSQP in Rust, stops as the peer", &as_peer),
        ("SLSQP in Rust, whole value", &whole),
        ("dex_retargeting", &theirs),
    ] {
        if lane.path.is_empty() {
            println!("{name:<36} skipped, {}", peer.as_ref().err().unwrap());
            continue;
        }
        report(problem, &mut solver, name, lane, reference, &start);
    }
    if !theirs.path.is_empty() {
        let times = quantile(&theirs.us, 0.5) / quantile(&ours.us, 0.5);
        limits.keep("dex_retargeting over the solver", times, least..);
    }
    show_iterations(&mut iterations);
    frame_by_frame(problem, &mut solver);
}

fn report(
    problem: &Problem,
    solver: &mut Solver<'_>,
    name: &str,
    lane: &Lane,
    reference: &Lane,
    start: &Posture,
) {
    let points = vec![Point3::origin(); problem.links.len()];
    let mut costs = Vec::new();
    for (frame, posture) in lane.path.iter().enumerate() {
        let before = frame
            .checked_sub(1)
            .map_or(start, |frame| &lane.path[frame]);
        let task = Objective::Peer.task(problem, frame, before, &points);
        costs.push(solver.place(&task, posture, &mut NoTerms).unwrap());
    }
    let path: Vec<Vec<f64>> = lane
        .path
        .iter()
        .map(|posture| problem.coordinates(posture))
        .collect();
    let bends: Vec<f64> = path
        .windows(3)
        .map(|w| {
            let bend = w[0]
                .iter()
                .zip(&w[1])
                .zip(&w[2])
                .map(|((a, b), c)| (a - 2.0 * b + c).powi(2));
            bend.sum::<f64>().sqrt()
        })
        .collect();
    let excess = lane
        .path
        .iter()
        .map(|posture| problem.excess_rad(posture))
        .fold(0.0, f64::max);
    let (median_us, mean_us) = (
        quantile(&lane.us, 0.5),
        lane.cpu_us / lane.path.len() as f64,
    );
    println!(
        "{name:<36} {median_us:>10.2} {mean_us:>10.2} {:>10.2} {:>10.1} {:>10.1} {:>8.6} {:>8.4} {excess:>8.1e} rad",
        quantile(&lane.us, 0.95),
        quantile(&reference.us, 0.5) / median_us,
        reference.cpu_us / lane.path.len() as f64 / mean_us,
        mean(&costs),
        mean(&bends),
    );
}

/// Our solver's results on some frames.
struct Found {
    us: Vec<f64>,
    path: Vec<Posture>,
    iterations: Vec<f64>,
}

/// Retargets frames one after another, each from the answer before.
fn sequence(
    problem: &Problem,
    solver: &mut Solver<'_>,
    frames: std::ops::Range<usize>,
    start: &Posture,
    options: &SearchOptions,
) -> Found {
    let points = vec![Point3::origin(); problem.links.len()];
    let mut found = Found {
        us: Vec::new(),
        path: Vec::new(),
        iterations: Vec::new(),
    };
    let mut before = start.clone();
    for frame in frames {
        let mut posture = before.clone();
        let started = Instant::now();
        let task = Objective::Peer.task(problem, frame, &before, &points);
        let outcome = solver
            .minimize(&task, &mut posture, options, &mut NoTerms)
            .unwrap();
        found.us.push(started.elapsed().as_secs_f64() * 1e6);
        found.iterations.push(outcome.iterations as f64);
        before.clone_from(&posture);
        found.path.push(posture);
    }
    found
}

/// Compares our objective with the recorded one at the peer's recorded answers.
fn reproduce(problem: &Problem) {
    let points = vec![Point3::origin(); problem.links.len()];
    let mut solver = Solver::new(&problem.hand);
    let mut worst: f64 = 0.0;
    for (frame, (before, answer)) in problem.peer_before.iter().zip(&problem.peer).enumerate() {
        let task = Objective::Peer.task(problem, frame, before, &points);
        let cost = solver.place(&task, answer, &mut NoTerms).unwrap();
        worst = worst.max((cost - problem.peer_objective[frame]).abs());
    }
    println!(
        "{:<36} {worst:>10.1e} of {:.6} on average",
        "recorded F reproduced within",
        mean(&problem.peer_objective)
    );
}

/// Compares answers to the very questions that the peer was asked.
fn frame_by_frame(problem: &Problem, solver: &mut Solver<'_>) {
    let points = vec![Point3::origin(); problem.links.len()];
    let costs = [FAST, TIGHT].map(|options| {
        let costs = problem
            .peer_before
            .iter()
            .enumerate()
            .map(|(frame, before)| {
                let task = Objective::Peer.task(problem, frame, before, &points);
                let mut posture = before.clone();
                solver
                    .minimize(&task, &mut posture, &options, &mut NoTerms)
                    .unwrap()
                    .cost
            });
        mean(&costs.collect::<Vec<f64>>())
    });
    println!(
        "{:<36} solver {:.6}, full convergence {:.6}, recorded {:.6}",
        "mean F, from the peer's own frames",
        costs[0],
        costs[1],
        mean(&problem.peer_objective)
    );
}

/// Compares the answers of a sequence with the best of many starts for each frame.
fn minima(problem: &Problem, objective: Objective) {
    let n_points = problem.links.len();
    let mut solver = Solver::new(&problem.hand);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut before = problem.hand.within_limits(&problem.peer_before[0]);
    let (mut excess, mut iterations) = (Vec::new(), Vec::new());
    let (mut ours, mut best) = (Vec::new(), Vec::new());
    let first = objective.task(problem, 0, &before, &[]);
    let first = posture::Task {
        vectors: None,
        smoothness: None,
        ..first
    };
    let mut posture = before.clone();
    if objective != Objective::Peer {
        let starts = solver.initial_postures(&first).unwrap();
        posture = best_of(&mut solver, &first, starts, &FAST).0;
        before = posture.clone();
    }
    for frame in 0..problem.targets.len() {
        let points = points_at(&mut solver, n_points, &before);
        let task = objective.task(problem, frame, &before, &points);
        let outcome = match objective {
            Objective::Peer => solver.minimize(&task, &mut posture, &FAST, &mut NoTerms),
            Objective::Paper(_) => {
                solver.minimize_with_flips(&task, &mut posture, &FAST, &mut NoTerms)
            }
        };
        let outcome = outcome.unwrap();
        let least = true_minimum(problem, &mut solver, &task, &[&before, &posture], &mut rng);
        excess.push(outcome.cost / least - 1.0);
        iterations.push(outcome.iterations as f64);
        ours.push(outcome.cost);
        best.push(least);
        before.clone_from(&posture);
    }
    let agree = excess.iter().filter(|&&excess| excess < 0.01).count();
    println!(
        "{:<36} {:.2} % of frames within 1 % of the best of many starts, worst {:.1} %, mean cost {:.3e} of {:.3e}",
        format!("minima, {objective:?}"),
        100.0 * agree as f64 / excess.len() as f64,
        100.0 * excess.iter().copied().fold(0.0, f64::max),
        mean(&ours),
        mean(&best),
    );
    show_iterations(&mut iterations);
}

fn show_iterations(iterations: &mut [f64]) {
    println!(
        "{:<36} median {}, p95 {}, p99 {}, most {}",
        "  postures tried for a frame",
        quantile(iterations, 0.5),
        quantile(iterations, 0.95),
        quantile(iterations, 0.99),
        quantile(iterations, 1.0)
    );
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an index"
    )]
    let idx = (share * last as f64).round() as usize;
    sorted.get(idx).copied().unwrap_or(f64::NAN)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
