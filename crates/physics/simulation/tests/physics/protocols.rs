//! Protocols by name, each on a case that is worked out by hand: a cube between two plates on springs, with
//! sides of 5 cm. A plate that is commanded by `d` into the cube presses with its stiffness times `d`.

use motion::{Motion, Step};
use nalgebra::Isometry3;
use robot::RobotModel;
use simulation::{
    Approach, DriveConfig, KnockedUntil, PalmComplianceConfig, Protocol, ProtocolName, Rollout,
    SceneConfig, SettledScene, Support, TraceMode, Trial, Verdict,
};
use spatial::{Object, Pose};

use crate::{bodies::body, scene};

/// Two plates that slide towards each other below a palm; at 0.035 m they touch the cube.
const PLATES: &str = r#"<robot name="plates">
  <link name="palm"><inertial><mass value="0.5"/>
    <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="left"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0.005 0"/><geometry><box size="0.03 0.01 0.03"/></geometry></collision></link>
  <link name="right"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 -0.005 0"/><geometry><box size="0.03 0.01 0.03"/></geometry></collision></link>
  <joint name="slide_left" type="prismatic"><parent link="palm"/><child link="left"/>
    <origin xyz="0 0.06 0"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.5" effort="50" velocity="1"/></joint>
  <joint name="slide_right" type="prismatic"><parent link="palm"/><child link="right"/>
    <origin xyz="0 -0.06 0"/><axis xyz="0 1 0"/><limit lower="0" upper="0.5" effort="50" velocity="1"/></joint>
</robot>"#;
/// The cube: a box, with its half extents in meters and its mass in kilograms.
const CUBE: (&str, u32, [f64; 3], f64) = ("cube", 0, [0.025; 3], 0.3);
/// Position of the plates in meters at which they touch the cube.
const TOUCHING_M: f64 = 0.035;

fn plates() -> RobotModel {
    RobotModel::from_urdf(PLATES).unwrap()
}

fn protocol(name: ProtocolName) -> Protocol {
    Protocol {
        name,
        flexion_joints: vec!["slide_left".to_owned(), "slide_right".to_owned()],
        open_rad: 0.01,
        ..scene::protocol()
    }
}

/// The plates on both sides of the cube, `height_m` above its middle, moving from one position to another.
fn motion(height_m: f64, [from, to]: [f64; 2]) -> Motion<Object, ()> {
    let step = |(time_s, q): (f64, f64)| Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, height_m)),
        q_rad: vec![q; 2],
        rates: (),
    };
    Motion::new(
        &plates().joint_names(),
        [(0.0, from), (0.8, to)].map(step).to_vec(),
    )
    .unwrap()
}

/// The cube on a table beside the plates.
fn settled(scene: &SceneConfig) -> SettledScene {
    let (_, cube, rest) = body(CUBE);
    SettledScene::new(scene, &plates(), &cube, &rest).unwrap()
}

/// Carries out a motion as a protocol says.
fn execute(given: &SceneConfig, given_protocol: &Protocol, motion: &Motion<Object, ()>) -> Rollout {
    let (scene, protocol) = given_protocol.resolved(given);
    settled(&scene)
        .rollout(motion, &protocol, TraceMode::Nothing)
        .unwrap()
}

/// A grasp that touches the cube, then squeezed by `squeeze_m`.
fn squeezed(name: ProtocolName, squeeze_m: f64) -> Rollout {
    let protocol = Protocol {
        squeeze_rad: squeeze_m,
        ..protocol(name)
    };
    let touching = motion(0.0, [TOUCHING_M - 0.001, TOUCHING_M]);
    execute(&scene::scene(), &protocol, &touching)
}

