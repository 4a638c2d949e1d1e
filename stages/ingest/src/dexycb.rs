//! `DexYCB`'s reader: from the files of one sequence to a [`Recording`].
//!
//! Landmarks are `joint_3d` of the first camera, in the order of `meta.yml`, that has the hand in
//! an image; the object's pose is `pose_y` of the first camera that has it, or `pose.npz` where no
//! camera does. The dataset's marks for "not there" (all −1, all 0) become `None` here.

use std::{fs::File, io::Read};

use dataflow::SourceFile;
use nalgebra::{Isometry3, Point3, Translation3};
use schemas::demonstrations::KEYPOINTS;
use spatial::{Camera, Object, Pose, World, quaternion_xyzw};

use crate::{
    dataset::{SequenceFiles, extrinsics_name},
    error::Unusable,
    npz::Arrays,
    recording::{Keypoints, Observation, Recording, Tag},
    yaml::{self, Extrinsics, Meta},
    ycb,
};

/// Largest accepted label file: an image's segmentation alone is 0.3 MB before compression.
const MAX_LABEL_BYTES: u64 = 4 << 20;
/// Largest accepted `pose.npz`: 100 images and 4 objects are 30 kB.
const MAX_POSES_BYTES: u64 = 16 << 20;
/// Largest accepted YAML file: the real ones have less than 2 kB.
const MAX_YAML_BYTES: u64 = 1 << 20;
/// Most accepted images of a recording: six minutes at 30 Hz, where the real ones have 72.
const MAX_IMAGES: u64 = 10_800;
/// Most accepted objects of a scene: as many as are numbered.
const MAX_OBJECTS: usize = 21;
/// The tag on the table, among the cameras of `extrinsics.yml`.
const TAG: &str = "apriltag";

/// Reads `meta.yml`.
pub(crate) fn meta(files: &SequenceFiles<'_>) -> Result<Meta, Unusable> {
    let file = files.meta.ok_or_else(|| Unusable::Missing {
        file: "meta.yml".to_owned(),
    })?;
    let meta: Meta = read_yaml(file)?;
    let value = |what: String| Unusable::Value {
        what,
        file: file.name.clone(),
    };
    if meta.num_frames > MAX_IMAGES {
        return Err(value(format!(
            "`num_frames` is {}, more than {MAX_IMAGES}",
            meta.num_frames
        )));
    }
    if meta.ycb_ids.len() > MAX_OBJECTS {
        return Err(value(format!("{} `ycb_ids`", meta.ycb_ids.len())));
    }
    Ok(meta)
}

/// Reads one recording whose `meta.yml` is `meta`.
pub(crate) fn recording(meta: &Meta, files: &SequenceFiles<'_>) -> Result<Recording, Unusable> {
    let object = grasped_object(meta, files)?;
    if files.labels.is_empty() {
        return Err(Unusable::NoLabels);
    }
    let calibration = Calibration::read(meta, files)?;
    let cameras = meta
        .serials
        .iter()
        .filter(|serial| files.labels.contains_key(serial.as_str()))
        .map(|serial| Ok((serial.as_str(), calibration.world_from_camera(serial)?)))
        .collect::<Result<Vec<_>, Unusable>>()?;
    if cameras.is_empty() {
        return Err(Unusable::NoLabels);
    }
    let n_images = usize::try_from(meta.num_frames).unwrap_or(usize::MAX);
    let mut images = Vec::with_capacity(n_images);
    for image in (0_u32..).take(n_images) {
        let mut observation = Observation::default();
        for (serial, world_from_camera) in &cameras {
            let Some(file) = files.labels.get(serial).and_then(|of| of.get(&image)) else {
                continue;
            };
            observe(&mut observation, file, meta, world_from_camera)?;
            if observation.keypoints_in_world.is_some() && observation.world_from_object.is_some() {
                break;
            }
        }
        images.push(observation);
    }
    if let Some(file) = files.poses
        && images.iter().any(|image| image.world_from_object.is_none())
    {
        fill_poses(&mut images, file, meta)?;
    }
    Ok(Recording {
        object: object.to_owned(),
        world_from_tag: calibration.world_from_tag()?,
        images,
    })
}

/// Returns the name of the object that is grasped.
pub(crate) fn grasped_object(
    meta: &Meta,
    files: &SequenceFiles<'_>,
) -> Result<&'static str, Unusable> {
    let value = |what: String| Unusable::Value {
        what,
        file: files.meta.map(|file| file.name.clone()).unwrap_or_default(),
    };
    let number = *meta.ycb_ids.get(meta.ycb_grasp_ind).ok_or_else(|| {
        value(format!(
            "`ycb_grasp_ind` is {}, but there are {} objects",
            meta.ycb_grasp_ind,
            meta.ycb_ids.len()
        ))
    })?;
    ycb::name(number).ok_or_else(|| value(format!("object {number} has no name")))
}

