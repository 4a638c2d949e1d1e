use motion::{MotionSpline, PalmTrajectory};
use proptest::{
    strategy::{Strategy, ValueTree},
    test_runner::TestRunner,
};
use robot::RobotModel;
use simulation::Protocol;
use spatial::{Base, Object, Palm, Pose, Table};

use super::*;
use crate::{
    ArmFault, ArmSetup, CommandRatesConfig, Infeasible, LimitsConfig, Planner, PlannerConfig,
    fixture::{MotionOnTable, protocol},
};

mod clear;
mod motions;
mod real;

use clear::Clear;
use motions::{JointPath, joint_paths, straight};
use palm_path::PalmPath;

const XARM: &str = include_str!("../../../../../data/robots/xarm6_allegro.urdf");
const HAND: &str = include_str!("../../../../../data/robots/allegro_right.urdf");
/// The rate at which the arm is commanded, in 1/s.
const RATE_HZ: f64 = 250.0;

fn config() -> ArmConfig {
    ArmConfig {
        robot: "xarm6_allegro.urdf".into(),
        palm: "base_link".to_owned(),
        table_from_base: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        object_m: [0.45, 0.0],
        turns: 1,
        velocity_scale: 1.0,
        acceleration_rad_per_s2: 20.0,
        clearance_m: 0.005,
        min_singular_value: 0.02,
    }
}

fn hand() -> RobotModel {
    RobotModel::from_urdf(HAND).unwrap()
}

fn arm(config: &ArmConfig) -> Arm {
    Arm::new(config, &RobotModel::from_urdf(XARM).unwrap(), &hand()).unwrap()
}

/// Returns the number of motions of the property tests.
fn cases() -> u32 {
    let cases = std::env::var("PIPELINE_CASES").ok();
    cases.and_then(|cases| cases.parse().ok()).unwrap_or(200)
}

fn follow<'a>(
    arm: &'a Arm,
    spline: &'a MotionSpline<Object>,
    drawn: &MotionOnTable,
    lift_m: f64,
) -> Result<ArmPath<'a>, Infeasible> {
    let fingers = |time_s: f64| spline.at(time_s).q_rad;
    arm.follow(spline, &drawn.table_from_object, fingers, lift_m)
}

/// With no links at all nothing would be near anything.
#[test]
fn links_are_those_of_all_joints_or_an_error() {
    let arm = arm(&config());
    let links = |arm_n: usize, hand_n: usize| arm.links(&vec![0.1; arm_n], &vec![0.2; hand_n]);
    assert_eq!(links(6, 16).unwrap().len(), arm.robot.links().len());
    for (arm_n, hand_n) in [(5, 16), (7, 16), (6, 0), (6, 17), (0, 0)] {
        links(arm_n, hand_n).unwrap_err();
    }
    // Nor is a pose of NaN clear.
    let mut links = links(6, 16).unwrap();
    links[3] = Pose::new(nalgebra::Isometry3::translation(f64::NAN, 0.0, 0.0));
    let links = clearance::LinkPoses {
        at: crate::PathPoint::Reach { time_s: 0.0 },
        base_from_links: links,
    };
    let up = nalgebra::Vector3::z();
    arm.clearance.check(&[links], &up, 1.0).unwrap_err();
}

fn spline_of(drawn: &MotionOnTable) -> Option<MotionSpline<Object>> {
    MotionSpline::through(drawn.motion().ok()?).ok()
}

fn refused(arm: &Arm, drawn: &MotionOnTable) -> Infeasible {
    let spline = spline_of(drawn).unwrap();
    follow(arm, &spline, drawn, 0.1).unwrap_err()
}

fn fault(arm: &Arm, drawn: &MotionOnTable) -> ArmFault {
    match refused(arm, drawn) {
        Infeasible::Arm { fault, .. } => fault,
        other => panic!("{other}"),
    }
}

