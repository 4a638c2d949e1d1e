use nalgebra::Isometry3;
use proptest::prelude::*;

use motion::{HandRates, JointRates, PalmPoint, Step};
use simulation::{ProtocolName, Trial};
use spatial::{Object, Palm, Pose, Table, Twist};

use super::*;
use crate::fixture::{MotionOnTable, protocol, swings::motions};

/// A hand with three joints, whose palm is a ball.
const HAND: &str = r#"<robot name="hand">
  <link name="palm"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="a"/><link name="b"/><link name="c"/>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/></joint>
  <joint name="jb" type="revolute"><parent link="palm"/><child link="b"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="7"/></joint>
  <joint name="jc" type="prismatic"><parent link="palm"/><child link="c"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="0.5"/></joint>
</robot>"#;
const JOINTS: [&str; 3] = ["ja", "jb", "jc"];

fn hand() -> RobotModel {
    RobotModel::from_urdf(HAND).unwrap()
}

/// Configuration of a planner.
struct Config {
    grasp: Protocol,
    limits: LimitsConfig,
    rates: CommandRatesConfig,
}

impl Config {
    fn planner_config<'a>(&'a self, hand: &'a RobotModel) -> PlannerConfig<'a> {
        PlannerConfig {
            hand,
            arm: None,
            protocol: &self.grasp,
            limits: &self.limits,
            rates: self.rates,
        }
    }
}

fn config(approach: Approach) -> Config {
    Config {
        grasp: Protocol {
            flexion_joints: vec!["ja".to_owned(), "jc".to_owned()],
            approach,
            ..protocol()
        },
        limits: LimitsConfig {
            max_slowdown: 1e3,
            ..LimitsConfig::default()
        },
        rates: CommandRatesConfig::default(),
    }
}

/// So high that no table matters.
fn high() -> Pose<Table, Object> {
    Pose::new(Isometry3::translation(0.0, 0.0, 5.0))
}

fn plan(config: &Config, given: &MotionOnTable) -> Result<PlannedMotion, Infeasible> {
    let hand = hand();
    let planner = Planner::new(&config.planner_config(&hand)).unwrap();
    planner.plan(&given.motion()?, &given.table_from_object)
}

/// Plans a motion of an object that lies [`high`].
fn plan_high(config: &Config, motion: &Motion<Object>) -> PlannedMotion {
    let hand = hand();
    let planner = Planner::new(&config.planner_config(&hand)).unwrap();
    planner.plan(motion, &high()).unwrap()
}

fn palm_of(planned: &PlannedMotion) -> &[PalmPoint] {
    match &planned.carrier {
        PalmTrajectory::Palm(points) => points,
        PalmTrajectory::Arm(_) => panic!("no arm was given"),
    }
}

/// Returns the hand, in the object's frame, that a plan commands at a time.
fn followed(planned: &PlannedMotion, table_from_object: &Pose<Table, Object>, time_s: f64) -> Hand {
    let table_from_palm = PalmPoint::between(palm_of(planned), time_s).unwrap();
    let q = planned.fingers.at(time_s).unwrap().q_rad;
    (table_from_object.inv_mul(&table_from_palm), q)
}

/// Pose of the palm and the joints' positions.
type Hand = (Pose<Object, Palm>, Vec<f64>);

/// Largest difference of two hands, where 1 is 1 mm, half a degree, or half a degree of a joint (or 1 mm
/// where it slides).
fn off(a: &Hand, b: &Hand) -> f64 {
    let degree = 0.5_f64.to_radians();
    let joints = a.1.iter().zip(&b.1).zip([degree, degree, 1e-3]);
    let joints = joints.map(|((a, b), unit)| (a - b).abs() / unit);
    let distance = (a.0.translation.vector - b.0.translation.vector).norm() / 1e-3;
    let turn = a.0.rotation.angle_to(&b.0.rotation) / degree;
    joints.fold(distance.max(turn), f64::max)
}

/// Points with the first and the last doubled, and the period between two.
fn with_rest<T: Clone>(points: &[T], time_s: impl Fn(&T) -> f64) -> (Vec<T>, f64) {
    let mut all = vec![points[0].clone()];
    all.extend(points.iter().cloned());
    all.push(points[points.len() - 1].clone());
    (all, time_s(&points[1]) - time_s(&points[0]))
}

