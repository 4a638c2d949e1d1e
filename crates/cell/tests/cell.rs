//! Dispatcher and simulated cell over real sockets of the loopback interface.

use std::time::Duration;

use cell::{
    CellClient, CellError, Executed, Goal, GoalStep, Keys, ObjectError, RejectionCode, Report,
    SealedGoal, Service, SimulatedCell, SimulatedCellConfig, StateHeader, robot_digest, subscribe,
};
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use schemas::executions::Outcome;
use simulation::{
    Approach, ControllerKind, DriveConfig, ObjectShape, Offset, Protocol, PullConfig, SceneConfig,
    Shortcuts, Trial,
};
use spatial::{Pose, Rest};
use zenoh::Wait;

const LISTEN: &str = "tcp/127.0.0.1:0";
const SOON: Duration = Duration::from_secs(20);
const HALF_EDGE_M: f64 = 0.02;

/// Two plates that slide towards each other below a palm that points down.
const GRIPPER: &str = include_str!("gripper.urdf");

fn joints() -> Vec<String> {
    vec!["slide_left".to_owned(), "slide_right".to_owned()]
}

fn scene() -> SceneConfig {
    SceneConfig {
        friction: 1.0,
        mass_scale: 1.0,
        hand_mass_scale: 1.0,
        object_offset: Offset::default(),
        time_step_s: 0.002,
        steps_per_control: 5,
        prediction_m: 0.002,
        settle_s: 0.5,
        drive: DriveConfig {
            controller: ControllerKind::Pd,
            stiffness: 2000.0,
            damping: 60.0,
            torque_limit: 20.0,
            armature: 0.0,
            stop_stiffness: 10_000.0,
        },
        shortcuts: Shortcuts::ALL,
    }
}

fn grasp() -> Protocol {
    Protocol {
        approach: Approach::Follow,
        reach_s: 0.6,
        close_fraction: 0.3,
        flexion_joints: joints(),
        open_rad: 0.0,
        squeeze_rad: 0.01,
        squeeze_s: 0.2,
        pause_s: 0.1,
        lift_m: 0.1,
        lift_s: 0.4,
        hold_s: 0.5,
        lifted_m: 0.05,
        min_links: 2,
        max_slip_m_per_s: 0.02,
        knocked_m: 0.02,
        knocked_rad: 0.3,
        limit_tolerance_rad: 0.001,
        table_tolerance_m: 0.002,
        early_tolerance_m: 0.005,
        trial: Trial::Lift,
        pull: PullConfig::default(),
    }
}

fn cube() -> ObjectShape {
    let corners = (0..8).map(|corner| {
        let side = |bit: u32| {
            if corner >> bit & 1 == 0 {
                -HALF_EDGE_M
            } else {
                HALF_EDGE_M
            }
        };
        Point3::new(side(0), side(1), side(2))
    });
    let mass_kg = 0.1;
    ObjectShape {
        parts_m: vec![corners.collect()],
        mass_kg,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::identity() * mass_kg * (2.0 * HALF_EDGE_M).powi(2) / 6.0,
    }
}

/// Comes from above, closes the plates to `closed_m`, which touches the cube at 0.04.
fn goal(closed_m: f64) -> Goal {
    let rest = Rest {
        up_in_object: Vector3::z_axis(),
        height_m: HALF_EDGE_M,
    };
    let step = |time_s: f64, above_m: f64, q: f64| GoalStep {
        time_s,
        object_from_palm: Pose::new(Isometry3::from_parts(
            nalgebra::Translation3::new(0.0, 0.0, above_m),
            UnitQuaternion::identity(),
        )),
        q_rad: vec![q, q],
    };
    Goal {
        candidate_id: "cube-0001".to_owned(),
        object: "cube".to_owned(),
        robot: robot_digest(GRIPPER),
        attempt: 1,
        table_from_object: rest.table_from_object(),
        joints: joints(),
        start_tolerance_rad: 0.1,
        grasp: grasp(),
        steps: vec![
            step(0.0, 0.15, 0.0),
            step(0.7, 0.02, 0.0),
            step(1.0, 0.02, closed_m),
        ],
    }
}

fn start() -> SimulatedCell {
    let config = SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        object_error: ObjectError::default(),
        service: Service::default(),
    };
    let cell = SimulatedCell::start(config, GRIPPER).unwrap();
    cell.put_object("cube", cube());
    cell
}