/// Whether all joints of the arm are within their limits, but for rounding.
fn is_within_limits(arm: &Arm, q: &[f64]) -> bool {
    let within = |joint: &robot::Joint, q: f64| q >= joint.lower - 1e-9 && q <= joint.upper + 1e-9;
    let mut joints = arm.joints().iter().zip(q);
    q.len() == arm.joints().len() && joints.all(|(joint, &q)| within(joint, q))
}

/// Returns the requested pose of the palm in the frame of the arm's base.
fn requested(
    arm: &Arm,
    path: &ArmPath<'_>,
    spline: &MotionSpline<Object>,
    time_s: f64,
) -> Pose<Base, Palm> {
    let object_from_palm = spline.at(time_s).frame_from_palm;
    arm.base_from_table * path.table_from_object * object_from_palm
}

/// Meters or radians from one pose to another, whichever is more.
fn off(a: &Pose<Base, Palm>, b: &Pose<Base, Palm>) -> f64 {
    let distance = (a.translation.vector - b.translation.vector).norm();
    distance.max((a.rotation * b.rotation.inverse()).angle())
}

/// Checks a path at the arm's rate and, for collisions, at four times that.
fn check(arm: &Arm, path: &ArmPath<'_>, spline: &MotionSpline<Object>, lift_m: f64) {
    let palm = arm.robot.link("base_link").unwrap();
    let max_velocity: Vec<f64> = arm
        .limits()
        .iter()
        .map(|limits| limits.max_velocity)
        .collect();
    let clear = Clear::of(&arm.robot, arm.config.clearance_m - 1e-6);
    // As fast as the joints allow, but no faster than requested.
    let slower = (0..=1000)
        .map(|k| {
            path.at(spline.duration_s() * f64::from(k) / 1000.0)
                .unwrap()
        })
        .flat_map(|at| {
            let speeds = at.rates.velocity.into_iter().zip(&max_velocity);
            speeds.map(|(v, max)| v.abs() / max).collect::<Vec<_>>()
        })
        .fold(1.0, f64::max);
    let ticks = (spline.duration_s() * slower * RATE_HZ).ceil();
    let mut before: Option<Vec<f64>> = None;
    let mut tick = 0.0;
    while tick <= ticks {
        let time_s = (tick / RATE_HZ / slower).min(spline.duration_s());
        tick += 1.0;
        let now = path.at(time_s).unwrap();
        assert!(is_within_limits(arm, &now.q), "{:?}", now.q);
        let fingers = spline.at(time_s).q_rad;
        let links = arm.links(&now.q, &fingers).unwrap();
        let far = off(
            &links[palm].reinterpret(),
            &requested(arm, path, spline, time_s),
        );
        assert!(far < 1e-6, "{far} at {time_s} s");
        if let Some(before) = before {
            for ((before, now), max) in before.iter().zip(&now.q).zip(&max_velocity) {
                let step = (now - before).abs();
                // The greatest speed is that of a thousand points.
                assert!(step <= max / RATE_HZ * 1.001, "{step} rad at {time_s} s");
            }
        }
        before = Some(now.q);
        for part in 0..4 {
            let time_s = time_s + f64::from(part) / 4.0 / RATE_HZ;
            let q = path.at(time_s).unwrap().q;
            let fingers = spline.at(time_s).q_rad;
            clear.check(&arm.links(&q, &fingers).unwrap(), &arm.base_from_table);
        }
    }
    let grasp = spline.at(spline.duration_s());
    let end = path.at(spline.duration_s()).unwrap().q;
    let start = path.lifted(0.0).unwrap().q;
    assert!(end.iter().zip(&start).all(|(a, b)| (a - b).abs() < 1e-9));
    for part in 0..=200 {
        let height_m = lift_m * f64::from(part) / 200.0;
        let now = path.lifted(height_m).unwrap();
        assert!(is_within_limits(arm, &now.q));
        let links = arm.links(&now.q, &grasp.q_rad).unwrap();
        let up = nalgebra::Translation3::new(0.0, 0.0, height_m);
        let table_from_palm = Pose::new(up * *(path.table_from_object * grasp.frame_from_palm));
        assert!(
            off(
                &links[palm].reinterpret(),
                &(arm.base_from_table * table_from_palm)
            ) < 1e-6
        );
        clear.check(&links, &arm.base_from_table);
    }
}

