//! Agreement of verdicts with those of `MuJoCo`: all candidates of a lake, accepted or not, screened again here and
//! carried out there with the same shapes, masses, limits, friction and script; and the cost of both, one thread each,
//! object by object in turns, MuJoCo until the motion fails or ends; here also with geometric refusals, and until the object rests. Here they are screened at a quarter
//! of the physics time step too: the verdicts that change are those that depend on it.
//!
//! Agreement is Cohen's kappa of held or not (J. Cohen, "A coefficient of agreement for nominal scales",
//! 1960): 1 if all verdicts are equal, 0 if no more are than by chance. McNemar's test says whether one
//! engine is more lenient than the other.
//!
//! `PIPELINE_LAKE` names the lake, or several with `:` between them, which are counted together. The newest
//! `objects` in each and the newest `candidates` of the stage `PIPELINE_STAGE`, `refine` where it is not set,
//! are taken, and the options are those of `pipelines/cgf.toml`, or of `pipelines/replay.toml` for motions
//! that are not refined, with the profile `PIPELINE_PROFILE`, or none. `PIPELINE_PYTHON` names the Python that has
//! `mujoco`, `python3` where it is not set. Anything missing is skipped.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;
#[path = "screening/mujoco.rs"]
mod mujoco;
#[path = "screening/options.rs"]
mod options;
mod python;

use std::{collections::BTreeMap, env, path::PathBuf, process::ExitCode};

use dataflow::PartitionKey;
use lake::Lake;
use limits::Limits;
use mujoco::{Engine, Mujoco};
use rayon::prelude::*;
use robot::RobotModel;
use schemas::candidates::{Candidates, ObjectSplit};
use serde_json::Value;
use simulation::{ObjectShape, SettledScene, TraceMode, Verdict};
use spatial::{Object, Pose, RestingPose, Table};
use stage_screen::ScreenConfig;
use statistics::mcnemar;

/// Least kappa of all candidates, and of those of unseen objects.
const MIN_KAPPA: [f64; 2] = [0.80, 0.75];
/// Least share of the accepted motions that hold there too, of all and of unseen objects.
const MIN_SHARE: [f64; 2] = [0.90, 0.85];
/// Greatest difference, for one object, between the shares that hold here and there.
const MAX_RATE_DIFFERENCE: f64 = 0.25;
/// Both engines are deterministic: equal lakes give equal shares.
const NOISE: f64 = 0.0;
/// Divisor of the physics time step where verdicts are screened once more.
const FINER: u32 = 4;
/// The peer with friction that does not creep.
const PEER: Engine = Engine {
    cone: "elliptic",
    impratio: 10.0,
    solref: mujoco::SOLREF,
    noslip: 5,
    steps: 1,
};
/// The peer, the peer at half the step as the bound of any agreement with it, the peer with its regularized friction,
/// in which held objects creep, and its own defaults.
const ENGINES: [(&str, Engine); 4] = [
    ("no creep", PEER),
    ("half steps", Engine { steps: 2, ..PEER }),
    ("creep", Engine { noslip: 0, ..PEER }),
    (
        "defaults",
        Engine {
            cone: "pyramidal",
            impratio: 1.0,
            solref: [0.02, 1.0],
            noslip: 0,
            steps: 1,
        },
    ),
];

