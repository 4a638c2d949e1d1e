//! `sampling`: plausibility and diversity of the motions drawn for an object, one partition per
//! object, one row per candidate.
//!
//! The hand is its collision shapes, filled with balls; it is measured at the motion's steps.

use crate::{
    SchemaError,
    columns::{Flatten, columns},
    table::table,
};

/// Greatest joint limit excess of a draw, in radians, that counts as within the limits:
/// demonstrations often lie on a limit, and draws scatter to both sides of it.
pub const LIMIT_TOLERANCE_RAD: f64 = 0.05;

/// Plausibility of a motion and its distance from others.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleMeasures {
    /// The motion's name.
    pub candidate_id: String,
    /// Greatest joint limit excess as drawn, before clamping, in radians (meters if prismatic); 0
    /// if none.
    pub limit_excess_rad: f64,
    /// Greatest depth of the hand in the object before the grasp, in meters; 0 if none.
    pub approach_depth_m: f64,
    /// Time of that depth, in seconds since the first step; none without depth.
    pub approach_depth_time_s: Option<f64>,
    /// Greatest depth of the hand in the object at the grasp, in meters; 0 if none.
    pub grasp_depth_m: f64,
    /// Greatest depth of the hand below the table at any step, in meters; 0 if none.
    pub table_depth_m: f64,
    /// The object's demonstration with the nearest grasp, and its distance.
    pub demonstration: Option<(String, GraspDistance)>,
    /// Distance of the grasp from the mean of all motions in which the object lies alike; none if it is the only one.
    pub from_mean: Option<GraspDistance>,
}

/// Distance between two grasps of an object.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GraspDistance {
    /// Distance of the palms' origins, in meters.
    pub palm_m: f64,
    /// Angle between the palms, in radians.
    pub palm_rad: f64,
    /// Root mean square difference of the joint positions, in radians (meters if prismatic).
    pub q_rad: f64,
}

impl GraspDistance {
    /// Returns a distance of three columns, none if all are null. In `sampling/1` a single 0 is read as null.
    fn of_columns(columns: [Option<f64>; 3]) -> Option<Self> {
        let is_there = columns.iter().any(Option::is_some);
        let [palm_m, palm_rad, q_rad] = columns.map(Option::unwrap_or_default);
        is_there.then_some(Self {
            palm_m,
            palm_rad,
            q_rad,
        })
    }
}

impl SampleMeasures {
    /// Returns whether every joint was drawn within [`LIMIT_TOLERANCE_RAD`] of its limits.
    pub fn within_limits(&self) -> bool {
        self.limit_excess_rad <= LIMIT_TOLERANCE_RAD
    }
}

/// The motions drawn for one object.
pub type Sampling = Vec<SampleMeasures>;
table! {"sampling", 2, per "object", rows: SampleMeasures}

columns! {
    /// The columns of a [`SampleMeasures`].
    pub(crate) struct Flat {
        candidate_id: String => "the motion",
        + within_limits: bool = |row| row.limit_excess_rad <= LIMIT_TOLERANCE_RAD
            => "no joint was drawn farther outside its limits than 0.05 rad",
        limit_excess_rad: f64 ["rad"]
            => "farthest that a joint was drawn outside its limits, before it was put back",
        approach_depth_m: f64 ["m"] => "deepest that the hand is in the object before the grasp",
        approach_depth_time_s: Option<f64> ["s"] => "when that is, since the first step; null if it never is",
        grasp_depth_m: f64 ["m"] => "deepest that the hand is in the object at the grasp",
        table_depth_m: f64 ["m"] => "deepest that the hand is below the table at any step",
        demonstration: String
            => "sequence of the object's demonstration with the nearest grasp; empty if there is none",
        demonstration_palm_m: Option<f64> ["m"]
            => "distance of the palm from its palm at the grasp; null without one",
        demonstration_palm_rad: Option<f64> ["rad"]
            => "angle between the two palms; null without one",
        demonstration_q_rad: Option<f64> ["rad"]
            => "root mean square difference of the joint positions; null without one",
        mean_palm_m: Option<f64> ["m"]
            => "distance of the palm from the mean of all motions with the object lying so, at the grasp; null if it is the only one",
        mean_palm_rad: Option<f64> ["rad"]
            => "angle between the two palms; null if it is the only one",
        mean_q_rad: Option<f64> ["rad"]
            => "root mean square difference of the joint positions; null if it is the only one",
    }
}

impl Flatten for SampleMeasures {
    type Flat = Flat;

    fn flat(&self) -> Flat {
        let (demonstration, nearest) = self.demonstration.clone().unzip();
        Flat {
            candidate_id: self.candidate_id.clone(),
            limit_excess_rad: self.limit_excess_rad,
            approach_depth_m: self.approach_depth_m,
            approach_depth_time_s: self.approach_depth_time_s,
            grasp_depth_m: self.grasp_depth_m,
            table_depth_m: self.table_depth_m,
            demonstration: demonstration.unwrap_or_default(),
            demonstration_palm_m: nearest.map(|nearest| nearest.palm_m),
            demonstration_palm_rad: nearest.map(|nearest| nearest.palm_rad),
            demonstration_q_rad: nearest.map(|nearest| nearest.q_rad),
            mean_palm_m: self.from_mean.map(|mean| mean.palm_m),
            mean_palm_rad: self.from_mean.map(|mean| mean.palm_rad),
            mean_q_rad: self.from_mean.map(|mean| mean.q_rad),
        }
    }

    fn from_flat(flat: Flat) -> Result<Self, SchemaError> {
        let nearest = GraspDistance::of_columns([
            flat.demonstration_palm_m,
            flat.demonstration_palm_rad,
            flat.demonstration_q_rad,
        ]);
        let from_mean = [flat.mean_palm_m, flat.mean_palm_rad, flat.mean_q_rad];
        let is_near = !flat.demonstration.is_empty();
        Ok(Self {
            candidate_id: flat.candidate_id,
            limit_excess_rad: flat.limit_excess_rad,
            approach_depth_m: flat.approach_depth_m,
            approach_depth_time_s: flat.approach_depth_time_s,
            grasp_depth_m: flat.grasp_depth_m,
            table_depth_m: flat.table_depth_m,
            demonstration: is_near.then(|| (flat.demonstration, nearest.unwrap_or_default())),
            from_mean: GraspDistance::of_columns(from_mean),
        })
    }
}