/// Returns the least of a distance along a curve, which is gone along from 0 to 1: in coarse steps, then
/// in fine ones about the least of those.
fn nearest(distance: impl Fn(f64) -> f64) -> f64 {
    const COARSE: f64 = 1e-3;
    let coarse = (0..=1000).map(|k| f64::from(k) * COARSE);
    let at = coarse.min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let fine = (-400..=400).map(|k| at.unwrap() + f64::from(k) * COARSE / 400.0);
    let fine = fine.map(|share| distance(share.clamp(0.0, 1.0)));
    fine.fold(f64::INFINITY, f64::min)
}

/// Moments between two points that are looked at.
const LOOKS: u32 = 20;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    /// The commands, period by period, keep every limit, from rest to rest.
    #[test]
    fn every_limit_holds_at_the_rate(
        motion in motions(&JOINTS),
        rate_hz in 80.0..500.0_f64,
        max in (0.2..2.0_f64, 1.0..15.0_f64, 0.5..5.0_f64, 3.0..30.0_f64, 5.0..100.0_f64),
        open in any::<bool>(),
    ) {
        let approach = if open { Approach::Open } else { Approach::Follow };
        let mut config = config(approach);
        config.rates = CommandRatesConfig { palm_hz: rate_hz, hand_hz: 1.3 * rate_hz };
        config.grasp.open_rad = 0.3;
        config.grasp.squeeze_rad = 0.2;
        config.grasp.lift_m = 0.15;
        let limits = &mut config.limits;
        limits.palm_speed_m_per_s = max.0;
        limits.palm_acceleration_m_per_s2 = max.1;
        limits.palm_turn_rad_per_s = max.2;
        limits.palm_turn_acceleration_rad_per_s2 = max.3;
        limits.joint_acceleration_rad_per_s2 = max.4;
        let planned = plan_high(&config, &motion);
        let slack = 1.0 + 1e-6;
        // The commanded points.
        for point in palm_of(&planned) {
            prop_assert!(point.velocity.linear.norm() <= max.0 * slack);
            prop_assert!(point.acceleration.linear.norm() <= max.1 * slack);
            prop_assert!(point.velocity.angular.norm() <= max.2 * slack);
            prop_assert!(point.acceleration.angular.norm() <= max.3 * slack);
        }
        let speeds = [2.0, 7.0, 0.5];
        for point in &planned.fingers.points {
            for (velocity, limit) in point.rates.velocity.iter().zip(speeds) {
                prop_assert!(velocity.abs() <= limit * slack);
            }
            for acceleration in &point.rates.acceleration {
                prop_assert!(acceleration.abs() <= max.4 * slack);
            }
        }
        // The quintic polynomials between two points.
        for pair in palm_of(&planned).windows(2) {
            let segment = pair[0].segment(&pair[1]).unwrap();
            for look in 1..=LOOKS {
                let share = f64::from(look) / f64::from(LOOKS + 1);
                let now = segment.at(share * (pair[1].time_s - pair[0].time_s));
                prop_assert!(now.velocity.linear.norm() <= max.0 * slack);
                prop_assert!(now.acceleration.linear.norm() <= max.1 * slack);
                prop_assert!(now.velocity.angular.norm() <= max.2 * slack);
                prop_assert!(now.acceleration.angular.norm() <= max.3 * slack);
            }
        }
        let limits = hand();
        for pair in planned.fingers.points.windows(2) {
            for look in 1..=LOOKS {
                let share = f64::from(look) / f64::from(LOOKS + 1);
                let time_s = pair[0].time_s + share * (pair[1].time_s - pair[0].time_s);
                let now = planned.fingers.at(time_s).unwrap();
                for (j, speed) in speeds.into_iter().enumerate() {
                    prop_assert!(now.rates.velocity[j].abs() <= speed * slack);
                    prop_assert!(now.rates.acceleration[j].abs() <= max.4 * slack);
                    let (joint, q) = (&limits.joints()[j], now.q_rad[j]);
                    let tolerance = config.grasp.limit_tolerance_rad + 1e-6;
                    prop_assert!(q >= joint.lower - tolerance && q <= joint.upper + tolerance);
                }
            }
        }
        // Differences of positions, with rest before and after.
        let (all, dt) = with_rest(palm_of(&planned), |point| point.time_s);
        prop_assert!(dt >= 1.0 / rate_hz * (1.0 - 1e-6));
        let palm = |k: usize| *all[k].table_from_palm;
        let spin = |k: usize| (palm(k + 1).rotation * palm(k).rotation.inverse()).scaled_axis() / dt;
        let place = |k: usize| palm(k).translation.vector;
        for k in 1..all.len() - 1 {
            let speed = (place(k + 1) - place(k)).norm() / dt;
            prop_assert!(speed <= max.0 * slack, "palm {speed} m/s");
            let bend = (place(k + 1) - 2.0 * place(k) + place(k - 1)).norm() / dt / dt;
            prop_assert!(bend <= max.1 * slack, "palm {bend} m/s²");
            prop_assert!(spin(k).norm() <= max.2 * slack);
            prop_assert!((spin(k) - spin(k - 1)).norm() / dt <= max.3 * slack);
        }
        let (all, dt) = with_rest(&planned.fingers.points, |point| point.time_s);
        for k in 1..all.len() - 1 {
            for (j, velocity) in speeds.into_iter().enumerate() {
                let q = |k: usize| all[k].q_rad[j];
                prop_assert!((q(k + 1) - q(k)).abs() / dt <= velocity * slack);
                let bend = (q(k + 1) - 2.0 * q(k) + q(k - 1)).abs() / dt / dt;
                prop_assert!(bend <= max.4 * slack, "joint {j}: {bend}");
            }
        }
        for times in [
            planned.fingers.points.iter().map(|p| p.time_s).collect::<Vec<_>>(),
            palm_of(&planned).iter().map(|p| p.time_s).collect(),
        ] {
            prop_assert!(times[0] == 0.0 && times.windows(2).all(|pair| pair[1] > pair[0]));
        }
    }

    /// Commanded rates are derivatives of the commanded positions.
    #[test]
    fn the_rates_of_a_goal_are_its_derivatives(
        motion in motions(&JOINTS),
        place in any::<prop::sample::Index>(),
    ) {
        let mut config = config(Approach::Follow);
        config.rates = CommandRatesConfig { palm_hz: 2000.0, hand_hz: 2000.0 };
        config.grasp.squeeze_rad = 0.2;
        let planned = plan_high(&config, &motion);
        let palm = palm_of(&planned);
        let at = place.index(palm.len() - 2) + 1;
        let [before, now, after] = [at - 1, at, at + 1].map(|k| &palm[k]);
        let dt = after.time_s - before.time_s;
        let [a, b] = [before, after].map(|p| *p.table_from_palm);
        let speed = (b.translation.vector - a.translation.vector) / dt;
        prop_assert!((speed - now.velocity.linear).norm() < 0.01);
        let spin = (b.rotation * a.rotation.inverse()).scaled_axis() / dt;
        prop_assert!((spin - now.velocity.angular).norm() < 0.02);
        let hand = &planned.fingers.points;
        let at = place.index(hand.len() - 2) + 1;
        let [before, now, after] = [at - 1, at, at + 1].map(|k| &hand[k]);
        let dt = after.time_s - before.time_s;
        for j in 0..3 {
            let speed = (after.q_rad[j] - before.q_rad[j]) / dt;
            prop_assert!((speed - now.rates.velocity[j]).abs() < 0.05);
        }
    }

    /// As a curve the goal is the motion: each is within 1 mm and half a degree of the other, wherever
    /// one is along it.
    #[test]
    fn the_goal_stays_on_the_course(motion in motions(&JOINTS), share in 0.0..=1.0_f64) {
        let config = config(Approach::Follow);
        let planned = plan_high(&config, &motion);
        let object = high();
        let end_s = planned.grasp.reach_s;
        let followed = |time_s: f64| followed(&planned, &object, time_s);
        let spline = MotionSpline::through(motion).unwrap();
        let laid = |share: f64| {
            let hand = spline.at(share * spline.duration_s());
            (hand.frame_from_palm, hand.q_rad)
        };
        let there = laid(share);
        let far = nearest(|share| off(&there, &followed(share * end_s)));
        prop_assert!(far <= 1.0, "the spline is {far} off the goal");
        let there = followed(share * end_s);
        let far = nearest(|share| off(&there, &laid(share)));
        prop_assert!(far <= 1.0, "the goal is {far} off the spline");
        prop_assert!(off(&laid(0.0), &followed(0.0)) < 1e-6);
        // The path ends between two points, on the polynomial between them.
        prop_assert!(off(&laid(1.0), &followed(end_s)) < 0.05);
    }

    /// Limits that no motion reaches leave it as it was screened, but for rest at its ends.
    #[test]
    fn motions_within_limits_keep_their_duration(motion in motions(&JOINTS)) {
        let mut config = config(Approach::Follow);
        let limits = &mut config.limits;
        limits.joint_velocity_rad_per_s = Some(1e6);
        limits.palm_speed_m_per_s = 1e6;
        limits.palm_turn_rad_per_s = 1e6;
        limits.palm_acceleration_m_per_s2 = 1e9;
        limits.palm_turn_acceleration_rad_per_s2 = 1e9;
        limits.joint_acceleration_rad_per_s2 = 1e9;
        let planned = plan_high(&config, &motion);
        // The accelerations at both ends are spread over four periods.
        let path_s = planned.grasp.reach_s - 4.0 / config.rates.palm_hz;
        let slower = path_s / config.grasp.reach_s;
        prop_assert!((1.0..1.02).contains(&slower), "{slower}");
    }
}

