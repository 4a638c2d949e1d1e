//! A made-up dataset of one sequence, written as `numpy` and YAML files, with a known answer.

use std::{
    f64::consts::PI,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Isometry3, Point3, Vector3};
use npyz::{WriterBuilder, npz::NpzWriter, zip::write::FileOptions};

/// Images of the recording.
pub(crate) const IMAGES: usize = 40;
/// First image with a hand.
pub(crate) const FIRST: usize = 3;
/// Last image before the object is lifted.
pub(crate) const LAST: usize = 27;
/// The object, and its number among `YCB`'s.
pub(crate) const OBJECT: (&str, u32) = ("008_pudding_box", 7);

/// `DexYCB`'s cameras, the first one the master.
const CAMERAS: [&str; 8] = [
    "836212060125",
    "839512060362",
    "840412060917",
    "841412060263",
    "932122060857",
    "932122060861",
    "932122061900",
    "932122062010",
];
/// Objects that nobody touches, with their numbers: a box that stands upright and a can.
const OTHERS: [(&str, u32); 2] = [("003_cracker_box", 2), ("005_tomato_soup_can", 4)];

/// Everything about the recording that a test may want different.
pub(crate) struct Rig {
    pub(crate) side: &'static str,
    /// Number of cameras.
    pub(crate) cameras: usize,
    /// Cameras that see the hand and the object where they are not.
    pub(crate) wrong: Vec<usize>,
    /// Whether the first camera's frame is not the world's.
    pub(crate) turned_master: bool,
    /// Whether a tag marks the table.
    pub(crate) tag: bool,
    /// In which order `pose.npz` holds quaternions.
    pub(crate) quaternions: Quaternions,
    /// Images in which no camera sees the hand.
    pub(crate) hidden: Vec<usize>,
    /// Whether the labels of an image show the object.
    pub(crate) labels_show_object: bool,
    /// Largest error of the object's measured place per coordinate, in meters.
    pub(crate) jitter_m: f64,
    /// The calibration's lines, by default those of [`Rig::world_from_camera`] and the tag.
    pub(crate) calibration: Option<String>,
}

/// An order of a quaternion's numbers.
#[derive(Clone, Copy)]
pub(crate) enum Quaternions {
    /// The dataset's.
    Xyzw,
    /// That of many libraries.
    Wxyz,
}

impl Default for Rig {
    fn default() -> Self {
        Self {
            side: "right",
            cameras: CAMERAS.len(),
            wrong: Vec::new(),
            turned_master: true,
            tag: true,
            quaternions: Quaternions::Xyzw,
            hidden: Vec::new(),
            labels_show_object: true,
            jitter_m: 0.0,
            calibration: None,
        }
    }
}

impl Rig {
    /// Folder of the sequence.
    pub(crate) fn sequence(root: &Path) -> PathBuf {
        root.join("20200709-subject-01/20200709_141754")
    }

    /// One label file of the first camera.
    pub(crate) fn label(root: &Path, image: usize) -> PathBuf {
        Self::sequence(root)
            .join(CAMERAS[0])
            .join(format!("labels_{image:06}.npz"))
    }

    /// Each camera loses the hand for four images in twelve, of two neighbors never both; a lone one
    /// keeps it.
    fn sees(&self, camera: usize, image: usize) -> bool {
        let looks = self.cameras == 1 || !(image / 4 + camera).is_multiple_of(3);
        image >= FIRST && looks && !self.hidden.contains(&image)
    }

    fn world_from_camera(&self, camera: usize) -> Isometry3<f64> {
        if camera == 0 && !self.turned_master {
            return Isometry3::identity();
        }
        let around = camera as f64;
        Isometry3::new(
            Vector3::new(0.2 - 0.3 * around, -0.1 + 0.1 * around, 0.05 * around),
            Vector3::new(0.3 - 0.2 * around, -0.2 + 0.25 * around, 0.9 - 0.1 * around),
        )
    }

    /// World-to-camera transform of a camera's labels: a wrong one is 6 cm and 20 degrees off.
    fn camera_from_world(&self, camera: usize) -> Isometry3<f64> {
        let camera_from_world = self.world_from_camera(camera).inverse();
        if self.wrong.contains(&camera) {
            let off = Vector3::new(0.06, 0.0, 0.0);
            Isometry3::new(off, Vector3::y() * 0.35) * camera_from_world
        } else {
            camera_from_world
        }
    }

