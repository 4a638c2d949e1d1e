//! On real recordings, if `PIPELINE_REAL_DATA` names the folder that holds them.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::LazyLock,
};

use dataflow::{Outcome, SourceFile, Unit};
use geometry::{SurfaceDistance, TriMesh};
use nalgebra::{Matrix3, Point3};
use npyz::npz::NpzArchive;
use schemas::demonstrations::{Demonstration, Side};

use stage_ingest::TableRule;

use crate::bench::{Bench, config};

/// All that is made of the right hands, made once.
static RIGHT: LazyLock<Option<Bench>> =
    LazyLock::new(|| measured_data::folder("dexycb-right").map(|root| Bench::new(config(&root))));

impl Bench {
    /// The recordings that became demonstrations.
    fn demonstrations(&self) -> impl Iterator<Item = (&Unit, Demonstration)> {
        let made = self.units["demonstrations"].iter().filter(|unit| {
            let outcome = &self.outcomes[&("demonstrations", unit.partition.clone())];
            matches!(outcome, Outcome::Labeled(..))
        });
        made.map(|unit| (unit, self.demonstration(&unit.partition)))
    }

    fn mesh(&self, object: &str) -> TriMesh {
        let path = self.path("shapes", object).join("mesh.obj");
        TriMesh::from_obj(&fs::read_to_string(path).unwrap()).unwrap()
    }
}

fn array(file: &SourceFile, name: &str) -> Vec<f64> {
    let mut npz = NpzArchive::open(&file.path).unwrap();
    let numbers: Vec<f32> = npz.by_name(name).unwrap().unwrap().into_vec().unwrap();
    numbers.into_iter().map(f64::from).collect()
}

fn file<'a>(unit: &'a Unit, end: &str) -> &'a SourceFile {
    let mut files = unit.files.iter();
    files.find(|file| file.name.ends_with(end)).unwrap()
}

/// The scalar or the list behind a key, from the text of `meta.yml` and no parser's help.
fn words(meta: &str, key: &str) -> Vec<String> {
    let mut lines = meta.lines().skip_while(|line| !line.starts_with(key));
    let first = lines.next().unwrap()[key.len()..].trim_matches([':', ' ', '[', ']']);
    let rest = lines.take_while(|line| line.starts_with("- ") || line.starts_with("  - "));
    let rest: Vec<String> = rest
        .map(|line| {
            line.trim_start_matches([' ', '-'])
                .trim_matches('\'')
                .to_owned()
        })
        .collect();
    if first.is_empty() {
        rest
    } else {
        first
            .split(',')
            .map(|word| word.trim().trim_matches('\'').to_owned())
            .collect()
    }
}

/// The grasped object's number among the scene's.
fn grasped(unit: &Unit) -> usize {
    let meta = fs::read_to_string(&file(unit, "meta.yml").path).unwrap();
    words(&meta, "ycb_grasp_ind")[0].parse().unwrap()
}

/// Every `meta.yml` in a folder's folder, with the name of the upper one.
fn descriptions(root: &Path) -> Vec<(String, PathBuf)> {
    let folders = |path: &Path| -> Vec<PathBuf> {
        let entries = fs::read_dir(path)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        entries.filter(|path| path.is_dir()).collect()
    };
    let mut found = Vec::new();
    for subject in folders(root) {
        let name = subject.file_name().unwrap().to_str().unwrap().to_owned();
        let metas = folders(&subject)
            .into_iter()
            .map(|path| path.join("meta.yml"));
        found.extend(
            metas
                .filter(|meta| meta.is_file())
                .map(|meta| (name.clone(), meta)),
        );
    }
    found
}