/// Returns the number of random motions to try, 96 unless `PIPELINE_CASES` sets another.
fn cases() -> u32 {
    let cases = std::env::var("PIPELINE_CASES").ok();
    cases.and_then(|n| n.parse().ok()).unwrap_or(96)
}

/// A palm that goes 0.3 m straight down in 1 s at one speed, while the fingers rest.
fn straight() -> MotionOnTable {
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, 0.3 - 0.3 * time_s)),
        q_rad: vec![0.5, 0.0, 0.0],
        rates: HandRates {
            palm_velocity: Twist::from_array([0.0, 0.0, -0.3, 0.0, 0.0, 0.0]),
            ..HandRates::zero(3)
        },
    };
    MotionOnTable {
        joints: hand().joint_names(),
        steps: (0..=10).map(|k| step(f64::from(k) / 10.0)).collect(),
        table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 0.1)),
    }
}

#[test]
fn straight_path_takes_the_time_of_a_trapezoidal_profile() {
    let mut config = config(Approach::Follow);
    config.grasp.reach_s = 0.3;
    for (speed, acceleration) in [(0.5, 2.0), (10.0, 4.0), (0.5, 1e3)] {
        config.limits.palm_speed_m_per_s = speed;
        config.limits.palm_acceleration_m_per_s2 = acceleration;
        let planned = plan(&config, &straight()).unwrap();
        // The path at 1 m/s would take the requested 0.3 s.
        let speed = f64::min(speed, 1.0);
        let expected_s = if speed * speed / acceleration < 0.3 {
            0.3 / speed + speed / acceleration
        } else {
            2.0 * f64::sqrt(0.3 / acceleration)
        };
        // Its corners are spread over four periods.
        let found_s = planned.grasp.reach_s;
        let off = (found_s - 4.0 / config.rates.palm_hz) / expected_s - 1.0;
        assert!((-1e-9..0.01).contains(&off), "{found_s} for {expected_s}");
        let [before, now] = [found_s - 0.02, found_s].map(|time_s| {
            let there = PalmPoint::between(palm_of(&planned), time_s).unwrap();
            there.translation.z
        });
        assert!(before > now + 1e-5 && (now - 0.1).abs() < 1e-6 * acceleration);
    }
}

