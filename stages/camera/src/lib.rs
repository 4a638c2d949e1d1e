//! Depth images of the objects by a simulated camera: what a stereo camera over a table would measure of each.
//!
//! One unit per object. The object lies in one of its resting orientations, anywhere near the point at which the camera
//! looks and turned at random; every camera of a unit looks from a random direction. The images carry the object's true
//! pose, which `ground_truth` reads, and `register` to report its errors.

mod camera;
mod config;

pub use camera::{CameraMetrics, SimulatedCamera};
pub use config::CameraConfig;