/// Rates are the derivatives of positions.
fn check_rates(path: &ArmPath<'_>, spline: &MotionSpline<Object>, share: f64) {
    let h = 1e-4 * spline.duration_s();
    let time_s = (share * spline.duration_s()).clamp(2.0 * h, spline.duration_s() - 2.0 * h);
    let [before, now, after] = [-h, 0.0, h].map(|by| path.at(time_s + by).unwrap());
    for joint in 0..6 {
        let slope = (after.q[joint] - before.q[joint]) / (2.0 * h);
        let scale = 1.0 + now.rates.velocity[joint].abs() + now.rates.acceleration[joint].abs();
        assert!(
            (slope - now.rates.velocity[joint]).abs() < 1e-3 * scale,
            "{slope} {now:?}"
        );
        let bend = (after.rates.velocity[joint] - before.rates.velocity[joint]) / (2.0 * h);
        assert!(
            (bend - now.rates.acceleration[joint]).abs() < 2e-2 * scale,
            "{bend} {now:?}"
        );
    }
}

/// The arm can follow, and well, palm motions that come from motions of its own joints.
#[test]
fn arm_follows_reachable_motions() {
    let arm = arm(&config());
    let mut runner = TestRunner::deterministic();
    let mut followed = 0;
    for case in 0..cases() {
        let made = joint_paths().new_tree(&mut runner).unwrap().current();
        let (drawn, given) = made.motion(&arm);
        let spline = spline_of(&drawn).unwrap();
        match follow(&arm, &spline, &drawn, 0.05) {
            Ok(found) => {
                check(&arm, &found, &spline, 0.05);
                check_rates(&found, &spline, f64::from(case) / f64::from(cases()));
                followed += 1;
            }
            // The posture that made it is one of those tried: if it does well it must be taken.
            Err(Infeasible::Arm { fault, .. }) => {
                assert!(!given.is_clear, "{fault}");
                let is_blocking =
                    matches!(fault, ArmFault::Table { .. } | ArmFault::Collision { .. });
                assert!(is_blocking || !given.is_free || !given.can_grasp, "{fault}");
            }
            Err(other) => assert!(!given.is_free, "{other}"),
        }
    }
    println!("{followed} of {} motions followed", cases());
    assert!(followed > cases() / 4, "{followed}");
}

/// The quintic polynomials between two commanded points keep every limit, as the points do.
#[test]
fn commanded_arm_keeps_every_limit_between_points() {
    let protocol = Protocol {
        flexion_joints: vec!["joint_1.0".to_owned()],
        squeeze_rad: 0.1,
        limit_tolerance_rad: 0.1,
        ..protocol()
    };
    let limits = LimitsConfig {
        max_slowdown: 1e3,
        ..LimitsConfig::default()
    };
    let (config, hand) = (config(), hand());
    let robot = RobotModel::from_urdf(XARM).unwrap();
    let planner = Planner::new(&PlannerConfig {
        hand: &hand,
        arm: Some(ArmSetup {
            config: &config,
            robot: &robot,
        }),
        protocol: &protocol,
        limits: &limits,
        rates: CommandRatesConfig::default(),
    });
    let planner = planner.unwrap();
    let arm = arm(&config);
    let mut runner = TestRunner::deterministic();
    let (mut planned_n, mut max_share) = (0, 0.0_f64);
    for _ in 0..cases() / 4 {
        let made = joint_paths().new_tree(&mut runner).unwrap().current();
        let (drawn, _) = made.motion(&arm);
        let Ok(goal) = planner.plan(&drawn.motion().unwrap(), &drawn.table_from_object) else {
            continue;
        };
        planned_n += 1;
        let PalmTrajectory::Arm(track) = &goal.carrier else {
            panic!("an arm was given");
        };
        for pair in track.points.windows(2) {
            for look in 0..=20 {
                let length_s = pair[1].time_s - pair[0].time_s;
                let time_s = pair[0].time_s + length_s * f64::from(look) / 20.0;
                let now = track.at(time_s).unwrap();
                assert!(is_within_limits(&arm, &now.q_rad), "{:?}", now.q_rad);
                let moving = now.rates.velocity.iter().zip(&now.rates.acceleration);
                for ((velocity, acceleration), limits) in moving.zip(arm.limits()) {
                    let shares = [
                        velocity / limits.max_velocity,
                        acceleration / limits.max_acceleration,
                    ];
                    let share = shares.map(f64::abs).into_iter().fold(0.0, f64::max);
                    assert!(
                        share <= 1.0 + 1e-6,
                        "{shares:?} of the limits at {time_s} s"
                    );
                    max_share = max_share.max(share);
                }
            }
        }
    }
    println!("{planned_n} motions planned, at most {max_share} of a limit");
    assert!(planned_n > cases() / 40 && max_share > 0.98);
}

