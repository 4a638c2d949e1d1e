//! `HO-Cap`'s reader.
//!
//! Written from the layout that its toolkit reads, <https://github.com/IRVLUTD/HO-Cap>; it has not met the
//! dataset's own files.
//!
//! The world is the frame of the tag `tag_1` on the table: z up, z = 0 the surface. `poses_o.npy` holds the
//! objects' poses in it. The hand's landmarks are `hand_joints_3d` of every camera, taken to the world by the
//! camera's pose and fused; marks for "not there" (−1) become `None` here.
//!
//! A recording has several objects, and people move one after the other. It is read as the reach to the object
//! that moves first, by the hand that `mano_sides` names; where it names both, by the configured one, if that is
//! the nearer hand when the object leaves.

mod files;
mod poses;

use std::path::Path;

use dataflow::SourceFile;
use nalgebra::{Point3, Vector3};
use schemas::demonstrations::Side;
use spatial::{Camera, Pose, World};

pub(crate) use self::files::MESH;
use self::{
    files::{Meta, SequenceFiles},
    poses::Poses,
};
use crate::{
    config::{IngestConfig, TableRule},
    departure::{self, Departure, Rule},
    error::{IngestError, RecordingError},
    fuse,
    ingest::Agreement,
    labels::LabelReader,
    reader::{About, ListedRecording, Reader, read_yaml},
    recording::{Keypoints, Observation, Recording, StillObject, TableSource, Tag},
    selection::Cameras,
    yaml::Extrinsics,
};

/// Largest accepted `poses_o.npy`: a thousand images of four objects in f4 are 112 kB.
const MAX_POSES_BYTES: u64 = 16 << 20;
/// Maximum number of accepted images of a recording: six minutes at 30 Hz.
const MAX_IMAGES: u64 = 10_800;
/// Maximum number of accepted objects of a scene, where the dataset has four.
const MAX_OBJECTS: usize = 64;
/// Maximum number of accepted cameras of a recording, where the dataset has eight.
const MAX_CAMERAS: usize = 64;
/// Largest accepted median distance of the object's poses in the labels from those in `poses_o.npy`, in meters, with
/// a tenth of a meter for each radian: both are one fit, written twice.
const MAX_DISAGREEMENT_M: f64 = 0.02;
/// The tag whose frame is the world.
const TAG: &str = "tag_1";

/// Returns the number of the object that moves first by a rule, from the bytes of `meta.yaml` and `poses_o.npy`;
/// `None` if none moves.
///
/// # Errors
///
/// Fails if one is damaged or does not fit the other.
pub(crate) fn first_moved(
    meta: &[u8],
    poses: &[u8],
    rule: &Rule,
) -> Result<Option<usize>, RecordingError> {
    let meta = Meta::parse(files::META, meta)?;
    let poses = meta.poses(files::POSES, poses)?;
    Ok(grasped(&poses, rule).map(|grasped| grasped.number))
}

/// Finds the object that moves first.
fn grasped(poses: &Poses, rule: &Rule) -> Option<Grasped> {
    let moved = poses.iter().enumerate().filter_map(|(number, poses)| {
        let departure = departure::find(poses, rule)?;
        Some(Grasped { number, departure })
    });
    moved.min_by_key(|grasped| grasped.departure.left)
}

/// A dataset in `HO-Cap`'s layout.
pub(crate) struct HoCap<'a> {
    root: &'a Path,
    hand: Side,
    table: TableRule,
    camera_agreement_m: f64,
    rate_hz: Option<f64>,
    moved: Rule,
}

/// The object that moves first: its number, and when it leaves.
struct Grasped {
    number: usize,
    departure: Departure,
}

/// Metadata of a recording and poses of its objects.
struct RecordingFiles {
    meta: Meta,
    poses: Poses,
    about: About,
    grasped: Grasped,
}

impl<'a> HoCap<'a> {
    pub(crate) fn new(config: &'a IngestConfig) -> Self {
        Self {
            root: &config.root,
            hand: config.hand,
            table: config.table,
            camera_agreement_m: config.camera_agreement_m,
            rate_hz: config.rate_hz,
            moved: Rule::from(config),
        }
    }

    /// Returns what a recording is about, from its metadata and its objects' poses.
    fn about_of(&self, subject: &str, meta: &Meta, poses: &Poses) -> Option<(About, Grasped)> {
        let grasped = grasped(poses, &self.moved)?;
        let about = About {
            subject: subject.to_owned(),
            object: meta.object_ids.get(grasped.number)?.clone(),
            hand: meta.hand(self.hand)?,
            scene: meta.object_ids.clone(),
        };
        Some((about, grasped))
    }