#[test]
fn a_protocol_that_no_cell_can_execute_is_refused() {
    type Change = fn(&mut Protocol);
    let changes: [(&str, Change); 3] = [
        ("protocol.name", |grasp| grasp.name = ProtocolName::Dro),
        ("protocol.approach", |grasp| {
            grasp.approach = Approach::AtGrasp;
        }),
        ("protocol.trial", |grasp| grasp.trial = Trial::SixDirections),
    ];
    for (key, change) in changes {
        let mut config = config(Approach::Follow);
        change(&mut config.grasp);
        let fault = Planner::new(&config.planner_config(&hand())).err().unwrap();
        assert_eq!(fault.key, key);
    }
}

#[test]
fn a_protocol_that_opens_keeps_its_closing_time() {
    let mut config = config(Approach::Open);
    config.grasp.open_rad = 0.02;
    config.limits.palm_speed_m_per_s = 0.2;
    let planned = plan(&config, &straight()).unwrap().grasp;
    let closing_s = |protocol: &Protocol| protocol.reach_s * protocol.close_fraction;
    config.limits.joint_acceleration_rad_per_s2 = 1e6;
    assert!((closing_s(&planned) - closing_s(&config.grasp)).abs() < 1e-9);
    assert!(planned.reach_s > 1.5 + closing_s(&planned));
    // 0.2 m of the slide, at its 0.5 m/s halfway.
    config.grasp.open_rad = 0.2;
    let planned = plan(&config, &straight()).unwrap().grasp;
    assert!((closing_s(&planned) - 0.75).abs() < 1e-6);
}