/// A continuous joint has no limit to open or close to by a share: it is commanded all the same.
#[test]
fn joints_without_limits_are_commanded_by_every_protocol() {
    let limit = r#"<limit lower="0" upper="0.5" effort="50" velocity="1"/>"#;
    let endless = PLATES.replace("prismatic", "continuous").replace(limit, "");
    let endless = RobotModel::from_urdf(&endless).unwrap();
    assert!(
        endless
            .joints()
            .iter()
            .all(|joint| joint.upper.is_infinite())
    );
    let (_, cube, rest) = body(CUBE);
    for name in ProtocolName::ALL {
        let (scene, resolved) = protocol(name).resolved(&scene::scene());
        let settled = SettledScene::new(&scene, &endless, &cube, &rest).unwrap();
        let grasp = motion(0.0, [0.0, 0.1]);
        let setpoints = settled.setpoints(&grasp, &resolved).unwrap();
        let finite = |q: &f64| q.is_finite();
        assert!(
            setpoints.iter().all(|step| step.q.iter().all(finite)),
            "{name:?}"
        );
        let rollout = settled
            .rollout(&grasp, &resolved, TraceMode::Nothing)
            .unwrap();
        assert_ne!(rollout.verdict, Verdict::Diverged, "{name:?}");
    }
}

#[test]
fn this_projects_own_protocol_is_as_the_options_say() {
    let (given, options) = (scene::scene(), scene::protocol());
    assert_eq!(options.resolved(&given), (given, options));
}

#[test]
fn each_protocol_states_its_friction_mass_drive_and_steps() {
    // Friction of the hand and of the table, mass in kg, density in kg/m³, stiffness in Nm/rad, damping in Nms/rad,
    // torque limit in Nm, control steps.
    let stated = [
        (
            ProtocolName::Paper,
            [2.0, 1.5],
            None,
            Some(1000.0),
            [200.0, 60.0, 10.0],
            40 + 15 + 1,
        ),
        (
            ProtocolName::DexgraspbenchForceClosure,
            [0.6, 0.6],
            Some(0.1),
            None,
            [5.0, 0.1, 1000.0],
            40 + 600,
        ),
        (
            ProtocolName::DexgraspbenchTabletop,
            [0.6, 0.6],
            Some(0.1),
            None,
            [5.0, 0.1, 1000.0],
            40 + 20 + 1,
        ),
        (
            ProtocolName::GetAGrip,
            [0.9, 1.0],
            None,
            Some(500.0),
            [50.0, 1.0, 15.0],
            9 + 13 + 57 + 3 * 57 + 1,
        ),
        (
            ProtocolName::Dro,
            [3.0, 3.0],
            None,
            Some(500.0),
            [1000.0, 200.0, 15.0],
            50 + 300,
        ),
        (
            ProtocolName::Frogger,
            [0.7, 0.7],
            None,
            Some(150.0),
            [20.0, 1.0, 0.7],
            1 + 10 + 50 + 75,
        ),
    ];
    let published = ProtocolName::ALL.into_iter().filter(|name| !name.is_own());
    assert_eq!(stated.len(), published.count());
    let mut odd = scene::scene();
    (odd.mass_scale, odd.table_friction, odd.object_mass_kg) = (3.0, Some(0.1), Some(7.0));
    for (name, friction, mass_kg, density, drive, steps_n) in stated {
        let (scene, _) = protocol(name).resolved(&odd);
        let table = scene.table_friction.unwrap_or(scene.friction);
        assert_eq!([scene.friction, table], friction, "{name:?}");
        assert_eq!(
            (scene.object_mass_kg, scene.mass_scale),
            (mass_kg, 1.0),
            "{name:?}"
        );
        assert_eq!(scene.object_density_kg_per_m3, density, "{name:?}");
        let DriveConfig {
            stiffness,
            damping,
            torque_limit,
            ..
        } = scene.drive;
        assert_eq!([stiffness, damping, torque_limit], drive, "{name:?}");
        let rollout = squeezed(name, 0.01);
        assert_eq!(
            rollout.measures.control_steps_n + rollout.measures.skipped_steps_n.unwrap(),
            steps_n,
            "{name:?}"
        );
    }
}