fn main() -> ExitCode {
    let lakes = env::var_os("PIPELINE_LAKE").unwrap_or_default();
    let lakes: Vec<PathBuf> = env::split_paths(&lakes)
        .filter(|lake| lake.is_dir())
        .collect();
    if lakes.is_empty() {
        println!("skipped: PIPELINE_LAKE names no lake with candidates and objects");
        return ExitCode::SUCCESS;
    }
    let mut mujoco = match Mujoco::start() {
        Ok(mujoco) => mujoco,
        Err(reason) => {
            println!("skipped: {reason}");
            return ExitCode::SUCCESS;
        }
    };
    println!("MuJoCo {}", mujoco.version);
    let stage = env::var("PIPELINE_STAGE").unwrap_or_else(|_| "refine".to_owned());
    let hand = options::hand();
    let profile = env::var("PIPELINE_PROFILE").ok();
    let screen = options::screen(stage == "refine", profile.as_deref());
    let mut by_object: BTreeMap<PartitionKey, Counts> = BTreeMap::new();
    let mut unseen = Counts::default();
    println!("{:24} {}", "object", Counts::header());
    let n_lakes = lakes.len();
    for lake in lakes {
        let lake = Lake::open(&lake);
        let objects = lake.newest_partitions("objects", None).unwrap();
        for (name, candidates) in lake.newest_partitions("candidates", Some(&stage)).unwrap() {
            let Some(object) = objects.get(&name) else {
                continue;
            };
            let object = ObjectShape::from_artifact(&lake::table::read(object).unwrap());
            let candidates: Candidates = lake::table::read(&candidates).unwrap();
            assert_eq!(*candidates.joints, *hand.joint_names());
            let counts = compare(&mut mujoco, &hand, &object, &candidates, &screen);
            println!("{name:24} {}", counts.line());
            let drawn = candidates.candidates.iter();
            let mut splits = drawn.map(|candidate| candidate.source.object_split);
            if splits.any(|split| split == Some(ObjectSplit::Unseen)) {
                unseen.add(&counts);
            }
            by_object.entry(name).or_default().add(&counts);
        }
    }
    let mut totals = Counts::default();
    let mut apart: (f64, String) = (0.0, "none".to_owned());
    if n_lakes > 1 {
        println!("\n{:24} {}", "of all lakes", Counts::header());
    }
    for (name, counts) in &by_object {
        if n_lakes > 1 {
            println!("{name:24} {}", counts.line());
        }
        totals.add(counts);
        if counts.rate_difference() > apart.0 {
            apart = (counts.rate_difference(), name.to_string());
        }
    }
    println!("{:24} {}", "unseen", unseen.line());
    println!("{:24} {}", "all", totals.line());
    let only_here = totals.held - totals.there[0];
    println!(
        "{}: {:?}; succeed here alone {only_here}, there alone {}, p = {:.2e} by McNemar's test",
        ENGINES[0].0,
        totals.reasons,
        totals.only_there,
        mcnemar(only_here as u64, totals.only_there as u64)
    );
    println!(
        "{} and {}: kappa {:.2}, {} verdicts differ",
        ENGINES[0].0,
        ENGINES[1].0,
        totals.kappa_of_peers(),
        totals.peers_differ
    );
    let all = totals.candidates as f64;
    println!(
        "here, and here at 1/{FINER} of the physics step: {} verdicts differ ({:.1} %), {} of unseen objects; held \
         {} and {}",
        totals.differ_finer,
        100.0 * totals.differ_finer as f64 / all,
        unseen.differ_finer,
        totals.held,
        totals.held_finer
    );
    println!(
        "here       {:7.2} ms of CPU per candidate",
        totals.here_s / all * 1e3
    );
    for ((name, _), cpu_s) in ENGINES.iter().zip(totals.there_s) {
        println!(
            "{name:10} {:7.2} ms of CPU per candidate ({:.2} times)",
            cpu_s / all * 1e3,
            cpu_s / totals.here_s
        );
    }
    let mut limits = Limits::with_noise(NOISE);
    let parts = [("all", &totals), ("unseen objects", &unseen)];
    for ((what, counts), least) in parts.into_iter().zip(MIN_KAPPA) {
        limits.keep(&format!("kappa, {what}"), counts.kappa(), least..);
    }
    for ((what, counts), least) in parts.into_iter().zip(MIN_SHARE) {
        let share = counts.there[0] as f64 / counts.held as f64;
        limits.keep(
            &format!("accepted that succeed there, {what}"),
            share,
            least..,
        );
    }
    let (apart, name) = apart;
    limits.keep(
        &format!("most apart of one object ({name})"),
        apart,
        ..=MAX_RATE_DIFFERENCE,
    );
    limits.end()
}

