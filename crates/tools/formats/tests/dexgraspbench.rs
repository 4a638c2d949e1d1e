//! Grasps are read back with the poses and joints that were exported, by numpy, and simulated by the evaluator
//! of `DexGraspBench`.
//!
//! `PIPELINE_PYTHON` names a Python with `numpy`; `PIPELINE_DEXGRASPBENCH` the folder of the evaluator, with the
//! meshes of its hands, whose packages that Python has. What is not there is skipped, and it is said.

mod motions;

use std::{collections::BTreeMap, path::Path, process::Command};

use formats::{BenchObject, Episode, EpisodeStep, Export, GraspTimes, to_dexgraspbench};
use geometry::TriMesh;
use motions::{ask, assert_near, episodes, joints, python, write};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use spatial::Pose;

const TIMES: GraspTimes = GraspTimes {
    pregrasp: 0.6,
    grasp: 0.85,
};

/// A box of 60 mm by 120 mm by 100 mm as two convex parts.
fn boxes() -> BTreeMap<String, BenchObject> {
    let cuboid =
        |from: f64, to: f64| TriMesh::cuboid([-0.03, -0.06, from].into(), [0.03, 0.06, to].into());
    let part = |from, to| {
        let corners = cuboid(from, to).vertices_m.into_iter();
        corners
            .map(|corner| [corner.x, corner.y, corner.z])
            .collect()
    };
    let object = BenchObject {
        mass_kg: 0.2,
        center_of_mass_m: [0.0; 3],
        mesh: cuboid(-0.05, 0.05),
        parts_m: vec![part(-0.05, 0.0), part(0.0, 0.05)],
    };
    ["025_mug", "004_sugar_box"]
        .map(|name| (name.to_owned(), object.clone()))
        .into()
}

fn export(episodes: &[Episode], objects_at: &str) -> Export {
    to_dexgraspbench(episodes, &boxes(), TIMES, objects_at, "allegro_right").unwrap()
}

/// Position and quaternion, w first.
fn wxyz<A, B>(pose: &Pose<A, B>) -> Vec<f64> {
    let [px, py, pz, x, y, z, w] = pose.to_array();
    vec![px, py, pz, w, x, y, z]
}

/// The hand as the evaluator's, by its own words: joints in the order of their numbers; its root such that the
/// palm, turned in it by the quaternion (w 0, x 1, y 0, z 1), stands where ours stands.
fn qpos(step: &EpisodeStep) -> Vec<f64> {
    let palm = UnitQuaternion::from_quaternion(Quaternion::new(0.0, 1.0, 0.0, 1.0));
    let root = *step.table_from_palm * Isometry3::from_parts([0.0; 3].into(), palm).inverse();
    let mut numbers = wxyz(&Pose::<spatial::Table, spatial::Palm>::new(root));
    let mut by_number: Vec<(usize, f64)> = joints()
        .iter()
        .map(|joint| {
            joint.name["joint_".len()..]
                .trim_end_matches(".0")
                .parse()
                .unwrap()
        })
        .zip(step.q.iter().copied())
        .collect();
    by_number.sort_by_key(|(number, _)| *number);
    numbers.extend(by_number.into_iter().map(|(_, q)| q));
    numbers
}

#[test]
fn numpy_loads_what_was_exported() {
    let Some(python) = python(&["numpy"]) else {
        return;
    };
    let folder = write(&export(&episodes(), "somewhere/objects"), "dexgraspbench");
    for episode in &episodes() {
        let file = folder.join(format!(
            "graspdata/{}/{}.npy",
            episode.object(),
            episode.name()
        ));
        let loaded = ask(&python, "load_npy.py", &[&file]);
        assert_eq!(
            loaded["obj_path"],
            format!("somewhere/objects/{}", episode.object())
        );
        assert_eq!(loaded["obj_scale"], 1.0);
        let at = |fraction: f64| episode.at(fraction * episode.duration_s());
        assert_near(
            &loaded["obj_pose"],
            wxyz(&at(TIMES.pregrasp).table_from_object),
        );
        for (key, fraction) in [
            ("pregrasp_qpos", TIMES.pregrasp),
            ("grasp_qpos", TIMES.grasp),
            ("squeeze_qpos", 1.0),
        ] {
            assert_near(&loaded[key], qpos(&at(fraction)));
        }
        assert_eq!(loaded["dtypes"], "float64");
    }
}

/// A hand whose straight fingers, pointing down, lay their tips on a side of the box, or stay away from it.
fn touch(name: &str, aside_m: f64) -> Episode {
    // The fingers, along the palm's z, point down; its normal x, along which they curl, points to the box.
    let palm = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI);
    let closing = |(time_s, flexion): (f64, f64)| {
        let q = |name: &str| match name {
            "joint_1.0" | "joint_5.0" | "joint_9.0" => flexion,
            "joint_12.0" => 0.3,
            _ => 0.0,
        };
        EpisodeStep {
            time_s,
            table_from_palm: Pose::from_parts([0.075 + aside_m, 0.0, 0.18], palm),
            table_from_object: Pose::from_parts([0.0, 0.0, 0.05], UnitQuaternion::identity()),
            q: joints().iter().map(|joint| q(&joint.name)).collect(),
            q_command: None,
        }
    };
    let steps = [(0.0, 0.0), (0.6, 0.1), (0.85, 0.28), (1.0, 0.32)].map(closing);
    Episode::new(name, "025_mug", &joints(), &steps).unwrap()
}

#[test]
fn the_evaluator_reads_and_simulates_what_was_exported() {
    let Some(bench) = measured_data::named_by("PIPELINE_DEXGRASPBENCH") else {
        return;
    };
    let Some(python) = python(&[
        "mujoco",
        "hydra",
        "torch",
        "qpsolvers",
        "imageio",
        "sklearn",
    ]) else {
        return;
    };
    let objects_at = Path::new(env!("CARGO_TARGET_TMPDIR")).join("evaluated/objects");
    let grasps = [touch("near", 0.0), touch("far", 0.2)];
    let folder = write(&export(&grasps, objects_at.to_str().unwrap()), "evaluated");
    let ran = Command::new(&python)
        .current_dir(&bench)
        .args([
            "src/main.py",
            "task=eval",
            "hand=allegro",
            "setting=tabletop",
            "n_worker=1",
        ])
        .arg(format!("save_dir={}", folder.display()))
        .output()
        .unwrap();
    assert!(
        ran.status.success(),
        "{}",
        String::from_utf8_lossy(&ran.stderr)
    );
    let result = |name: &str| {
        let file = folder.join(format!("evaluation/025_mug/{name}.npy"));
        ask(&python, "load_npy.py", &[&file])
    };
    let [near, far] = ["near", "far"].map(result);
    println!("near: {near}\nfar: {far}");
    // What it read is what was written; a hand that is elsewhere touches nothing, and its object stays behind by
    // the lift of 100 mm.
    assert_near(&near["grasp_qpos"], qpos(&grasps[0].at(TIMES.grasp)));
    assert_eq!(far["contact_num"], 0);
    assert_eq!(far["succ_flag"], false);
    assert!(
        (far["delta_pos"].as_f64().unwrap() - 0.1).abs() < 5e-3,
        "{far}"
    );
    // The three fingertips are on the box within a few millimeters, the thumb is not: its distance counts as 10 mm.
    assert_eq!(near["contact_num"], 3);
    let distance_m = near["contact_dist"].as_f64().unwrap();
    assert!((0.0024..0.005).contains(&distance_m), "{near}");
}
