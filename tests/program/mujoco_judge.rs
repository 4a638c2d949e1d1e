//! The judge in `MuJoCo` beside the screen: one script, one object, one set of limits; verdicts on grasps that were
//! recorded.

use std::{collections::BTreeMap, fs, path::Path, process::Command, sync::Arc};

use dataflow::{Artifact, Pipeline};
use lake::Lake;
use measured_data::named_by;
use motion::{HandRates, JointRates, Motion, Step};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use robot::RobotModel;
use schemas::{
    candidates::{Candidate, Candidates, DrawSource},
    objects::{Object, RestingOrientation},
    rollouts::{Rollouts, Verdict},
    smoothness::{Smoothness, SmoothnessTable},
};
use serde_json::{Value, json};
use simulation::{ObjectShape, Phase, SettledScene};
use spatial::{Object as InObject, Palm, Pose, RestingPose, Table, Twist};
use stage_screen::Screen;
use tempfile::TempDir;

use crate::program::{
    bench::{Bench, stderr},
    python::python,
};

const JUDGE: &str = "stages/program/examples/mujoco/judge.py";
const MODULES: [&str; 3] = ["mujoco", "numpy", "pyarrow"];

/// Motions that are compared step by step.
const COMPARED: usize = 5;
/// Greatest difference of a commanded position, in meters, radians and parts of a quaternion.
const COMMANDED: f64 = 1e-9;
/// Greatest difference of the object's position at rest: each engine lets it fall half a millimeter and settle. Most
/// differ by less than 0.05 mm and 1 mrad; a bottle that rocks on its bottom by 15 mrad.
const START_M: f64 = 5e-4;
const START_RAD: f64 = 2e-2;
/// Verdicts of 62 recorded ones that have to agree; the screen agrees with 58 of them.
const MIN_AGREEMENTS: usize = 56;

/// Demonstrations of the sample, replayed; contacts of the hand with itself and a palm that yields are those that a test
/// asks for.
const REPLAYED: &str = r#"
extends = "ROOT/pipelines/replay.toml"
[shared]
friction = 1.0
protocol.name = "table_lift"
"#;
/// The judge as the stage `NAME`, which makes `MAKES` of the replayed demonstrations.
const JUDGED: &str = r#"
[stages.NAME]
kind = "program"
command = ["PYTHON", "stages/program/examples/mujoco/judge.py"]
code = ["stages/program/examples/mujoco/*.py"]
inputs.candidates = "replay.candidates"
inputs.objects = "ingest.objects"
each = "candidates"
makes = "MAKES"
files.hand = "data/robots/allegro_right.urdf"
files.hand_file = "data/hands/allegro_right.toml"
shared.options.protocol = "protocol"
"#;

/// Returns a pipeline in which the judge makes `rollouts`, with one motion of each object recorded, and `smoothness` of the
/// replayed demonstrations: `of_judge` is added to the stage of the rollouts, `stages` at the end.
fn judged(python: &str, of_judge: &str, stages: &str) -> String {
    let judge = |name: &str, makes: &str| JUDGED.replace("NAME", name).replace("MAKES", makes);
    let rollouts = judge("mujoco", "rollouts") + "options.recorded = 1\n" + of_judge;
    let smoothness = judge("mujoco_smoothness", "smoothness");
    [REPLAYED, &rollouts, &smoothness, stages]
        .concat()
        .replace("ROOT", env!("CARGO_MANIFEST_DIR"))
        .replace("PYTHON", python)
}

/// Greatest relative difference of a figure of smoothness; accelerations are second differences of positions.
const SMOOTHNESS: f64 = 1e-6;

