//! `DexYCB`'s reader.
//!
//! Landmarks are `joint_3d` of every camera that has the hand in an image, taken to the world by the
//! camera's pose and fused; so is the object's pose, `pose_y`, or that of `pose.npz` where no camera
//! has it. With the user's hand model, `pose_m` of `pose.npz` gives the landmarks too.
//! The dataset's marks for "not there" (all −1, all 0) become `None` here.

mod calibration;
mod hand_model;
mod layout;
mod poses;

use std::{collections::BTreeSet, path::Path};

use dataflow::SourceFile;
use spatial::{Object, Pose, World};

pub(crate) use self::hand_model::{MAX_MODEL_BYTES, model_file};
use self::{calibration::Calibration, layout::SequenceFiles};
use crate::{
    config::{IngestConfig, Landmarks, TableRule},
    error::{IngestError, RecordingError},
    fuse,
    ingest::Agreement,
    labels::LabelReader,
    reader::{About, ListedRecording, Reader, read, read_yaml},
    recording::{Observation, Recording, StillObject, TableSource},
    selection::Cameras,
    yaml::Meta,
};

/// Largest accepted `pose.npz`: 100 images and 4 objects are 30 kB.
const MAX_POSES_BYTES: u64 = 16 << 20;
/// Maximum number of accepted images of a recording: six minutes at 30 Hz, where the real ones have 72.
const MAX_IMAGES: u64 = 10_800;
/// Maximum number of accepted objects of a scene: as many as are numbered.
const MAX_OBJECTS: usize = 21;
/// Maximum number of accepted cameras of a recording, where the real ones have 8.
const MAX_CAMERAS: usize = 64;
/// Largest accepted median distance of the object's poses in `pose.npz` from those in the labels, in
/// meters, with a tenth of a meter for each radian: both are one fit, written twice.
const MAX_DISAGREEMENT_M: f64 = 0.02;

/// A dataset in `DexYCB`'s layout.
pub(crate) struct DexYcb<'a> {
    root: &'a Path,
    mano_models: Option<&'a Path>,
    landmarks: Landmarks,
    table: TableRule,
    camera_agreement_m: f64,
    rate_hz: Option<f64>,
}

impl<'a> DexYcb<'a> {
    pub(crate) fn new(config: &'a IngestConfig) -> Self {
        Self {
            root: &config.root,
            mano_models: config.mano_models.as_deref(),
            landmarks: config.landmarks,
            table: config.table,
            camera_agreement_m: config.camera_agreement_m,
            rate_hz: config.rate_hz,
        }
    }
}

impl Reader for DexYcb<'_> {
    fn list(&self) -> Result<Vec<ListedRecording>, IngestError> {
        self.listed()
    }

    fn files(
        &self,
        listed: &ListedRecording,
        cameras: Cameras,
    ) -> Result<Vec<SourceFile>, RecordingError> {
        layout::files_of(listed, cameras)
    }

    fn description(&self) -> &'static str {
        layout::META
    }

    fn about(&self, files: &[SourceFile]) -> Result<About, RecordingError> {
        let files = SequenceFiles::sort(files);
        about(&meta(&files)?, &files)
    }

    fn read(&self, files: &[SourceFile]) -> Result<Recording, RecordingError> {
        let files = SequenceFiles::sort(files);
        let meta = meta(&files)?;
        let about = about(&meta, &files)?;
        let calibration = Calibration::read(&meta, &files)?;
        let seen = self.images(&meta, &files, &calibration)?;
        let mut recording = Recording {
            object: about.object,
            subject: about.subject,
            hand: about.hand,
            ground: match (self.table, calibration.world_from_tag()?) {
                (TableRule::Tag, Some(tag)) => TableSource::Tag(tag),
                _ => TableSource::StillObject {
                    others: Vec::new(),
                    above: calibration.middle_of_cameras(&meta.serials)?,
                },
            },
            rate_hz: self.rate_hz,
            images: seen.images,
            agreement: seen.agreement,
        };
        let poses = files
            .poses
            .map(|file| Ok((file, read(file, MAX_POSES_BYTES)?)))
            .transpose()?;
        let poses = poses
            .as_ref()
            .map(|(file, bytes)| (*file, bytes.as_slice()));
        if let Some((file, bytes)) = poses {
            add_poses(&mut recording, &meta, file, bytes)?;
        }
        let n_images = recording.images.len();
        let needs_model = match self.landmarks {
            Landmarks::Mano => true,
            Landmarks::Either => files.labels.is_empty(),
            Landmarks::Labels => false,
        };
        if needs_model {
            hand_model::check_files(&files, &meta)?;
        }
        let modeled = hand_model::keypoints(&files, recording.hand, poses, n_images)?;
        hand_model::combine(&mut recording, modeled, self.landmarks)?;
        Ok(recording)
    }
}

/// Fused observations of the labels, and the cameras' agreement.
struct FusedLabels {
    images: Vec<Observation>,
    agreement: Agreement,
}