/// Plates at 5 N/m press with 0.2 m of squeeze by 1 N: friction holds 2 · 0.6 · 1 N against a pull of 1 N along
/// them. Across them only the two springs hold, which yield by 1 N / 10 N/m = 10 cm.
#[test]
fn force_closure_pulls_with_one_newton_on_100_g() {
    let rollout = squeezed(ProtocolName::DexgraspbenchForceClosure, 0.2);
    assert_eq!(rollout.verdict, Verdict::Slipped);
    // Both pulls along x are held for 2 s. The next one swings cube and plates, 0.302 kg on 10 N/m, by 5 cm
    // in a sixth of a period, 0.18 s.
    let lost_n = rollout.measures.control_steps_n - 40 - 200;
    assert!((8..=11).contains(&lost_n), "{lost_n}");
    // With 0.7 N, 0.84 N of friction hold: at 1.6 m/s² the cube is 5 cm away after 0.25 s.
    let rollout = squeezed(ProtocolName::DexgraspbenchForceClosure, 0.14);
    let lost_n = rollout.measures.control_steps_n - 40;
    assert!((12..=14).contains(&lost_n), "{lost_n}");
    // In no grip at all it is 5 cm away after 0.1 s at 10 m/s².
    let away = motion(0.3, [0.0, 0.0]);
    let options = protocol(ProtocolName::DexgraspbenchForceClosure);
    let rollout = execute(&scene::scene(), &options, &away);
    assert_eq!(
        (rollout.verdict, rollout.measures.control_steps_n),
        (Verdict::Dropped, 40 + 5)
    );
}

/// Every pull begins where the first one began: a cube that swings from one does so again in the next.
#[test]
fn pulls_of_force_closure_know_nothing_of_each_other() {
    let options = protocol(ProtocolName::DexgraspbenchForceClosure);
    let (scene, mut apart) = options.resolved(&scene::scene());
    // With stiff springs all six are held, each with the same displacement as its opposite.
    let mut stiff = scene;
    stiff.drive.stiffness = 50.0;
    apart.squeeze_rad = 0.05;
    // Late fingers still close when the first pull begins, and do so in each.
    for delay_s in [0.0, 0.04] {
        stiff.drive.delay_s = delay_s;
        let settled = settled(&stiff);
        let touching = motion(0.0, [TOUCHING_M - 0.001, TOUCHING_M]);
        let rollout = settled
            .rollout(&touching, &apart, TraceMode::Trace)
            .unwrap();
        assert_eq!(rollout.verdict, Verdict::Held, "{rollout:?}");
        let steps = rollout.trace.unwrap().steps;
        let place = |idx: usize| steps[idx].table_from_object.translation.vector;
        let before = place(40);
        // Each pull has 100 steps; the first step of the second one starts from `before` again.
        for pull in 1..6 {
            let first = place(40 + 100 * pull + 1) - before;
            assert!(first.norm() < 0.006, "pull {pull}: {first}");
        }
        let across = [2, 3].map(|pull| (place(40 + 100 * pull + 30) - before).y);
        assert!(
            (across[0] + across[1]).abs() < 1e-3 && across[0].abs() > 0.005,
            "{across:?}"
        );
        // Along the plates, a pull moves them as fast as the one before it.
        let closing = [0, 1, 4].map(|pull| steps[40 + 100 * pull + 4].q[0]);
        assert!(
            closing.iter().all(|q| (q - closing[0]).abs() < 2e-4),
            "{closing:?}"
        );
    }
}

/// The cube weighs 0.98 N: friction of 2 · 0.6 · 1.1 N carries it, and 2 · 0.6 · 0.8 N do not. The palm rises at
/// 0.25 m/s from its first step, to which friction brings the cube within 0.1 s, 1 cm behind.
#[test]
fn tabletop_lifts_100_g_by_10_cm() {
    let held = squeezed(ProtocolName::DexgraspbenchTabletop, 0.22);
    assert_eq!(held.verdict, Verdict::Held, "{held:?}");
    assert!(
        (0.08..0.1).contains(&held.measures.lift_m.unwrap()),
        "{held:?}"
    );
    let resting = squeezed(ProtocolName::DexgraspbenchTabletop, 0.16);
    assert_eq!(resting.verdict, Verdict::Dropped, "{resting:?}");
    assert!(resting.measures.lift_m.unwrap() < 1e-3, "{resting:?}");
}