#[test]
fn script_start_and_limits_are_those_of_the_screen_step_by_step() {
    let Some(python) = python(&MODULES) else {
        return;
    };
    let bench = Bench::new();
    let file = bench.lake().parent().unwrap().join("judged.toml");
    fs::write(&file, judged(&python, "", "")).unwrap();
    bench.run_own(&file);

    let read = Pipeline::parse(
        &file,
        &fs::read_to_string(&file).unwrap(),
        &pipeline::kinds(),
        None,
        &[],
    );
    let read = read.unwrap();
    let screen = read
        .find("screen")
        .unwrap()
        .options::<Screen>()
        .unwrap()
        .resolved();
    let hand = RobotModel::from_urdf(include_str!("../../data/robots/allegro_right.urdf")).unwrap();
    let lake = Lake::open(&bench.lake());
    let objects = lake.newest_partitions("objects", Some("ingest")).unwrap();
    let candidates = lake
        .newest_partitions("candidates", Some("replay"))
        .unwrap();
    let mut compared = 0;
    for (key, artifact) in candidates.iter().take(COMPARED) {
        let object: Object = lake::table::read(&objects[key]).unwrap();
        let candidates: Candidates = lake::table::read(artifact).unwrap();
        let candidate = &candidates.candidates[0];
        let rest = RestingPose::of(&candidate.table_from_object);
        let shape = ObjectShape::from_artifact(&object);
        let settled = SettledScene::new(&screen.scene, &hand, &shape, &rest).unwrap();
        let motion = candidate.motion.reordered(&hand.joint_names()).unwrap();
        let trace = bench
            .lake()
            .join("files/judged/mujoco/rollouts")
            .join(key.as_str());
        let trace = fs::read(trace.join(format!("{}.json", candidate.candidate_id))).unwrap();
        let trace: Value = serde_json::from_slice(&trace).unwrap();

        let there = pose(&trace["table_from_object"]);
        let here = settled.table_from_object();
        let apart = here.inv_mul(&there);
        let (apart_m, apart_rad) = (apart.translation.vector.norm(), apart.rotation.angle());
        println!(
            "{key}: object {:.3} mm and {:.3} mrad apart",
            apart_m * 1e3,
            apart_rad * 1e3
        );
        assert!(
            apart_m < START_M && apart_rad < START_RAD,
            "{key}: {apart_m} m, {apart_rad} rad"
        );

        let steps = trace["steps"].as_array().unwrap();
        let setpoints = settled.setpoints(&motion, &screen.protocol).unwrap();
        assert_eq!(steps.len(), setpoints.len(), "{key}");
        let mut worst: f64 = 0.0;
        for (idx, (step, setpoint)) in steps.iter().zip(&setpoints).enumerate() {
            assert_eq!(step["phase"], phase(setpoint.phase), "{key} step {idx}");
            // In the frame of the object as it lay, before the hand is carried.
            let lifted = |start: &Pose<Table, InObject>, palm: Pose<Table, Palm>, last: f64| {
                start.inv_mul(&palm.translated(&Vector3::new(0.0, 0.0, -last)))
            };
            let carried_m = setpoint.table_from_palm.translation.z
                - setpoints[setpoints.len() - 1 - lift_back(&setpoints, idx)]
                    .table_from_palm
                    .translation
                    .z;
            let ours = lifted(&here, setpoint.table_from_palm, carried_m);
            let theirs = lifted(&there, pose(&step["palm"]), carried_m);
            let q: Vec<f64> = serde_json::from_value(step["q"].clone()).unwrap();
            let of_q = q.iter().zip(&setpoint.q).map(|(a, b)| (a - b).abs());
            let of_palm = (ours.translation.vector - theirs.translation.vector).norm();
            let of_turn = ours.rotation.angle_to(&theirs.rotation);
            worst = of_q.fold(worst, f64::max).max(of_palm).max(of_turn);
        }
        println!("{key}: {} commands, at most {worst:.1e} apart", steps.len());
        assert!(worst < COMMANDED, "{key}: {worst}");

        let limits: Vec<[f64; 2]> = serde_json::from_value(trace["limits"].clone()).unwrap();
        let ours: Vec<[f64; 2]> = hand
            .joints()
            .iter()
            .map(|joint| [joint.lower, joint.upper])
            .collect();
        assert_eq!(limits, ours);
        assert_eq!(trace["torque_limit"], screen.scene.drive.torque_limit);
        compared += 1;
    }
    assert_eq!(compared, COMPARED);

    // Every motion has a row of each, and geometry alone refuses the same ones.
    let (ours, theirs) = (verdicts(&lake, "screen"), verdicts(&lake, "mujoco"));
    assert_eq!(
        ours.keys().collect::<Vec<_>>(),
        theirs.keys().collect::<Vec<_>>()
    );
    let is_refused = |verdict: &Verdict| {
        matches!(
            verdict,
            Verdict::Limit | Verdict::Table | Verdict::EarlyContact
        )
    };
    for (candidate, ours) in &ours {
        let theirs = &theirs[candidate];
        if is_refused(ours) || is_refused(theirs) {
            assert_eq!(ours, theirs, "{candidate}");
        }
    }
    smoothness_is_that_of_the_screen(&lake);
}

