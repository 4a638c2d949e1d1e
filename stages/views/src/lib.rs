//! Reads depth images of objects on a table from the files that a lab has, so that objects can be estimated and grasped
//! that nobody has a mesh of.
//!
//! One unit per object. Three layouts are read, and what lies at `path` decides which:
//!
//! - a scene's folder in BOP layout
//!   (<https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md>): `scene_camera.json` and
//!   `depth/NNNNNN.png`, and if they are there `mask_visib` or `mask` and `scene_gt.json`. Images with camera poses are
//!   views of one world; without poses each image is a world of its own, and one image of an object is used;
//! - a cloud of the points that one camera saw, `.ply` or `.npy`, which becomes the depth image of a camera at the same
//!   place;
//! - a recording of a depth camera in ROS 2, in MCAP format: depth images with their `CameraInfo`, or clouds. Images whose
//!   camera tf tracks are views of one world, the frame that is the root of tf; without it one image is used.
//!
//! Without masks the object is the largest thing on the table. Everything is checked here: an image whose numbers do not
//! fit together is left out with the reason and what to do, and so is an object without a usable image.
//!
//! What it deliberately does not do: undistort images, register clouds to each other, or tell objects apart by more than
//! their masks. A cloud that several cameras fused is not what one camera sees: its images are better.

mod bop;
mod camera_info;
mod cloud;
mod cloud_message;
mod config;
mod depth_message;
mod error;
mod file;
mod layout;
mod npy;
mod object;
mod ply;
mod png;
mod recording;
mod recording_topics;
mod scene_camera;
mod scene_image;
mod transforms;
mod views;
mod world;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod recording_fixture;
#[cfg(test)]
mod recording_tests;
#[cfg(test)]
mod tests;

pub use config::ViewsConfig;
pub use error::ViewsError;
pub use views::{RecordedViews, ViewsMetrics};
