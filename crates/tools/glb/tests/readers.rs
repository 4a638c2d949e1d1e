//! Other readers of the files: Khronos' validator and trimesh.
//!
//! `PIPELINE_NODE_MODULES` names a folder with `gltf-validator` from npm, `PIPELINE_PYTHON` a Python with
//! `trimesh`; without them these tests skip, and say so.

mod motions;

use std::{fs, path::Path, process::Command};

use glb::Moment;
use motions::{MotionSpectrum, hand, motion, object, scene};
use robot::Link;
use spatial::{Palm, Pose};

/// Files of a motion as it is, of one moment, and without an object's triangles or contacts.
fn files() -> Vec<(&'static str, Vec<Moment>, Vec<u8>)> {
    let hand = hand();
    let wild = MotionSpectrum {
        turns_per_s: 0.4,
        reach_m: 0.2,
        shake_m: 0.002,
    };
    let whole = motion(&hand, wild, 400);
    let one = whole[..1].to_vec();
    let bare: Vec<Moment> = whole
        .iter()
        .map(|moment| Moment {
            contacts: Vec::new(),
            q_command: None,
            ..moment.clone()
        })
        .collect();
    let nothing = glb::ObjectMesh::default();
    let object = object();
    let write = |object, moments: &[Moment]| scene(&hand, object).to_glb(moments).unwrap();
    vec![
        ("whole", whole.clone(), write(&object, &whole)),
        ("one", one.clone(), write(&object, &one)),
        ("bare", bare.clone(), write(&nothing, &bare)),
    ]
}

fn script(name: &str) -> String {
    format!("{}/tests/{name}", env!("CARGO_MANIFEST_DIR"))
}

#[expect(clippy::disallowed_methods, reason = "files of a test")]
fn write(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
}

fn folder(name: &str) -> std::path::PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn the_validator_finds_no_error_and_no_warning() {
    let Some(modules) = measured_data::named_by("PIPELINE_NODE_MODULES") else {
        return;
    };
    let folder = folder("validated");
    for (name, _, bytes) in files() {
        let path = folder.join(format!("{name}.glb"));
        write(&path, &bytes);
        let ran = Command::new("node")
            .arg(script("validate.cjs"))
            .arg(&path)
            .env("NODE_PATH", &modules)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ran.stdout).into_owned();
        let faults = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{name}: {said}{faults}");
        assert!(said.contains("0 errors, 0 warnings"), "{name}: {said}");
    }
}

/// Links are where forward kinematics has them, at three times between key frames.
#[test]
fn trimesh_finds_every_node_and_the_links_where_they_were() {
    let Some(python) = measured_data::named_by("PIPELINE_PYTHON") else {
        return;
    };
    let has_it = Command::new(&python)
        .args(["-c", "import trimesh"])
        .output()
        .unwrap();
    if !has_it.status.success() {
        measured_data::print_skipped("`PIPELINE_PYTHON` has no trimesh");
        return;
    }
    let folder = folder("loaded");
    let hand = hand();
    for (name, moments, bytes) in files() {
        let path = folder.join(format!("{name}.glb"));
        write(&path, &bytes);
        let n = moments.len();
        let mut arguments: Vec<String> = Vec::new();
        let nodes_n = 3
            + hand.links().len()
            + if moments[0].q_command.is_some() {
                hand.links().len()
            } else {
                0
            }
            + moments
                .iter()
                .map(|moment| moment.contacts.len())
                .max()
                .unwrap();
        // Contacts are shown at fewer moments.
        let nodes_n = if n == 1 {
            3 + 2 * hand.links().len()
        } else {
            nodes_n
        };
        arguments.push(nodes_n.to_string());
        for moment in [0, n / 3, n - 1].map(|idx| &moments[idx]) {
            let links = hand.forward_kinematics::<Palm>(&moment.q).unwrap();
            let table_from_root: Pose<spatial::Table, Palm> = moment.table_from_root.reinterpret();
            for (link, root_from_link) in hand.links().iter().zip(links) {
                let pose: Pose<spatial::Table, Link> = table_from_root * root_from_link;
                let numbers = pose
                    .to_array()
                    .map(|number| format!("{number:.17}"))
                    .join(",");
                arguments.push(format!("{:.9}|{}|{numbers}", moment.time_s, link.name));
            }
        }
        let ran = Command::new(&python)
            .arg(script("trimesh_poses.py"))
            .arg(&path)
            .args(&arguments)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ran.stdout).into_owned();
        let faults = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{name}: {said}{faults}");
        assert!(said.contains("within 1e-4 m"), "{name}: {said}");
    }
}
