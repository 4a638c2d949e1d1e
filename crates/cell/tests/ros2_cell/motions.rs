//! Motions that nothing disturbs, and goals that are refused.

use std::{sync::mpsc, thread};

use cell::{Goal, PalmTrajectory, RejectionCode};
use schemas::executions::Outcome;
use spatial::Pose;

use crate::{
    emulated::Behavior,
    lab::{Lab, OBJECT_Z_M, SOON, SOUND, execute, goal, wait_until},
};

/// A change of a track.
type Change = fn(&mut cell::JointTrack);

#[test]
fn joints_follow_the_goal_and_a_lifted_object_is_a_success() {
    let lab = Lab::new();
    let emulated = lab.emulate(SOUND);
    let cell = lab.serve();
    let client = lab.connect();
    let told = client.capabilities(SOON).unwrap();
    assert!(told.real_time && told.palm.is_none());
    let goal = goal(&lab, 1);
    let (id, lift_s) = (goal.encode().goal_id, 1.4);
    let (watching, watched) = mpsc::channel();
    let report = thread::scope(|scope| {
        // The object is in the hand once it has closed.
        scope.spawn(|| {
            let (mut grasped_m, mut is_approach_seen) = (None, false);
            lab.watch(|state| {
                let _told = watching.send(());
                let palm_m = state.sample.table_from_palm.translation.z;
                is_approach_seen |= state.goal_id == id && state.sample.time_s < 0.0;
                if state.goal_id == id && state.sample.time_s >= 1.0 {
                    let from_m = *grasped_m.get_or_insert(palm_m);
                    emulated.put_object(OBJECT_Z_M + palm_m - from_m);
                }
                state.goal_id == id && state.sample.time_s > lift_s + 0.8
            });
            assert!(
                is_approach_seen,
                "nothing moved on the way to the first row"
            );
        });
        watched.recv().unwrap();
        execute(&client, &goal)
    });
    assert_eq!(report.outcome, Outcome::Succeeded, "{}", report.message);
    assert!(report.lift_m > 0.03, "{}", report.lift_m);
    assert!(
        report.tracking_error_rad() < 0.1,
        "{}",
        report.tracking_error_rad()
    );
    assert_eq!(emulated.log().refused, Vec::<String>::new());
    // Asked again, the cell answers, and nothing moves.
    assert_eq!(execute(&client, &goal), report);
    assert_eq!((cell.executed_count(), emulated.log().motions_n), (1, 2));
}

#[test]
fn an_object_that_stays_is_a_failure_and_one_that_nothing_measures_is_unknown() {
    let mut lab = Lab::new();
    let _emulated = lab.emulate(SOUND);
    let cell = lab.serve();
    let report = execute(&lab.connect(), &goal(&lab, 1));
    assert_eq!(report.outcome, Outcome::Failed, "{}", report.message);
    drop(cell);
    lab.config.object = None;
    let _cell = lab.serve();
    let report = execute(&lab.connect(), &goal(&lab, 2));
    assert_eq!(report.outcome, Outcome::Unknown);
    assert_eq!(report.message, "executed; nothing measures the object");
    assert!(!report.samples.is_empty());
}

#[test]
fn late_and_jerky_controllers_that_keep_to_their_commands_are_no_fault() {
    for behavior in [Behavior::Late, Behavior::Jerky] {
        let lab = Lab::new();
        let emulated = lab.emulate([behavior; 2]);
        let _cell = lab.serve();
        let report = execute(&lab.connect(), &goal(&lab, 1));
        assert_eq!(
            report.outcome,
            Outcome::Failed,
            "{behavior:?}: {}",
            report.message
        );
        assert!(
            report.message.contains("rose 0.000 m"),
            "{}",
            report.message
        );
        assert_eq!(emulated.log().refused, Vec::<String>::new());
    }
}

#[test]
fn a_goal_is_refused_unless_robot_and_object_are_ready_for_it() {
    let mut lab = Lab::new();
    lab.config.arm.deceleration_rad_per_s2 = 100.0;
    let emulated = lab.emulate(SOUND);
    let cell = lab.serve();
    let client = lab.connect();
    let check = |change: fn(&mut Goal), code: RejectionCode, reason: &str| {
        let mut goal = goal(&lab, 1);
        change(&mut goal);
        let rejection = execute(&client, &goal).rejection;
        let rejection = rejection.unwrap_or_else(|| panic!("{reason}: it was taken"));
        assert_eq!(rejection.code, code, "{}", rejection.reason);
        assert!(rejection.reason.contains(reason), "{}", rejection.reason);
    };
    let arm = |goal: &mut Goal, change: fn(&mut cell::JointTrack)| match &mut goal.carrier {
        PalmTrajectory::Arm(track) => change(track),
        PalmTrajectory::Palm(_) => panic!("an arm was given"),
    };
    check(
        |goal| {
            goal.start_tolerance_rad = 0.1;
            goal.hand.points[0].q_rad[3] += 0.2;
        },
        RejectionCode::Busy,
        "a joint is 0.200 rad from the first row",
    );
    check(
        |goal| {
            let aside = [0.1, 0.0, OBJECT_Z_M, 0.0, 0.0, 0.0, 1.0];
            goal.table_from_object = Pose::from_array(aside).unwrap();
        },
        RejectionCode::Object,
        "m from where the goal has it",
    );
    // The arm's first joint at more than 3.14 rad/s, and at a speed that no brake stops in time.
    let faster: [(Change, RejectionCode, &str); 3] = [
        (
            |arm| arm.points[1].time_s = 0.2,
            RejectionCode::Limits,
            "`joint1` would move at",
        ),
        (
            |arm| arm.points[1].time_s = 0.4,
            RejectionCode::Limits,
            "to brake in",
        ),
        (
            |arm| arm.points[1].time_s = 0.0,
            RejectionCode::Times,
            "point 1 of the arm",
        ),
    ];
    for (change, code, reason) in faster {
        let mut goal = goal(&lab, 1);
        arm(&mut goal, change);
        let rejection = execute(&client, &goal).rejection.unwrap();
        assert_eq!(rejection.code, code, "{}", rejection.reason);
        assert!(rejection.reason.contains(reason), "{}", rejection.reason);
    }
    // Nobody is there any more.
    drop(emulated);
    wait_until(|| {
        let refused = execute(&client, &goal(&lab, 1)).rejection;
        refused.is_some_and(|it| it.code == RejectionCode::Busy && it.reason.contains("s old"))
    });
    assert_eq!(cell.executed_count(), 0);
}