/// Adds to `observation` what one camera's labels show and it lacks.
fn observe(
    observation: &mut Observation,
    file: &SourceFile,
    meta: &Meta,
    world_from_camera: &Pose<World, Camera>,
) -> Result<(), Unusable> {
    let bytes = read(file, MAX_LABEL_BYTES)?;
    let npz = |source| Unusable::Npz {
        file: file.name.clone(),
        source,
    };
    let mut labels = Arrays::open(&bytes).map_err(npz)?;
    if observation.keypoints_in_world.is_none() {
        let numbers = labels
            .numbers("joint_3d", &[1, KEYPOINTS as u64, 3])
            .map_err(npz)?;
        observation.keypoints_in_world = keypoints(&numbers)
            .map(|in_camera| in_camera.map(|point| world_from_camera.point(&point)));
    }
    if observation.world_from_object.is_none() {
        let numbers = labels
            .numbers("pose_y", &[meta.ycb_ids.len() as u64, 3, 4])
            .map_err(npz)?;
        let rows = numbers.chunks_exact(12).nth(meta.ycb_grasp_ind);
        let rows: Option<[f64; 12]> = rows.and_then(|rows| rows.try_into().ok());
        if let Some(rows) = rows.filter(|rows| rows.iter().any(|&number| number != 0.0)) {
            let isometry = yaml::isometry(&rows).ok_or_else(|| Unusable::Value {
                what: "`pose_y` is not a rotation and a translation".to_owned(),
                file: file.name.clone(),
            })?;
            let camera_from_object = Pose::<Camera, Object>::new(isometry);
            observation.world_from_object = Some(world_from_camera * &camera_from_object);
        }
    }
    Ok(())
}

/// Returns the landmarks, `None` if all numbers are −1: no hand.
fn keypoints(numbers: &[f64]) -> Option<Keypoints> {
    #[expect(clippy::float_cmp, reason = "the mark for `no hand` is exactly -1")]
    let is_marked = numbers.iter().all(|&number| number == -1.0);
    if is_marked {
        return None;
    }
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (point, xyz) in keypoints.iter_mut().zip(numbers.chunks_exact(3)) {
        point.coords.copy_from_slice(xyz);
    }
    Some(keypoints)
}

/// Adds the object's poses from `pose.npz` to the images that lack them.
fn fill_poses(images: &mut [Observation], file: &SourceFile, meta: &Meta) -> Result<(), Unusable> {
    let bytes = read(file, MAX_POSES_BYTES)?;
    let n_objects = meta.ycb_ids.len();
    let numbers = Arrays::open(&bytes)
        .and_then(|mut arrays| {
            arrays.numbers("pose_y", &[images.len() as u64, n_objects as u64, 7])
        })
        .map_err(|source| Unusable::Npz {
            file: file.name.clone(),
            source,
        })?;
    for (image, poses) in images.iter_mut().zip(numbers.chunks_exact(7 * n_objects)) {
        let pose = poses.chunks_exact(7).nth(meta.ycb_grasp_ind);
        if image.world_from_object.is_some() {
            continue;
        }
        let Some(&[x, y, z, w, px, py, pz]) = pose else {
            continue;
        };
        // The dataset's marks for an object that is not there: all zero, or no motion at all.
        let is_marked = [x, y, z, px, py, pz].iter().all(|&number| number == 0.0);
        if is_marked {
            continue;
        }
        let rotation = quaternion_xyzw([x, y, z, w]).map_err(|err| Unusable::Value {
            what: format!("`pose_y`: {err}"),
            file: file.name.clone(),
        })?;
        let translation = Translation3::new(px, py, pz);
        image.world_from_object = Some(Pose::new(Isometry3::from_parts(translation, rotation)));
    }
    Ok(())
}

/// Where the cameras and the tag are.
struct Calibration<'a> {
    file: &'a SourceFile,
    extrinsics: Extrinsics,
}

impl<'a> Calibration<'a> {
    fn read(meta: &Meta, files: &SequenceFiles<'a>) -> Result<Self, Unusable> {
        let file = files.extrinsics.ok_or_else(|| Unusable::Missing {
            file: extrinsics_name(&meta.extrinsics),
        })?;
        Ok(Self {
            file,
            extrinsics: read_yaml(file)?,
        })
    }

    fn world_from_camera(&self, serial: &str) -> Result<Pose<World, Camera>, Unusable> {
        self.isometry(serial).map(Pose::new)
    }

    fn world_from_tag(&self) -> Result<Pose<World, Tag>, Unusable> {
        self.isometry(TAG).map(Pose::new)
    }

    fn isometry(&self, name: &str) -> Result<Isometry3<f64>, Unusable> {
        let value = |what: String| Unusable::Value {
            what,
            file: self.file.name.clone(),
        };
        let rows = self
            .extrinsics
            .extrinsics
            .get(name)
            .ok_or_else(|| value(format!("no pose of `{name}`")))?;
        yaml::isometry(rows)
            .ok_or_else(|| value(format!("`{name}` is not a rotation and a translation")))
    }
}

fn read_yaml<T: serde::de::DeserializeOwned>(file: &SourceFile) -> Result<T, Unusable> {
    yaml::parse(&read(file, MAX_YAML_BYTES)?).map_err(|source| Unusable::Yaml {
        file: file.name.clone(),
        source,
    })
}

/// Reads a file of at most `limit` bytes.
pub(crate) fn read(file: &SourceFile, limit: u64) -> Result<Vec<u8>, Unusable> {
    let unreadable = |source| Unusable::Unreadable {
        file: file.name.clone(),
        source,
    };
    let mut opened = File::open(&file.path).map_err(unreadable)?;
    let found = opened.metadata().map_err(unreadable)?.len();
    if found > limit {
        return Err(Unusable::TooLarge {
            file: file.name.clone(),
            found,
            limit,
        });
    }
    let mut bytes = Vec::with_capacity(usize::try_from(found).unwrap_or(0) + 1);
    opened
        .by_ref()
        .take(limit)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    Ok(bytes)
}