/// With twelve turns the arm follows wherever it can with one, in no more time.
#[test]
fn more_yaw_angles_never_lose_a_motion() {
    let mut runner = TestRunner::deterministic();
    let mut followed = [0, 0];
    for _ in 0..40 {
        let made = joint_paths().new_tree(&mut runner).unwrap().current();
        let one = arm(&config());
        let twelve = arm(&ArmConfig {
            turns: 12,
            ..config()
        });
        let (drawn, _) = made.motion(&one);
        let spline = spline_of(&drawn).unwrap();
        let can = [&one, &twelve].map(|arm| follow(arm, &spline, &drawn, 0.05).is_ok());
        assert!(can[1] || !can[0]);
        for (n, can) in followed.iter_mut().zip(can) {
            *n += usize::from(can);
        }
    }
    assert!(followed[1] > followed[0], "{followed:?}");
}

#[test]
fn the_object_is_turned_about_the_vertical_where_it_stands() {
    let arm = arm(&ArmConfig {
        turns: 8,
        object_m: [0.3, 0.2],
        ..config()
    });
    let drawn = straight([0.0, 0.0, 0.5], [0.0, 0.0, 0.3], [0.3, -0.1, 0.04]);
    let spline = spline_of(&drawn).unwrap();
    let path = follow(&arm, &spline, &drawn, 0.1).unwrap();
    let found = path.table_from_object;
    let place = found.translation.vector;
    assert!(
        (place - nalgebra::Vector3::new(0.3, 0.2, 0.04)).norm() < 1e-12,
        "{place}"
    );
    let turn = found.rotation * drawn.table_from_object.rotation.inverse();
    let [x, y, z] = <[f64; 3]>::from(turn.scaled_axis());
    assert!(x.abs() < 1e-12 && y.abs() < 1e-12);
    let eighths = z / (std::f64::consts::TAU / 8.0);
    assert!((eighths - eighths.round()).abs() < 1e-9, "{eighths}");
    check(&arm, &path, &spline, 0.1);
}

