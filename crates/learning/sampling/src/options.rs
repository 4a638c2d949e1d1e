//! The object and the options of sampling.

use nalgebra::{Point3, Unit, Vector3};
use spatial::RestingPose;

use crate::PenetrationProbe;

/// Options of sampling.
#[derive(Debug, Clone, PartialEq)]
pub struct SamplingOptions {
    /// Number of motions.
    pub n: usize,
    /// Steps of each motion, at equal times; at least 2.
    pub steps: usize,
    /// Time from the first step to the grasp, in seconds.
    pub duration_s: f64,
    /// Share of the motions whose latent code is sampled from a demonstration's posterior, in 0..=1; the codes of
    /// the others are sampled from the function's prior.
    pub posterior_share: f64,
    /// Names of these demonstrations, of any object; empty: all training demonstrations of the object.
    pub demonstrations: Vec<String>,
    /// Factor on the standard deviation of sampled codes.
    pub spread: f64,
    /// Names of two demonstrations between whose means the codes go in equal steps, in the orientation of the first;
    /// none: codes are sampled.
    pub path: Option<[String; 2]>,
    /// The object's resting orientations.
    pub orientations: Orientations,
    /// Noise on the object's points, new for each motion: standard deviation along each axis as a share of the
    /// object's extent.
    pub point_noise: f64,
}

/// Resting orientations in which an object gets motions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Orientations {
    /// Those of its demonstrations, as often as they were seen; of an object that the function was not trained on,
    /// the stable ones.
    Seen,
    /// Those of its demonstrations, also of an object that the function was not trained on.
    Recorded,
    /// Those that are stable, by their probability.
    Stable,
    /// With this direction of the object's frame up, the lowest vertex on the table.
    Given(Unit<Vector3<f64>>),
}

/// An object, in its own frame.
#[derive(Debug, Clone)]
pub struct SampledObject<'a> {
    /// Its name.
    pub name: &'a str,
    /// Points on its surface, in meters, in random order.
    pub points_m: &'a [[f64; 3]],
    /// Vertices of its mesh, in meters.
    pub vertices_m: &'a [[f64; 3]],
    /// Its resting orientations, the most frequent first; may be empty.
    pub orientations: Vec<Orientation>,
}

/// A resting orientation of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orientation {
    /// Up direction and height.
    pub rest: RestingPose,
    /// Number of demonstrations in which the object lay so.
    pub seen_n: u32,
    /// Share of random drops of the object that end so.
    pub probability: f64,
}

/// When a motion is drawn again.
#[derive(Clone, Copy)]
pub struct Redraws<'a> {
    /// Measures how deep the hand is.
    pub probe: PenetrationProbe<'a>,
    /// Most draws of a motion, the first among them.
    pub max_draws: usize,
    /// Tolerated depth in object or table, in meters.
    pub max_depth_m: f64,
}

impl SampledObject<'_> {
    /// Returns the points on the surface.
    pub(crate) fn points(&self) -> Vec<Point3<f64>> {
        let points = self.points_m.iter().map(|&point| Point3::from(point));
        points.collect()
    }
}
