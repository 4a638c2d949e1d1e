//! Accepted motions of a lake, where `PIPELINE_LAKE` names one.

use std::{collections::BTreeMap, path::PathBuf, time::Instant};

use schemas::{
    candidates::{self, Candidate},
    rollouts::{self, Verdict},
};

use super::*;

/// Says how many of them the arm can follow, what keeps it from the others, and what that takes.
#[test]
fn accepted_motions_are_followed_or_refused_with_a_reason() {
    let Some(lake) = std::env::var_os("PIPELINE_LAKE").map(PathBuf::from) else {
        println!("skipped: PIPELINE_LAKE names no lake with candidates and rollouts");
        return;
    };
    let lake = lake::Lake::open(&lake);
    let rollouts = lake.newest_partitions("rollouts").unwrap();
    let mut accepted: Vec<Candidate> = Vec::new();
    for (name, artifact) in lake.newest_partitions("candidates").unwrap() {
        let Some(rollouts) = rollouts.get(&name) else {
            continue;
        };
        let rollouts = rollouts::from_batch(&lake::table::read(rollouts).unwrap()).unwrap();
        let held: Vec<&str> = rollouts
            .iter()
            .filter(|rollout| rollout.verdict == Verdict::Held)
            .map(|rollout| rollout.candidate_id.as_str())
            .collect();
        let batch = lake::table::read(&artifact).unwrap();
        let all = candidates::from_batch(&name, &batch).unwrap();
        assert_eq!(all.joints, hand().joint_names());
        let is_held = |one: &Candidate| held.contains(&one.candidate_id.as_str());
        accepted.extend(all.candidates.into_iter().filter(is_held));
    }
    println!("{} accepted motions", accepted.len());
    assert!(!accepted.is_empty());
    let mut rows = Vec::new();
    for place in [[0.35, 0.0], [0.45, 0.0], [0.55, 0.0]] {
        for turns in [1, 12] {
            rows.push((place, turns, [0.0, 0.0, 0.0]));
        }
    }
    // As in the lab of the paper: the foot is 0.14 m above the desk.
    rows.push(([0.45, 0.0], 12, [0.0, 0.0, 0.14]));
    rows.push(([0.45, 0.0], 36, [0.0, 0.0, 0.0]));
    for (object_m, turns, foot) in rows {
        let [x, y, z] = foot;
        let arm = arm(&ArmConfig {
            object_m,
            turns,
            table_from_base: [x, y, z, 0.0, 0.0, 0.0, 1.0],
            ..config()
        });
        let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
        let (mut n, mut slower, mut times) = (0, Vec::new(), Vec::new());
        for (idx, candidate) in accepted.iter().enumerate() {
            let course = Course::through(candidate, 16).unwrap();
            let before = Instant::now();
            let found = follow(&arm, &course, candidate, 0.15);
            times.push(before.elapsed().as_secs_f64() * 1e3);
            match found {
                Ok(path) => {
                    n += 1;
                    let (most, _) = arm.limits();
                    let speeds = (0..=200).flat_map(|k| {
                        let at = path.at(course.duration_s() * f64::from(k) / 200.0).unwrap();
                        let speeds = at.velocity.into_iter().zip(&most);
                        speeds.map(|(v, most)| v.abs() / most).collect::<Vec<_>>()
                    });
                    slower.push(speeds.fold(0.0, f64::max));
                    if idx % 20 == 0 {
                        check(&arm, &path, &course, 0.15);
                    }
                }
                Err(Refusal::Arm { fault, .. }) => {
                    let reason = match fault {
                        ArmFault::Limit { joint, .. } => format!("limit of {joint}"),
                        ArmFault::Singular { .. } => "singular".to_owned(),
                        ArmFault::Jump { .. } => "jump".to_owned(),
                        ArmFault::Table { link, .. } => format!("table and {link}"),
                        ArmFault::Collision { first, second, .. } => {
                            let finger = if second.contains('.') {
                                "finger"
                            } else {
                                &second
                            };
                            format!("{first} and {finger}")
                        }
                    };
                    *reasons.entry(reason).or_default() += 1;
                }
                Err(Refusal::Reach { .. }) => {
                    *reasons.entry("out of reach".to_owned()).or_default() += 1;
                }
                Err(other) => panic!("{other}"),
            }
        }
        times.sort_by(f64::total_cmp);
        slower.sort_by(f64::total_cmp);
        let at = |all: &[f64], share: f64| {
            let last = all.len().saturating_sub(1) as f64;
            all.get((share * last) as usize)
                .copied()
                .unwrap_or(f64::NAN)
        };
        println!(
            "object at {object_m:?}, foot at {foot:?}, {turns:2} turns: {n} followed, {:.1} %; joint speed / limit at the motions' own pace median {:.2}, 95 % {:.2}; planning median {:.1} ms, 95 % {:.1} ms, most {:.1} ms",
            100.0 * f64::from(n) / accepted.len() as f64,
            at(&slower, 0.5),
            at(&slower, 0.95),
            at(&times, 0.5),
            at(&times, 0.95),
            at(&times, 1.0),
        );
        let mut reasons: Vec<(String, usize)> = reasons.into_iter().collect();
        reasons.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
        for (reason, n) in reasons {
            println!("    {n:5} {reason}");
        }
    }
}