/// Moving the base on the table moves the arm, and changes nothing else.
#[test]
fn the_table_may_be_anywhere_about_the_base() {
    let drawn = straight([0.0, 0.0, 0.5], [0.0, 0.0, 0.3], [0.0, 0.0, 0.04]);
    let spline = spline_of(&drawn).unwrap();
    let (sin, cos) = 0.4_f64.sin_cos();
    let here = arm(&config());
    let there = arm(&ArmConfig {
        table_from_base: [-0.55, 0.1, 0.0, 0.0, 0.0, 0.4_f64.sin(), 0.4_f64.cos()],
        object_m: [
            -0.55 + 0.45 * (cos * cos - sin * sin),
            0.1 + 0.45 * 2.0 * sin * cos,
        ],
        ..config()
    });
    // The object is turned with the base.
    let turned = MotionOnTable {
        table_from_object: Pose::<Table, Object>::new(
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::z_axis(), 0.8)
                * *drawn.table_from_object,
        ),
        ..drawn.clone()
    };
    let found = follow(&here, &spline, &drawn, 0.1).unwrap();
    let other = follow(&there, &spline, &turned, 0.1).unwrap();
    for share in [0.0, 0.3, 1.0] {
        let [a, b] = [&found, &other].map(|path| path.at(share * spline.duration_s()).unwrap());
        for (a, b) in a.q.iter().zip(&b.q) {
            assert!((a - b).abs() < 1e-8, "{a} {b}");
        }
    }
}

#[test]
fn a_grasp_beyond_reach_is_refused() {
    let arm = arm(&ArmConfig {
        object_m: [0.9, 0.0],
        turns: 4,
        ..config()
    });
    let drawn = straight([-0.3, 0.0, 0.5], [0.0, 0.0, 0.3], [0.0, 0.0, 0.04]);
    assert_eq!(
        refused(&arm, &drawn).to_string(),
        "grasp unreachable: no inverse kinematics solution for the palm at (0.900, 0.000, 0.340) m \
         (base frame), at any of 4 object yaws"
    );
}

#[test]
fn a_path_that_begins_beyond_reach_is_refused() {
    let drawn = straight([0.6, 0.0, 0.5], [0.0, 0.0, 0.3], [0.0, 0.0, 0.04]);
    let found = fault(&arm(&config()), &drawn);
    // An arm that is stretched out is singular.
    assert!(
        matches!(found, ArmFault::Singular { .. } | ArmFault::Limit { .. }),
        "{found}"
    );
}

#[test]
fn an_arm_in_the_table_is_refused() {
    // The fingers level above the table, but the wrist, as thick as the hand is wide, is in it.
    let drawn = motions::level([0.0, 0.0, 0.05], [0.1, 0.0, 0.05]);
    let found = fault(&arm(&config()), &drawn);
    let ArmFault::Table { link, gap_m, .. } = found else {
        panic!("{found}");
    };
    assert!(link.starts_with("link"), "{link}");
    assert!(gap_m < 0.005, "{gap_m}");
}

#[test]
fn a_path_through_the_arms_own_base_is_refused() {
    // Down beside the arm's first joint, so near that the hand meets the base.
    let arm = arm(&ArmConfig {
        turns: 1,
        ..config()
    });
    let drawn = straight([-0.33, 0.0, 0.45], [-0.33, 0.0, 0.2], [0.0, 0.0, 0.04]);
    let found = fault(&arm, &drawn);
    assert!(matches!(found, ArmFault::Collision { .. }), "{found}");
    assert!(found.to_string().contains("link"), "{found}");
}

#[test]
fn a_wrist_that_would_turn_too_far_is_refused() {
    let drawn = motions::wound(2.5);
    let found = fault(&arm(&config()), &drawn);
    let ArmFault::Limit { joint, lower, .. } = found else {
        panic!("{found}");
    };
    assert_eq!(joint, "joint6");
    assert!((lower + std::f64::consts::TAU).abs() < 1e-6, "{lower}");
    // Less than two turns are within its limits.
    let drawn = motions::wound(1.8);
    let spline = spline_of(&drawn).unwrap();
    // It turns so fast that from one point to the next the thumb moves farther than it keeps away.
    let arm = arm(&ArmConfig {
        clearance_m: 0.001,
        ..config()
    });
    let path = follow(&arm, &spline, &drawn, 0.1).unwrap();
    check(&arm, &path, &spline, 0.1);
}