#[test]
fn ramps_keep_the_limits() {
    let mut config = config(Approach::Follow);
    config.grasp.squeeze_rad = 0.2;
    config.grasp.lift_m = 0.15;
    config.limits.palm_speed_m_per_s = 0.1;
    let planned = plan(&config, &straight()).unwrap().grasp;
    assert!((planned.squeeze_s - 0.75).abs() < 1e-6);
    assert!((planned.lift_s - 2.8125).abs() < 1e-6);
    config.limits.palm_speed_m_per_s = 10.0;
    config.limits.palm_acceleration_m_per_s2 = 0.15 * 10.0 / 3.0_f64.sqrt();
    let planned = plan(&config, &straight()).unwrap().grasp;
    assert!((planned.lift_s - 1.0).abs() < 1e-6);
}

#[test]
fn infeasible_motions_name_their_reason() {
    let refused = |change: &dyn Fn(&mut Config, &mut MotionOnTable)| {
        let (mut config, mut given) = (config(Approach::Follow), straight());
        change(&mut config, &mut given);
        plan(&config, &given).unwrap_err().to_string()
    };
    assert!(plan(&config(Approach::Follow), &straight()).is_ok());
    let short = refused(&|_, given| given.steps.truncate(1));
    assert!(short.contains("expected at least 2"), "{short}");
    let strange = refused(&|_, given| given.joints[1] = "jx".to_owned());
    assert!(strange.contains("`jx`"), "{strange}");
    let twice = refused(&|_, given| given.joints[2] = "ja".to_owned());
    assert!(twice.contains("`ja`"), "{twice}");
    let missing = refused(&|_, given| {
        given.joints.truncate(2);
        for step in &mut given.steps {
            step.q_rad.truncate(2);
            step.rates.joints = JointRates::zero(2);
        }
    });
    assert!(missing.contains("`jc`"), "{missing}");
    let limit = refused(&|_, given| given.steps[4].q_rad[2] = 3.5);
    assert!(limit.contains("`jc`"), "{limit}");
    // The palm's ball of 0.05 m ends 0.06 m above the table less what the object sinks.
    let table = refused(&|_, given| {
        given.table_from_object = Pose::new(Isometry3::translation(0.0, 0.0, 0.04));
    });
    assert!(table.starts_with("link `palm` would be"), "{table}");
    let slow = refused(&|config, _| {
        config.limits.palm_speed_m_per_s = 0.01;
        config.limits.max_slowdown = 5.0;
    });
    assert!(slow.contains("max_slowdown"), "{slow}");
}

#[test]
fn joints_come_in_the_hands_order() {
    let mut given = straight();
    given.joints.rotate_left(1);
    for step in &mut given.steps {
        step.q_rad.rotate_left(1);
        step.rates.joints.velocity.rotate_left(1);
        step.rates.joints.acceleration.rotate_left(1);
    }
    let config = config(Approach::Follow);
    assert_eq!(
        plan(&config, &given).unwrap(),
        plan(&config, &straight()).unwrap()
    );
}

#[test]
fn invalid_limits_are_named() {
    let refused = |change: fn(&mut Config)| {
        let mut config = config(Approach::Follow);
        change(&mut config);
        let planner = Planner::new(&config.planner_config(&hand())).map(drop);
        planner.unwrap_err().to_string()
    };
    let named = |text: &str, key: &str| assert!(text.contains(key), "{text}");
    named(
        &refused(|c| c.limits.palm_speed_m_per_s = 0.0),
        "limits.palm_speed_m_per_s",
    );
    named(
        &refused(|c| c.limits.joint_acceleration_rad_per_s2 = f64::NAN),
        "limits.joint_acceleration_rad_per_s2",
    );
    named(
        &refused(|c| c.limits.max_slowdown = 0.5),
        "limits.max_slowdown",
    );
    named(
        &refused(|c| c.grasp.flexion_joints = vec!["jq".to_owned()]),
        "protocol.flexion_joints",
    );
    named(&refused(|c| c.grasp.reach_s = 0.0), "protocol.reach_s");
    let silent = RobotModel::from_urdf(&HAND.replace("velocity=\"7\"", "velocity=\"0\"")).unwrap();
    let config = config(Approach::Follow);
    let err = Planner::new(&config.planner_config(&silent)).map(drop);
    named(&err.unwrap_err().to_string(), "`jb`");
}

