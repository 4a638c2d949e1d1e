//! Accepted motions of a lake, where `PIPELINE_LAKE` names one.

use std::{collections::BTreeMap, time::Instant};

use schemas::{
    candidates::Candidates,
    rollouts::{Rollouts, Verdict},
};

use super::*;

/// Of so many paths one is checked at every place.
const CHECKED: usize = 20;
/// Places at which speeds are looked up.
const PLACES: u32 = 200;

/// Results of all motions at one object place.
#[derive(Default)]
struct Tally {
    followed: u32,
    reasons: BTreeMap<String, u32>,
    /// Greatest speed of a joint at the motion's own pace, over its limit.
    speeds: Vec<f64>,
    /// Planning times, in milliseconds.
    times_ms: Vec<f64>,
    /// Total time of the lookups of places on paths, in seconds, and their number.
    places: (f64, f64),
}

/// Prints the number of motions that the arm can follow, the faults of the others, and the times.
#[test]
fn accepted_motions_are_followed_or_refused_with_a_reason() {
    let Some(lake) = measured_data::named_by("PIPELINE_LAKE") else {
        return;
    };
    let accepted = accepted(&lake::Lake::open(&lake));
    println!("{} accepted motions", accepted.len());
    assert!(!accepted.is_empty());
    // As in the lab of the paper: the base is 0.14 m above the desk.
    let desk_m = 0.14;
    for (x, turns, base_height_m) in [
        (0.35, 1, 0.0),
        (0.35, 12, 0.0),
        (0.45, 1, 0.0),
        (0.45, 12, 0.0),
        (0.45, 36, 0.0),
        (0.55, 1, 0.0),
        (0.55, 12, 0.0),
        (0.45, 12, desk_m),
    ] {
        let arm = arm(&ArmConfig {
            object_m: [x, 0.0],
            turns,
            table_from_base: [0.0, 0.0, base_height_m, 0.0, 0.0, 0.0, 1.0],
            ..config()
        });
        let mut tally = Tally::default();
        for (idx, drawn) in accepted.iter().enumerate() {
            tally.add(&arm, drawn, idx % CHECKED == 0);
        }
        println!("object {x} m ahead, base {base_height_m} m high, {turns} turns");
        tally.say();
    }
}

fn accepted(lake: &lake::Lake) -> Vec<MotionOnTable> {
    let rollouts = lake.newest_partitions("rollouts", Some("screen")).unwrap();
    let mut accepted: Vec<MotionOnTable> = Vec::new();
    for (name, artifact) in lake
        .newest_partitions("candidates", Some("refine"))
        .unwrap()
    {
        let Some(rollouts) = rollouts.get(&name) else {
            continue;
        };
        let rollouts: Rollouts = lake::table::read(rollouts).unwrap();
        let held: Vec<&str> = rollouts
            .iter()
            .filter(|rollout| rollout.verdict == Verdict::Held)
            .map(|rollout| rollout.candidate_id.as_str())
            .collect();
        let all: Candidates = lake::table::read(&artifact).unwrap();
        assert_eq!(*all.joints, *hand().joint_names());
        let all_held = all.candidates.iter();
        let all_held = all_held.filter(|one| held.contains(&one.candidate_id.as_str()));
        accepted.extend(all_held.map(|one| MotionOnTable {
            joints: all.joints.to_vec(),
            steps: one.motion.steps().to_vec(),
            table_from_object: one.table_from_object,
        }));
    }
    accepted
}

impl Tally {
    fn add(&mut self, arm: &Arm, drawn: &MotionOnTable, is_checked: bool) {
        const LIFT_M: f64 = 0.15;
        let spline = spline_of(drawn).unwrap();
        let before = Instant::now();
        let found = follow(arm, &spline, drawn, LIFT_M);
        self.times_ms.push(before.elapsed().as_secs_f64() * 1e3);
        match found {
            Ok(path) => {
                self.followed += 1;
                let before = Instant::now();
                self.speeds.push(fastest(arm, &path, &spline));
                self.places.0 += before.elapsed().as_secs_f64();
                self.places.1 += f64::from(PLACES + 1);
                if is_checked {
                    check(arm, &path, &spline, LIFT_M);
                }
            }
            Err(err) => *self.reasons.entry(reason(&err)).or_default() += 1,
        }
    }

    fn say(&mut self) {
        self.times_ms.sort_by(f64::total_cmp);
        self.speeds.sort_by(f64::total_cmp);
        let at = |all: &[f64], percent: usize| {
            let idx = all.len().saturating_sub(1) * percent / 100;
            all.get(idx).copied().unwrap_or(f64::NAN)
        };
        println!(
            "  {} followed, {:.1} %; fastest joint over its limit at the motions' own pace: median \
             {:.2}, 95 % {:.2}; planning: median {:.1} ms, 95 % {:.1} ms, most {:.1} ms, \
             {:.1} µs for a place of a path",
            self.followed,
            100.0 * f64::from(self.followed) / self.times_ms.len() as f64,
            at(&self.speeds, 50),
            at(&self.speeds, 95),
            at(&self.times_ms, 50),
            at(&self.times_ms, 95),
            at(&self.times_ms, 100),
            1e6 * self.places.0 / self.places.1,
        );
        let mut reasons: Vec<(&String, &u32)> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, n)| std::cmp::Reverse(**n));
        for (reason, n) in reasons {
            println!("  {n:5} {reason}");
        }
    }
}

/// Returns the greatest speed of a joint over its limit.
fn fastest(arm: &Arm, path: &ArmPath<'_>, spline: &MotionSpline<Object>) -> f64 {
    let limits = arm.limits();
    let places = (0..=PLACES).map(|k| spline.duration_s() * f64::from(k) / f64::from(PLACES));
    places
        .map(|time_s| {
            let velocity = path.at(time_s).unwrap().rates.velocity;
            let shares = velocity
                .iter()
                .zip(limits)
                .map(|(v, limits)| v.abs() / limits.max_velocity);
            shares.fold(0.0, f64::max)
        })
        .fold(0.0, f64::max)
}

fn reason(err: &Infeasible) -> String {
    match err {
        Infeasible::Reach { .. } => "out of reach".to_owned(),
        Infeasible::Arm { fault, .. } => match fault {
            ArmFault::Limit { joint, .. } => format!("limit of {joint}"),
            ArmFault::Singular { .. } => "singular".to_owned(),
            ArmFault::Jump { .. } => "jump".to_owned(),
            ArmFault::Dof(err) => panic!("{err}"),
            ArmFault::Table { link, .. } => format!("{link} in the table"),
            ArmFault::Collision { first, second, .. } if second.contains('.') => {
                format!("{first} and a finger")
            }
            ArmFault::Collision { first, second, .. } => format!("{first} and {second}"),
        },
        other => panic!("{other}"),
    }
}
