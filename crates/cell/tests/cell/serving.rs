//! What a cell answers.

use std::time::Duration;

use cell::{
    Carrier, CellClient, CellError, Executed, Gap, Goal, Keys, RejectionCode, SealedGoal, Service,
    SimulatedCell, SimulatedCellConfig, StateHeader, robot_digest, subscribe,
};
use schemas::executions::Outcome;
use simulation::Trial;
use zenoh::Wait;

use crate::lab::{GRIPPER, SOON, connect, execute, goal, joints, scene, start};

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
        |g| g.carrier = Carrier::Arm(g.hand.clone()),
        RejectionCode::Joints,
        "no arm",
    );
    check(
        |g| g.hand.points[2].q_rad[0] = 0.07,
        RejectionCode::Limits,
        "`slide_left` would be at 0.06",
    );
    // Both points are inside, and the way between them is not.
    check(
        |g| {
            g.hand.points[1].velocity_rad_per_s[1] = -0.4;
            g.hand.points[2].velocity_rad_per_s[1] = 0.4;
        },
        RejectionCode::Limits,
        "`slide_right` would be at -0.0",
    );
    check(
        |g| g.hand.points[2].velocity_rad_per_s[0] = 50.0,
        RejectionCode::Limits,
        "`slide_left` would be at -0.0",
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
        |g| g.carrier = Carrier::Palm(Vec::new()),
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
        |g| g.grasp.trial = Trial::SixDirections,
        RejectionCode::Malformed,
        "pulls at nothing",
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
fn two_cells_that_answer_to_one_name_are_refused() {
    let cell = start();
    // Another program on the same router has the same name.
    let (other, _) = subscribe(cell.endpoint(), "nothing", SOON).unwrap();
    let _second = other
        .declare_queryable(Keys::new("simulated").unwrap().capabilities())
        .callback(|query| query.reply(query.key_expr(), "{}\n").wait().unwrap())
        .wait()
        .unwrap();
    let err = connect(&cell).capabilities(SOON).unwrap_err();
    assert!(
        matches!(err, CellError::SeveralCells { count: 2, .. }),
        "{err}"
    );
    assert!(err.to_string().contains("nothing was sent"), "{err}");
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
        arm: None,
        gap: Gap::default(),
        service: Service::default(),
    };
    let err = SimulatedCell::start(config, GRIPPER).map(drop).unwrap_err();
    assert!(matches!(err, CellError::Listen { .. }), "{err}");
    assert!(err.hint().unwrap().contains("dispatch.listen"));
}
