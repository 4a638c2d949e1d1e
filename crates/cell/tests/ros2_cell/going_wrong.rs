//! Controllers that do not do what they are told: nothing is claimed that did not happen.

use std::{thread, time::Duration};

use cell::{ControlReply, Report};
use schemas::executions::Outcome;

use crate::{
    emulated::Behavior,
    lab::{Lab, SOUND, execute, goal},
};

/// Age of a measurement that a motion outlasts after its controllers died, in seconds.
const SHORT_S: f64 = 0.5;

fn execute_by(behaviors: [Behavior; 2]) -> Report {
    let mut lab = Lab::new();
    if behaviors.contains(&Behavior::Dying) {
        lab.config.max_age_s = SHORT_S;
    }
    let _emulated = lab.emulate(behaviors);
    let _cell = lab.serve();
    execute(&lab.connect(), &goal(&lab, 1))
}

#[test]
fn arm_that_takes_nothing_is_noticed_and_the_motion_is_aborted() {
    let report = execute_by([Behavior::Refusing, Behavior::Sound]);
    assert_eq!(report.outcome, Outcome::Aborted, "{}", report.message);
    assert!(
        report.message.contains("joint `joint1` is"),
        "{}",
        report.message
    );
    assert!(
        report.message.contains("rad from its command"),
        "{}",
        report.message
    );
}

/// Fingers may lag behind as far as this hand's do, but not stay where they were.
#[test]
fn hand_that_takes_nothing_leaves_the_outcome_unknown() {
    let report = execute_by([Behavior::Sound, Behavior::Refusing]);
    assert_eq!(report.outcome, Outcome::Unknown, "{}", report.message);
    assert!(
        report.message.contains("has moved by 0.0000"),
        "{}",
        report.message
    );
}

#[test]
fn outcome_is_unknown_where_controllers_die_or_joints_do_not_stop() {
    for (behaviors, why) in [
        ([Behavior::Dying, Behavior::Sound], "s old"),
        ([Behavior::Sound, Behavior::Dying], "s old"),
        (
            [Behavior::Runaway, Behavior::Sound],
            "`joint1` moves after the brake",
        ),
    ] {
        let report = execute_by(behaviors);
        assert_eq!(report.outcome, Outcome::Unknown, "{}", report.message);
        assert!(report.message.contains(why), "{}", report.message);
        assert!(
            report.message.contains("emergency stop"),
            "{}",
            report.message
        );
    }
}

#[test]
fn a_cancel_is_not_answered_while_a_joint_moves() {
    let lab = Lab::new();
    let _emulated = lab.emulate([Behavior::Runaway, Behavior::Sound]);
    let _cell = lab.serve();
    let (client, watcher) = (lab.connect(), lab.connect());
    let goal = goal(&lab, 1);
    let id = goal.encode().goal_id;
    thread::scope(|scope| {
        let executing = scope.spawn(|| execute(&client, &goal));
        // It goes its own way after a second.
        lab.watch(|state| state.goal_id == id && state.sample.time_s > 0.8);
        let reply = watcher.cancel(&id, Duration::from_secs(5)).unwrap();
        assert_ne!(reply, ControlReply::Done);
        assert_eq!(executing.join().unwrap().outcome, Outcome::Unknown);
    });
}

#[test]
fn controllers_that_come_back_are_driven_again() {
    let mut lab = Lab::new();
    let patient_s = std::mem::replace(&mut lab.config.max_age_s, SHORT_S);
    let dying = lab.emulate([Behavior::Dying; 2]);
    let cell = lab.serve();
    let client = lab.connect();
    assert_eq!(execute(&client, &goal(&lab, 1)).outcome, Outcome::Unknown);
    drop((dying, cell));
    lab.config.max_age_s = patient_s;
    let _sound = lab.emulate(SOUND);
    let _cell = lab.serve();
    let report = execute(&lab.connect(), &goal(&lab, 2));
    assert_eq!(report.outcome, Outcome::Failed, "{}", report.message);
}