/// Candidates of an object, and their outcomes.
#[derive(Default)]
struct Counts {
    candidates: usize,
    held: usize,
    /// Of those, by engine.
    there: [usize; ENGINES.len()],
    /// Those that do not hold with the first engine, by reason.
    reasons: BTreeMap<String, usize>,
    /// Held with the first engine, and not here.
    only_there: usize,
    /// Held with the second engine, here or not, and number of differences between the first two.
    held_by_second: usize,
    peers_differ: usize,
    /// Held here at a quarter of the step, and number of differences from the full step.
    held_finer: usize,
    differ_finer: usize,
    /// CPU seconds of all here, and of all there by engine.
    here_s: f64,
    there_s: [f64; ENGINES.len()],
}

impl Counts {
    fn header() -> String {
        let engines = ENGINES.map(|(name, _)| format!("{name:>18}"));
        format!(
            "candidates  successes  {}  of all there  kappa",
            engines.join(" ")
        )
    }

    fn line(&self) -> String {
        let there = self.there.map(|n| {
            let share = 100.0 * n as f64 / self.held as f64;
            format!("{n:9} ({share:5.1} %)")
        });
        format!(
            "{:10}  {:9}  {}  {:12}  {:5.2}",
            self.candidates,
            self.held,
            there.join(" "),
            self.held_there(),
            self.kappa()
        )
    }

    /// Candidates that hold with the first engine, held here or not.
    fn held_there(&self) -> usize {
        self.there[0] + self.only_there
    }

    /// Returns the difference between the shares that hold here and with the first engine.
    fn rate_difference(&self) -> f64 {
        let shares = [self.held, self.held_there()].map(|n| n as f64 / self.candidates as f64);
        (shares[0] - shares[1]).abs()
    }

    /// Returns Cohen's kappa of this and the first engine; NaN if all verdicts of both are the same one.
    fn kappa(&self) -> f64 {
        let differ = self.held - self.there[0] + self.only_there;
        kappa(self.candidates, self.held, self.held_there(), differ)
    }

    /// Returns that of the first two engines.
    fn kappa_of_peers(&self) -> f64 {
        let (first, second) = (self.held_there(), self.held_by_second);
        kappa(self.candidates, first, second, self.peers_differ)
    }

    fn add(&mut self, other: &Self) {
        self.candidates += other.candidates;
        self.held += other.held;
        for (sum, n) in self.there.iter_mut().zip(other.there) {
            *sum += n;
        }
        self.only_there += other.only_there;
        self.held_by_second += other.held_by_second;
        self.peers_differ += other.peers_differ;
        self.held_finer += other.held_finer;
        self.differ_finer += other.differ_finer;
        self.here_s += other.here_s;
        for (sum, cpu_s) in self.there_s.iter_mut().zip(other.there_s) {
            *sum += cpu_s;
        }
        for (reason, n) in &other.reasons {
            *self.reasons.entry(reason.clone()).or_default() += n;
        }
    }
}

