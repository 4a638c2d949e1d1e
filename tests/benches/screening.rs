//! Cost of screening 1,000 candidates of one object, beside `MuJoCo` stepping the same rollouts until
//! they fail or end: the same hand, object, script and friction, one thread each, in turns of ten.
//!
//! `PIPELINE_PYTHON` names the Python that has `mujoco`, `python3` where it is not set; without it
//! `MuJoCo` is skipped.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "screening/can.rs"]
mod can;
#[path = "screening/grasps.rs"]
mod grasps;
mod limits;
#[path = "screening/mujoco.rs"]
mod mujoco;
#[path = "screening/options.rs"]
mod options;
mod python;

use std::{collections::BTreeMap, fmt::Display, hint::black_box, process::ExitCode, time::Instant};

use limits::Limits;
use motion::Motion;
use mujoco::{Engine, Mujoco, Rolled};
use rayon::{ThreadPoolBuilder, prelude::*};
use serde_json::Value;
use simulation::{Protocol, Rollout, SettledScene, TraceMode, Verdict};
use spatial::Object;

const CANDIDATES: usize = 1000;
/// Candidates of one turn.
const TURN: usize = 10;
/// Candidates and rounds with which threads are compared.
const THREADED: usize = 300;
const ROUNDS: usize = 4;
/// Least ratio of CPU time per candidate of `MuJoCo` to this screen, and least speedup of two
/// threads.
const MIN_BESIDE_MUJOCO: f64 = 1.0;
const MIN_OF_TWO_THREADS: f64 = 1.8;
/// Relative difference of a ratio of CPU times from run to run, with other programs beside.
const NOISE: f64 = 0.1;
/// The cheapest engine that `MuJoCo` has.
const ENGINE: Engine = Engine {
    cone: "pyramidal",
    impratio: 1.0,
    solref: mujoco::SOLREF,
    noslip: 0,
    steps: 1,
};

fn main() -> ExitCode {
    let mut limits = Limits::with_noise(NOISE);
    let hand = options::hand();
    let mut screen = options::screen(false, Some("table_lift"));
    screen.protocol = grasps::opened(screen.protocol);
    let (scene, protocol) = (&screen.scene, &screen.protocol);
    let object = can::can();
    let motions = grasps::grasps(&hand, CANDIDATES);
    let before = cpu_time::thread_s();
    let settled = SettledScene::new(scene, &hand, &object, &can::upright()).unwrap();
    let build_s = cpu_time::thread_s() - before;
    let mut peer = Mujoco::start();
    match &mut peer {
        Ok(mujoco) => {
            println!("MuJoCo {}, {} cones", mujoco.version, ENGINE.cone);
            mujoco.build(&screen, &hand, &object, ENGINE);
        }
        Err(reason) => println!("MuJoCo: skipped, {reason}"),
    }

    let mut ours: Vec<(Rollout, f64)> = Vec::new();
    let mut theirs: Vec<Rolled> = Vec::new();
    for turn in motions.chunks(TURN) {
        for motion in turn {
            let before = cpu_time::thread_s();
            let rollout = settled.rollout(motion, protocol, TraceMode::Nothing);
            ours.push((rollout.unwrap(), cpu_time::thread_s() - before));
        }
        if let Ok(mujoco) = &mut peer {
            let scripts: Vec<Value> = turn
                .iter()
                .map(|motion| {
                    let setpoints = settled.setpoints(motion, protocol).unwrap();
                    mujoco::rollout(&settled, &setpoints)
                })
                .collect();
            theirs.extend(mujoco.roll(&scripts));
        }
    }
    drop(peer);

    let steps = settled.setpoints(&motions[0], protocol).unwrap().len() - 1;
    let steps = steps as f64 * f64::from(scene.steps_per_control);
    println!("{CANDIDATES} candidates of a can, {steps} physics steps each to the end");
    let (verdicts, options) = (ours.iter(), screen.screening(0));
    let verdicts = verdicts.map(|(rollout, _)| options.verdict(rollout));
    let verdicts: Vec<Verdict> = verdicts.collect();
    count("here", verdicts.iter().map(|verdict| verdict.as_str()));
    let substeps = f64::from(scene.steps_per_control);
    let simulated: f64 = ours
        .iter()
        .map(|(r, _)| f64::from(r.measures.control_steps_n) * substeps)
        .sum();
    let candidates = CANDIDATES as f64;
    println!(
        "here     {:.0} steps simulated per candidate, {:.1} ms to build the scene",
        simulated / candidates,
        build_s * 1e3
    );
    let ours_s = ours.iter().map(|(_, cpu_s)| cpu_s).sum::<f64>() + build_s;
    println!(
        "here     {:8.3} ms of CPU per candidate",
        ours_s / candidates * 1e3
    );
    if !theirs.is_empty() {
        count(
            "MuJoCo",
            theirs.iter().map(|rolled| rolled.verdict.as_str()),
        );
        let is_same =
            |idx: &usize| (verdicts[*idx] == Verdict::Held) == (theirs[*idx].verdict == "held");
        let same = (0..CANDIDATES).filter(is_same).count();
        println!("success: {same} of {CANDIDATES} agree");
        let pairs = verdicts.iter().zip(&theirs).map(|(verdict, rolled)| {
            let [here, there] = [verdict.as_str(), rolled.verdict.as_str()];
            format!("{here} here and {there} there")
        });
        count("both", pairs);
        let theirs_s: f64 = theirs.iter().map(|rolled| rolled.cpu_s).sum();
        println!(
            "MuJoCo   {:8.3} ms of CPU per candidate",
            theirs_s / candidates * 1e3
        );
        let times = theirs_s / ours_s;
        limits.keep(
            "MuJoCo over here, per candidate",
            times,
            MIN_BESIDE_MUJOCO..,
        );
    }
    threads(&settled, protocol, &motions[..THREADED], &mut limits);
    limits.end()
}

