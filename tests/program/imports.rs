//! Recordings of other labs through the whole program: a tree in `HO-Cap`'s layout, and motion capture in a csv,
//! which the documented script converts.

use std::{
    fs,
    io::{Cursor, Write},
    path::{Path, PathBuf},
    process::Command,
};

use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};
use serde_json::Value;
use stage_ingest::read;
use zip::{ZipWriter, write::SimpleFileOptions};

use crate::program::{
    bench::{Bench, stderr},
    commands::done,
    python::python,
};

/// The page that shows the script, and the script.
const README: &str = include_str!("../../stages/ingest/README.md");
const SCRIPT: &str = include_str!("../../stages/ingest/examples/from_csv.py");
/// Lines that a lab can write.
const LINES: usize = 20;

/// A recording of the sample, as far as it is needed here.
struct Sequence {
    /// `SUBJECT/SEQUENCE`.
    folder: PathBuf,
    side: String,
    objects: Vec<String>,
    images: usize,
    serials: Vec<String>,
    extrinsics: String,
}

/// The recordings of the sample with a right hand.
fn sequences(root: &Path) -> Vec<Sequence> {
    let mut found = Vec::new();
    for subject in folders(root) {
        for folder in folders(&subject) {
            let Ok(text) = fs::read_to_string(folder.join("meta.yml")) else {
                continue;
            };
            let list = |key: &str| -> Vec<String> {
                let (_, rest) = text.split_once(&format!("{key}:")).unwrap();
                let inline = rest.lines().next().unwrap().trim();
                let plain = |word: &str| {
                    word.trim_matches(['[', ']', '\'', '"', ' ', '-'])
                        .to_owned()
                };
                if inline.is_empty() {
                    let lines = rest.lines().skip(1);
                    lines
                        .take_while(|line| line.trim_start().starts_with('-'))
                        .map(plain)
                        .collect()
                } else {
                    inline.split(',').map(plain).collect()
                }
            };
            let names = list("ycb_ids").into_iter().map(|id| {
                let prefix = ycb(id.parse().unwrap());
                let model = folders(&root.join("models"))
                    .into_iter()
                    .find(|model| name(model).starts_with(prefix));
                name(&model.unwrap())
            });
            found.push(Sequence {
                objects: names.collect(),
                side: list("mano_sides").remove(0),
                images: list("num_frames").remove(0).parse().unwrap(),
                serials: list("serials"),
                extrinsics: list("extrinsics").remove(0),
                folder,
            });
        }
    }
    found.retain(|sequence| sequence.side == "right");
    found
}

/// Returns the prefix of an object's name, by its number in the dataset.
fn ycb(number: usize) -> &'static str {
    [
        "002", "003", "004", "005", "006", "007", "008", "009", "010", "011", "019", "021", "024",
        "025", "035", "036", "037", "040", "051", "052", "061", "056",
    ][number - 1]
}

fn name(path: &Path) -> String {
    path.file_name().unwrap().to_str().unwrap().to_owned()
}

fn folders(path: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(path)
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let mut folders: Vec<PathBuf> = entries.filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

impl Sequence {
    /// The sample's calibration: the poses of the cameras and of the tag.
    fn calibration(&self, root: &Path) -> (String, Isometry3<f64>) {
        let file = format!("calibration/extrinsics_{}/extrinsics.yml", self.extrinsics);
        let text = fs::read_to_string(root.join(file)).unwrap();
        let (_, rows) = text.split_once("apriltag:").unwrap();
        let until = rows.find(['a', 'b', 'c', 'm', '\'']).unwrap_or(rows.len());
        let numbers = rows[..until].split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c)));
        let numbers: Vec<f64> = numbers
            .filter_map(|word| word.parse().ok())
            .take(12)
            .collect();
        let turn = nalgebra::Matrix3::from_fn(|row, column| numbers[4 * row + column]);
        let turn = nalgebra::Rotation3::from_matrix(&turn);
        let place = Translation3::new(numbers[3], numbers[7], numbers[11]);
        (
            text,
            Isometry3::from_parts(place, UnitQuaternion::from_rotation_matrix(&turn)),
        )
    }

    /// The objects' poses in the frame of the tag, by object and image.
    fn poses(&self, world_from_tag: &Isometry3<f64>) -> Vec<Vec<Isometry3<f64>>> {
        let file = fs::read(self.folder.join("pose.npz")).unwrap();
        let n = self.objects.len();
        let numbers = read::npz(&file, "pose_y", &[self.images as u64, n as u64, 7]).unwrap();
        let pose = |image: usize, object: usize| {
            let at = &numbers[7 * (n * image + object)..][..7];
            let turn = Quaternion::new(at[3], at[0], at[1], at[2]);
            let place = Translation3::new(at[4], at[5], at[6]);
            world_from_tag.inverse()
                * Isometry3::from_parts(place, UnitQuaternion::from_quaternion(turn))
        };
        (0..n)
            .map(|object| (0..self.images).map(|image| pose(image, object)).collect())
            .collect()
    }

    /// Returns a camera's label of the hand in an image, in the camera's frame; all −1 if there is nothing.
    fn hand(&self, serial: &str, image: usize) -> Option<Vec<f64>> {
        let file = self
            .folder
            .join(serial)
            .join(format!("labels_{image:06}.npz"));
        read::npz(&fs::read(file).ok()?, "joint_3d", &[1, 21, 3]).ok()
    }
}

