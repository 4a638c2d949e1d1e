//! Answers of a cell.

use std::time::Duration;

use cell::{
    CellClient, CellError, Goal, GoalMessage, Keys, ModelMismatch, PalmPoint, PalmTrajectory,
    RejectionCode, ServiceConfig, SimulatedCell, SimulatedCellConfig, StateHeader, robot_digest,
    subscribe,
};
use nalgebra::Isometry3;
use robot::RobotModel;
use schemas::executions::Outcome;
use spatial::Pose;
use zenoh::Wait;

use crate::lab::{GRIPPER, SOON, addressed, connect, execute, goal, joints, scene, start};

#[test]
fn a_motion_that_holds_is_accepted_executed_and_measured() {
    let cell = start();
    let client = connect(&cell);
    let capabilities = client.capabilities(SOON).unwrap();
    assert!(capabilities.simulated);
    assert_eq!(capabilities.robot, robot_digest(GRIPPER));
    let [palm, hand] = capabilities.controllers.as_slice() else {
        panic!("{:?}", capabilities.controllers);
    };
    assert_eq!(
        (palm.controller.as_str(), hand.controller.as_str()),
        ("palm", "hand")
    );
    assert_eq!(hand.joints, joints());
    assert!((hand.rate_hz - 100.0).abs() < 1e-9);

    let held = execute(&client, &goal(0.04));
    assert_eq!(
        (held.outcome, held.message.as_str()),
        (Outcome::Succeeded, "held")
    );
    assert!(held.lift_m > 0.08, "{}", held.lift_m);
    assert!(
        (held.duration_s() - 1.8).abs() < 0.02,
        "{}",
        held.duration_s()
    );
    assert!(
        held.tracking_error_rad() > 0.001,
        "squeezing leaves an error"
    );

    let missed = execute(&client, &goal(0.0));
    assert_eq!(missed.outcome, Outcome::Failed);
    assert!(missed.lift_m < 0.01);
    cell.stop();
}

#[test]
fn equal_goals_on_two_cells_give_equal_reports() {
    let run = || {
        let cell = start();
        execute(&connect(&cell), &goal(0.04))
    };
    assert_eq!(run(), run());
}

#[test]
fn a_goal_sent_twice_is_executed_once_and_answered_twice() {
    let cell = start();
    let first = execute(&connect(&cell), &goal(0.04));
    let second = execute(&connect(&cell), &goal(0.04));
    assert_eq!(first, second);
    assert_eq!(cell.executed_count(), 1);
    let mut again = goal(0.04);
    again.attempt = 2;
    execute(&connect(&cell), &again);
    assert_eq!(cell.executed_count(), 2);
}

#[test]
fn motion_beyond_the_robot_is_rejected_with_a_reason() {
    let cell = start();
    let client = connect(&cell);
    let check = |change: fn(&mut Goal), code: RejectionCode, reason: &str| {
        let mut goal = goal(0.04);
        change(&mut goal);
        let report = execute(&client, &goal);
        let rejection = report.rejection.unwrap();
        assert_eq!((report.outcome, rejection.code), (Outcome::Rejected, code));
        assert!(rejection.reason.contains(reason), "{}", rejection.reason);
    };
    check(
        |g| g.hand.joints[1] = "thumb".to_owned(),
        RejectionCode::Joints,
        "no joint `thumb`",
    );
    check(
        |g| g.hand.joints[1] = "slide_left".to_owned(),
        RejectionCode::Joints,
        "`slide_right` is missing",
    );
    check(
        |g| g.carrier = PalmTrajectory::Arm(g.hand.clone()),
        RejectionCode::Joints,
        "no arm",
    );
    check(
        |g| g.hand.points[2].q_rad[0] = 0.07,
        RejectionCode::Limits,
        "`slide_left` would be at 0.07",
    );
    // Both points are inside, and the way between them is not.
    check(
        |g| {
            g.hand.points[1].rates.velocity[1] = -0.4;
            g.hand.points[2].rates.velocity[1] = 0.4;
        },
        RejectionCode::Limits,
        "`slide_right` would be at -0.0",
    );
    check(
        |g| g.hand.points[2].rates.velocity[0] = 50.0,
        RejectionCode::Limits,
        "`slide_left` would be at -",
    );
    check(
        |g| g.hand.points[2].time_s = 0.3,
        RejectionCode::Times,
        "point 2 of the hand is at 0.3 s",
    );
    check(
        |g| g.hand.points[0].time_s = 0.1,
        RejectionCode::Times,
        "the hand's first point is at 0.1 s",
    );
    check(
        |g| g.hand.points.truncate(1),
        RejectionCode::Times,
        "1 points of the hand",
    );
    check(
        |g| g.carrier = PalmTrajectory::Palm(Vec::new()),
        RejectionCode::Times,
        "0 points of the palm",
    );
    check(
        |g| g.hand.points[1].time_s = f64::INFINITY,
        RejectionCode::Malformed,
        "not finite",
    );
    check(
        |g| g.grasp.hold_s = 1e9,
        RejectionCode::Times,
        "`hold_s` is 1000000000 s",
    );
    check(
        |g| g.start_tolerance_rad = -0.1,
        RejectionCode::Limits,
        "`start_tolerance_rad` is -0.1",
    );
    check(
        |g| g.grasp.limit_tolerance_rad = -0.1,
        RejectionCode::Limits,
        "`limit_tolerance_rad` is -0.1",
    );
    check(
        |g| g.grasp.knocked_m = -1.0,
        RejectionCode::Limits,
        "`knocked_m` is -1",
    );
    check(
        |g| g.grasp.close_fraction = 1.5,
        RejectionCode::Limits,
        "`close_fraction` is 1.5",
    );
    check(
        |g| g.robot = robot_digest("<robot/>"),
        RejectionCode::Robot,
        "this one is",
    );
    check(
        |g| g.object = "mug".to_owned(),
        RejectionCode::Object,
        "no object `mug`",
    );
    assert_eq!(cell.executed_count(), 0);
}

