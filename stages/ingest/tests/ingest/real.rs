//! On real recordings, if `PIPELINE_REAL_DATA` names the folder that holds them.

use std::{collections::BTreeMap, fs, path::PathBuf};

use dataflow::{Outcome, Partition, Scope, SourceFile, Stage};
use nalgebra::{Matrix3, Point3};
use npyz::npz::NpzArchive;
use stage_ingest::Ingest;

/// Returns a real dataset's folder; says so and returns `None` where there is none.
pub(crate) fn real(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("PIPELINE_REAL_DATA").map(|root| PathBuf::from(root).join(name));
    let folder = folder.filter(|folder| folder.is_dir());
    if folder.is_none() {
        eprintln!("skipped: `PIPELINE_REAL_DATA` holds no `{name}`");
    }
    folder
}

fn array(file: &SourceFile, name: &str) -> Vec<f64> {
    let mut npz = NpzArchive::open(&file.path).unwrap();
    let numbers: Vec<f32> = npz.by_name(name).unwrap().unwrap().into_vec().unwrap();
    numbers.into_iter().map(f64::from).collect()
}

/// The grasped object's number among the scene's, from the text of `meta.yml`.
fn grasp_idx(meta: &str) -> usize {
    let line = meta
        .lines()
        .find(|line| line.starts_with("ycb_grasp_ind:"))
        .unwrap();
    line["ycb_grasp_ind:".len()..].trim().parse().unwrap()
}

#[test]
fn every_real_recording_gives_its_reach() {
    let Some(root) = real("dexycb-right") else {
        return;
    };
    let config = super::config(&root);
    let units = super::units(&config);
    assert_eq!(units.len(), 376);
    let (mut n_filtered, mut n_exact, mut n_on_table) = (0, 0, 0);
    let mut by_object: BTreeMap<String, usize> = BTreeMap::new();
    for unit in &units {
        let (demonstration, _) = match super::demonstration(&config, unit) {
            Ok(made) => made,
            Err(Outcome::Filtered { .. }) => {
                n_filtered += 1;
                continue;
            }
            Err(other) => panic!("{}: {other:?}", unit.partition),
        };
        *by_object.entry(demonstration.object.clone()).or_default() += 1;
        let file = |end: &str| {
            unit.files
                .iter()
                .find(|file| file.name.ends_with(end))
                .unwrap()
        };
        let grasped = grasp_idx(&fs::read_to_string(&file("meta.yml").path).unwrap());
        // The object's own pose in each image, as the file has it.
        let poses = array(file("pose.npz"), "pose_y");
        let images = array(file("pose.npz"), "pose_m").len() / 51;
        let per_image = poses.len() / images;
        let pose = |image: usize| &poses[image * per_image + 7 * grasped..][..7];
        let last_still = (1..images).find(|&image| pose(image) != pose(0)).unwrap() - 1;
        let grasp = demonstration.steps.last().unwrap();
        n_exact += usize::from(grasp.image as usize == last_still);
        for step in &demonstration.steps {
            let label = file(&format!("labels_{:06}.npz", step.image));
            let joints = array(label, "joint_3d");
            let pose_y = array(label, "pose_y");
            let m: [f64; 12] = pose_y[12 * grasped..][..12].try_into().unwrap();
            let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
            let inverse = rotation.try_inverse().unwrap();
            for (point, joint) in step.keypoints_m.iter().zip(joints.chunks_exact(3)) {
                let in_camera = Point3::new(joint[0] - m[3], joint[1] - m[7], joint[2] - m[11]);
                let error_m = (Point3::from(*point) - inverse * in_camera).norm();
                assert!(error_m < 1e-6, "{}: {error_m} m", unit.partition);
            }
        }
        let mesh = fs::read_to_string(
            root.join("models")
                .join(&demonstration.object)
                .join("textured_simple.obj"),
        )
        .unwrap();
        let mesh = geometry::TriMesh::from_obj(&mesh).unwrap();
        let table_from_object = demonstration.rest.table_from_object();
        let lowest_m = mesh
            .vertices_m
            .iter()
            .map(|vertex| table_from_object.point(vertex).z)
            .fold(f64::INFINITY, f64::min);
        n_on_table += usize::from(lowest_m.abs() < 0.010);
    }
    let n_made: usize = by_object.values().sum();
    eprintln!("{n_made} made, {n_filtered} filtered, {n_exact} exact, {n_on_table} on the table");
    assert_eq!((n_made, n_filtered), (361, 15));
    assert_eq!(by_object.len(), 20);
    assert!(
        n_exact * 100 >= 99 * n_made,
        "{n_exact} of {n_made} end at the last still image"
    );
    assert!(
        n_on_table * 100 >= 97 * n_made,
        "{n_on_table} of {n_made} lie on the table"
    );
}