    /// Poses of the other objects: the box upright and turned, the can beside it, each with its
    /// base on the table.
    fn tag_from_other(other: usize) -> Isometry3<f64> {
        let (place, yaw) = [
            (Vector3::new(0.2, 0.1, 0.1), 0.4),
            (Vector3::new(0.7, 0.5, 0.05), -1.0),
        ][other];
        Isometry3::new(place, Vector3::z() * yaw)
    }

    /// The tag's z points up; the table is tilted against the world.
    pub(crate) fn world_from_tag() -> Isometry3<f64> {
        Isometry3::new(
            Vector3::new(-0.05, 0.12, 0.95),
            Vector3::new(-2.1, 0.1, 0.2),
        )
    }

    /// The box lies on its side (its y up), 4 cm above the table, turned by a third of a turn.
    pub(crate) fn tag_from_object(image: usize) -> Isometry3<f64> {
        let lift = 0.01 * image.saturating_sub(LAST) as f64;
        let yaw = Isometry3::new(
            Vector3::new(0.5, 0.3, 0.04 + lift),
            Vector3::z() * (2.0 * PI / 3.0),
        );
        yaw * Isometry3::rotation(Vector3::x() * (PI / 2.0))
    }

    /// The hand's landmarks in the object frame.
    pub(crate) fn keypoint(image: usize, k: usize) -> Point3<f64> {
        let away = 0.01 * LAST.saturating_sub(image) as f64;
        Point3::new(0.002 * k as f64, 0.05 + away, -0.001 * (k * k) as f64)
    }

    /// The shape of the person's hand.
    pub(crate) const BETAS: [f64; 10] = [0.5, -0.25, 0.0, 1.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.125];

    /// Input of a hand model in an image: another hand than that of the labels, somewhere else.
    pub(crate) fn hand_numbers(image: usize) -> [f32; 51] {
        std::array::from_fn(|k| match k {
            _ if image < FIRST => 0.0,
            48.. => 0.3 + 0.05 * (k - 47) as f32 - 0.004 * image as f32,
            _ => 0.02 * ((k * 7 + image) % 11) as f32 - 0.1,
        })
    }