/// Prints the number of each verdict.
fn count<T: Display + Ord>(who: &str, verdicts: impl Iterator<Item = T>) {
    let mut counts: BTreeMap<T, usize> = BTreeMap::new();
    for verdict in verdicts {
        *counts.entry(verdict).or_default() += 1;
    }
    let counts: Vec<String> = counts.iter().map(|(v, n)| format!("{v} {n}")).collect();
    println!("{who:8} {}", counts.join(", "));
}

/// Prints the speedup of two threads over one, in turns.
fn threads(
    settled: &SettledScene,
    protocol: &Protocol,
    motions: &[Motion<Object, ()>],
    limits: &mut Limits,
) {
    let pools = [1, 2].map(|n| ThreadPoolBuilder::new().num_threads(n).build().unwrap());
    let mut walls = [Vec::new(), Vec::new()];
    let mut cpus = [Vec::new(), Vec::new()];
    for _ in 0..ROUNDS {
        for (idx, pool) in pools.iter().enumerate() {
            let of_pool = || pool.broadcast(|_| cpu_time::thread_s()).iter().sum::<f64>();
            let before = (Instant::now(), of_pool());
            pool.install(|| {
                motions.par_iter().for_each(|motion| {
                    let rollout = settled.rollout(motion, protocol, TraceMode::Nothing);
                    black_box(rollout.unwrap());
                });
            });
            walls[idx].push(before.0.elapsed().as_secs_f64());
            cpus[idx].push(of_pool() - before.1);
        }
    }
    let least = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    let [one, two] = [&walls[0], &walls[1]].map(|times| least(times));
    let [cpu_of_one, cpu_of_two] = [&cpus[0], &cpus[1]].map(|times| least(times));
    println!(
        "2 threads {:.2} times as fast as 1 if both had a core to themselves (CPU)",
        2.0 * cpu_of_one / cpu_of_two
    );
    let what = format!("2 threads over 1, by the wall clock, best of {ROUNDS}");
    limits.keep(&what, one / two, MIN_OF_TWO_THREADS..);
}
