use std::convert::Infallible;

use motion::{HandState, Motion};
use nalgebra::{Isometry3, Point3, Vector3};
use robot::{ConvexBody, RobotModel};
use simulation::{
    Approach, Offset, PalmDriveConfig, Protocol, Rollout, SceneConfig, SettledScene,
    SimulationError, TraceMode, Verdict,
};
use spatial::{Object, Pose};

use crate::scene::{can, hand, protocol, q, scene, settled, side_grasp, upright, urdf};

const BESIDE: [f64; 3] = [-0.015, -0.055, 0.02];

fn good() -> Motion<Object, ()> {
    side_grasp(BESIDE, &q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]))
}

/// The same motion with the palm moved at one step, in the object's frame.
fn with_step_moved(
    motion: &Motion<Object, ()>,
    step: usize,
    by_m: Vector3<f64>,
) -> Motion<Object, ()> {
    let mut steps = motion.steps().to_vec();
    let mut pose = *steps[step].frame_from_palm;
    pose.translation.vector += by_m;
    steps[step].frame_from_palm = Pose::new(pose);
    Motion::of_joints(motion.joints().clone(), steps).unwrap()
}

fn too_open() -> Motion<Object, ()> {
    side_grasp(BESIDE, &q([0.5, 0.6, 0.4], [1.3, 0.3, 0.2, 0.3]))
}

fn roll(motion: &Motion<Object, ()>) -> Rollout {
    settled(&scene())
        .rollout(motion, &protocol(), TraceMode::Nothing)
        .unwrap()
}

#[test]
fn a_closed_hand_lifts_and_holds_the_can() {
    let rollout = roll(&good());
    assert_eq!(rollout.verdict, Verdict::Held);
    assert!(
        (rollout.measures.lift_m.unwrap() - 0.15).abs() < 0.02,
        "{rollout:?}"
    );
    assert!(rollout.measures.slip_m.unwrap() < 0.003, "{rollout:?}");
    assert!(rollout.measures.contacts_n.unwrap() >= 2, "{rollout:?}");
    // 0.8 s reach, 0.3 s squeeze, 0.3 s pause, 0.4 s lift, 2 s hold, at 50 Hz.
    assert_eq!(rollout.measures.control_steps_n, 190);
}

#[test]
fn palm_without_inertia_holds_the_same_grasp() {
    let urdf = urdf();
    let start = urdf.find("<inertial>").unwrap();
    let end = start + urdf[start..].find("</inertial>").unwrap() + "</inertial>".len();
    let without = [&urdf[..start], &urdf[end..]].concat();
    let hand = RobotModel::from_urdf(&without).unwrap();
    assert!(hand.links()[0].inertial.is_none());
    let settled = SettledScene::new(&scene(), &hand, &can(), &upright()).unwrap();
    let rollout = settled.rollout(&good(), &protocol(), TraceMode::Nothing);
    let rollout = rollout.unwrap();
    assert_eq!(rollout.verdict, Verdict::Held);
    let with = roll(&good());
    assert!(
        (rollout.measures.lift_m.unwrap() - with.measures.lift_m.unwrap()).abs() < 1e-3,
        "{rollout:?}"
    );
    assert!(
        (rollout.measures.slip_m.unwrap() - with.measures.slip_m.unwrap()).abs() < 1e-3,
        "{rollout:?}"
    );
}

/// The hand with a mesh in place of every box, named by the box's sides.
fn hand_of_meshes() -> RobotModel {
    let urdf = urdf();
    let n_boxes = urdf.matches("<box size=").count();
    assert!(n_boxes > 10);
    let of_meshes = urdf.replace("<box size=", "<mesh filename=");
    RobotModel::from_urdf(&of_meshes).unwrap()
}