/// Has a goal executed to its end.
fn execute(client: &CellClient, goal: &Goal) -> Report {
    match client.execute(goal, SOON, SOON).unwrap() {
        Executed::Over(report) => report,
        Executed::Unheard(message) => panic!("{message}"),
    }
}

fn connect(cell: &SimulatedCell) -> CellClient {
    CellClient::connect(cell.endpoint(), cell.name(), SOON).unwrap()
}

#[test]
fn a_motion_that_holds_is_accepted_executed_and_measured() {
    let cell = start();
    let client = connect(&cell);
    let capabilities = client.capabilities(SOON).unwrap();
    assert!(capabilities.simulated);
    assert_eq!(capabilities.robot, robot_digest(GRIPPER));
    assert_eq!(capabilities.joints, joints());

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
    assert_eq!(cell.executed_n(), 1);
    let mut again = goal(0.04);
    again.attempt = 2;
    execute(&connect(&cell), &again);
    assert_eq!(cell.executed_n(), 2);
}

#[test]
fn what_the_robot_cannot_do_is_rejected_with_a_reason() {
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
        |g| g.joints[1] = "thumb".to_owned(),
        RejectionCode::Joints,
        "no joint `thumb`",
    );
    check(
        |g| g.joints[1] = "slide_left".to_owned(),
        RejectionCode::Joints,
        "`slide_right` is missing",
    );
    check(
        |g| g.steps[2].q_rad[0] = 0.07,
        RejectionCode::Limits,
        "`slide_left` at 0.07",
    );
    check(
        |g| g.steps[2].time_s = 0.7,
        RejectionCode::Times,
        "step 2 is at 0.7 s",
    );
    check(|g| g.steps.truncate(1), RejectionCode::Times, "1 steps");
    check(
        |g| g.steps[1].time_s = f64::INFINITY,
        RejectionCode::Malformed,
        "not finite",
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
    assert_eq!(cell.executed_n(), 0);
}

#[test]
fn bytes_that_are_no_goal_are_rejected_by_code() {
    let cell = start();
    let (session, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let mut damaged = goal(0.04).seal().bytes;
    *damaged.last_mut().unwrap() ^= 1;
    for (bytes, code) in [
        (Vec::new(), "malformed"),
        (b"{\"protocol\":2}".to_vec(), "malformed"),
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
    // Asking something proves that the subscription arrived: one connection keeps its order.
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
            assert_eq!(SealedGoal::open(&bytes).unwrap().0.goal_id, report.goal_id);
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
    assert_eq!((motions, states), (1, report.samples.len()));
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
fn a_cell_that_takes_a_goal_and_falls_silent_leaves_it_unknown() {
    // The simulated cell only forwards here: another program is the cell `mute`.
    let router = start();
    let (mute, _) = subscribe(router.endpoint(), "nothing", SOON).unwrap();
    let keys = Keys::new("mute").unwrap();
    let _goal = mute
        .declare_queryable(keys.goal())
        .callback(|query| {
            query
                .reply(
                    query.key_expr(),
                    "{\"answer\":\"accepted\",\"known\":false}\n",
                )
                .wait()
                .unwrap();
        })
        .wait()
        .unwrap();
    let (kept, _never_answered) = std::sync::mpsc::channel();
    let _result = mute
        .declare_queryable(keys.result("*"))
        .callback(move |query| drop(kept.send(query)))
        .wait()
        .unwrap();
    let client = CellClient::connect(router.endpoint(), "mute", SOON).unwrap();
    let executed = client
        .execute(&goal(0.04), SOON, Duration::from_millis(300))
        .unwrap();
    assert!(
        matches!(&executed, Executed::Unheard(message) if message.contains("no answer about the result")),
        "{executed:?}"
    );
    assert!(matches!(
        client.capabilities(Duration::from_millis(300)),
        Err(CellError::NoAnswer { .. })
    ));
}

#[test]
fn a_taken_port_is_an_error_that_says_what_to_do() {
    let cell = start();
    let config = SimulatedCellConfig {
        name: "second".to_owned(),
        listen: cell.endpoint().to_owned(),
        scene: scene(),
        object_error: ObjectError::default(),
        service: Service::default(),
    };
    let err = SimulatedCell::start(config, GRIPPER).map(drop).unwrap_err();
    assert!(matches!(err, CellError::Listen { .. }), "{err}");
    assert!(err.hint().unwrap().contains("dispatch.listen"));
}