#[test]
fn another_hand_on_the_arm_is_refused() {
    let other = |urdf: &str, hand: &str| {
        let [robot, hand] = [urdf, hand].map(|urdf| RobotModel::from_urdf(urdf).unwrap());
        Arm::new(&config(), &robot, &hand).unwrap_err().to_string()
    };
    let message = other(XARM, &HAND.replace("joint_3.0", "joint_3.1"));
    assert!(message.contains("no joint `joint_3.1`"), "{message}");
    let message = other(
        XARM,
        &HAND.replace("xyz=\"0 0 0.0384\"", "xyz=\"0 0 0.0385\""),
    );
    assert!(
        message.contains("1.0e-4 (m or rad) from where"),
        "{message}"
    );
    let finger = XARM.replace(
        "</robot>",
        r#"<link name="x"/><joint name="extra" type="continuous"><parent link="link6"/>
           <child link="x"/></joint></robot>"#,
    );
    let message = other(&finger, HAND);
    assert!(message.contains("`extra` is neither"), "{message}");
}

#[test]
fn invalid_arms_are_refused() {
    let message = |change: fn(&mut ArmConfig)| {
        let mut config = config();
        change(&mut config);
        let robot = RobotModel::from_urdf(XARM).unwrap();
        Arm::new(&config, &robot, &hand()).unwrap_err().to_string()
    };
    assert!(message(|c| c.palm = "plam".to_owned()).contains("`arm.palm`"));
    assert!(message(|c| c.palm = "link5".to_owned()).contains("5 joints lead"));
    assert!(message(|c| c.turns = 0).contains("`arm.turns`"));
    assert!(message(|c| c.clearance_m = f64::NAN).contains("`arm.clearance_m`"));
    assert!(message(|c| c.velocity_scale = 1.5).contains("`arm.velocity_scale`"));
    assert!(message(|c| c.min_singular_value = 0.0).contains("`arm.min_singular_value`"));
    assert!(message(|c| c.acceleration_rad_per_s2 = -1.0).contains("acceleration"));
    assert!(message(|c| c.table_from_base[6] = 3.0).contains("`arm.table_from_base`"));
    assert!(message(|c| c.object_m[0] = f64::INFINITY).contains("`arm.object_m`"));
}

#[test]
fn neighbors_alone_may_touch() {
    let arm = arm(&config());
    let pairs = arm.clearance.names();
    let is_checked = |a: &str, b: &str| pairs.iter().any(|[x, y]| x == a && y == b);
    for a in ["link_base", "link1", "link2", "link3", "link4"] {
        for b in ["base_link", "link_3.0", "link_15.0_tip", "link6"] {
            assert!(is_checked(a, b), "{a} {b}");
        }
    }
    assert!(is_checked("link2", "link5") && is_checked("link1", "link4"));
    assert!(is_checked("link_base", "link3"));
    assert!(!is_checked("link2", "link3") && !is_checked("link6", "base_link"));
}

#[test]
fn speeds_are_those_of_the_urdf_or_less() {
    let arm = arm(&ArmConfig {
        velocity_scale: 0.5,
        ..config()
    });
    assert_eq!(
        arm.joint_names(),
        ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]
    );
    let limits = MotionLimits {
        max_velocity: 1.57,
        max_acceleration: 20.0,
    };
    assert_eq!(arm.limits(), [limits; 6]);
}

#[test]
fn joint_path_rates_are_its_derivatives() {
    // The generator's own rates, by differences.
    let mut runner = TestRunner::deterministic();
    let path: JointPath = joint_paths().new_tree(&mut runner).unwrap().current();
    let arm = arm(&config());
    let (drawn, _) = path.motion(&arm);
    let spline = spline_of(&drawn).unwrap();
    for share in [0.2, 0.77] {
        let time_s = share * spline.duration_s();
        let expected = arm.chain.state(&path.q(time_s)).unwrap().base_from_palm;
        let palm_path = PalmPath::new(&arm, &spline, &drawn.table_from_object, 0.0);
        let found = palm_path.at(crate::PathPoint::Reach { time_s });
        assert!(off(&found.base_from_palm, &expected) < 1e-5);
    }
}
