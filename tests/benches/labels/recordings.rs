//! Recordings in `DexYCB`'s layout, made fast: labels and calibration without images.
//!
//! Each label file has what `numpy.savez_compressed` writes, byte for byte in the same form: a
//! segmentation of realistic size, poses of four objects, a hand's numbers, landmarks. The
//! segmentations are a few, deflated once; everything else is every file's own.

use std::{
    fs::{self, File},
    io::Write,
    path::Path,
};

use flate2::{Compression, Crc, write::DeflateEncoder};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Objects of every scene.
pub(crate) const N_OBJECTS: usize = 4;
/// Index of the object that is grasped.
pub(crate) const GRASPED: usize = 2;

const SERIALS: [&str; 8] = [
    "836212060125",
    "839512060362",
    "840412060917",
    "841412060263",
    "932122060857",
    "932122060861",
    "932122061900",
    "932122062010",
];
const CALIBRATION: &str = "20200702_151821";
/// Standard deviation of landmarks about their positions, in meters.
const NOISE_M: f64 = 0.0005;
/// Different segmentations.
const N_SEGMENTATIONS: usize = 16;

/// Writes `n_sequences` recordings of `n_images` images each.
pub(crate) fn write(root: &Path, n_sequences: usize, n_images: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let segmentations: Vec<Member> = (0..N_SEGMENTATIONS)
        .map(|_| Member::new("seg", "|u1", &[480, 640], &segmentation(&mut rng)))
        .collect();
    let cameras = cameras();
    let folder = root.join(format!("calibration/extrinsics_{CALIBRATION}"));
    fs::create_dir_all(&folder).unwrap();
    save(&folder.join("extrinsics.yml"), &extrinsics(&cameras));
    for sequence in 0..n_sequences {
        let folder = root.join(format!(
            "20200709-subject-01/20200709_{:06}",
            140_000 + sequence
        ));
        for serial in SERIALS {
            fs::create_dir_all(folder.join(serial)).unwrap();
        }
        save(&folder.join("meta.yml"), meta(n_images).as_bytes());
        let mut poses = Vec::new();
        let mut hands = Vec::new();
        for image in 0..n_images {
            let scene = Scene::new(image, n_images, &mut rng);
            for pose in &scene.world_from_objects {
                let q = pose.rotation.coords;
                let t = pose.translation.vector;
                poses.extend([q.x, q.y, q.z, q.w, t.x, t.y, t.z].map(|number| number as f32));
            }
            hands.extend(numbers(51, &mut rng));
            for (serial, world_from_camera) in SERIALS.iter().zip(&cameras) {
                let segmentation = &segmentations[rng.random_range(0..N_SEGMENTATIONS)];
                let bytes = label(&scene, world_from_camera, segmentation, &mut rng);
                let name = format!("labels_{image:06}.npz");
                save(&folder.join(serial).join(name), &bytes);
            }
        }
        let n_images = n_images as u64;
        let members = [
            Member::floats("pose_y", &[n_images, N_OBJECTS as u64, 7], &poses),
            Member::floats("pose_m", &[n_images, 1, 51], &hands),
        ];
        save(&folder.join("pose.npz"), &archive(&members.each_ref()));
    }
}

/// Poses of the objects, and the hand's landmarks, in one image.
struct Scene {
    world_from_objects: Vec<Isometry3<f64>>,
    landmarks_in_world: Option<[Point3<f64>; 21]>,
}

