//! Claims of `pipelines/interpolation.toml`, on the recordings of the bundled sample: motions along
//! a path between two demonstrations, side by side in one recording.

use std::{collections::BTreeMap, fs, process::Command};

use nalgebra::{Isometry3, Translation3};
use robot::RobotModel;
use schemas::ros2::{TfMessage, motion};
use serde_json::Value;
use tempfile::TempDir;
use toml_edit::DocumentMut;

use crate::program::bench::{Bench, put, stderr};

/// The pipeline file, from the root of the project.
const FILE: &str = "pipelines/interpolation.toml";
/// Meters that count as much as a radian where hands are compared.
const ARM_M: f64 = 0.1;

/// A hand at one time.
struct Hand {
    object_from_palm: Isometry3<f64>,
    q_rad: Vec<f64>,
}

/// The recipe of the bundled sample with less search for good grasps, which names nothing else.
fn quick_recipe() -> String {
    let recipe = include_str!("../../data/sample/recipe.toml");
    let lines = recipe.lines().map(|line| match line.split_once(" = ") {
        Some(("grasp_draws", _)) => "grasp_draws = 100",
        Some(("grasp_tries", _)) => "grasp_tries = 3",
        _ => line,
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Runs the file with little training on the recordings of its one object.
fn interpolated() -> (Bench, TempDir) {
    let sample = TempDir::new().unwrap();
    put(&sample.path().join("recipe.toml"), &quick_recipe());
    let bench = Bench::on(sample.path().to_owned());
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", FILE, "--lake"])
        .arg(bench.lake());
    for value in [
        &format!("ingest.root={}", sample.path().display()),
        "ingest.objects=[\"006_mustard_bottle\"]",
        "train.held_out_share=0.0",
        "train.network.points=64",
        "train.training.epochs=400",
    ] {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    (bench, sample)
}

/// Asks the lake in SQL.
fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let answer = bench.ask(&["query", sql, "--format", "json"]);
    assert!(answer.status.success(), "{}", stderr(&answer));
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    rows.collect::<Result<_, _>>().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap()
}

fn hand(pose: &Value, q_rad: &[f64]) -> Hand {
    let [x, y, z, i, j, k, w] = numbers(pose)[..] else {
        panic!("{pose}");
    };
    let rotation = spatial::quaternion_xyzw([i, j, k, w]).unwrap();
    Hand {
        object_from_palm: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        q_rad: q_rad.to_vec(),
    }
}

/// Returns the distance between two motions: the mean over equal parts of their time.
fn apart(a: &[Hand], b: &[Hand]) -> f64 {
    const PARTS: usize = 20;
    let at = |motion: &[Hand], part: usize| (part * (motion.len() - 1) + PARTS / 2) / PARTS;
    let parts = (0..=PARTS).map(|part| {
        let (a, b) = (&a[at(a, part)], &b[at(b, part)]);
        let (pose_a, pose_b) = (&a.object_from_palm, &b.object_from_palm);
        let way = pose_a.translation.vector - pose_b.translation.vector;
        let squares = a.q_rad.iter().zip(&b.q_rad).map(|(a, b)| (a - b).powi(2));
        let joints = (squares.sum::<f64>() / a.q_rad.len() as f64).sqrt();
        way.norm() / ARM_M + pose_a.rotation.angle_to(&pose_b.rotation) + joints
    });
    parts.sum::<f64>() / (PARTS + 1) as f64
}

#[test]
fn motions_go_from_one_demonstration_to_another_side_by_side() {
    let path = format!("{}/{FILE}", env!("CARGO_MANIFEST_DIR"));
    let file: DocumentMut = fs::read_to_string(path).unwrap().parse().unwrap();
    let options = &file["stages"]["sample"];
    let ends = options["path"].as_array().unwrap().iter();
    let ends: Vec<&str> = ends.map(|name| name.as_str().unwrap()).collect();
    let n_motions = usize::try_from(options["per_object"].as_integer().unwrap()).unwrap();
    let n_steps = usize::try_from(options["steps"].as_integer().unwrap()).unwrap();

    let (bench, _sample) = interpolated();
    let rows = ask(
        &bench,
        "select candidate_id, latent, object_from_palm, q_rad from candidates order by candidate_id",
    );
    assert_eq!(rows.len(), n_motions);
    let motions: Vec<Vec<Hand>> = rows
        .iter()
        .map(|row| {
            let poses = row["object_from_palm"].as_array().unwrap();
            assert_eq!(poses.len(), n_steps);
            let q_rad = numbers(&row["q_rad"]);
            let q_rad = q_rad.chunks_exact(q_rad.len() / n_steps);
            poses.iter().zip(q_rad).map(|(p, q)| hand(p, q)).collect()
        })
        .collect();

    // The first motion is more like the one demonstration than like any other, the last like the other.
    let mut shown: BTreeMap<String, Vec<Hand>> = BTreeMap::new();
    for row in ask(
        &bench,
        "select sequence, object_from_palm, q_rad from trajectories order by sequence, step",
    ) {
        let sequence = row["sequence"].as_str().unwrap().to_owned();
        let hand = hand(&row["object_from_palm"], &numbers(&row["q_rad"]));
        shown.entry(sequence).or_default().push(hand);
    }
    assert!(shown.len() > 3, "{:?}", shown.keys());
    for (motion, expected) in [(&motions[0], ends[0]), (&motions[n_motions - 1], ends[1])] {
        let distances = shown
            .iter()
            .map(|(name, other)| (name, apart(motion, other)));
        let distances: Vec<(&String, f64)> = distances.collect();
        let nearest = distances.iter().min_by(|(_, a), (_, b)| a.total_cmp(b));
        assert_eq!(nearest.unwrap().0, expected, "{distances:?}");
    }

    // Between them the code goes in equal steps, and the motion changes little from each to the next.
    let latents: Vec<Vec<f64>> = rows.iter().map(|row| numbers(&row["latent"])).collect();
    let (first, last) = (&latents[0], &latents[n_motions - 1]);
    assert_ne!(first, last);
    for (number, latent) in latents.iter().enumerate() {
        let share = number as f64 / (n_motions - 1) as f64;
        for (found, (from, to)) in latent.iter().zip(first.iter().zip(last)) {
            assert!((found - (from + share * (to - from))).abs() < 1e-9);
        }
    }
    let whole = apart(&motions[0], &motions[n_motions - 1]);
    for pair in motions.windows(2) {
        let one = apart(&pair[0], &pair[1]);
        assert!(0.0 < one && one < 0.5 * whole, "{one} of {whole}");
    }

    check_recording(&bench, &rows, &motions);
}

/// Compares the recording for viewers with the motions: each above a table of its own, in a row.
fn check_recording(bench: &Bench, rows: &[Value], motions: &[Vec<Hand>]) {
    let path = "files/interpolation/sample/candidates/006_mustard_bottle/motions.mcap";
    let contents = lake::recording::read(&bench.lake().join(path)).unwrap();
    let names = rows.iter().map(|row| row["candidate_id"].as_str().unwrap());
    let names: Vec<&str> = names.collect();
    assert_eq!(contents.about["candidate_ids"], names.join(","));
    let poses = |topic: &str| -> Vec<BTreeMap<(String, String), Isometry3<f64>>> {
        let messages = contents.topic(topic);
        let messages = messages.map(|message| message.decode::<TfMessage>().unwrap().unwrap());
        let pose = |transform: schemas::ros2::TransformStamped| {
            let (t, r) = (
                transform.transform.translation,
                transform.transform.rotation,
            );
            let rotation = spatial::quaternion_xyzw([r.x, r.y, r.z, r.w]).unwrap();
            let pose = Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), rotation);
            let frames = (transform.header.frame_id, transform.child_frame_id);
            (frames, pose)
        };
        messages
            .map(|message| message.transforms.into_iter().map(pose).collect())
            .collect()
    };
    let fixed = poses(motion::TF_STATIC);
    let steps = poses(motion::TF);
    assert_eq!((fixed.len(), steps.len()), (1, motions[0].len()));
    let urdf = format!(
        "{}/data/robots/allegro_right.urdf",
        env!("CARGO_MANIFEST_DIR")
    );
    let model = RobotModel::from_urdf(&fs::read_to_string(urdf).unwrap()).unwrap();
    let palm = &model.links()[0].name;
    let between = |parent: &str, child: String| (parent.to_owned(), child);
    let mut places = Vec::new();
    for (number, hands) in motions.iter().enumerate() {
        let own = format!("motion_{number}");
        places.push(
            fixed[0][&between(motion::TABLE, own.clone())]
                .translation
                .vector,
        );
        let own_from_object = fixed[0][&between(&own, format!("{own}/object"))];
        for (step, hand) in steps.iter().zip(hands) {
            let own_from_palm = step[&between(&own, format!("{own}/{palm}"))];
            let off = (own_from_object * hand.object_from_palm).inv_mul(&own_from_palm);
            assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-6);
        }
    }
    for pair in places.windows(2) {
        let beside = pair[1] - pair[0];
        // Wider than the hand, and all in one row.
        assert!(beside.y > 0.3 && beside.x == 0.0 && beside.z == 0.0);
    }
}