    /// Writes the dataset.
    pub(crate) fn write(&self, root: &Path) {
        let sequence = Self::sequence(root);
        let calibration = root.join("calibration/extrinsics_20200702_151821");
        let model = root.join("models").join(OBJECT.0);
        for folder in [&sequence, &calibration, &model] {
            fs::create_dir_all(folder).unwrap();
        }
        fs::write(model.join("textured_simple.obj"), brick([0.1, 0.08, 0.03])).unwrap();
        for ((name, _), edges_m) in OTHERS.iter().zip([[0.06, 0.16, 0.2], [0.06, 0.07, 0.1]]) {
            let model = root.join("models").join(name);
            fs::create_dir_all(&model).unwrap();
            fs::write(model.join("textured_simple.obj"), brick(edges_m)).unwrap();
        }
        let lines = self.calibration.clone().unwrap_or_else(|| {
            let mut lines = String::new();
            for (camera, serial) in CAMERAS.iter().enumerate() {
                lines += &format!("  '{serial}': {}\n", rows(&self.world_from_camera(camera)));
            }
            if self.tag {
                lines += &format!("  apriltag: {}\n", rows(&Self::world_from_tag()));
            }
            lines + &format!("master: '{}'\n", CAMERAS[0])
        });
        fs::write(
            calibration.join("extrinsics.yml"),
            format!("extrinsics:\n{lines}"),
        )
        .unwrap();
        let mut serials = String::new();
        for serial in CAMERAS {
            serials += &format!("- '{serial}'\n");
        }
        let meta = format!(
            "serials:\n{serials}num_frames: {IMAGES}\nextrinsics: '20200702_151821'\n\
             ycb_ids: [{}, {}, {}]\nycb_grasp_ind: 1\nmano_sides: [{}]\nmano_calib: [x]\n",
            OTHERS[0].1, OBJECT.1, OTHERS[1].1, self.side
        );
        fs::write(sequence.join("meta.yml"), meta).unwrap();
        let shape = root.join("calibration/mano_x");
        fs::create_dir_all(&shape).unwrap();
        let betas = Self::BETAS.map(|beta| format!("- {beta}\n")).concat();
        fs::write(shape.join("mano.yml"), format!("betas:\n{betas}")).unwrap();
        let hands: Vec<f32> = (0..IMAGES).flat_map(Self::hand_numbers).collect();
        let mut poses: Vec<f32> = Vec::new();
        for image in 0..IMAGES {
            let mut world_from_object = Self::world_from_tag() * Self::tag_from_object(image);
            for (axis, value) in world_from_object.translation.vector.iter_mut().enumerate() {
                // Far from random, but as often up as down in each window of images.
                *value += self.jitter_m * ((7 * image + 3 * axis) as f64).sin();
            }
            let world_from_objects = [
                Self::world_from_tag() * Self::tag_from_other(0),
                world_from_object,
                Self::world_from_tag() * Self::tag_from_other(1),
            ];
            for pose in &world_from_objects {
                let (q, t) = (pose.rotation, pose.translation);
                let turn = match self.quaternions {
                    Quaternions::Xyzw => [q.i, q.j, q.k, q.w],
                    Quaternions::Wxyz => [q.w, q.i, q.j, q.k],
                };
                poses.extend(turn.map(|v| v as f32));
                poses.extend([t.x, t.y, t.z].map(|v| v as f32));
            }
            for (camera, serial) in CAMERAS.iter().enumerate().take(self.cameras) {
                let camera_from_world = self.camera_from_world(camera);
                let folder = sequence.join(serial);
                fs::create_dir_all(&folder).unwrap();
                let joints: Vec<f32> = (0..21)
                    .flat_map(|k| {
                        let resting =
                            Self::world_from_tag() * Self::tag_from_object(LAST.min(image));
                        let point = camera_from_world * resting * Self::keypoint(image, k);
                        <[f64; 3]>::from(point)
                    })
                    .map(|v| {
                        if self.sees(camera, image) {
                            v as f32
                        } else {
                            -1.0
                        }
                    })
                    .collect();
                let mut pose_y = Vec::new();
                for world_from_object in &world_from_objects {
                    let m = (camera_from_world * world_from_object).to_homogeneous();
                    let is_there = self.labels_show_object;
                    let number = |n: usize| {
                        if is_there {
                            m[(n / 4, n % 4)] as f32
                        } else {
                            0.0
                        }
                    };
                    pose_y.extend((0..12).map(number));
                }
                npz(
                    &folder.join(format!("labels_{image:06}.npz")),
                    &[
                        ("joint_3d", &[1, 21, 3], &joints),
                        ("pose_y", &[3, 3, 4], &pose_y),
                    ],
                );
            }
        }
        npz(
            &sequence.join("pose.npz"),
            &[
                ("pose_y", &[IMAGES as u64, 3, 7], &poses),
                ("pose_m", &[IMAGES as u64, 1, 51], &hands),
            ],
        );
    }
}

/// Writes arrays of `f4`.
pub(crate) fn npz(path: &Path, arrays: &[(&str, &[u64], &[f32])]) {
    let mut npz = NpzWriter::create(path).unwrap();
    for (name, shape, numbers) in arrays {
        let mut array = npz
            .array(name, FileOptions::default())
            .unwrap()
            .default_dtype()
            .shape(shape)
            .begin_nd()
            .unwrap();
        array.extend(numbers.iter().copied()).unwrap();
        array.finish().unwrap();
    }
}

/// `[R|t]`, row by row, as a YAML list.
pub(crate) fn rows(pose: &Isometry3<f64>) -> String {
    let m = pose.to_homogeneous();
    let numbers: Vec<String> = (0..12)
        .map(|n| format!("{:?}", m[(n / 4, n % 4)]))
        .collect();
    format!("[{}]", numbers.join(", "))
}

/// A box about the origin with these edges in meters, as OBJ.
pub(crate) fn brick(edges_m: [f64; 3]) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        text.push('v');
        for (axis, edge) in edges_m.iter().enumerate() {
            let side = if corner & (1 << axis) == 0 { -0.5 } else { 0.5 };
            text += &format!(" {}", side * edge);
        }
        text.push('\n');
    }
    for face in [
        "1 3 2", "2 3 4", "5 6 7", "6 8 7", "1 2 5", "2 6 5", "3 7 4", "4 7 8", "1 5 3", "3 5 7",
        "2 4 6", "4 8 6",
    ] {
        text += &format!("f {face}\n");
    }
    text
}