/// A box with these sides, in meters.
fn cuboid(sides: &str) -> ConvexBody {
    let sides: Vec<f64> = sides.split(' ').map(|side| side.parse().unwrap()).collect();
    let half = Vector3::from_column_slice(&sides) / 2.0;
    let corner = |k: usize| {
        let sign = |axis: usize| if k >> axis & 1 == 0 { -1.0 } else { 1.0 };
        Point3::from(half.component_mul(&Vector3::new(sign(0), sign(1), sign(2))))
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    ConvexBody::new((0..8).map(corner).collect(), triangles.collect()).unwrap()
}

#[test]
fn mesh_hand_holds_the_same_grasps_as_a_box_hand() {
    let unread = hand_of_meshes();
    let build = |hand: &RobotModel| SettledScene::new(&scene(), hand, &can(), &upright());
    let refused = build(&unread).err().unwrap();
    assert!(
        matches!(refused, SimulationError::MeshNotRead { .. }),
        "{refused}"
    );
    let read = unread.with_mesh_shapes(|_, mesh| Ok::<_, Infallible>(vec![cuboid(&mesh.file)]));
    let settled = build(&read.unwrap()).unwrap();
    let roll = |motion: &Motion<Object, ()>| {
        let rollout = settled.rollout(motion, &protocol(), TraceMode::Nothing);
        rollout.unwrap()
    };
    let rollout = roll(&good());
    assert_eq!(rollout.verdict, Verdict::Held);
    assert!(
        (rollout.measures.lift_m.unwrap() - 0.15).abs() < 0.02,
        "{rollout:?}"
    );
    assert!(rollout.measures.contacts_n.unwrap() >= 2, "{rollout:?}");
    assert_eq!(roll(&too_open()).verdict, Verdict::NotGrasped);
    // What geometry alone refuses it refuses of meshes, too.
    let fingers = q([0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]);
    let low = side_grasp([BESIDE[0], BESIDE[1], -0.03], &fingers);
    assert_eq!(roll(&low).verdict, Verdict::Table);
    let inside = side_grasp([BESIDE[0], -0.01, BESIDE[2]], &fingers);
    assert_eq!(roll(&inside).verdict, Verdict::EarlyContact);
}

#[test]
fn an_open_hand_leaves_the_can_and_ends_early() {
    let rollout = roll(&too_open());
    assert_eq!(rollout.verdict, Verdict::NotGrasped);
    assert!(rollout.measures.control_steps_n < 100, "{rollout:?}");
    assert!(rollout.measures.lift_m.unwrap().abs() < 0.01, "{rollout:?}");
}

#[test]
fn without_friction_nothing_is_held() {
    let mut scene = scene();
    scene.friction = 0.0;
    let rollout = settled(&scene)
        .rollout(&good(), &protocol(), TraceMode::Nothing)
        .unwrap();
    assert_ne!(rollout.verdict, Verdict::Held);
}

#[test]
fn a_can_of_twenty_kilograms_stays_on_the_table() {
    let mut scene = scene();
    scene.mass_scale = 60.0;
    let rollout = settled(&scene)
        .rollout(&good(), &protocol(), TraceMode::Nothing)
        .unwrap();
    assert_eq!(rollout.verdict, Verdict::NotGrasped);
}

#[test]
fn geometry_alone_refuses_limits_table_and_early_contact() {
    let settled = settled(&scene());
    let check = |motion: &Motion<Object, ()>, expected: Verdict| {
        let rollout = settled
            .rollout(motion, &protocol(), TraceMode::Trace)
            .unwrap();
        assert_eq!(rollout.verdict, expected);
        assert_eq!(
            (rollout.measures.control_steps_n, &rollout.trace),
            (0, &None)
        );
    };
    let fingers = [0.8, 0.9, 0.7];
    let beyond = q([2.5, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]);
    check(&side_grasp(BESIDE, &beyond), Verdict::Limit);
    let fine = q(fingers, [1.3, 0.5, 0.5, 0.7]);
    let low = [BESIDE[0], BESIDE[1], -0.03];
    check(&side_grasp(low, &fine), Verdict::Table);
    let inside = [BESIDE[0], -0.01, BESIDE[2]];
    check(&side_grasp(inside, &fine), Verdict::EarlyContact);
}

#[test]
fn a_hand_that_pushes_the_can_knocks_it_over() {
    // Fingers stretched: the palm runs 8 cm too far, and only the last quarter is not refused.
    let motion = side_grasp(BESIDE, &q([0.0; 3], [1.3, 0.0, 0.0, 0.0]));
    let mut protocol = protocol();
    protocol.approach = Approach::Follow;
    let last = motion.steps().len() - 1;
    let motion = with_step_moved(&motion, last, 0.08 * Vector3::y());
    let rollout = settled(&scene())
        .rollout(&motion, &protocol, TraceMode::Nothing)
        .unwrap();
    assert_eq!(rollout.verdict, Verdict::KnockedOver);
    assert!(
        rollout.measures.displacement_m.unwrap() > 0.02,
        "{rollout:?}"
    );
}

#[test]
fn a_displaced_object_is_off_its_estimated_pose() {
    let mut scene = scene();
    scene.object_offset = Offset {
        x_m: 0.3,
        y_m: 0.1,
        yaw_rad: 0.5,
    };
    let settled = settled(&scene);
    let actual = settled.table_from_object();
    let estimate = settled.table_from_estimate();
    let apart = actual.translation.vector - estimate.translation.vector;
    assert!((apart.x - 0.3).abs() < 1e-6 && (apart.y - 0.1).abs() < 1e-6);
    assert!((actual.rotation.angle_to(&estimate.rotation) - 0.5).abs() < 1e-6);
    let rollout = settled
        .rollout(&good(), &protocol(), TraceMode::Nothing)
        .unwrap();
    assert_eq!(rollout.verdict, Verdict::NotGrasped);
}

#[test]
fn the_palm_follows_its_path_and_the_trace_has_every_control_step() {
    let settled = settled(&scene());
    let motion = good();
    let rollout = settled
        .rollout(&motion, &protocol(), TraceMode::Trace)
        .unwrap();
    let steps = rollout.trace.unwrap().steps;
    assert_eq!(steps.len(), 191);
    let grasp = *(settled.table_from_estimate() * motion.grasp().frame_from_palm);
    for (step, rise) in [(40, 0.0), (190, 0.15)] {
        let palm = steps[step].table_from_palm;
        let error = palm.translation.vector - grasp.translation.vector;
        assert!(
            (error.z - rise).abs() < 1e-4 && error.xy().norm() < 1e-4,
            "{error}"
        );
        assert!(palm.rotation.angle_to(&grasp.rotation) < 1e-3);
    }
}

#[test]
fn a_driven_palm_is_late_on_its_way_and_still_lifts_the_can() {
    let executed = |palm_drive: Option<PalmDriveConfig>| {
        let scene = SceneConfig {
            palm_drive,
            ..scene()
        };
        let rollout = settled(&scene)
            .rollout(&good(), &protocol(), TraceMode::Nothing)
            .unwrap();
        assert_eq!(rollout.verdict, Verdict::Held);
        rollout.executed
    };
    let exact = executed(None);
    let late = executed(Some(PalmDriveConfig::default()));
    assert_eq!([exact.len(), late.len()], [41, 41]);
    let place =
        |steps: &[HandState<Object>], step: usize| steps[step].frame_from_palm.translation.vector;
    // The palm goes along y at 25 cm/s until three quarters of the reach; PD is 20 ms late.
    let lag_m = (place(&exact, 25) - place(&late, 25)).y;
    assert!((0.004..0.007).contains(&lag_m), "{lag_m} m");
    assert_eq!(place(&exact, 0), place(&late, 0));
    let left_m = (place(&exact, 40) - place(&late, 40)).norm();
    assert!(left_m < 1e-3, "{left_m} m");
}

#[test]
fn only_a_reach_that_was_simulated_to_its_end_counts_as_executed() {
    let check = |motion: &Motion<Object, ()>, protocol: &Protocol, steps_n: usize| {
        let rollout = settled(&scene())
            .rollout(motion, protocol, TraceMode::Nothing)
            .unwrap();
        let simulated_n = rollout.measures.control_steps_n;
        assert_eq!(rollout.executed.len(), steps_n, "{simulated_n} steps");
        simulated_n
    };
    assert!(check(&good(), &protocol(), 41) > 40);
    let below = good().moved(&Pose::new(Isometry3::translation(0.0, 0.0, -1.0)));
    assert_eq!(check(&below, &protocol(), 0), 0);
    // The palm runs into the can before the reach ends, and that is enough.
    let mut strict = protocol();
    (strict.approach, strict.knocked_m) = (Approach::Follow, 0.001);
    let motion = side_grasp(BESIDE, &q([0.0; 3], [1.3, 0.0, 0.0, 0.0]));
    let last = motion.steps().len() - 1;
    let pushes = with_step_moved(&motion, last, 0.08 * Vector3::y());
    let simulated_n = check(&pushes, &strict, 0);
    assert!((1..40).contains(&simulated_n), "{simulated_n}");
}

#[test]
fn fingers_stay_open_until_the_closing_and_squeeze_after_it() {
    let settled = settled(&scene());
    let motion = good();
    let rollout = settled
        .rollout(&motion, &protocol(), TraceMode::Trace)
        .unwrap();
    let steps = rollout.trace.unwrap().steps;
    let grasp = &motion.grasp().q_rad;
    let names = hand().joint_names();
    for (joint, name) in names.iter().enumerate() {
        let flexes = protocol().flexion_joints.contains(name);
        // Control steps 0 to 30 are before the last quarter of 0.8 s, 40 is its end.
        for (step, angle) in [
            (0, -0.3),
            (30, -0.3),
            (35, -0.15),
            (40, 0.0),
            (55, 0.15),
            (190, 0.15),
        ] {
            let expected = grasp[joint] + if flexes { angle } else { 0.0 };
            let found = steps[step].q_command[joint];
            assert!(
                (found - expected).abs() < 1e-9,
                "{name} at step {step}: {found}"
            );
        }
    }
}

#[test]
fn the_same_rollout_has_the_same_bytes() {
    let first = settled(&scene());
    let second = settled(&scene());
    let run = |settled: &SettledScene| {
        settled
            .rollout(&good(), &protocol(), TraceMode::Trace)
            .unwrap()
    };
    let reference = run(&first);
    // A rollout leaves nothing behind in its settled scene, and neither does another one.
    first
        .rollout(&too_open(), &protocol(), TraceMode::Nothing)
        .unwrap();
    for other in [run(&first), run(&second)] {
        let bits = |rollout: &Rollout| -> Vec<u64> {
            let steps = &rollout.trace.as_ref().unwrap().steps;
            steps
                .iter()
                .flat_map(|step| {
                    step.q
                        .iter()
                        .chain(&step.table_from_object.translation.vector)
                })
                .map(|number| number.to_bits())
                .collect()
        };
        assert_eq!(bits(&other), bits(&reference));
        assert_eq!(other, reference);
    }
}

#[test]
fn exploding_simulation_is_a_divergence() {
    let check = |time_step_s: f64, motion: &Motion<Object, ()>| {
        let mut scene = scene();
        scene.time_step_s = time_step_s;
        let rollout = settled(&scene)
            .rollout(motion, &protocol(), TraceMode::Trace)
            .unwrap();
        assert_eq!(
            (rollout.verdict, &rollout.trace),
            (Verdict::Diverged, &None)
        );
        let figures = [
            rollout.measures.lift_m,
            rollout.measures.slip_m,
            rollout.measures.displacement_m,
            rollout.measures.penetration_m,
        ];
        assert!(figures.iter().flatten().all(|figure| figure.is_finite()));
    };
    // A palm that jumps a kilometer aside and up, where no tilt of the can puts it below the table, and one
    // that jumps beyond single precision.
    for jump_m in [1e3, 1e39] {
        check(
            0.004,
            &with_step_moved(&good(), 3, jump_m * Vector3::new(0.0, -1.0, 1.0)),
        );
    }
}