impl Scene {
    /// The hand appears in image 3, comes closer, and lifts the grasped object in the last third.
    fn new(image: usize, n_images: usize, rng: &mut ChaCha8Rng) -> Self {
        let grasp = n_images * 2 / 3;
        let lift = Vector3::z() * (0.01 * image.saturating_sub(grasp) as f64);
        let world_from_objects: Vec<_> = (0..N_OBJECTS)
            .map(|object| {
                let on_table = Vector3::new(0.15 * object as f64 - 0.2, 0.1, 0.05);
                let lifted = if object == GRASPED {
                    lift
                } else {
                    Vector3::zeros()
                };
                Isometry3::new(on_table + lifted, Vector3::new(0.1, 0.2, object as f64))
            })
            .collect();
        let away = 0.006 * grasp.saturating_sub(image) as f64;
        let grasped = world_from_objects[GRASPED].translation.vector;
        let palm = grasped + Vector3::new(away, 0.0, 0.08 + away);
        let landmarks = std::array::from_fn(|k| {
            let (finger, joint) = (k.div_ceil(4) as f64, (k % 4) as f64);
            let at = Vector3::new(0.02 * finger - 0.05, 0.03 * joint, -0.01 * joint);
            Point3::from(palm + at + noise(rng))
        });
        Self {
            world_from_objects,
            landmarks_in_world: (image >= 3).then_some(landmarks),
        }
    }
}

/// A label file: what a camera sees of a scene.
fn label(
    scene: &Scene,
    world_from_camera: &Isometry3<f64>,
    segmentation: &Member,
    rng: &mut ChaCha8Rng,
) -> Vec<u8> {
    let camera_from_world = world_from_camera.inverse();
    let mut poses = Vec::new();
    for world_from_object in &scene.world_from_objects {
        poses.extend(rows(&(camera_from_world * world_from_object)).map(|number| number as f32));
    }
    let (landmarks, pixels, hand) = match &scene.landmarks_in_world {
        Some(landmarks) => {
            let seen = landmarks.map(|point| camera_from_world * (point + noise(rng)));
            let pixels = seen.map(|p| [600.0 * p.x / p.z + 313.0, 600.0 * p.y / p.z + 245.0]);
            (
                seen.iter()
                    .flat_map(|p| <[f64; 3]>::from(*p))
                    .map(|v| v as f32)
                    .collect(),
                pixels.as_flattened().iter().map(|&v| v as f32).collect(),
                numbers(51, rng),
            )
        }
        None => (vec![-1.0; 63], vec![-1.0; 42], vec![0.0; 51]),
    };
    archive(&[
        segmentation,
        &Member::floats("pose_y", &[N_OBJECTS as u64, 3, 4], &poses),
        &Member::floats("pose_m", &[1, 51], &hand),
        &Member::floats("joint_3d", &[1, 21, 3], &landmarks),
        &Member::floats("joint_2d", &[1, 21, 2], &pixels),
    ])
}

/// An ellipse for the hand and for each object, with outlines that wander by a pixel or two.
fn segmentation(rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut image = vec![0; 480 * 640];
    for number in [2, 5, 11, 14, 255] {
        let (x, y) = (
            rng.random_range(100.0..540.0),
            rng.random_range(100.0..380.0),
        );
        let (a, b): (f64, f64) = (rng.random_range(30.0..70.0), rng.random_range(30.0..90.0));
        for (row, pixels) in image.chunks_exact_mut(640).enumerate() {
            let up: f64 = (row as f64 - y) / b;
            if up.abs() < 1.0 {
                let half = a * (1.0 - up * up).sqrt() + rng.random_range(0.0..3.0);
                for (column, pixel) in pixels.iter_mut().enumerate() {
                    if (column as f64 - x).abs() < half {
                        *pixel = number;
                    }
                }
            }
        }
    }
    image
}

/// Eight cameras about the table, 0.9 m from it, looking at it.
fn cameras() -> Vec<Isometry3<f64>> {
    (0..SERIALS.len())
        .map(|camera| {
            let angle = 0.7 * camera as f64;
            let eye = Point3::new(0.7 * angle.cos(), 0.7 * angle.sin(), 0.6);
            // Camera: x right, y down, z forward.
            Isometry3::face_towards(&eye, &Point3::origin(), &-Vector3::z())
        })
        .collect()
}

/// `[R|t]`, row by row.
fn rows(pose: &Isometry3<f64>) -> [f64; 12] {
    let m = pose.to_homogeneous();
    std::array::from_fn(|n| m[(n / 4, n % 4)])
}

