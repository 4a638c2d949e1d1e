//! `sampling`: how plausible and how different the motions drawn for an object are, one partition per
//! object, one row per candidate.
//!
//! The hand is its collision shapes, filled with balls; it is measured at the motion's steps.

use crate::{
    SchemaError,
    columns::{Reader, Row, Writer, columns},
    table::table,
};

/// How far outside its limits a joint may be drawn, in radians, to count as within them: demonstrations
/// often lie on a limit, and about them something is drawn on either side.
pub const LIMIT_TOLERANCE_RAD: f64 = 0.05;

/// How plausible a motion is and how far from others.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    /// The motion's name.
    pub candidate_id: String,
    /// Farthest that a joint was drawn outside its limits, before it was put back to them, in radians
    /// (meters if prismatic); 0 if none was.
    pub limit_excess_rad: f64,
    /// Deepest that the hand is in the object before the grasp, in meters; 0 if it never is.
    pub approach_depth_m: f64,
    /// When that is, in seconds since the first step; 0 if it never is.
    pub approach_depth_time_s: f64,
    /// Deepest that the hand is in the object at the grasp, in meters; 0 if it is not.
    pub grasp_depth_m: f64,
    /// Deepest that the hand is below the table at any step, in meters; 0 if it never is.
    pub table_depth_m: f64,
    /// The object's demonstration with the nearest grasp, and how far that is.
    pub demonstration: Option<(String, GraspDistance)>,
    /// How far the grasp is from the mean of all motions with the object lying so.
    pub from_mean: GraspDistance,
}

/// How far two grasps of an object are apart.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GraspDistance {
    /// Distance of the palms' origins, in meters.
    pub palm_m: f64,
    /// Angle between the palms, in radians.
    pub palm_rad: f64,
    /// Root mean square difference of the joint positions, in radians (meters if prismatic).
    pub q_rad: f64,
}

impl Sampled {
    /// Says whether no joint was drawn farther outside its limits than [`LIMIT_TOLERANCE_RAD`].
    pub fn within_limits(&self) -> bool {
        self.limit_excess_rad <= LIMIT_TOLERANCE_RAD
    }
}

/// The motions drawn for one object.
pub type Sampling = Vec<Sampled>;
table! {"sampling", 1, rows: Sampled}

columns! {
    /// The columns of a [`Sampled`].
    struct Flat {
        candidate_id: String => "the motion",
        + within_limits: bool = |row| row.limit_excess_rad <= LIMIT_TOLERANCE_RAD
            => "no joint was drawn farther outside its limits than 0.05 rad",
        limit_excess_rad: f64 ["rad"]
            => "farthest that a joint was drawn outside its limits, before it was put back",
        approach_depth_m: f64 ["m"] => "deepest that the hand is in the object before the grasp",
        approach_depth_time_s: f64 ["s"] => "when that is, since the first step; 0 if it never is",
        grasp_depth_m: f64 ["m"] => "deepest that the hand is in the object at the grasp",
        table_depth_m: f64 ["m"] => "deepest that the hand is below the table at any step",
        demonstration: String
            => "sequence of the object's demonstration with the nearest grasp; empty if there is none",
        demonstration_palm_m: f64 ["m"]
            => "distance of the palm from its palm at the grasp; 0 without one",
        demonstration_palm_rad: f64 ["rad"] => "angle between the two palms; 0 without one",
        demonstration_q_rad: f64 ["rad"]
            => "root mean square difference of the joint positions; 0 without one",
        mean_palm_m: f64 ["m"]
            => "distance of the palm from the mean of all motions with the object lying so, at the grasp",
        mean_palm_rad: f64 ["rad"] => "angle between the two palms",
        mean_q_rad: f64 ["rad"] => "root mean square difference of the joint positions",
    }
}

impl Row for Sampled {
    fn write(rows: &[&Self], to: &mut Writer) {
        let rows = rows.iter().map(|sampled| {
            let (demonstration, nearest) = sampled.demonstration.clone().unwrap_or_default();
            Flat {
                candidate_id: sampled.candidate_id.clone(),
                limit_excess_rad: sampled.limit_excess_rad,
                approach_depth_m: sampled.approach_depth_m,
                approach_depth_time_s: sampled.approach_depth_time_s,
                grasp_depth_m: sampled.grasp_depth_m,
                table_depth_m: sampled.table_depth_m,
                demonstration,
                demonstration_palm_m: nearest.palm_m,
                demonstration_palm_rad: nearest.palm_rad,
                demonstration_q_rad: nearest.q_rad,
                mean_palm_m: sampled.from_mean.palm_m,
                mean_palm_rad: sampled.from_mean.palm_rad,
                mean_q_rad: sampled.from_mean.q_rad,
            }
        });
        to.rows(&rows.collect::<Vec<_>>());
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        let flat: Flat = Row::read(from, row)?;
        let nearest = GraspDistance {
            palm_m: flat.demonstration_palm_m,
            palm_rad: flat.demonstration_palm_rad,
            q_rad: flat.demonstration_q_rad,
        };
        let is_near = !flat.demonstration.is_empty();
        Ok(Self {
            candidate_id: flat.candidate_id,
            limit_excess_rad: flat.limit_excess_rad,
            approach_depth_m: flat.approach_depth_m,
            approach_depth_time_s: flat.approach_depth_time_s,
            grasp_depth_m: flat.grasp_depth_m,
            table_depth_m: flat.table_depth_m,
            demonstration: is_near.then_some((flat.demonstration, nearest)),
            from_mean: GraspDistance {
                palm_m: flat.mean_palm_m,
                palm_rad: flat.mean_palm_rad,
                q_rad: flat.mean_q_rad,
            },
        })
    }
}