#[test]
fn counts_are_those_of_the_recordings_descriptions() {
    let Some(bench) = &*RIGHT else { return };
    // By side, subject and object's number, from the files alone.
    let mut expected: BTreeMap<(String, String, usize), usize> = BTreeMap::new();
    for (subject, meta) in descriptions(&bench.config.root) {
        let text = fs::read_to_string(meta).unwrap();
        let grasped: usize = words(&text, "ycb_grasp_ind")[0].parse().unwrap();
        let number = words(&text, "ycb_ids")[grasped].parse().unwrap();
        let side = words(&text, "mano_sides").remove(0);
        *expected.entry((side, subject, number)).or_default() += 1;
    }
    // The names of the objects' folders begin with YCB's numbers, in the order of the dataset's, but
    // for the clamps and the brick, of which it lacks one.
    let mut names: Vec<String> = fs::read_dir(bench.config.root.join("models"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let number = |name: &str| {
        let place = 1 + names.iter().position(|other| other == name).unwrap();
        if names.len() == 20 && place >= 19 {
            place + 1
        } else {
            place
        }
    };
    let mut found: BTreeMap<(String, String, usize), usize> = BTreeMap::new();
    for (_, demonstration) in bench.demonstrations() {
        let side = demonstration.hand.as_str().to_owned();
        let key = (side, demonstration.subject, number(&demonstration.object));
        *found.entry(key).or_default() += 1;
    }
    let (right, left): (BTreeMap<_, _>, BTreeMap<_, _>) = expected
        .into_iter()
        .partition(|((side, ..), _)| side == "right");
    assert_eq!(found, right);
    let n = |counts: &BTreeMap<_, usize>| counts.values().sum::<usize>();
    assert_eq!((n(&right), n(&left)), (361, 15));
    assert_eq!(bench.units["objects"].len(), 20);
}

#[test]
fn every_landmark_is_the_labels_own() {
    let Some(bench) = &*RIGHT else { return };
    let mut largest_m = 0.0_f64;
    for (unit, demonstration) in bench.demonstrations() {
        let grasped = grasped(unit);
        for step in &demonstration.steps {
            let label = file(unit, &format!("labels_{:06}.npz", step.image));
            let joints = array(label, "joint_3d");
            let pose_y = array(label, "pose_y");
            let m: [f64; 12] = pose_y[12 * grasped..][..12].try_into().unwrap();
            let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
            let inverse = rotation.try_inverse().unwrap();
            for (point, joint) in step.keypoints_m.iter().zip(joints.chunks_exact(3)) {
                let in_camera = Point3::new(joint[0] - m[3], joint[1] - m[7], joint[2] - m[11]);
                let error_m = (Point3::from(*point) - inverse * in_camera).norm();
                largest_m = largest_m.max(error_m);
            }
        }
    }
    eprintln!("largest difference {largest_m:.1e} m");
    assert!(largest_m < 1e-6, "{largest_m} m");
}

#[test]
fn the_grasp_is_the_last_still_image() {
    let Some(bench) = &*RIGHT else { return };
    let (mut n, mut n_exact) = (0, 0);
    for (unit, demonstration) in bench.demonstrations() {
        // The object's own pose in each image, as the file has it.
        let poses = array(file(unit, "pose.npz"), "pose_y");
        let images = array(file(unit, "pose.npz"), "pose_m").len() / 51;
        let per_image = poses.len() / images;
        let pose = |image: usize| &poses[image * per_image + 7 * grasped(unit)..][..7];
        let last_still = (1..images).find(|&image| pose(image) != pose(0)).unwrap() - 1;
        n += 1;
        n_exact += usize::from(demonstration.steps.last().unwrap().image as usize == last_still);
    }
    eprintln!("{n_exact} of {n} end at the last still image");
    assert!(n_exact * 100 >= 99 * n, "{n_exact} of {n}");
}

#[test]
fn finger_tips_are_on_the_object_at_the_grasp() {
    let Some(bench) = &*RIGHT else { return };
    let mut meshes: BTreeMap<String, SurfaceDistance> = BTreeMap::new();
    let mut gaps_m: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (_, demonstration) in bench.demonstrations() {
        let object = &demonstration.object;
        let mesh = meshes
            .entry(object.clone())
            .or_insert_with(|| SurfaceDistance::new(&bench.mesh(object)));
        let grasp = demonstration.steps.last().unwrap();
        for (finger, tip) in [("thumb", 4), ("index", 8), ("middle", 12)] {
            let point = Point3::from(grasp.keypoints_m[tip]);
            let gaps_m = gaps_m.entry(finger).or_default();
            gaps_m.push(mesh.signed_distance(&point).distance_m.abs());
        }
    }
    for (finger, mut gaps_m) in gaps_m {
        gaps_m.sort_by(f64::total_cmp);
        let median_m = gaps_m[gaps_m.len() / 2];
        eprintln!("{finger}: median {:.1} mm from the mesh", 1000.0 * median_m);
        assert!(median_m < 0.008, "{finger}: {median_m} m");
    }
}

#[test]
fn objects_lie_on_the_table_and_hands_stay_above_it() {
    let Some(bench) = &*RIGHT else { return };
    let (mut n, mut n_on_table, mut n_below) = (0, 0, 0);
    for (_, demonstration) in bench.demonstrations() {
        let table_from_object = demonstration.rest.table_from_object();
        let heights = bench.mesh(&demonstration.object).vertices_m.into_iter();
        let lowest_m = heights
            .map(|vertex| (table_from_object * vertex).z)
            .fold(f64::INFINITY, f64::min);
        let grasp = demonstration.steps.last().unwrap().keypoints_m.iter();
        let lowest_landmark_m = grasp
            .map(|&point| (table_from_object * Point3::from(point)).z)
            .fold(f64::INFINITY, f64::min);
        n += 1;
        n_on_table += usize::from(lowest_m.abs() < 0.010);
        n_below += usize::from(lowest_landmark_m < -0.005);
    }
    eprintln!("{n_on_table} of {n} on the table, {n_below} with a landmark below it");
    assert!(n_on_table * 100 >= 97 * n, "{n_on_table} of {n}");
    assert!(n_below * 100 <= 12 * n, "{n_below} of {n}");
}

#[test]
fn every_object_lies_as_its_demonstrations_saw_it() {
    let Some(bench) = &*RIGHT else { return };
    for unit in &bench.units["objects"] {
        let object = bench.object("objects", &unit.partition);
        let seen: Vec<u32> = object.rests.iter().map(|rest| rest.seen_n).collect();
        eprintln!(
            "{}: {} parts, closed {}, rests seen {seen:?}",
            unit.partition,
            object.parts_m.len(),
            object.watertight,
        );
        let n_seen = unit.reads["demonstrations"].len();
        assert_eq!(seen.iter().sum::<u32>() as usize, n_seen);
        assert!(seen.is_sorted_by(|a, b| a >= b));
        assert!(object.parts_m.len() <= bench.config.shape.max_convex_parts_n);
    }
}

#[test]
fn left_hands_become_right_ones() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    let mut config = config(&root);
    config.mirror = true;
    let bench = Bench::until(config, "demonstrations").unwrap();
    let made: Vec<_> = bench.demonstrations().collect();
    let mirrored: Vec<_> = made.iter().filter(|(_, d)| d.mirrored).collect();
    for unit in &bench.units["demonstrations"] {
        match &bench.outcomes[&("demonstrations", unit.partition.clone())] {
            Outcome::Made(_) | Outcome::Labeled(..) | Outcome::Provisional(_) => {}
            Outcome::Skipped { reason } => eprintln!("{}: {reason}", unit.partition),
            Outcome::Filtered { reason } => panic!("{}: {reason}", unit.partition),
        }
    }
    eprintln!("{} of 15 left hands mirrored", mirrored.len());
    assert!(mirrored.len() >= 10, "{}", mirrored.len());
    for (unit, demonstration) in &made {
        assert_eq!(demonstration.hand, Side::Right);
        // Seen from the palm, a right hand's thumb is on the other side than a left hand's: fingers
        // curl towards the palm, so that their tips say where it is.
        let point = |k: usize| Point3::from(demonstration.steps.last().unwrap().keypoints_m[k]);
        let along = point(9) - point(0);
        let across = point(5) - point(17);
        let palm = across.cross(&along);
        let curl = (point(8) - point(5)) + (point(12) - point(9)) + (point(16) - point(13));
        assert!(palm.dot(&curl) > 0.0, "{}: a left hand", unit.partition);
    }
}

#[test]
fn a_tracked_bottle_that_jitters_gives_a_plausible_grasp() {
    // Its rest jitters by several millimeters and its rotation is unreliable.
    let Some(root) = measured_data::folder("dexmv-mustard") else {
        return;
    };
    let mut config = config(&root);
    // Its tag is not on the table on which the bottle stands, which the first try says.
    let (_, reason) = Bench::new(config.clone()).reason();
    assert!(reason.contains("from the table"), "{reason}");
    config.table = TableRule::Objects;
    let (_, reason) = Bench::new(config.clone()).reason();
    assert!(
        reason.starts_with("only 1 of the still objects"),
        "{reason}"
    );
    config.min_table_objects_n = 1;
    let bench = Bench::new(config);
    let demonstration = bench.only();
    // A lone object lies on one of its stable sides, whichever.
    let table_from_object = demonstration.rest.table_from_object();
    let mesh = bench.mesh(&demonstration.object).vertices_m;
    let heights = mesh.iter().map(|vertex| (table_from_object * *vertex).z);
    let lowest_m = heights.fold(f64::INFINITY, f64::min);
    assert!(lowest_m.abs() < 1e-3, "{lowest_m} m");
    assert_eq!(demonstration.object, "006_mustard_bottle");
    assert_eq!(demonstration.steps[0].image, 0);
    let last = demonstration.steps.last().unwrap();
    // By eye in the track: the hand arrives at image 60, the bottle is surely away at image 77.
    assert!((60..=76).contains(&last.image), "{}", last.image);
    let wrist = Point3::from(last.keypoints_m[0]);
    assert!(wrist.coords.norm() < 0.15, "wrist {wrist}");
}
