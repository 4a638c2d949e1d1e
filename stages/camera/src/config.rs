//! Options of `kind = "camera"`.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, FRAC_PI_6};

use depth_view::StereoNoise;
use options::{OptionFaults, options};

/// Most views of an object.
const MAX_VIEWS: usize = 64;
/// Most pixels along a side.
const MAX_SIDE: usize = 4096;
/// Farthest that a camera is from an object, in meters.
const MAX_DISTANCE_M: f64 = 10.0;

/// Options of `kind = "camera"`.
#[options(also = Self::combined_faults)]
pub struct CameraConfig {
    /// Views of each object, in one world
    #[option(default = 1, range = 1..=MAX_VIEWS, why = "each is an image in memory")]
    pub views_n: usize,
    /// Pixels of a row: those of a stereo camera at its usual setting
    #[option(default = 640, range = 16..=MAX_SIDE, why = "an image is in memory")]
    pub width: usize,
    /// Number of rows
    #[option(default = 480, range = 16..=MAX_SIDE, why = "an image is in memory")]
    pub height: usize,
    /// Horizontal field of view (rad): that of a `RealSense` D435 in an image of 4:3
    #[option(default = 1.2, range = 0.05..=3.0, why = "a pinhole sees less than half a turn")]
    pub field_of_view_rad: f64,
    /// Distance from the camera to the point that it looks at (m): an arm's length
    #[option(default = 0.6, range = 0.05..=MAX_DISTANCE_M, why = "it is over a table")]
    pub distance_m: f64,
    /// Least angle of the camera's direction below the horizontal (rad), drawn evenly from there to `elevation_most_rad`:
    /// 30 degrees
    #[option(default = FRAC_PI_6, range = 0.0..=FRAC_PI_2, why = "a camera looks down at a table")]
    pub elevation_least_rad: f64,
    /// Greatest angle of the camera's direction below the horizontal (rad): 60 degrees
    #[option(default = FRAC_PI_3, range = 0.0..=FRAC_PI_2, why = "a camera looks down at a table")]
    pub elevation_most_rad: f64,
    /// Farthest that the object is from the point at which the camera looks, along both axes of the table (m): as a person
    /// puts it down
    #[option(default = 0.03, range = 0.0..=1.0, why = "it is in view")]
    pub off_center_m: f64,
    /// Errors of the depths
    #[option(default, table)]
    pub noise: StereoNoise,
    /// Error of each camera's known position (m), in a random direction, for a study (0)
    #[option(default, range = 0.0..=1.0, why = "it is an error")]
    pub position_error_m: f64,
    /// Error of each camera's known orientation (rad), about a random axis, for a study (0)
    #[option(default, range = 0.0..=1.0, why = "it is an error")]
    pub orientation_error_rad: f64,
}

impl CameraConfig {
    fn combined_faults(&self, faults: &mut OptionFaults) {
        if self.elevation_least_rad > self.elevation_most_rad {
            let (least, most) = (self.elevation_least_rad, self.elevation_most_rad);
            let problem =
                format!("is {least}, and `elevation_most_rad` is {most}: it must not be less");
            faults.note("elevation_least_rad", problem);
        }
    }
}