/// Both measure the motions as drawn alike.
fn smoothness_is_that_of_the_screen(lake: &Lake) {
    let of = |stage: &str| -> BTreeMap<String, Smoothness> {
        let parts = lake.newest_partitions("smoothness", Some(stage)).unwrap();
        let rows = parts
            .values()
            .flat_map(|part| lake::table::read::<SmoothnessTable>(part).unwrap());
        rows.map(|row| (row.candidate_id, row.drawn)).collect()
    };
    let (ours, theirs) = (of("screen"), of("mujoco_smoothness"));
    assert_eq!(ours.len(), theirs.len());
    let figures = |of: &Smoothness| {
        let all = [of.paper, of.released, of.robust].map(|of| [of.joints, of.cartesian]);
        let all = all.as_flattened().iter();
        all.flat_map(|of| [of.position, of.velocity, of.acceleration])
            .collect::<Vec<f64>>()
    };
    for (candidate, ours) in &ours {
        let (ours, theirs) = (figures(ours), figures(&theirs[candidate]));
        for (ours, theirs) in ours.into_iter().zip(theirs) {
            assert!(
                (ours - theirs).abs() <= SMOOTHNESS * ours.abs(),
                "{candidate}: {ours} {theirs}"
            );
        }
    }
}

/// Returns the number of commands after the one that a command's lift is relative to. A command before the lift is
/// relative to itself, and is compared as it is.
fn lift_back(setpoints: &[simulation::Setpoint], idx: usize) -> usize {
    let is_carried = |at: usize| matches!(setpoints[at].phase, Phase::Lift | Phase::Hold);
    let before = (0..setpoints.len()).rfind(|&at| !is_carried(at)).unwrap();
    let reference = if is_carried(idx) { before } else { idx };
    setpoints.len() - 1 - reference
}

fn phase(phase: Phase) -> &'static str {
    match phase {
        Phase::Reach => "reach",
        Phase::Close => "close",
        Phase::Squeeze => "squeeze",
        Phase::Lift => "lift",
        Phase::Hold => "hold",
        Phase::Pull => "pull",
    }
}

fn pose<To, From>(value: &Value) -> Pose<To, From> {
    Pose::from_array(serde_json::from_value(value.clone()).unwrap()).unwrap()
}

/// Convex parts of the judge's own and a hand that touches itself on an arm that yields.
const OWN_PARTS: &str = r#"
inputs.parts = "own_parts.parts"
options.parts = "own"
options.scene = { fingers_touch = true, fingers_touch_palm = true, palm_compliance = {} }
"#;
/// The same hand in the screen, and the parts.
const OWN_STAGES: &str = r#"
[stages.screen]
scene.fingers_touch = true
scene.fingers_touch_palm = true
scene.palm_compliance = {}

[stages.ingest]
objects = ["006_mustard_bottle", "011_banana"]

[stages.own_parts]
kind = "program"
command = ["PYTHON", "stages/program/examples/mujoco/parts.py"]
inputs.objects = "ingest.objects"
each = "objects"
makes = "parts"

[stages.own_parts.columns]
part_idx = { type = "integer", unit = "1", about = "number of the convex part" }
points_m = { type = "numbers", unit = "m", about = "its corners, x, y and z of each" }
"#;
/// Greatest turn of an object from the pose in which it was asked to lie.
const TURNED_RAD: f64 = 0.05;
/// Greatest difference of the bounds of parts and mesh, in meters.
const BOUNDS_M: f64 = 1e-4;