/// An array of `f4` in numpy's format.
fn npy(shape: &[usize], numbers: &[f64]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(|length| format!("{length}, ")).collect();
    let shape = shape.concat();
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(
        numbers
            .iter()
            .flat_map(|&number| (number as f32).to_le_bytes()),
    );
    bytes
}

fn npz(array: &str, npy: &[u8]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    zip.start_file(format!("{array}.npy"), SimpleFileOptions::default())
        .unwrap();
    zip.write_all(npy).unwrap();
    zip.finish().unwrap().into_inner()
}

fn write(path: &Path, bytes: &[u8]) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// Writes the sample's recordings of right hands again, in `HO-Cap`'s layout.
fn hocap(sample: &Path, root: &Path) -> usize {
    for model in folders(&sample.join("models")) {
        let mesh = fs::read(model.join("textured_simple.obj")).unwrap();
        write(
            &root
                .join("models")
                .join(name(&model))
                .join("cleaned_mesh_10000.obj"),
            &mesh,
        );
    }
    let sequences = sequences(sample);
    for sequence in &sequences {
        let (calibration, world_from_tag) = sequence.calibration(sample);
        let calibration = calibration.replace("apriltag", "tag_1");
        let file = format!("calibration/extrinsics/{}.yaml", sequence.extrinsics);
        write(&root.join(file), calibration.as_bytes());
        let subject = name(sequence.folder.parent().unwrap());
        let folder = root.join(subject).join(name(&sequence.folder));
        let serials = sequence.serials.iter();
        let serials: Vec<String> = serials.map(|serial| format!("'{serial}', ")).collect();
        let serials = serials.concat();
        let meta = format!(
            "num_frames: {}\nobject_ids: [{}]\nmano_sides: [right]\nsubject_id: x\ntask_id: 1\n\
                 realsense: {{serials: [{serials}], width: 640, height: 480}}\nextrinsics: {}.yaml\n",
            sequence.images,
            sequence.objects.join(", "),
            sequence.extrinsics,
        );
        write(&folder.join("meta.yaml"), meta.as_bytes());
        let poses = sequence.poses(&world_from_tag);
        let numbers = poses.iter().flatten().flat_map(|pose| {
            let (q, t) = (pose.rotation, pose.translation);
            [q.i, q.j, q.k, q.w, t.x, t.y, t.z]
        });
        let shape = [sequence.objects.len(), sequence.images, 7];
        write(
            &folder.join("poses_o.npy"),
            &npy(&shape, &numbers.collect::<Vec<_>>()),
        );
        for serial in &sequence.serials {
            for image in 0..sequence.images {
                let Some(mut hands) = sequence.hand(serial, image) else {
                    continue;
                };
                hands.extend([-1.0; 63]);
                let label = npz("hand_joints_3d", &npy(&[2, 21, 3], &hands));
                write(
                    &folder.join(serial).join(format!("label_{image:06}.npz")),
                    &label,
                );
            }
        }
    }
    sequences.len()
}

fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    command
        .args(["query", "--format", "json", sql, "--lake"])
        .arg(bench.lake());
    let asked = command.output().unwrap();
    assert!(asked.status.success(), "{}", stderr(&asked));
    let text = String::from_utf8(asked.stdout).unwrap();
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

#[test]
fn a_tree_in_hocaps_layout_goes_through_the_whole_flow() {
    let sample = Bench::new();
    sample.run_well(&["--until", "retarget"]);
    let root = tempfile::tempdir().unwrap();
    let n = hocap(sample.root(), root.path());
    let bench = Bench::on(root.path().to_owned());
    bench.run_well(&["--set", "ingest.format=hocap"]);
    let sql = "select sequence, avg(keypoint_error_m) as error, count(*) as n from trajectories group by sequence order by sequence";
    let (ours, theirs) = (ask(&bench, sql), ask(&sample, sql));
    assert!(
        n >= 10 && ours.len() == theirs.len(),
        "{n} recordings, {} and {}",
        ours.len(),
        theirs.len()
    );
    for (ours, theirs) in ours.iter().zip(&theirs) {
        assert_eq!(
            (&ours["sequence"], &ours["n"]),
            (&theirs["sequence"], &theirs["n"])
        );
        let apart = ours["error"].as_f64().unwrap() - theirs["error"].as_f64().unwrap();
        assert!(apart.abs() < 1e-4, "{ours} {theirs}");
    }
    let executed = ask(&bench, "select count(*) as n from executions");
    assert!(executed[0]["n"].as_u64().unwrap() > 0);
    done(&bench, "plan", &["--set", "ingest.format=hocap"]);
}

