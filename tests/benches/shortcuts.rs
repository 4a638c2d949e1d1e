//! Whether shortcuts of the simulation ever change a verdict: the same motions with every shortcut of
//! `screen.scene.shortcuts` and with none, and the work that they spare; where `PIPELINE_SHORTCUTS_EACH` is set, also
//! with each one alone.
//!
//! 400 scripted grasps of each of seven bodies; and, where `PIPELINE_LAKE` names a lake, the newest
//! `objects` in it and the newest `candidates` of the stage `PIPELINE_STAGE` (`refine`), with the options of
//! `pipelines/cgf.toml` and its profile `table_lift`.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "../../crates/physics/simulation/tests/physics/bodies.rs"]
mod bodies;
#[path = "screening/grasps.rs"]
mod grasps;
mod limits;
#[path = "screening/options.rs"]
mod options;

use std::{collections::BTreeMap, env, path::PathBuf, process::ExitCode};

use lake::Lake;
use limits::Limits;
use motion::{Motion, Rates};
use rayon::prelude::*;
use robot::RobotModel;
use schemas::candidates::Candidates;
use simulation::{ObjectShape, Protocol, SceneConfig, SettledScene, Shortcuts, TraceMode, Verdict};
use spatial::{Object, RestingPose};
use stage_screen::ScreenConfig;

const GRASPS: usize = 400;
/// All, each alone, none.
const SETS: [(&str, Shortcuts); 5] = [
    ("none", Shortcuts::NONE),
    ("all", Shortcuts::ALL),
    (
        "refused",
        Shortcuts {
            refused: true,
            ..Shortcuts::NONE
        },
    ),
    (
        "lost",
        Shortcuts {
            lost: true,
            ..Shortcuts::NONE
        },
    ),
    (
        "settled",
        Shortcuts {
            settled: true,
            ..Shortcuts::NONE
        },
    ),
];

/// Outcomes of the motions of an object with one set of shortcuts.
#[derive(Default)]
struct Counts {
    rollouts: usize,
    steps: u64,
    cpu_s: f64,
    held: usize,
    /// Verdicts that are not as with no shortcut.
    changed: Vec<String>,
}

fn main() -> ExitCode {
    let hand = options::hand();
    let ScreenConfig {
        scene, protocol, ..
    } = options::screen(false, Some("table_lift"));
    let scripted = grasps::opened(protocol.clone());
    let mut totals: BTreeMap<usize, Counts> = BTreeMap::new();
    let motions = grasps::grasps(&hand, GRASPS);
    for (name, object, rest) in bodies::bodies() {
        let motions: Vec<(RestingPose, &Motion<Object, ()>)> =
            motions.iter().map(|m| (rest, m)).collect();
        compare(
            name,
            &hand,
            &object,
            &motions,
            &scene,
            &scripted,
            &mut totals,
        );
    }
    if let Some(folder) = env::var_os("PIPELINE_LAKE").map(PathBuf::from) {
        let lake = Lake::open(&folder);
        let stage = env::var("PIPELINE_STAGE").unwrap_or_else(|_| "refine".to_owned());
        let of_lake = options::screen(stage == "refine", Some("table_lift")).protocol;
        let objects = lake.newest_partitions("objects", None).unwrap();
        for (name, artifact) in lake.newest_partitions("candidates", Some(&stage)).unwrap() {
            let Some(object) = objects.get(&name) else {
                continue;
            };
            let object = ObjectShape::from_artifact(&lake::table::read(object).unwrap());
            let candidates: Candidates = lake::table::read(&artifact).unwrap();
            let rests = candidates
                .candidates
                .iter()
                .map(|c| RestingPose::of(&c.table_from_object));
            let motions = candidates.candidates.iter().map(|one| &one.motion);
            let motions: Vec<(RestingPose, &Motion<Object>)> = rests.zip(motions).collect();
            compare(
                name.as_str(),
                &hand,
                &object,
                &motions,
                &scene,
                &of_lake,
                &mut totals,
            );
        }
    } else {
        println!("lake: skipped, PIPELINE_LAKE names none");
    }
    for (idx, counts) in &totals {
        say("all", SETS[*idx].0, counts, &totals[&0]);
    }
    // Rollouts are deterministic: there is no noise.
    let mut limits = Limits::with_noise(0.0);
    let changed: usize = totals.values().map(|counts| counts.changed.len()).sum();
    limits.keep("changed verdicts", changed as f64, ..=0.0);
    limits.end()
}

fn say(object: &str, set: &str, counts: &Counts, none: &Counts) {
    println!(
        "{object:24} {set:8} {:6} rollouts, {:6} held, {:3} verdicts changed, {:5.1} % of the control \
         steps, {:5.1} % of the CPU time",
        counts.rollouts,
        counts.held,
        counts.changed.len(),
        100.0 * counts.steps as f64 / none.steps as f64,
        100.0 * counts.cpu_s / none.cpu_s
    );
    for changed in &counts.changed {
        println!("    {changed}");
    }
}

/// Carries out the motions of an object with each set of shortcuts.
fn compare<R: Rates + Sync>(
    name: &str,
    hand: &RobotModel,
    object: &ObjectShape,
    motions: &[(RestingPose, &Motion<Object, R>)],
    scene: &SceneConfig,
    protocol: &Protocol,
    totals: &mut BTreeMap<usize, Counts>,
) {
    let sets = if env::var_os("PIPELINE_SHORTCUTS_EACH").is_some() {
        &SETS[..]
    } else {
        &SETS[..2]
    };
    let rows: Vec<Vec<(Verdict, u32, f64, String)>> = motions
        .par_iter()
        .map(|(rest, motion)| {
            let roll = |shortcuts: Shortcuts| {
                let mut scene = scene.clone();
                scene.shortcuts = shortcuts;
                let settled = SettledScene::new(&scene, hand, object, rest).unwrap();
                let before = cpu_time::thread_s();
                let rollout = settled
                    .rollout(motion, protocol, TraceMode::Nothing)
                    .unwrap();
                let cpu_s = cpu_time::thread_s() - before;
                let said = format!("{rollout:?}");
                (
                    rollout.verdict,
                    rollout.measures.control_steps_n,
                    cpu_s,
                    said,
                )
            };
            sets.iter().map(|(_, shortcuts)| roll(*shortcuts)).collect()
        })
        .collect();
    let mut here: BTreeMap<usize, Counts> = BTreeMap::new();
    for (number, row) in rows.iter().enumerate() {
        for (idx, (verdict, control_steps_n, cpu_s, said)) in row.iter().enumerate() {
            for counts in [totals.entry(idx).or_default(), here.entry(idx).or_default()] {
                counts.rollouts += 1;
                counts.steps += u64::from(*control_steps_n);
                counts.cpu_s += cpu_s;
                counts.held += usize::from(*verdict == Verdict::Held);
                if *verdict != row[0].0 {
                    let line = format!("{name} {number}: {said} instead of {}", row[0].3);
                    counts.changed.push(line);
                }
            }
        }
    }
    for (idx, counts) in &here {
        say(name, SETS[*idx].0, counts, &here[&0]);
    }
}
