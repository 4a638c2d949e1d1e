//! Shortcuts of the simulation do not change a verdict. `cargo bench --bench shortcuts` checks thousands
//! of rollouts.

use motion::Motion;
use simulation::{Rollout, SettledScene, Shortcuts, TraceMode, Verdict};
use spatial::Object;

use crate::{
    bodies::bodies,
    scene::{hand, protocol, q, scene, side_grasp},
};

/// Grasps from the side, some of which fail in each way.
fn motions() -> Vec<Motion<Object, ()>> {
    let mut motions = Vec::new();
    for x in [-0.035, -0.015] {
        for y in [-0.058, -0.052] {
            for closed in [0.5, 0.8, 1.1] {
                for z in [0.0, 0.02] {
                    let q = q([closed; 3], [1.3, closed / 2.0, closed / 2.0, closed]);
                    motions.push(side_grasp([x, y, z], &q));
                }
            }
        }
    }
    motions
}

fn roll(shortcuts: Shortcuts, delay_s: f64) -> Vec<Rollout> {
    let mut scene = scene();
    scene.drive.delay_s = delay_s;
    scene.shortcuts = shortcuts;
    let templates = bodies()
        .into_iter()
        .map(|(_, object, rest)| SettledScene::new(&scene, &hand(), &object, &rest).unwrap());
    let roll = |settled: SettledScene| {
        let motions = motions();
        let rollouts = motions
            .iter()
            .map(|motion| settled.rollout(motion, &protocol(), TraceMode::Nothing));
        rollouts.collect::<Result<Vec<_>, _>>().unwrap()
    };
    templates.flat_map(roll).collect()
}

#[test]
fn shortcuts_spare_steps_and_change_no_verdict() {
    let all = roll(Shortcuts::NONE, 0.0);
    let few = roll(Shortcuts::ALL, 0.0);
    let verdicts = |rollouts: &[Rollout]| rollouts.iter().map(|r| r.verdict).collect::<Vec<_>>();
    assert_eq!(verdicts(&few), verdicts(&all));
    for verdict in [
        Verdict::Held,
        Verdict::NotGrasped,
        Verdict::KnockedOver,
        Verdict::EarlyContact,
    ] {
        let n = all.iter().filter(|r| r.verdict == verdict).count();
        assert!(n >= 3, "{n} are {}", verdict.as_str());
    }
    for (few, all) in few.iter().zip(&all) {
        assert_eq!(
            few.measures.control_steps_n + few.measures.skipped_steps_n,
            all.measures.control_steps_n + all.measures.skipped_steps_n
        );
        assert!(few.measures.control_steps_n <= all.measures.control_steps_n);
        match all.verdict {
            Verdict::Held => assert_eq!(all.measures.skipped_steps_n, 0),
            Verdict::EarlyContact => {
                assert!(all.measures.control_steps_n > 0 && few.measures.control_steps_n == 0);
            }
            _ => {}
        }
    }
    // The hold is more than half of the script, and is cut to a third where nothing creeps in the hand.
    let held = || few.iter().filter(|r| r.verdict == Verdict::Held);
    let early = held().filter(|r| r.measures.skipped_steps_n > 60).count();
    assert!(
        5 * early > 4 * held().count(),
        "{early} of {}",
        held().count()
    );
}

#[test]
fn shortcuts_change_no_verdict_of_a_hand_that_is_late() {
    for delay_s in [0.04, 0.2] {
        let verdicts = |shortcuts| -> Vec<Verdict> {
            let rollouts = roll(shortcuts, delay_s).into_iter();
            rollouts.map(|rollout| rollout.verdict).collect()
        };
        let all = verdicts(Shortcuts::NONE);
        assert_eq!(verdicts(Shortcuts::ALL), all);
        assert!(all.contains(&Verdict::Held) && all.contains(&Verdict::NotGrasped));
    }
}

#[test]
fn recorded_rollout_runs_to_its_end() {
    let mut scene = scene();
    scene.shortcuts = Shortcuts::ALL;
    let (_, can, rest) = bodies().remove(0);
    let settled = SettledScene::new(&scene, &hand(), &can, &rest).unwrap();
    let motion = side_grasp(
        [-0.015, -0.055, 0.02],
        &q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]),
    );
    let roll = |record| settled.rollout(&motion, &protocol(), record).unwrap();
    let (short, whole) = (roll(TraceMode::Nothing), roll(TraceMode::Trace));
    assert_eq!(
        (short.verdict, whole.verdict),
        (Verdict::Held, Verdict::Held)
    );
    assert!(short.measures.skipped_steps_n > 0 && whole.measures.skipped_steps_n == 0);
    assert_eq!(
        whole.trace.unwrap().steps.len() - 1,
        whole.measures.control_steps_n as usize
    );
}