#[test]
fn the_documented_script_is_the_one_that_is_shown_and_short() {
    assert!(
        SCRIPT.lines().count() <= LINES,
        "{}",
        SCRIPT.lines().count()
    );
    assert!(
        README.contains(&format!("```python\n{SCRIPT}```")),
        "the page shows another script"
    );
}

/// A recording of the sample as a csv of motion capture, in millimeters above the table.
fn take(sample: &Path, sequence: &Sequence) -> String {
    let (_, world_from_tag) = sequence.calibration(sample);
    let axes = |of: &str, names: &[&str]| {
        names
            .iter()
            .map(|axis| format!("{of}_{axis}"))
            .collect::<Vec<_>>()
    };
    let mut columns = vec!["time".to_owned()];
    columns.extend((0..21).flat_map(|k| axes(&format!("hand{k}"), &["x", "y", "z"])));
    columns.extend(axes("object", &["x", "y", "z", "qx", "qy", "qz", "qw"]));
    let mut text = columns.join(",") + "\n";
    let calibration = sequence.calibration(sample).0;
    let serial = &sequence.serials[0];
    let (_, rows) = calibration.split_once(serial.as_str()).unwrap();
    let numbers = rows.split(|c: char| !(c.is_ascii_digit() || "+-.e".contains(c)));
    let numbers: Vec<f64> = numbers
        .filter_map(|word| word.parse().ok())
        .take(12)
        .collect();
    let world_from_camera = |point: &[f64]| {
        let row = |row: usize| {
            (0..3)
                .map(|column| numbers[4 * row + column] * point[column])
                .sum::<f64>()
                + numbers[4 * row + 3]
        };
        Point3::new(row(0), row(1), row(2))
    };
    let moved = sequence.poses(&world_from_tag).into_iter().max_by(|a, b| {
        let path = |poses: &[Isometry3<f64>]| {
            (poses[0].translation.vector - poses[poses.len() - 1].translation.vector).norm()
        };
        path(a).total_cmp(&path(b))
    });
    for (image, pose) in moved.unwrap().iter().enumerate() {
        let mut cells = vec![(image as f64 / 30.0).to_string()];
        match sequence
            .hand(serial, image)
            .filter(|hand| hand.iter().any(|&number| number != -1.0))
        {
            Some(hand) => cells.extend(hand.chunks(3).flat_map(|point| {
                let point = world_from_tag.inverse() * world_from_camera(point) * 1000.0;
                [point.x, point.y, point.z].map(|number| number.to_string())
            })),
            None => cells.extend(vec![String::new(); 63]),
        }
        let (q, t) = (pose.rotation, pose.translation.vector * 1000.0);
        cells.extend([t.x, t.y, t.z, q.i, q.j, q.k, q.w].map(|number| number.to_string()));
        text += &(cells.join(",") + "\n");
    }
    text
}

#[test]
fn motion_capture_in_a_csv_goes_through_ingest_and_retarget() {
    let Some(python) = python(&["numpy"]) else {
        return;
    };
    let sample = Bench::new();
    sample.run_well(&["--until", "ingest"]);
    let root = tempfile::tempdir().unwrap();
    let all = sequences(sample.root());
    for (take_n, sequence) in all.iter().take(3).enumerate() {
        let csv = root.path().join(format!("take_{take_n}.csv"));
        write(&csv, take(sample.root(), sequence).as_bytes());
        let sql = "select sequence, object from demonstrations group by sequence, object order by sequence";
        let key = format!(
            "{}-{}",
            name(sequence.folder.parent().unwrap()),
            name(&sequence.folder)
        );
        let object = ask(&sample, sql)
            .into_iter()
            .find(|row| row["sequence"] == key.as_str());
        let object = object.unwrap()["object"].as_str().unwrap().to_owned();
        let script =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("stages/ingest/examples/from_csv.py");
        let ran = Command::new(&python)
            .arg("-B")
            .arg(script)
            .arg(&csv)
            .args([&object, "right"])
            .arg(root.path().join(format!("tracks/anna/take_{take_n}")))
            .output()
            .unwrap();
        assert!(ran.status.success(), "{}", stderr(&ran));
        let model = format!("models/{object}/textured_simple.obj");
        let mesh = fs::read(sample.root().join(&model)).unwrap();
        write(&root.path().join("tracks").join(model), &mesh);
    }
    let bench = Bench::on(root.path().join("tracks"));
    bench.run_well(&["--until", "retarget", "--set", "ingest.format=tracks"]);
    let made = ask(
        &bench,
        "select sequence, count(*) as n, max(keypoint_error_m) as error from trajectories group by sequence",
    );
    assert_eq!(made.len(), 3);
    for row in &made {
        assert!(
            row["n"].as_u64().unwrap() > 10 && row["error"].as_f64().unwrap() < 0.05,
            "{row}"
        );
    }
}