#[test]
fn a_tracked_bottle_that_jitters_gives_a_plausible_grasp() {
    // Its rest jitters by several millimeters and its rotation is unreliable.
    let Some(root) = real("dexmv-mustard") else {
        return;
    };
    let config = super::config(&root);
    let unit = &super::units(&config)[0];
    let (demonstration, _) = super::demonstration(&config, unit).unwrap();
    assert_eq!(demonstration.object, "006_mustard_bottle");
    assert_eq!(demonstration.steps[0].image, 0);
    let last = demonstration.steps.last().unwrap();
    // By eye in the track: the hand arrives at image 60, the bottle is surely away at image 77.
    assert!((60..=76).contains(&last.image), "{}", last.image);
    let wrist = Point3::from(last.keypoints_m[0]);
    assert!(wrist.coords.norm() < 0.15, "wrist {wrist}");
}

#[test]
fn every_real_object_lies_as_its_demonstrations_saw_it() {
    let Some(root) = real("dexycb-right") else {
        return;
    };
    let config = super::config(&root);
    let lake = tempfile::tempdir().unwrap();
    let mut made_by_key = BTreeMap::new();
    for unit in super::units(&config) {
        let folder = lake.path().join(&unit.partition);
        fs::create_dir(&folder).unwrap();
        let outcome = super::run(&config, "demonstrations", &unit, BTreeMap::new(), &folder);
        if let Outcome::Made(made) = outcome.unwrap() {
            made_by_key.insert(unit.partition.clone(), (made, folder));
        }
    }
    let partitions = made_by_key
        .iter()
        .map(|(key, (made, _))| Partition::new(key.clone(), made.labels.clone()));
    let scope = Scope::new(BTreeMap::from([(
        "demonstrations".to_owned(),
        partitions.collect(),
    )]));
    let units = Ingest::units(&config, "objects", &scope).unwrap();
    assert_eq!(units.len(), 20);
    for unit in &units {
        let artifacts: Vec<_> = unit.reads["demonstrations"]
            .iter()
            .map(|key| super::artifact(key, &made_by_key[key].0, &made_by_key[key].1))
            .collect();
        let n_seen = artifacts.len();
        let read = BTreeMap::from([("demonstrations".to_owned(), artifacts)]);
        let folder = tempfile::tempdir().unwrap();
        let outcome = super::run(&config, "objects", unit, read, folder.path()).unwrap();
        let Outcome::Made(made) = outcome else {
            panic!("{}: {outcome:?}", unit.partition);
        };
        let artifact = super::artifact(&unit.partition, &made, folder.path());
        let batch = lake::table::read(&artifact).unwrap();
        let object = schemas::objects::from_batch(&unit.partition, &batch).unwrap();
        let seen: Vec<u32> = object.rests.iter().map(|rest| rest.seen_n).collect();
        eprintln!(
            "{}: {} parts, rests seen {seen:?}",
            unit.partition,
            object.parts_m.len()
        );
        assert_eq!(seen.iter().sum::<u32>() as usize, n_seen);
        assert!(seen.is_sorted_by(|a, b| a >= b));
        assert!(object.parts_m.len() <= config.max_convex_parts_n);
    }
}
