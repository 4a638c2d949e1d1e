//! Writes what the targets start from to `corpus/`, beside this file.

use std::{
    fs::{self, File},
    io::{BufReader, Cursor, Read, Write},
    path::Path,
};

use npyz::{
    WriterBuilder,
    npz::NpzWriter,
    zip::{CompressionMethod, ZipArchive, write::FileOptions},
};

const META: &str = "serials:\n- '836212060125'\n- 839512060362\nnum_frames: 72\n\
    extrinsics: '20200702_151821'\nmano_calib:\n- 20200709-subject-01_right\n\
    mano_sides:\n- right\nycb_ids: [1, 11, 12, 20]\nycb_grasp_ind: 0\n";
const EXTRINSICS: &str = "extrinsics:\n  '836212060125': [1, 0, 0, 0.1, 0, 1, 0, -2e-1, 0, 0, 1, .3]\n\
    \x20 apriltag: &a\n  - 1.0\n  - 0.0\n  - 0.0\n  - 0.0\n  - 0.0\n  - 1.0\n  - 0.0\n  - 0.0\n\
    \x20 - 0.0\n  - 0.0\n  - 1.0\n  - 0.0\n  again: *a\nmaster: '836212060125'\n";
const ALIASES: &str = "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n<<: {d: *c}\nextrinsics: {}\n";
const MESH: &str = "# a thing\nmtllib a.mtl\no a\nv 0 0 0\nv 1 0 0\nv 1 1 0 1.0\nv 0 1 -1e-3\n\
    vt 0 0\nvn 0 0 1\ns off\nf 1/1/1 2/2 3//3 4\nf -4 -2 -1 # a triangle\n";
const CLOSED: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

const TRACK: &str = "object: 025_mug\nhand: right\nimages: 2\nunit: mm\ntable_plane: [0, 0, 1, 0.5]\n";
const TABLE: &str = "object: a\nhand: left\nimages: 2\ntable: [1, 0, 0, 0,  0, 1, 0, 0,  0, 0, 1, 0]\n";
const HOCAP: &str = "num_frames: 6\nobject_ids: [G01_1, G01_2]\nmano_sides: [right, left]\nsubject_id: subject_1\n\
    task_id: 1\nrealsense:\n  serials: ['037522251142', '043422252387']\n  width: 640\nextrinsics: extrinsics_20231014.yaml\n";

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let save = |target: &str, name: &str, bytes: &[u8]| {
        let folder = folder.join(target);
        fs::create_dir_all(&folder).unwrap();
        File::create(folder.join(name))
            .unwrap()
            .write_all(bytes)
            .unwrap();
    };
    for (name, text) in [
        ("meta", META),
        ("extrinsics", EXTRINSICS),
        ("aliases", ALIASES),
    ] {
        save("yaml", name, text.as_bytes());
    }
    for (name, text) in [("mesh", MESH), ("closed", CLOSED)] {
        save("obj", name, text.as_bytes());
    }
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        // The first byte says that an archive follows.
        save(
            "npz",
            &format!("{method}"),
            &[&[0], &archive(method)[..]].concat(),
        );
    }
    for (name, header, n_bytes) in [
        (
            "small",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }\n",
            16,
        ),
        (
            "fortran",
            "{'descr': '>f8', 'fortran_order': True, 'shape': (2, 2), }\n",
            32,
        ),
        (
            "fields",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,), }\n",
            8,
        ),
    ] {
        // The first byte says that an array follows.
        let mut bytes = b"\x01\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(vec![0; n_bytes]);
        save("npz", name, &bytes);
    }
    let track = tracks();
    for (name, text) in [("plane", TRACK), ("table", TABLE)] {
        save("tracks", name, &[text.as_bytes(), &[0][..]].concat());
        save("tracks", &format!("{name}_whole"), &[text.as_bytes(), &[0][..], &track[..]].concat());
    }
    save("", "track.npz", &track);
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6, 7), }\n";
    let mut poses = b"\x93NUMPY\x01\x00".to_vec();
    poses.extend((header.len() as u16).to_le_bytes());
    poses.extend(header.as_bytes());
    for n in 0..12_u8 {
        let lift = 0.02 * f32::from(n % 6);
        poses.extend([0.0, 0.0, 0.0, 1.0, 0.1, 0.2, lift].map(f32::to_le_bytes).as_flattened());
    }
    save("hocap", "whole", &[HOCAP.as_bytes(), &[0][..], &poses[..]].concat());
    save(
        "pickle",
        "dictionary",
        b"\x00\x80\x02}q\x00U\x0akintree_tableq\x01K\x02s.",
    );
    save("pickle", "changes", b"\x01\x10\x00K\x20\x00M");
    let models = folder.join("../../tests/mano/models.zip");
    let mut models = ZipArchive::new(BufReader::new(File::open(models).unwrap())).unwrap();
    let mut model = Vec::new();
    models
        .by_name("right_single.pkl")
        .unwrap()
        .read_to_end(&mut model)
        .unwrap();
    save("", "model.pkl", &model);
}

/// A label file without its segmentation.
fn archive(method: CompressionMethod) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut npz = NpzWriter::new(&mut bytes);
    for (name, shape) in [("pose_y", &[2, 3, 4][..]), ("joint_3d", &[1, 21, 3])] {
        let options = FileOptions::default().compression_method(method);
        let array = npz.array(name, options).unwrap();
        let mut array = array.default_dtype().shape(shape).begin_nd().unwrap();
        let count = shape.iter().product::<u64>() as u16;
        array
            .extend((0..count).map(|n| 0.1 * f32::from(n)))
            .unwrap();
        array.finish().unwrap();
    }
    drop(npz);
    bytes.into_inner()
}

/// Tracks of two images, their landmarks in each unit.
fn tracks() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut npz = NpzWriter::new(&mut bytes);
    for (name, shape, step) in [
        ("keypoints_m", &[2, 21, 3][..], 0.003),
        ("keypoints_mm", &[2, 21, 3], 3.0),
        ("world_from_object", &[2, 7], 0.0),
    ] {
        let array = npz.array(name, FileOptions::default()).unwrap();
        let mut array = array.default_dtype().shape(shape).begin_nd().unwrap();
        let count = shape.iter().product::<u64>() as u16;
        array.extend((0..count).map(|n| step * f32::from(n % 63))).unwrap();
        array.finish().unwrap();
    }
    drop(npz);
    bytes.into_inner()
}