#[test]
fn palm_keeps_the_limits_of_the_cell() {
    let cell = start();
    let client = connect(&cell);
    let palm = client.capabilities(SOON).unwrap().palm.unwrap();
    assert!(palm.speed_m_per_s > 1.0 && palm.speed_m_per_s < 10.0);
    let check = |change: fn(&mut Vec<PalmPoint>), reason: &str| {
        let mut goal = goal(0.04);
        let PalmTrajectory::Palm(points) = &mut goal.carrier else {
            panic!("a palm was given");
        };
        change(points);
        let rejection = execute(&client, &goal).rejection;
        let rejection = rejection.unwrap_or_else(|| panic!("{reason}: it was taken"));
        assert_eq!(rejection.code, RejectionCode::Limits, "{reason}");
        assert!(rejection.reason.contains(reason), "{}", rejection.reason);
    };
    // Violations in a row, and one between two rows that no row shows.
    check(
        |p| p[1].velocity.linear.x = 1000.0,
        "would move at 1000 m/s",
    );
    check(
        |p| p[1].velocity.angular.z = 100.0,
        "would turn at 100 rad/s",
    );
    check(
        |p| p[1].acceleration.linear.y = -1e4,
        "would accelerate at 10000 m/s²",
    );
    check(
        |p| p[1].acceleration.angular.y = 1e4,
        "would change its turn at 10000 rad/s²",
    );
    check(|p| p[1].time_s = 0.02, "the palm would move at");
    // Every row is within the limits, and the quick way between two of them is not.
    check(
        |p| {
            let along = Isometry3::translation(0.0225, 0.0, 0.0);
            p[1].time_s = 0.03;
            p[1].table_from_palm = Pose::new(along * *p[0].table_from_palm);
            p[1].velocity.linear.x = 1.5;
        },
        "m/s² between 0 and 0.03 s",
    );
    for change in [
        (|p: &mut Vec<PalmPoint>| {
            p[3].table_from_palm = Pose::new(Isometry3::translation(0.0, 0.0, 30.0));
        }) as fn(&mut Vec<PalmPoint>),
        |p| p[0].table_from_palm = Pose::new(Isometry3::translation(-2.5, 0.0, 0.2)),
        |p| p[0].table_from_palm = Pose::new(Isometry3::translation(0.0, 0.0, -1.0)),
    ] {
        check(change, "the palm would");
    }
    assert_eq!(cell.executed_count(), 0);
}

#[test]
fn malformed_goals_are_rejected_by_code() {
    let cell = start();
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let mut damaged = addressed(&connect(&cell), &goal(0.04), "me").bytes;
    *damaged.last_mut().unwrap() ^= 1;
    for (bytes, code) in [
        (Vec::new(), "malformed"),
        (b"{\"protocol\":2}".to_vec(), "protocol"),
        (b"{\"protocol\":5}".to_vec(), "malformed"),
        (vec![0xff; 1000], "malformed"),
        (damaged, "digest"),
        (vec![b' '; 33 * 1024 * 1024], "too_large"),
    ] {
        let replies = session
            .get(keys.goal())
            .payload(bytes)
            .timeout(SOON)
            .wait()
            .unwrap();
        let answer = replies.recv().unwrap().into_result().unwrap();
        let text = String::from_utf8(answer.payload().to_bytes().into_owned()).unwrap();
        assert!(
            text.contains("\"rejected\"") && text.contains(code),
            "{text}"
        );
    }
}

