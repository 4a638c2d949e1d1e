//! A gripper, a cube, and a cell of both.

use std::time::Duration;

use cell::{
    Address, CellClient, Goal, GoalMessage, GoalResult, Grasp, JointPoint, JointRates, JointTrack,
    ModelMismatch, PalmPoint, PalmTrajectory, Patience, Report, ServiceConfig, SigningKey,
    SimulatedCell, SimulatedCellConfig, Terms, UncheckedReport, robot_digest,
};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use robot::{Joint, RobotModel};
use simulation::{ObjectShape, Protocol, SceneConfig};
use spatial::{Pose, RestingPose, Twist};

pub(crate) const LISTEN: &str = "tcp/127.0.0.1:0";
pub(crate) const SOON: Duration = Duration::from_secs(20);
/// As patient as [`SOON`].
pub(crate) const PATIENT: Patience = Patience {
    answer: SOON,
    result: SOON,
};
pub(crate) const HALF_EDGE_M: f64 = 0.02;

/// Two plates that slide towards each other below a palm that points down.
pub(crate) const GRIPPER: &str = include_str!("../gripper.urdf");

pub(crate) fn joints() -> Vec<String> {
    vec!["slide_left".to_owned(), "slide_right".to_owned()]
}

pub(crate) fn scene() -> SceneConfig {
    let scene = serde_json::json!({
        "time_step_s": 0.002,
        "settle_s": 0.5,
        "drive": {
            "stiffness": 2000.0, "damping": 60.0, "torque_limit": 20.0, "armature": 0.0,
            "stop_stiffness": 10_000.0,
        },
    });
    serde_json::from_value(scene).unwrap()
}

pub(crate) fn grasp() -> Grasp {
    let protocol = serde_json::json!({
        "approach": "follow",
        "reach_s": 0.6,
        "close_fraction": 0.3,
        "flexion_joints": joints(),
        "open_rad": 0.0,
        "squeeze_rad": 0.01,
        "squeeze_s": 0.2,
        "pause_s": 0.1,
        "lift_m": 0.1,
        "lift_s": 0.4,
        "hold_s": 0.5,
        "lifted_m": 0.05,
        "min_links": 2,
        "max_slip_m_per_s": 0.02,
        "knocked_m": 0.02,
        "knocked_rad": 0.3,
        "limit_tolerance_rad": 0.001,
        "table_tolerance_m": 0.002,
        "early_tolerance_m": 0.005,
    });
    let protocol: Protocol = serde_json::from_value(protocol).unwrap();
    Grasp::try_from(&protocol).unwrap()
}

pub(crate) fn cube() -> ObjectShape {
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
        surface: None,
        parts_m: vec![corners.collect()],
        mass_kg,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::identity() * mass_kg * (2.0 * HALF_EDGE_M).powi(2) / 6.0,
    }
}

/// Comes from above, closes the plates to `closed_m`, which touches the cube at 0.04, squeezes and lifts.
pub(crate) fn goal(closed_m: f64) -> Goal {
    let rest = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: HALF_EDGE_M,
    };
    let palm = |time_s: f64, above_m: f64| PalmPoint {
        time_s,
        table_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, HALF_EDGE_M + above_m)),
        velocity: Twist::zero(),
        acceleration: Twist::zero(),
    };
    let hand = |time_s: f64, q: f64| JointPoint {
        time_s,
        q_rad: vec![q, q],
        rates: JointRates {
            velocity: vec![0.0; 2],
            acceleration: vec![0.0; 2],
        },
    };
    // As long as `grasp` says: the reach to 0.6 s, the squeeze to 0.8 s, the lift from 0.9 s to 1.3 s.
    Goal {
        candidate_id: "cube-0001".to_owned(),
        object: "cube".to_owned(),
        robot: robot_digest(GRIPPER),
        attempt: 1,
        resumed: 0,
        table_from_object: rest.table_from_object(),
        start_tolerance_rad: 0.1,
        grasp: grasp(),
        carrier: PalmTrajectory::Palm(vec![
            palm(0.0, 0.15),
            palm(0.42, 0.02),
            palm(0.9, 0.02),
            palm(1.3, 0.12),
        ]),
        hand: JointTrack {
            joints: joints(),
            points: vec![
                hand(0.0, 0.0),
                hand(0.42, 0.0),
                hand(0.6, closed_m),
                hand(0.8, closed_m + 0.01),
            ],
        },
    }
}

/// The gripper's joints.
pub(crate) fn robot() -> Vec<Joint> {
    joints_of(GRIPPER)
}

pub(crate) fn joints_of(urdf: &str) -> Vec<Joint> {
    RobotModel::from_urdf(urdf).unwrap().joints().to_vec()
}

pub(crate) fn config(service: ServiceConfig) -> SimulatedCellConfig {
    SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        arm: None,
        mismatch: ModelMismatch::default(),
        service,
    }
}

/// A cell that serves in this way.
pub(crate) fn start_with(service: ServiceConfig) -> SimulatedCell {
    let cell = SimulatedCell::start(config(service), GRIPPER).unwrap();
    cell.put_object("cube", cube());
    cell
}

pub(crate) fn start() -> SimulatedCell {
    start_with(ServiceConfig::default())
}

/// Has a goal executed to its end.
pub(crate) fn execute(client: &CellClient, goal: &Goal) -> Report {
    execute_by(client, goal, &robot())
}

/// As [`execute`], by a robot with these joints.
pub(crate) fn execute_by(client: &CellClient, goal: &Goal, robot: &[Joint]) -> Report {
    let done = client.execute(goal, &terms(client), robot, PATIENT, &());
    match done.unwrap() {
        GoalResult::Report(report) | GoalResult::EarlierReport(report) => report,
        other => panic!("{other:?}"),
    }
}

/// The terms of a cell that is simulated, as it says.
pub(crate) fn terms(client: &CellClient) -> Terms {
    Terms::new(client.capabilities(SOON).unwrap(), false)
}

/// A goal for the cell that this client reaches, from a dispatcher of this name.
pub(crate) fn addressed(client: &CellClient, goal: &Goal, dispatcher: &str) -> GoalMessage {
    let there = client.capabilities(SOON).unwrap();
    let address = Address::now(&there.cell, &there.journal, dispatcher, true, SOON);
    GoalMessage::new(goal.encode(), address, &SigningKey::fresh().unwrap())
}

/// Returns what follows the signature of an answer.
pub(crate) fn body(answer: &[u8]) -> &[u8] {
    let end = answer.iter().position(|&byte| byte == b'\n').unwrap();
    &answer[end + 1..]
}

/// Reads an answer that is a report on a goal.
pub(crate) fn report(answer: &[u8], goal: &Goal) -> Report {
    let report = UncheckedReport::from_bytes(body(answer)).unwrap();
    report
        .check(&goal.encode().goal_id, goal, &robot())
        .unwrap()
}

pub(crate) fn connect(cell: &SimulatedCell) -> CellClient {
    CellClient::connect(cell.endpoint(), cell.name(), SOON).unwrap()
}