fn extrinsics(cameras: &[Isometry3<f64>]) -> Vec<u8> {
    let mut text = String::from("extrinsics:\n");
    for (serial, camera) in SERIALS.iter().zip(cameras) {
        text += &format!("  '{serial}': {:?}\n", rows(camera));
    }
    let tag = rows(&Isometry3::identity());
    text += &format!("  apriltag: {tag:?}\nmaster: '{}'\n", SERIALS[0]);
    text.into_bytes()
}

fn meta(n_images: usize) -> String {
    let serials: Vec<String> = SERIALS
        .iter()
        .map(|serial| format!("- '{serial}'\n"))
        .collect();
    format!(
        "serials:\n{}num_frames: {n_images}\nextrinsics: '{CALIBRATION}'\n\
         mano_calib:\n- 20200709-subject-01_right\nmano_sides:\n- right\n\
         ycb_ids:\n- 2\n- 5\n- 14\n- 11\nycb_grasp_ind: {GRASPED}\n",
        serials.concat()
    )
}

fn noise(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    // The sum of three evenly distributed numbers from -1 to 1 has standard deviation 1.
    Vector3::from_fn(|_, _| NOISE_M * (0..3).map(|_| rng.random_range(-1.0..1.0)).sum::<f64>())
}

fn numbers(n: usize, rng: &mut ChaCha8Rng) -> Vec<f32> {
    (0..n).map(|_| rng.random_range(-2.0..2.0)).collect()
}

/// An array, deflated.
struct Member {
    name: String,
    crc32: u32,
    len: u32,
    deflated: Vec<u8>,
}

impl Member {
    fn floats(name: &str, shape: &[u64], numbers: &[f32]) -> Self {
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self::new(name, "<f4", shape, &bytes)
    }

    fn new(name: &str, descr: &str, shape: &[u64], data: &[u8]) -> Self {
        let lengths: Vec<String> = shape.iter().map(u64::to_string).collect();
        let mut header = format!(
            "{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}), }}",
            lengths.join(", ")
        );
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        let mut crc = Crc::new();
        crc.update(&bytes);
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&bytes).unwrap();
        Self {
            name: format!("{name}.npy"),
            crc32: crc.sum(),
            len: bytes.len() as u32,
            deflated: encoder.finish().unwrap(),
        }
    }

    /// Fields that both headers share: version, flags, method, time, date and checksum.
    fn said_twice(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = [45_u16, 0, 8, 0, 0x21].map(u16::to_le_bytes).concat();
        bytes.extend(self.crc32.to_le_bytes());
        bytes
    }
}

/// An archive as `numpy` writes it: lengths before the data stand in ZIP64's extra field.
fn archive(members: &[&Member]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut directory = Vec::new();
    for member in members {
        let deflated_len = member.deflated.len() as u32;
        let name_len = (member.name.len() as u16).to_le_bytes();
        directory.extend(b"PK\x01\x02\x2d\x03");
        directory.extend(member.said_twice());
        directory.extend(
            [deflated_len, member.len]
                .map(u32::to_le_bytes)
                .as_flattened(),
        );
        directory.extend(name_len);
        directory.extend([0; 8]);
        directory.extend([0, 0, 0x80, 0x01]);
        directory.extend((bytes.len() as u32).to_le_bytes());
        directory.extend(member.name.as_bytes());
        bytes.extend(b"PK\x03\x04");
        bytes.extend(member.said_twice());
        bytes.extend([0xff; 8]);
        bytes.extend(name_len);
        bytes.extend([20, 0]);
        bytes.extend(member.name.as_bytes());
        bytes.extend([1, 0, 16, 0]);
        let lengths = [u64::from(member.len), u64::from(deflated_len)];
        bytes.extend(lengths.map(u64::to_le_bytes).as_flattened());
        bytes.extend(&member.deflated);
    }
    let start = bytes.len() as u32;
    let n_members = (members.len() as u16).to_le_bytes();
    bytes.extend(&directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend(n_members);
    bytes.extend(n_members);
    bytes.extend((directory.len() as u32).to_le_bytes());
    bytes.extend(start.to_le_bytes());
    bytes.extend([0, 0]);
    bytes
}

fn save(path: &Path, bytes: &[u8]) {
    File::create(path).unwrap().write_all(bytes).unwrap();
}