#[test]
fn a_second_subscriber_sees_motions_states_and_outcomes() {
    let cell = start();
    let keys = Keys::new("simulated").unwrap();
    let (_session, watched) = subscribe(cell.endpoint(), &keys.all(), SOON).unwrap();
    // A query proves that the subscription arrived: one connection keeps its order.
    let report = execute(&connect(&cell), &goal(0.04));
    let outcome_key = keys.outcome(&report.goal_id);
    let (mut motions, mut states, mut outcome) = (0, 0, None);
    while (outcome.is_none() || motions == 0)
        && let Ok(Some(sample)) = watched.recv_timeout(SOON)
    {
        let bytes = sample.payload().to_bytes();
        let line = bytes.split(|&byte| byte == b'\n').next().unwrap();
        let key = sample.key_expr().as_str();
        if key == keys.motion() {
            assert_eq!(
                GoalMessage::decode(&bytes).unwrap().0.encoded.goal_id,
                report.goal_id
            );
            motions += 1;
        } else if key == keys.state() {
            let header: StateHeader = serde_json::from_slice(line).unwrap();
            assert_eq!(header.goal_id, report.goal_id);
            assert_eq!(bytes.len() - line.len() - 1, 8 * (15 + 4));
            states += 1;
        } else if key == outcome_key {
            outcome = Some(String::from_utf8(line.to_vec()).unwrap());
        }
    }
    // Every control step is a state, and the report has a hundred samples a second.
    assert_eq!(motions, 1);
    assert!(states >= report.samples.len());
    assert!(outcome.unwrap().contains("\"succeeded\""));
}

#[test]
fn a_cell_that_is_not_there_is_named_in_the_error() {
    let wait = Duration::from_millis(300);
    let cell = start();
    let endpoint = cell.endpoint().to_owned();
    let client = CellClient::connect(&endpoint, "other", SOON).unwrap();
    let err = client.capabilities(wait).unwrap_err();
    let text = err.to_string();
    assert!(matches!(err, CellError::NoAnswer { .. }));
    for part in [
        "did not answer",
        "cgf/cell/other/capabilities",
        &endpoint,
        "nothing was sent",
    ] {
        assert!(text.contains(part), "{text}");
    }
    assert!(err.hint().unwrap().contains("dispatch.cell=simulated"));
    cell.stop();
    let err = CellClient::connect(&endpoint, "simulated", wait)
        .map(drop)
        .unwrap_err();
    assert!(matches!(err, CellError::Connect { .. }), "{err}");
    let cause = std::error::Error::source(&err).unwrap().to_string();
    assert!(!cause.contains(".rs"), "{cause}");
    assert!(err.to_string().contains(&endpoint));
}

#[test]
fn hand_without_collision_shapes_is_refused() {
    let of_mesh = GRIPPER.replacen("<box size=", "<mesh filename=", 1);
    assert_ne!(of_mesh, GRIPPER);
    let config = || SimulatedCellConfig {
        name: "meshes".to_owned(),
        listen: "tcp/127.0.0.1:0".to_owned(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig::default(),
    };
    let err = SimulatedCell::start(config(), &of_mesh)
        .map(drop)
        .unwrap_err();
    assert!(matches!(err, CellError::Simulation(_)), "{err}");
    assert!(err.hint().unwrap().contains("with_mesh_shapes"), "{err}");
    // With any shapes given, the start succeeds.
    let read = RobotModel::from_urdf(GRIPPER).unwrap();
    SimulatedCell::start_with(config(), &of_mesh, read).unwrap();
}

#[test]
fn port_in_use_is_an_error_with_a_hint() {
    let cell = start();
    let config = SimulatedCellConfig {
        name: "second".to_owned(),
        listen: cell.endpoint().to_owned(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service: ServiceConfig::default(),
    };
    let err = SimulatedCell::start(config, GRIPPER).map(drop).unwrap_err();
    assert!(matches!(err, CellError::PortTaken { .. }), "{err}");
    assert!(err.hint().unwrap().contains("--listen tcp/127.0.0.1:0"));
}