impl DexYcb<'_> {
    /// Reads the labels of all cameras and fuses them, image by image.
    fn images(
        &self,
        meta: &Meta,
        files: &SequenceFiles<'_>,
        calibration: &Calibration<'_>,
    ) -> Result<FusedLabels, RecordingError> {
        let cameras = meta
            .serials
            .iter()
            .filter_map(|serial| Some((serial, files.labels.get(serial.as_str())?)))
            .map(|(serial, labels)| Ok((calibration.world_from_camera(serial)?, labels)))
            .collect::<Result<Vec<_>, RecordingError>>()?;
        let is_posed = files.hand_model.is_some() && self.landmarks != Landmarks::Labels;
        if cameras.is_empty() && !is_posed {
            return Err(RecordingError::NoLabels);
        }
        let n_images = usize::try_from(meta.num_frames).unwrap_or(usize::MAX);
        let mut reader = LabelReader::default();
        let mut images = Vec::with_capacity(n_images);
        let (mut spread_m, mut left_out_n) = (0.0_f64, 0);
        let (mut hands, mut objects) = (Vec::new(), Vec::new());
        for image in (0_u32..).take(n_images) {
            hands.clear();
            objects.clear();
            for (world_from_camera, labels) in &cameras {
                let Some(file) = labels.get(&image) else {
                    continue;
                };
                let labels = reader.read(file, meta.ycb_ids.len(), meta.ycb_grasp_ind)?;
                if let Some(hand) = labels.keypoints_in_camera {
                    hands.push(hand.map(|point| *world_from_camera * point));
                }
                let object = labels.camera_from_object;
                objects.extend(object.map(|pose| *world_from_camera * pose));
            }
            let hand = fuse::keypoints(&hands, self.camera_agreement_m);
            let object = fuse::pose(&objects, self.camera_agreement_m);
            let agreeing_n = hand.as_ref().map_or(0, |hand| hand.agreeing_n);
            left_out_n += hands.len() - agreeing_n;
            spread_m = spread_m.max(hand.as_ref().map_or(0.0, |hand| hand.spread_m));
            images.push(Observation {
                keypoints_in_world: hand.map(|hand| hand.value),
                cameras_n: u32::try_from(agreeing_n).unwrap_or(u32::MAX),
                world_from_object: object.map(|object| object.value),
            });
        }
        Ok(FusedLabels {
            images,
            agreement: Agreement {
                cameras_n: Some(cameras.len() as f64),
                camera_spread_m: Some(spread_m),
                disagreeing_labels_n: Some(left_out_n as f64),
                ..Agreement::default()
            },
        })
    }
}

/// Adds what `pose.npz` knows: the object's poses where the labels lack them, and the other objects
/// where nothing marks the table.
fn add_poses(
    recording: &mut Recording,
    meta: &Meta,
    file: &SourceFile,
    bytes: &[u8],
) -> Result<(), RecordingError> {
    let poses = poses::objects(file, bytes, recording.images.len(), meta.ycb_ids.len())?;
    let Some(grasped) = poses.get(meta.ycb_grasp_ind) else {
        return Ok(());
    };
    check_agreement(recording, grasped, file)?;
    for (image, pose) in recording.images.iter_mut().zip(grasped) {
        image.world_from_object = image.world_from_object.or(*pose);
    }
    if let TableSource::StillObject { others, .. } = &mut recording.ground {
        let scene = poses.into_iter().enumerate().zip(&meta.ycb_ids);
        others.extend(
            scene
                .filter(|((number, _), _)| *number != meta.ycb_grasp_ind)
                .filter_map(|((_, poses), &id)| {
                    let object = crate::ycb::name(id)?.to_owned();
                    Some(StillObject { object, poses })
                }),
        );
    }
    Ok(())
}

/// Refuses an object that is one thing in `pose.npz` and another in the labels, as it is where
/// quaternions are swapped.
fn check_agreement(
    recording: &mut Recording,
    grasped: &[Option<Pose<World, Object>>],
    file: &SourceFile,
) -> Result<(), RecordingError> {
    let both = recording.images.iter().zip(grasped);
    let mut distances: Vec<f64> = both
        .filter_map(|(image, pose)| Some((image.world_from_object?, (*pose)?)))
        .map(|(labels, poses)| fuse::distance_m(&labels, &poses))
        .collect();
    distances.sort_unstable_by(f64::total_cmp);
    let Some(&median_m) = distances.get(distances.len() / 2) else {
        return Ok(());
    };
    if median_m > MAX_DISAGREEMENT_M {
        return Err(RecordingError::Value {
            what: format!(
                "`pose_y` of the labels is {median_m:.2} m (or ten times as many radians) from that"
            ),
            file: file.name.clone(),
        });
    }
    recording.agreement.pose_difference_m = Some(median_m);
    Ok(())
}

/// Reads `meta.yml`.
fn meta(files: &SequenceFiles<'_>) -> Result<Meta, RecordingError> {
    let file = files.meta.ok_or_else(|| RecordingError::Missing {
        file: layout::META.to_owned(),
    })?;
    let meta: Meta = read_yaml(file)?;
    let refuse = |what: String| {
        Err(RecordingError::Value {
            what,
            file: file.name.clone(),
        })
    };
    if meta.num_frames > MAX_IMAGES {
        let found = meta.num_frames;
        return refuse(format!("`num_frames` is {found}, more than {MAX_IMAGES}"));
    }
    if meta.ycb_ids.len() > MAX_OBJECTS {
        return refuse(format!("{} `ycb_ids`", meta.ycb_ids.len()));
    }
    if meta.serials.len() > MAX_CAMERAS {
        return refuse(format!("{} `serials`", meta.serials.len()));
    }
    let mut serials = BTreeSet::new();
    if let Some(twice) = meta.serials.iter().find(|serial| !serials.insert(*serial)) {
        return refuse(format!("`serials` has `{twice}` twice"));
    }
    Ok(meta)
}

/// Returns what `meta.yml` says, or what is wrong with it.
fn about(meta: &Meta, files: &SequenceFiles<'_>) -> Result<About, RecordingError> {
    let value = |what: String| RecordingError::Value {
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
    if meta.hand().is_none() {
        return Err(value(format!(
            "`mano_sides` is {:?}, not one of right and left",
            meta.mano_sides
        )));
    }
    layout::about(&files.subject, meta).ok_or_else(|| value(format!("object {number} has no name")))
}