/// 0.125 kg weigh 1.23 N. With plates at 200 N/m, `d` into the cube, friction of 2 · 2 · 200 N/m · d lifts them.
#[test]
fn the_papers_lift_needs_a_contact_and_four_centimeters() {
    let (scene, resolved) = protocol(ProtocolName::Paper).resolved(&scene::scene());
    let grasp = |into_m: f64, protocol: &Protocol| {
        let closing = motion(0.0, [TOUCHING_M - 0.001, TOUCHING_M + into_m]);
        settled(&scene)
            .rollout(&closing, protocol, TraceMode::Nothing)
            .unwrap()
    };
    // 3.2 N, and 1.2 N.
    let held = grasp(0.004, &resolved);
    assert_eq!(held.verdict, Verdict::Held, "{held:?}");
    assert!(
        (0.13..0.15).contains(&held.measures.lift_m.unwrap()),
        "{held:?}"
    );
    let resting = grasp(0.0015, &resolved);
    assert_eq!(resting.verdict, Verdict::NotGrasped, "{resting:?}");
    // A firm grasp has to rise by 4 cm.
    for (lift_m, verdict) in [(0.045, Verdict::Held), (0.035, Verdict::NotGrasped)] {
        let lower = Protocol {
            lift_m,
            ..resolved.clone()
        };
        assert_eq!(grasp(0.006, &lower).verdict, verdict);
    }
}

/// Returns the least `into_m` with which a grasp is held, between two that are 1 % apart.
fn least_m(mut between: [f64; 2], held: impl Fn(f64) -> bool) -> f64 {
    assert!(!held(between[0]) && held(between[1]));
    while between[1] > 1.01 * between[0] {
        let middle = f64::midpoint(between[0], between[1]);
        between[usize::from(held(middle))] = middle;
    }
    between[1]
}

/// The plates rise at an even speed v and are beyond the cube after 4 cm: friction of r times the weight brings the
/// cube to that speed within v² / (2 (r - 1) g), so that r is 1.08 with 0.25 m/s. Slowly it is 1.
#[test]
fn plates_lift_what_friction_brings_to_their_speed_before_they_leave_it() {
    let tabletop = least_m([0.1, 0.4], |squeeze_m| {
        squeezed(ProtocolName::DexgraspbenchTabletop, squeeze_m).verdict == Verdict::Held
    });
    let (scene, resolved) = protocol(ProtocolName::Paper).resolved(&scene::scene());
    let paper = least_m([0.001, 0.006], |into_m| {
        let closing = motion(0.0, [TOUCHING_M - 0.001, TOUCHING_M + into_m]);
        let slowly = Protocol {
            lift_s: 20.0,
            ..resolved.clone()
        };
        let rollout = settled(&scene).rollout(&closing, &slowly, TraceMode::Nothing);
        rollout.unwrap().verdict == Verdict::Held
    });
    let tabletop = 2.0 * 0.6 * 5.0 * tabletop / (0.1 * 9.81);
    let paper = 2.0 * 2.0 * 200.0 * paper / (0.125 * 9.81);
    println!("least friction over weight: tabletop {tabletop:.2}, paper {paper:.2}");
    assert!((1.06..1.15).contains(&tabletop) && (0.98..1.05).contains(&paper));
}

/// Fingers begin a quarter of the way to their lower limits, 0, and close by 15 % of the way to their upper ones.
#[test]
fn dro_opens_and_closes_by_shares_of_what_is_left_to_the_limits() {
    let options = protocol(ProtocolName::Dro);
    let (scene, resolved) = options.resolved(&scene::scene());
    assert_eq!(
        (scene.support, resolved.approach, resolved.trial),
        (Support::Nothing, Approach::AtGrasp, Trial::SixDirections)
    );
    let settled = settled(&scene);
    let touching = motion(0.0, [0.0, TOUCHING_M]);
    let setpoints = settled.setpoints(&touching, &resolved).unwrap();
    let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
    assert!(close(setpoints[0].q[0], 0.75 * TOUCHING_M));
    assert!(close(
        setpoints[2].q[0],
        TOUCHING_M + 0.15 * (0.5 - TOUCHING_M)
    ));
    // Without a grip, a pull of 0.5 m/s² moves the cube by 2 cm in 0.28 s.
    let away = settled.rollout(&motion(0.3, [0.0, 0.0]), &resolved, TraceMode::Nothing);
    let away = away.unwrap();
    assert_eq!(
        (away.verdict, away.measures.control_steps_n),
        (Verdict::Dropped, 50 + 15)
    );
}