    /// Reads what a recording is about, or says what is wrong with it.
    fn described(&self, files: &SequenceFiles<'_>) -> Result<RecordingFiles, RecordingError> {
        let meta = files.meta()?;
        let poses = files.poses(&meta)?;
        let about = self.about_of(&files.subject, &meta, &poses);
        let (about, grasped) = about.ok_or_else(|| {
            files.about_meta(match meta.hand(self.hand) {
                None => format!(
                    "`mano_sides` is {:?}, not one or both of right and left",
                    meta.mano_sides
                ),
                Some(_) => "no object moves".to_owned(),
            })
        })?;
        Ok(RecordingFiles {
            meta,
            poses,
            about,
            grasped,
        })
    }
}

impl Reader for HoCap<'_> {
    fn list(&self) -> Result<Vec<ListedRecording>, IngestError> {
        let listed = files::listed(self.root, |subject, meta, poses| {
            Some(self.about_of(subject, meta, poses)?.0)
        })?;
        let marks_table = self.table == TableRule::Tag;
        Ok(listed
            .into_iter()
            .map(|listed| ListedRecording {
                marks_table: marks_table || listed.about.is_none(),
                ..listed
            })
            .collect())
    }

    fn files(
        &self,
        listed: &ListedRecording,
        cameras: Cameras,
    ) -> Result<Vec<SourceFile>, RecordingError> {
        files::files_of(listed, cameras)
    }

    fn description(&self) -> &'static str {
        files::META
    }

    fn about(&self, files: &[SourceFile]) -> Result<About, RecordingError> {
        Ok(self.described(&SequenceFiles::sort(files))?.about)
    }

    fn read(&self, files: &[SourceFile]) -> Result<Recording, RecordingError> {
        let files = SequenceFiles::sort(files);
        let described = self.described(&files)?;
        let calibration = Calibration::read(&files, &described.meta)?;
        let seen = self.seen(&described, &files, &calibration)?;
        let RecordingFiles {
            meta,
            poses,
            about,
            grasped,
        } = described;
        check_nearer_hand(&seen, about.hand, &grasped.departure, &files)?;
        let mut poses: Vec<_> = poses.into_iter().map(Some).collect();
        let object = poses
            .get_mut(grasped.number)
            .and_then(Option::take)
            .unwrap_or_default();
        let [right, left] = seen.hands;
        let hands = match about.hand {
            Side::Right => right,
            Side::Left => left,
        };
        let images = hands
            .into_iter()
            .zip(object)
            .map(|(hand, pose)| Observation {
                cameras_n: hand
                    .as_ref()
                    .map_or(0, |hand| u32::try_from(hand.agreeing_n).unwrap_or(u32::MAX)),
                keypoints_in_world: hand.map(|hand| hand.value),
                world_from_object: pose,
            });
        let others = poses
            .into_iter()
            .zip(&meta.object_ids)
            .filter_map(|(poses, name)| {
                Some(StillObject {
                    object: name.clone(),
                    poses: poses?,
                })
            });
        Ok(Recording {
            rate_hz: self.rate_hz,
            images: images.collect(),
            ground: match self.table {
                TableRule::Tag => TableSource::Tag(Pose::<World, Tag>::identity()),
                TableRule::Objects => TableSource::StillObject {
                    others: others.collect(),
                    above: calibration.middle,
                },
            },
            object: about.object,
            subject: about.subject,
            hand: about.hand,
            agreement: seen.agreement,
        })
    }
}

/// The hands that cameras saw: right and left, image by image.
struct ObservedHands {
    hands: [Vec<Option<fuse::CameraConsensus<Keypoints>>>; 2],
    agreement: Agreement,
}

