//! A parsed recording: the output of every dataset's reader, and the input of all later steps.

use nalgebra::Point3;
use schemas::demonstrations::{KEYPOINTS, Side};
use spatial::{Object, Pose, World};

use crate::{config::USUAL_RATE_HZ, ingest::Agreement};

/// The frame of the tag that lies on the table: z up against gravity, z = 0 the table's surface.
pub(crate) enum Tag {}

/// The 21 landmarks of a hand, in meters.
pub type Keypoints = [Point3<f64>; KEYPOINTS];

/// A recording of a hand that grasps an object.
#[derive(Debug, Clone)]
pub(crate) struct Recording {
    /// The grasped object's name.
    pub(crate) object: String,
    /// The subject.
    pub(crate) subject: String,
    /// The hand that grasps.
    pub(crate) hand: Side,
    /// The source of the table's pose.
    pub(crate) ground: TableSource,
    /// Images per second, if the recording or the pipeline file gives them.
    pub(crate) rate_hz: Option<f64>,
    /// The content of each image, by the image's number.
    pub(crate) images: Vec<Observation>,
    /// Agreement of the sources.
    pub(crate) agreement: Agreement,
}

impl Recording {
    /// Returns the images per second.
    pub(crate) fn rate_hz(&self) -> f64 {
        self.rate_hz.unwrap_or(USUAL_RATE_HZ)
    }
}

/// Source of the table's pose.
#[derive(Debug, Clone)]
pub(crate) enum TableSource {
    /// A tag lies on it.
    Tag(Pose<World, Tag>),
    /// Nothing marks it, but still objects stood on it.
    StillObject {
        /// The objects of the scene but the grasped one.
        others: Vec<StillObject>,
        /// A place above the table, such as the middle of the cameras, in the world.
        above: Option<Point3<f64>>,
    },
}

/// An untouched object of the scene.
#[derive(Debug, Clone)]
pub(crate) struct StillObject {
    /// Its name.
    pub(crate) object: String,
    /// Its pose in each image, where it is seen.
    pub(crate) poses: Vec<Option<Pose<World, Object>>>,
}

/// The content of one image.
#[derive(Debug, Clone, Default)]
pub(crate) struct Observation {
    /// The hand's landmarks, if it is seen, in meters.
    pub(crate) keypoints_in_world: Option<Keypoints>,
    /// Cameras whose landmarks agree and were fused.
    pub(crate) cameras_n: u32,
    /// The object's pose, if it is seen.
    pub(crate) world_from_object: Option<Pose<World, Object>>,
}