#[test]
fn own_parts_are_those_of_the_mesh_and_objects_rest_on_them_as_asked() {
    let Some(python) = python(&[&MODULES[..], &["coacd"]].concat()) else {
        return;
    };
    let bench = Bench::new();
    let file = bench.lake().parent().unwrap().join("own.toml");
    let (_, made_again) = OWN_STAGES.split_at(OWN_STAGES.find("[stages.own_parts]").unwrap());
    let stages = OWN_STAGES.to_owned() + &made_again.replace("own_parts", "again");
    fs::write(&file, judged(&python, OWN_PARTS, &stages)).unwrap();
    bench.run_own(&file);

    let lake = Lake::open(&bench.lake());
    let newest =
        |artifact: &str, stage: &str| lake.newest_partitions(artifact, Some(stage)).unwrap();
    let objects = newest("objects", "ingest");
    let (parts, again) = (newest("parts", "own_parts"), newest("parts", "again"));
    assert_eq!(objects.len(), 2);
    for (key, artifact) in &objects {
        let object: Object = lake::table::read(artifact).unwrap();
        let own = points_of_parts(&parts[key]);
        assert_eq!(own, points_of_parts(&again[key]), "{key}: made twice");
        assert_ne!(own, object.parts_m, "{key}");
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let farthest = |points: &[[f64; 3]]| {
                    let along = points.iter().map(|point| sign * point[axis]);
                    along.fold(f64::NEG_INFINITY, f64::max)
                };
                let apart = farthest(&own.concat()) - farthest(&object.vertices_m);
                assert!(apart.abs() < BOUNDS_M, "{key}: {apart} m along {axis}");
            }
        }
    }

    for (key, artifact) in &newest("candidates", "replay") {
        let candidates: Candidates = lake::table::read(artifact).unwrap();
        let candidate = &candidates.candidates[0];
        let traces = bench
            .lake()
            .join("files/own/mujoco/rollouts")
            .join(key.as_str());
        let trace = fs::read(traces.join(format!("{}.json", candidate.candidate_id))).unwrap();
        let trace: Value = serde_json::from_slice(&trace).unwrap();
        let asked = RestingPose::of(&candidate.table_from_object);
        let found = RestingPose::of(&pose(&trace["table_from_object"]));
        let turned_rad = found.up_in_object.angle(&asked.up_in_object);
        println!("{key}: rests {turned_rad:.3} rad from the pose asked for");
        assert!(turned_rad < TURNED_RAD, "{key}: {turned_rad} rad");
    }

    let (ours, theirs) = (verdicts(&lake, "screen"), verdicts(&lake, "mujoco"));
    assert_eq!(ours.len(), 2);
    assert_eq!(ours, theirs);
}

/// The corners of each part in a table of `parts.py`.
fn points_of_parts(artifact: &Artifact) -> Vec<Vec<[f64; 3]>> {
    let rows = lake::table::read_batch(artifact).unwrap();
    let lists = rows.column_by_name("points_m").unwrap();
    let lists = lists
        .as_any()
        .downcast_ref::<arrow_array::ListArray>()
        .unwrap();
    let points = |list: arrow_array::ArrayRef| -> Vec<[f64; 3]> {
        let numbers = list
            .as_any()
            .downcast_ref::<arrow_array::Float64Array>()
            .unwrap();
        numbers
            .values()
            .chunks(3)
            .map(|p| [p[0], p[1], p[2]])
            .collect()
    };
    lists.iter().map(|list| points(list.unwrap())).collect()
}

/// Each candidate's verdict by a stage.
fn verdicts(lake: &Lake, stage: &str) -> BTreeMap<String, Verdict> {
    let parts = lake.newest_partitions("rollouts", Some(stage)).unwrap();
    let rows = parts
        .values()
        .flat_map(|part| lake::table::read::<Rollouts>(part).unwrap());
    rows.map(|row| (row.candidate_id, row.verdict)).collect()
}