impl HoCap<'_> {
    /// Reads the labels of all cameras and fuses them, image by image; compares the grasped object's poses in them
    /// with those of the scene.
    fn seen(
        &self,
        described: &RecordingFiles,
        files: &SequenceFiles<'_>,
        calibration: &Calibration,
    ) -> Result<ObservedHands, RecordingError> {
        let (meta, grasped) = (&described.meta, described.grasped.number);
        let tracked = described.poses.get(grasped).map_or(&[][..], Vec::as_slice);
        let cameras: Vec<_> = calibration
            .world_from_cameras
            .iter()
            .filter_map(|(serial, pose)| Some((pose, files.labels.get(serial.as_str())?)))
            .collect();
        if cameras.is_empty() {
            return Err(RecordingError::NoLabels);
        }
        let mut reader = LabelReader::default();
        let mut hands = [Vec::new(), Vec::new()];
        let (mut spread_m, mut left_out_n) = (0.0_f64, 0);
        let mut apart_m = Vec::new();
        let images = u32::try_from(meta.num_frames).unwrap_or(u32::MAX);
        for image in 0..images {
            let mut seen: [Vec<Keypoints>; 2] = Default::default();
            for (world_from_camera, labels) in &cameras {
                let Some(file) = labels.get(&image) else {
                    continue;
                };
                let labels = reader.read_hands(file, meta.object_ids.len(), grasped)?;
                for (hand, seen) in labels.hands.into_iter().zip(&mut seen) {
                    seen.extend(hand.map(|hand| hand.map(|point| **world_from_camera * point)));
                }
                let tracked = tracked.get(image as usize).copied().flatten();
                let labeled = labels
                    .camera_from_object
                    .map(|pose| **world_from_camera * pose);
                apart_m.extend(tracked.zip(labeled).map(|(a, b)| fuse::distance_m(&a, &b)));
            }
            for ((seen, hand), side) in seen.iter().zip(&mut hands).zip([Side::Right, Side::Left]) {
                let fused = fuse::keypoints(seen, self.camera_agreement_m);
                if side == described.about.hand {
                    left_out_n += seen.len() - fused.as_ref().map_or(0, |fused| fused.agreeing_n);
                    spread_m = spread_m.max(fused.as_ref().map_or(0.0, |fused| fused.spread_m));
                }
                hand.push(fused);
            }
        }
        apart_m.sort_unstable_by(f64::total_cmp);
        let pose_difference_m = apart_m.get(apart_m.len() / 2).copied();
        if let Some(median_m) = pose_difference_m.filter(|median_m| *median_m > MAX_DISAGREEMENT_M)
        {
            return Err(files.about_poses(format!(
                "`obj_poses` of the labels is {median_m:.2} m (or ten times as many radians) from that"
            )));
        }
        Ok(ObservedHands {
            hands,
            agreement: Agreement {
                pose_difference_m,
                cameras_n: Some(cameras.len() as f64),
                camera_spread_m: Some(spread_m),
                disagreeing_labels_n: Some(left_out_n as f64),
                ..Agreement::default()
            },
        })
    }
}

/// Refuses a recording whose object leaves with the other hand.
fn check_nearer_hand(
    seen: &ObservedHands,
    hand: Side,
    departure: &Departure,
    files: &SequenceFiles<'_>,
) -> Result<(), RecordingError> {
    let object = Point3::from(departure.world_from_object.translation.vector);
    let nearest_m = |hands: &[Option<fuse::CameraConsensus<Keypoints>>]| {
        let hand = hands.get(departure.left)?.as_ref()?;
        let distances = hand.value.iter().map(|point| (point - object).norm());
        distances.reduce(f64::min)
    };
    let [right, left] = seen.hands.each_ref().map(|hands| nearest_m(hands));
    let (own, other) = match hand {
        Side::Right => (right, left),
        Side::Left => (left, right),
    };
    match (own, other) {
        (Some(own), Some(other)) if other < own => Err(files.about_meta(format!(
            "the object that moves first leaves with the hand that is not the {} one",
            hand.as_str()
        ))),
        _ => Ok(()),
    }
}

/// Poses of the cameras.
struct Calibration {
    /// By serial number, in the recording's order.
    world_from_cameras: Vec<(String, Pose<World, Camera>)>,
    /// The middle of the cameras, which look down on the table.
    middle: Option<Point3<f64>>,
}

impl Calibration {
    /// Reads a recording's `extrinsics` file: poses of cameras and tags in the frame of the master camera.
    fn read(files: &SequenceFiles<'_>, meta: &Meta) -> Result<Self, RecordingError> {
        let file = files.extrinsics.ok_or_else(|| RecordingError::Missing {
            file: meta.extrinsics_name(),
        })?;
        let extrinsics: Extrinsics = read_yaml(file)?;
        // The master camera's frame is only passed through, and so has no name of its own.
        let tag: Pose<Camera, World> = extrinsics.pose(TAG, file)?;
        let cameras = meta.realsense.serials.iter().map(|serial| {
            let master_from_camera: Pose<Camera, Camera> = extrinsics.pose(serial, file)?;
            Ok((serial.clone(), tag.inverse() * master_from_camera))
        });
        let world_from_cameras = cameras.collect::<Result<Vec<_>, RecordingError>>()?;
        let sum: Vector3<f64> = world_from_cameras
            .iter()
            .map(|(_, pose)| pose.translation.vector)
            .sum();
        let middle = Point3::from(sum / world_from_cameras.len().max(1) as f64);
        Ok(Self {
            middle: (!world_from_cameras.is_empty()).then_some(middle),
            world_from_cameras,
        })
    }
}