/// Screens the candidates of an object here, and carries them out there.
fn compare(
    mujoco: &mut Mujoco,
    hand: &RobotModel,
    object: &ObjectShape,
    candidates: &Candidates,
    screen: &ScreenConfig,
) -> Counts {
    let (scene, protocol) = (&screen.scene, &screen.protocol);
    let mut counts = Counts {
        candidates: candidates.candidates.len(),
        ..Counts::default()
    };
    let mut templates: Vec<(Pose<Table, Object>, SettledScene)> = Vec::new();
    let mut scripts: Vec<Value> = Vec::new();
    let mut held: Vec<bool> = Vec::new();
    for candidate in &candidates.candidates {
        let before = cpu_time::thread_s();
        let pose = candidate.table_from_object;
        let known = templates.iter().position(|(other, _)| *other == pose);
        let at = known.unwrap_or_else(|| {
            let settled = SettledScene::new(scene, hand, object, &RestingPose::of(&pose)).unwrap();
            templates.push((pose, settled));
            templates.len() - 1
        });
        let (settled, motion) = (&templates[at].1, &candidate.motion);
        counts.here_s += cpu_time::thread_s() - before;
        let before = cpu_time::thread_s();
        let rollout = settled.rollout(motion, protocol, TraceMode::Nothing);
        let cpu_s = cpu_time::thread_s() - before;
        let rollout = rollout.unwrap();
        held.push(screen.screening(0).verdict(&rollout) == Verdict::Held);
        counts.here_s += cpu_s;
        if held.last() == Some(&true) {
            counts.held += 1;
        }
        let setpoints = settled.setpoints(motion, protocol).unwrap();
        scripts.push(mujoco::rollout(settled, &setpoints));
    }
    let finer = finer(screen, hand, object, candidates);
    counts.held_finer = finer.iter().filter(|held| **held).count();
    counts.differ_finer = counts.held + counts.held_finer - 2 * both(&held, &finer);
    let mut verdicts: Vec<Vec<bool>> = Vec::new();
    for (idx, (_, engine)) in ENGINES.into_iter().enumerate() {
        mujoco.build(screen, hand, object, engine);
        let rolled = mujoco.roll(&scripts);
        counts.there_s[idx] += rolled.iter().map(|rolled| rolled.cpu_s).sum::<f64>();
        let there = rolled
            .iter()
            .map(|rolled| rolled.verdict == Verdict::Held.as_str());
        let there: Vec<bool> = there.collect();
        counts.there[idx] += both(&held, &there);
        verdicts.push(there);
        if idx == 0 {
            for (rolled, held) in rolled.into_iter().zip(&held) {
                if *held && rolled.verdict != Verdict::Held.as_str() {
                    *counts.reasons.entry(rolled.verdict).or_default() += 1;
                }
            }
        }
    }
    let [first, second] = [0, 1].map(|idx| &verdicts[idx]);
    let held_by = |engine: &[bool]| engine.iter().filter(|held| **held).count();
    let of_both = both(first, second);
    counts.only_there = held_by(first) - counts.there[0];
    counts.held_by_second = held_by(second);
    counts.peers_differ = held_by(first) + held_by(second) - 2 * of_both;
    counts
}

/// Returns which candidates hold here at a quarter of the physics step and the same control step.
fn finer(
    screen: &ScreenConfig,
    hand: &RobotModel,
    object: &ObjectShape,
    candidates: &Candidates,
) -> Vec<bool> {
    let mut scene = screen.scene.clone();
    scene.time_step_s /= f64::from(FINER);
    scene.steps_per_control *= FINER;
    let holds = candidates.candidates.par_iter().map(|candidate| {
        let rest = RestingPose::of(&candidate.table_from_object);
        let settled = SettledScene::new(&scene, hand, object, &rest).unwrap();
        let rollout = settled.rollout(&candidate.motion, &screen.protocol, TraceMode::Nothing);
        screen.screening(0).verdict(&rollout.unwrap()) == Verdict::Held
    });
    holds.collect()
}

/// Returns the number of candidates that hold in both.
fn both(one: &[bool], other: &[bool]) -> usize {
    one.iter().zip(other).filter(|(a, b)| **a && **b).count()
}

/// Returns Cohen's kappa of two judges of `n` candidates.
fn kappa(n: usize, held_by_one: usize, held_by_other: usize, differ: usize) -> f64 {
    let [one, other, differ] = [held_by_one, held_by_other, differ].map(|of| of as f64 / n as f64);
    let by_chance = one * other + (1.0 - one) * (1.0 - other);
    1.0 - differ / (1.0 - by_chance)
}