/// Motions of the Allegro hand from a table of candidates, e.g.
/// `PIPELINE_CANDIDATES=data/lake/tables/candidates/pipeline=cgf/stage=sample/object=025_mug`: the goal of
/// each stays on the screen's straight lines between its steps.
#[test]
fn candidates_of_a_lake_stay_where_they_were_screened() {
    let Some(folder) = measured_data::named_by("PIPELINE_CANDIDATES") else {
        return;
    };
    let file = folder.join(lake::table::FILE);
    let artifact = dataflow::Artifact {
        key: "object".parse().unwrap(),
        labels: std::collections::BTreeMap::new(),
        files: [(lake::table::FILE.to_owned(), file)].into(),
    };
    let given: schemas::candidates::Candidates = lake::table::read(&artifact).unwrap();
    let urdf = include_str!("../../../../../data/robots/allegro_right.urdf");
    let hand = RobotModel::from_urdf(urdf).unwrap();
    for approach in [Approach::Follow, Approach::Open] {
        let mut config = config(approach);
        config.grasp.flexion_joints = vec!["joint_1.0".to_owned()];
        config.grasp.reach_s = 0.8;
        config.grasp.close_fraction = 0.25;
        config.grasp.limit_tolerance_rad = 0.1;
        config.grasp.table_tolerance_m = 0.01;
        let planner = Planner::new(&config.planner_config(&hand)).unwrap();
        let (mut made_n, mut farthest, mut slowest) = (0, [0.0_f64; 3], 0.0_f64);
        for candidate in &given.candidates {
            let screened = &candidate.motion;
            let sent = match planner.plan(screened, &candidate.table_from_object) {
                Ok(sent) => sent,
                Err(reason) => {
                    eprintln!("{}: {reason}", candidate.candidate_id);
                    continue;
                }
            };
            made_n += 1;
            slowest = slowest.max(sent.grasp.reach_s / config.grasp.reach_s);
            let object = candidate.table_from_object;
            let path_s = sent.grasp.path_s();
            for tick in 0..=30 {
                let (there, commanded) = followed(&sent, &object, path_s * f64::from(tick) / 30.0);
                let apart = |share: f64| {
                    let step = screened.at_fraction(share);
                    let pose = step.frame_from_palm;
                    let joints = step
                        .q_rad
                        .iter()
                        .zip(&commanded)
                        .map(|(a, b)| (a - b).abs());
                    [
                        (pose.translation.vector - there.translation.vector).norm(),
                        pose.rotation.angle_to(&there.rotation),
                        // They are open in the reach.
                        if approach == Approach::Open {
                            0.0
                        } else {
                            joints.fold(0.0, f64::max)
                        },
                    ]
                };
                let worst = |[distance, turn, joint]: [f64; 3]| {
                    (distance / 1e-3).max(turn.max(joint) / 0.5_f64.to_radians())
                };
                let near = (0..=4000).map(|k| apart(f64::from(k) / 4000.0));
                let near = near.min_by(|&a, &b| worst(a).total_cmp(&worst(b))).unwrap();
                for (farthest, near) in farthest.iter_mut().zip(near) {
                    *farthest = farthest.max(near);
                }
            }
        }
        let [distance, turn, joint] = farthest;
        eprintln!(
            "{approach:?}: {made_n} of {} can be made, the slowest takes {slowest:.3} times as long; at most {:.3} mm, {:.3} degrees and {:.3} degrees of a joint from where it was screened",
            given.candidates.len(),
            1e3 * distance,
            turn.to_degrees(),
            joint.to_degrees()
        );
        assert!(made_n > 0);
        assert!(distance < 1e-3 && turn.max(joint) < 0.5_f64.to_radians());
    }
}