/// 19 g weigh 0.18 N: plates at 20 N/m hold them when they are 1 cm inside (0.28 N), and not at 5 mm (0.14 N).
#[test]
fn froggers_pick_holds_what_friction_carries() {
    let held = squeezed(ProtocolName::Frogger, 0.01);
    assert_eq!(held.verdict, Verdict::Held, "{held:?}");
    assert!(
        (held.measures.lift_m.unwrap() - 0.1).abs() < 0.01,
        "{held:?}"
    );
    let lost = squeezed(ProtocolName::Frogger, 0.005);
    assert_ne!(lost.verdict, Verdict::Held, "{lost:?}");
}

/// Two plates are two links, and three are asked for; a hand around a can has them.
#[test]
fn get_a_grip_asks_for_three_links_and_shakes() {
    let plates = squeezed(ProtocolName::GetAGrip, 0.01);
    assert_eq!(
        (plates.verdict, plates.measures.contacts_n.unwrap()),
        (Verdict::Dropped, 2)
    );
    let options = Protocol {
        name: ProtocolName::GetAGrip,
        ..scene::protocol()
    };
    let (scene, resolved) = options.resolved(&scene::scene());
    let q = scene::q([0.85, 0.95, 0.85], [1.3, 0.43, 0.51, 0.68]);
    let grasp = scene::side_grasp([-0.02, -0.054, 0.02], &q);
    let rollout = scene::settled(&scene).rollout(&grasp, &resolved, TraceMode::Trace);
    let rollout = rollout.unwrap();
    assert_eq!(rollout.verdict, Verdict::Held, "{:?}", rollout.verdict);
    let steps = rollout.trace.unwrap().steps;
    let start = steps[0].table_from_palm.translation.vector;
    let moved = |axis: usize| {
        steps
            .iter()
            .map(move |step| step.table_from_palm.translation.vector[axis] - start[axis])
    };
    for (axis, [least, most]) in [[-0.03, 0.03], [-0.03, 0.03], [0.0, 0.23]]
        .into_iter()
        .enumerate()
    {
        let found = [
            moved(axis).fold(f64::INFINITY, f64::min),
            moved(axis).fold(f64::NEG_INFINITY, f64::max),
        ];
        assert!(
            (found[0] - least).abs() < 2e-3 && (found[1] - most).abs() < 2e-3,
            "{axis}: {found:?}"
        );
    }
}

/// Between two plates the palm bears the cube's weight of 2.9 N by friction. Their pressures of 6 N cancel at rest,
/// while they come to rest only in part.
#[test]
fn palm_bears_what_friction_carries() {
    let mut scene = scene::scene();
    (scene.drive.stiffness, scene.drive.damping) = (200.0, 10.0);
    scene.drive.torque_limit = 50.0;
    let bearing = |newtons: f64| {
        let mut options = Protocol {
            approach: Approach::Follow,
            squeeze_rad: 0.03,
            lift_s: 2.0,
            ..protocol(ProtocolName::TableLift)
        };
        options.strict.max_palm_force_n = Some(newtons);
        let closing = motion(0.0, [TOUCHING_M - 0.001, TOUCHING_M]);
        execute(&scene, &options, &closing).verdict
    };
    assert_eq!(bearing(6.0), Verdict::Held);
    assert_eq!(bearing(2.6), Verdict::Overloaded);
}

