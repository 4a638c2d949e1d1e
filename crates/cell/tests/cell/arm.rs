//! A hand on an arm.

use cell::{
    CellArm, Goal, JointPoint, JointRates, JointTrack, ModelMismatch, PalmTrajectory,
    RejectionCode, ServiceConfig, SimulatedCell, SimulatedCellConfig, robot_digest,
};
use nalgebra::{Isometry3, Vector3};
use robot::RobotModel;
use schemas::executions::Outcome;
use spatial::{Base, Pose, Table};

use crate::lab::{LISTEN, connect, cube, execute_by, goal, joints_of, scene};

pub(crate) const HAND: &str = include_str!("../../../../data/robots/allegro_right.urdf");
pub(crate) const ARM: &str = include_str!("../../../../data/robots/xarm6_allegro.urdf");
/// The arm's joints where the hand points down, in front of it and well above the table.
const ABOVE: [f64; 6] = [0.0, -0.6, -0.6, 0.0, 1.2, 0.0];

fn table_from_base() -> Pose<Table, Base> {
    Pose::new(Isometry3::translation(-0.4, 0.1, 0.0))
}

pub(crate) fn config() -> SimulatedCellConfig {
    SimulatedCellConfig {
        name: "simulated".to_owned(),
        listen: LISTEN.to_owned(),
        scene: scene(),
        arm: Some(CellArm {
            urdf: ARM.to_owned(),
            palm: "base_link".to_owned(),
            table_from_base: table_from_base(),
        }),
        mismatch: ModelMismatch::default(),
        service: ServiceConfig::default(),
    }
}

fn start() -> SimulatedCell {
    let cell = SimulatedCell::start(config(), HAND).unwrap();
    cell.put_object("cube", cube());
    cell
}

/// Turns the arm's first joint by a tenth of a radian while the fingers stay as they are.
pub(crate) fn carried() -> Goal {
    let still = |joints: Vec<String>, ends: [(f64, Vec<f64>); 2]| JointTrack {
        points: ends
            .map(|(time_s, q)| JointPoint {
                time_s,
                rates: JointRates {
                    velocity: vec![0.0; q.len()],
                    acceleration: vec![0.0; q.len()],
                },
                q_rad: q,
            })
            .to_vec(),
        joints,
    };
    let hand = RobotModel::from_urdf(HAND).unwrap();
    let mut beside = ABOVE.to_vec();
    beside[0] += 0.1;
    let arm = (1..=6).map(|joint| format!("joint{joint}")).collect();
    let mut asked = goal(0.0);
    asked.robot = robot_digest(ARM);
    asked.grasp.flexion_joints = Vec::new();
    // The cube stands elsewhere, turned by one radian.
    let turned = Isometry3::new(Vector3::new(0.1, 0.05, 0.0), Vector3::z());
    let cube = turned * *asked.table_from_object;
    asked.table_from_object = Pose::new(cube);
    asked.carrier = PalmTrajectory::Arm(still(arm, [(0.0, ABOVE.to_vec()), (0.5, beside)]));
    let open = hand.mid_range();
    asked.hand = still(hand.joint_names(), [(0.0, open.clone()), (0.8, open)]);
    asked
}

#[test]
fn palm_pose_agrees_with_arm_kinematics() {
    let cell = start();
    let client = connect(&cell);
    let capabilities = client.capabilities(crate::lab::SOON).unwrap();
    assert_eq!(capabilities.controllers[0].controller, "arm");
    assert_eq!(capabilities.controllers[0].joints.len(), 6);
    assert_eq!(
        capabilities.table_from_base,
        Some([-0.4, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0])
    );
    let asked = carried();
    let report = execute_by(&client, &asked, &joints_of(ARM));
    let cube = report.samples[0].table_from_object;
    let off = asked.table_from_object.inv_mul(&cube);
    assert!(
        off.translation.vector.norm() < 1e-3 && off.rotation.angle() < 1e-3,
        "{off:?}"
    );
    // It grasps nothing.
    assert_eq!(report.outcome, Outcome::Failed, "{}", report.message);
    assert_eq!(report.joints.len(), 22);
    let robot = RobotModel::from_urdf(ARM).unwrap();
    let palm = robot.require_link("base_link").unwrap();
    let column = |name: &String| report.joints.iter().position(|joint| joint == name);
    let columns: Vec<usize> = robot
        .joint_names()
        .iter()
        .map(|n| column(n).unwrap())
        .collect();
    let palms: Vec<[Isometry3<f64>; 2]> = report
        .samples
        .iter()
        .take_while(|sample| sample.time_s <= 0.5)
        .map(|sample| {
            let q: Vec<f64> = columns
                .iter()
                .map(|&idx| sample.q_command_rad[idx])
                .collect();
            let there = *(table_from_base() * robot.forward_kinematics(&q).unwrap()[palm]);
            [*sample.table_from_palm, there]
        })
        .collect();
    assert!(palms.len() > 40);
    for [measured, commanded] in &palms {
        let off = measured.inv_mul(commanded);
        assert!(off.translation.vector.norm() < 1e-3, "{off}");
        assert!(off.rotation.angle() < 5e-3, "{off}");
    }
    let ([first_seen, _], [last_seen, _]) = (palms[0], palms[palms.len() - 1]);
    assert!((first_seen.rotation.angle_to(&last_seen.rotation) - 0.1).abs() < 5e-3);
}

#[test]
fn motion_beyond_the_arm_is_rejected_with_a_reason() {
    let cell = start();
    let client = connect(&cell);
    let check = |change: fn(&mut JointTrack), code: RejectionCode, reason: &str| {
        let mut goal = carried();
        let PalmTrajectory::Arm(track) = &mut goal.carrier else {
            panic!("an arm was given");
        };
        change(track);
        let rejection = execute_by(&client, &goal, &joints_of(ARM))
            .rejection
            .unwrap();
        assert_eq!(rejection.code, code);
        assert!(rejection.reason.contains(reason), "{}", rejection.reason);
    };
    check(
        |arm| {
            arm.points[1].q_rad[1] = 2.2;
            arm.points[1].time_s = 5.0;
        },
        RejectionCode::Limits,
        "`joint2` would be at",
    );
    check(
        |arm| arm.points[1].rates.velocity[0] = 3.5,
        RejectionCode::Limits,
        "`joint1` would move at 3.5",
    );
    check(
        |arm| arm.joints[5] = "joint7".to_owned(),
        RejectionCode::Joints,
        "the arm has no joint `joint7`",
    );
    check(
        |arm| arm.points.truncate(1),
        RejectionCode::Times,
        "1 points of the arm",
    );
    let flying = Goal {
        carrier: goal(0.0).carrier,
        ..carried()
    };
    let rejection = execute_by(&client, &flying, &joints_of(ARM))
        .rejection
        .unwrap();
    assert_eq!(rejection.code, RejectionCode::Joints);
    assert!(
        rejection.reason.contains("has an arm"),
        "{}",
        rejection.reason
    );
    assert_eq!(cell.executed_count(), 0);
}
