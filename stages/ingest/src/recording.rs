//! One recording, parsed: what every dataset's reader fills and everything later works on.

use nalgebra::Point3;
use schemas::demonstrations::KEYPOINTS;
use spatial::{Object, Pose, World};

/// The frame of the tag that lies on the table: z up against gravity, z = 0 the table's surface.
pub(crate) enum Tag {}

/// The 21 landmarks of a hand, in meters.
pub type Keypoints = [Point3<f64>; KEYPOINTS];

/// A recording of a hand that grasps an object.
#[derive(Debug, Clone)]
pub(crate) struct Recording {
    /// The grasped object's name.
    pub(crate) object: String,
    /// Pose of the table's tag.
    pub(crate) world_from_tag: Pose<World, Tag>,
    /// What each image shows, by the image's number.
    pub(crate) images: Vec<Observation>,
}

/// What one image shows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Observation {
    /// The hand's landmarks, if it is seen, in meters.
    pub(crate) keypoints_in_world: Option<Keypoints>,
    /// The object's pose, if it is seen.
    pub(crate) world_from_object: Option<Pose<World, Object>>,
}