#[test]
fn verdicts_on_recorded_grasps_agree() {
    let (Some(python), Some(folder)) = (python(&MODULES), named_by("PIPELINE_MUJOCO_GRASPS"))
    else {
        return;
    };
    let xml = fs::read_to_string(folder.join("scene.xml")).unwrap();
    let grasps: Vec<Value> =
        serde_json::from_slice(&fs::read(folder.join("grasps.json")).unwrap()).unwrap();
    let (object, height_m) = can(&xml);
    let hand = RobotModel::from_urdf(include_str!("../../data/robots/allegro_right.urdf")).unwrap();
    let candidates = Candidates {
        object: "can".to_owned(),
        joints: hand.joint_names().into(),
        candidates: grasps
            .iter()
            .enumerate()
            .map(|(idx, grasp)| candidate(&hand, idx, grasp, height_m))
            .collect(),
    };
    let job = TempDir::new().unwrap();
    let part = |input: &str| {
        let folder = job.path().join(input);
        fs::create_dir_all(&folder).unwrap();
        folder
    };
    lake::table::write(&part("candidates"), &candidates).unwrap();
    lake::table::write(&part("objects"), &object).unwrap();
    lake::table::write(&part("out"), &Rollouts::new()).unwrap();
    fs::rename(
        part("out").join(lake::table::FILE),
        job.path().join("template.parquet"),
    )
    .unwrap();
    let input = |name: &str| json!([{"partition": "can", "files": {"part.parquet": format!("{name}/part.parquet")}}]);
    let none = 1e9;
    let description = json!({
        "partition": "can",
        "options": {
            "scene": {"drive": {"stiffness": 20.0, "damping": 2.0, "torque_limit": 1.0, "armature": 0.001}},
            "protocol": {
                "flexion_joints": [], "reach_s": 1.0, "squeeze_rad": 0.0, "squeeze_s": 0.0, "pause_s": 0.0,
                "lift_s": 0.3, "hold_s": 1.0, "min_links": 0, "max_slip_m_per_s": none, "knocked_m": none,
                "knocked_rad": none, "limit_tolerance_rad": none, "table_tolerance_m": none,
                "early_tolerance_m": none,
                "strict": {
                    "min_fingers": 0, "max_spin_rad_per_s": none, "palm_table_tolerance_m": none,
                    "start_tolerance_m": none,
                },
            },
            "max_penetration_m": 1.0,
        },
        "files": {"hand": format!("{}/data/robots/allegro_right.urdf", env!("CARGO_MANIFEST_DIR"))},
        "inputs": {"candidates": input("candidates"), "objects": input("objects")},
        "output": {"artifact": "rollouts", "template": "template.parquet", "table": "out/part.parquet"},
    });
    fs::write(job.path().join("job.json"), description.to_string()).unwrap();
    let judged = Command::new(python)
        .arg("-B")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join(JUDGE))
        .current_dir(job.path())
        .output()
        .unwrap();
    assert!(judged.status.success(), "{}", stderr(&judged));
    let made = Artifact {
        key: "can".parse().unwrap(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(
            lake::table::FILE.to_owned(),
            job.path().join("out/part.parquet"),
        )]),
    };
    // The program's table lacks the schema's name, which the stage adds.
    let rows = lake::table::read_batch(&made).unwrap();
    let text = |name: &str| -> Vec<String> {
        let column = rows.column_by_name(name).unwrap();
        let column = column
            .as_any()
            .downcast_ref::<arrow_array::StringArray>()
            .unwrap();
        column.iter().map(|text| text.unwrap().to_owned()).collect()
    };
    let lift = rows.column_by_name("lift_m").unwrap();
    let lift = lift
        .as_any()
        .downcast_ref::<arrow_array::Float64Array>()
        .unwrap();
    let verdicts = text("reason").into_iter().zip(lift.iter());
    // The recorded script judges by height alone.
    let held: Vec<bool> = verdicts
        .map(|(reason, lift_m)| reason == "held" && (0.1..0.3).contains(&lift_m.unwrap()))
        .collect();
    let recorded: Vec<bool> = grasps
        .iter()
        .map(|grasp| grasp["held"].as_bool().unwrap())
        .collect();
    let agreements = held.iter().zip(&recorded).filter(|(a, b)| a == b).count();
    let said = format!(
        "{agreements} of {} verdicts agree; successes: {} here, {} recorded",
        recorded.len(),
        held.iter().filter(|held| **held).count(),
        recorded.iter().filter(|held| **held).count(),
    );
    println!("{said}");
    assert!(
        recorded.len() == 62 && agreements >= MIN_AGREEMENTS,
        "{said}"
    );
}