/// Plates that are commanded through each other stop where they meet, 0.06 m from where they start.
#[test]
fn fingers_that_touch_stop_each_other() {
    let ends = [false, true].map(|fingers_touch| {
        let mut scene = scene::scene();
        scene.fingers_touch = fingers_touch;
        (scene.drive.stiffness, scene.drive.damping) = (200.0, 10.0);
        let options = Protocol {
            approach: Approach::Follow,
            squeeze_rad: 0.0,
            ..protocol(ProtocolName::TableLift)
        };
        let beside = motion(0.3, [0.05, 0.08]);
        let rollout = settled(&scene).rollout(&beside, &options, TraceMode::Trace);
        let steps = rollout.unwrap().trace.unwrap().steps;
        steps.last().unwrap().q.clone()
    });
    for (end_m, expected_m) in ends.iter().flatten().zip([0.08, 0.08, 0.06, 0.06]) {
        assert!((end_m - expected_m).abs() < 5e-4, "{ends:?}");
    }
}

#[test]
fn full_contact_has_every_contact_an_arm_that_yields_and_little_friction() {
    let given = protocol(ProtocolName::FullContact);
    let mut slippery = scene::scene();
    slippery.friction = 0.8;
    assert!(given.faults_in(&slippery).is_empty());
    for table_friction in [None, Some(1.0)] {
        let rough = SceneConfig {
            friction: if table_friction.is_none() { 1.0 } else { 0.8 },
            table_friction,
            ..slippery.clone()
        };
        let [fault] = &given.faults_in(&rough)[..] else {
            panic!("not refused");
        };
        assert!(fault.problem.contains("at most 0.8"), "{fault:?}");
    }
    let (scene, resolved) = given.resolved(&slippery);
    assert!(scene.fingers_touch && scene.fingers_touch_palm);
    assert_eq!(scene.palm_compliance, Some(PalmComplianceConfig::default()));
    assert_eq!(resolved.strict.knocked_until, KnockedUntil::Lift);
    // What a scene says of its arm stays.
    let soft = PalmComplianceConfig {
        force_limit_n: 20.0,
        ..PalmComplianceConfig::default()
    };
    let with_arm = SceneConfig {
        palm_compliance: Some(soft),
        ..slippery.clone()
    };
    assert_eq!(given.resolved(&with_arm).0.palm_compliance, Some(soft));
    // The rest is that of the lenient one.
    assert_eq!(
        Protocol {
            name: ProtocolName::TableLift,
            strict: given.strict,
            ..resolved.clone()
        },
        protocol(ProtocolName::TableLift)
    );
}

/// Plates that are pressed together by 40 N are as deep in each other as their joints say: they meet at 0.06 m each.
#[test]
fn fingers_are_as_deep_in_each_other_as_their_joints_say() {
    let mut given = scene::scene();
    given.friction = 0.8;
    let drive = &mut given.drive;
    (drive.stiffness, drive.damping, drive.torque_limit) = (2000.0, 20.0, 50.0);
    let found = |name: ProtocolName| {
        let options = Protocol {
            approach: Approach::Follow,
            squeeze_rad: 0.0,
            ..protocol(name)
        };
        let (scene, options) = options.resolved(&given);
        let beside = motion(0.3, [0.05, 0.08]);
        let rollout = settled(&scene).rollout(&beside, &options, TraceMode::Trace);
        let rollout = rollout.unwrap();
        let steps = rollout.trace.unwrap().steps;
        let depths = steps.iter().map(|step| step.q[0] + step.q[1] - 0.12);
        (
            depths.fold(0.0, f64::max),
            rollout.measures.finger_penetration_m,
        )
    };
    let (through_m, unmeasured) = found(ProtocolName::TableLift);
    assert!(through_m > 0.03, "{through_m}");
    assert_eq!(unmeasured, None);
    let (depth_m, measured_m) = found(ProtocolName::FullContact);
    let measured_m = measured_m.unwrap();
    assert!((1e-4..5e-3).contains(&depth_m), "{depth_m}");
    assert!(
        (measured_m / depth_m - 1.0).abs() < 0.2,
        "{measured_m} {depth_m}"
    );
}

#[test]
fn a_published_protocol_has_to_be_resolved() {
    let options = protocol(ProtocolName::Paper);
    let rollout =
        settled(&scene::scene()).rollout(&motion(0.0, [0.0, 0.0]), &options, TraceMode::Nothing);
    assert!(rollout.unwrap_err().to_string().contains("`name`"));
}