/// The numbers of an attribute of the first element after `start`.
fn numbers(xml: &str, start: &str, attribute: &str) -> Vec<f64> {
    let element = &xml[xml.find(start).unwrap()..];
    let from = element.find(&format!(" {attribute}=\"")).unwrap() + attribute.len() + 3;
    let text = &element[from..];
    let text = &text[..text.find('"').unwrap()];
    text.split_whitespace()
        .map(|number| number.parse().unwrap())
        .collect()
}

/// The can of the recorded scene, and the height of its origin above the table.
fn can(xml: &str) -> (Object, f64) {
    let body = &xml[xml.find(r#"<body name="can""#).unwrap()..];
    let of_mass = |attribute| numbers(body, "<inertial", attribute);
    let axes = of_mass("quat");
    let axes = UnitQuaternion::from_quaternion(Quaternion::new(axes[0], axes[1], axes[2], axes[3]));
    let axes = axes.to_rotation_matrix();
    let moments = nalgebra::Matrix3::from_diagonal(&Vector3::from_vec(of_mass("diaginertia")));
    let m = axes * moments * axes.inverse();
    let vertices = numbers(xml, r#"<mesh name="can""#, "vertex");
    let vertices: Vec<[f64; 3]> = vertices.chunks(3).map(|p| [p[0], p[1], p[2]]).collect();
    let height_m = numbers(body, "<body", "pos")[2];
    let center = of_mass("pos");
    let object = Object {
        name: "can".to_owned(),
        mass_kg: of_mass("mass")[0],
        center_of_mass_m: [center[0], center[1], center[2]],
        inertia_kg_m2: [
            m[(0, 0)],
            m[(1, 1)],
            m[(2, 2)],
            m[(0, 1)],
            m[(0, 2)],
            m[(1, 2)],
        ],
        points_m: vertices.clone(),
        normals: vec![[0.0, 0.0, 1.0]; vertices.len()],
        watertight: true,
        mirror: None,
        triangles: vec![[0, 1, 2]],
        parts_m: vec![vertices.clone()],
        vertices_m: vertices,
        rests: vec![RestingOrientation {
            rest: RestingPose {
                up_in_object: Vector3::z_axis(),
                height_m,
            },
            seen_n: 1,
            probability: 1.0,
        }],
    };
    (object, height_m)
}

/// The palm stands still; the fingers wait 0.2 s, close in 0.6 s, and press for 0.2 s.
fn candidate(hand: &RobotModel, idx: usize, grasp: &Value, height_m: f64) -> Candidate {
    let numbers = |key: &str| -> Vec<f64> { serde_json::from_value(grasp[key].clone()).unwrap() };
    let at = |finger: &[f64], thumb: &[f64]| {
        let mut q = vec![0.0; hand.dof()];
        let positions = finger.repeat(3).into_iter().chain(thumb.iter().copied());
        for (joint, position) in positions.enumerate() {
            q[hand.joint(&format!("joint_{joint}.0")).unwrap()] = position;
        }
        q
    };
    let open = at(&[0.0, 0.1, 0.1, 0.1], &[1.0, 0.0, 0.0, 0.0]);
    let closed = at(&numbers("finger_close_rad"), &numbers("thumb_close_rad"));
    let root = numbers("root_in_world");
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, 0.5, 0.5, 0.5));
    let place = Translation3::new(root[0], root[1], root[2] - height_m);
    let step = |(time_s, q): (f64, &Vec<f64>)| Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::from_parts(place, turn)),
        q_rad: q.clone(),
        rates: HandRates {
            palm_velocity: Twist::from_array([0.0; 6]),
            palm_acceleration: Twist::from_array([0.0; 6]),
            joints: JointRates::zero(q.len()),
        },
    };
    let steps = [(0.0, &open), (0.2, &open), (0.8, &closed), (1.0, &closed)].map(step);
    let joints: Arc<[String]> = hand.joint_names().into();
    Candidate {
        candidate_id: format!("can-{idx:04}"),
        generator: "scripted".to_owned(),
        source: DrawSource::replayed("scripted"),
        latent: Vec::new(),
        table_from_object: Pose::from_parts([0.0, 0.0, height_m], UnitQuaternion::identity()),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion: Motion::of_joints(joints, steps.to_vec()).unwrap(),
    }
}
