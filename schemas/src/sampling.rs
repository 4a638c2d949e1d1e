//! `sampling`: how plausible and how different the motions drawn for an object are, one partition per
//! object, one row per candidate.
//!
//! | column                  | type | unit | meaning                                                  |
//! |-------------------------|------|------|----------------------------------------------------------|
//! | `candidate_id`          | utf8 |      | the motion                                               |
//! | `within_limits`         | bool |      | no joint was drawn farther outside its limits than 0.05 rad |
//! | `limit_excess_rad`      | f64  | rad  | farthest that one was, before it was put back            |
//! | `approach_depth_m`      | f64  | m    | deepest that the hand is in the object before the grasp  |
//! | `approach_depth_time_s` | f64  | s    | when: since the first step; 0 if it never is             |
//! | `grasp_depth_m`         | f64  | m    | deepest that it is at the grasp                          |
//! | `table_depth_m`         | f64  | m    | deepest that it is below the table at any step           |
//! | `demonstration`         | utf8 |      | sequence of the object's demonstration with the nearest grasp; empty if there is none |
//! | `demonstration_palm_m`  | f64  | m    | distance of the palm from its palm at the grasp; 0 without one |
//! | `demonstration_palm_rad` | f64 | rad  | angle between the two                                    |
//! | `demonstration_q_rad`   | f64  | rad  | root mean square difference of the joint positions       |
//! | `mean_palm_m`           | f64  | m    | distance of the palm from the mean of all motions with the object lying so, at the grasp |
//! | `mean_palm_rad`         | f64  | rad  | angle between the two                                    |
//! | `mean_q_rad`            | f64  | rad  | root mean square difference of the joint positions       |
//!
//! The hand is its collision shapes, filled with balls; it is measured at the motion's steps.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "sampling/1";

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

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(sampled: &[Sampled]) -> Columns {
    let rows = || sampled.iter();
    let mut c = Columns::new(VERSION);
    c.utf8(
        "candidate_id",
        "the motion",
        rows().map(|s| s.candidate_id.clone()),
    );
    c.bool(
        "within_limits",
        "no joint was drawn farther outside its limits than 0.05 rad",
        rows().map(Sampled::within_limits),
    );
    numbers(
        &mut c,
        sampled,
        &[
            (
                "limit_excess_rad",
                "rad",
                "farthest that a joint was drawn outside its limits, before it was put back",
                |s| s.limit_excess_rad,
            ),
            (
                "approach_depth_m",
                "m",
                "deepest that the hand is in the object before the grasp",
                |s| s.approach_depth_m,
            ),
            (
                "approach_depth_time_s",
                "s",
                "when that is, since the first step; 0 if it never is",
                |s| s.approach_depth_time_s,
            ),
            (
                "grasp_depth_m",
                "m",
                "deepest that the hand is in the object at the grasp",
                |s| s.grasp_depth_m,
            ),
            (
                "table_depth_m",
                "m",
                "deepest that the hand is below the table at any step",
                |s| s.table_depth_m,
            ),
        ],
    );
    let demonstration = |s: &Sampled| {
        let nearest = s.demonstration.as_ref();
        nearest.map_or(String::new(), |(name, _)| name.clone())
    };
    c.utf8(
        "demonstration",
        "sequence of the object's demonstration with the nearest grasp; empty if there is none",
        rows().map(demonstration),
    );
    numbers(
        &mut c,
        sampled,
        &[
            (
                "demonstration_palm_m",
                "m",
                "distance of the palm from its palm at the grasp; 0 without one",
                |s| s.demonstration_distance().palm_m,
            ),
            (
                "demonstration_palm_rad",
                "rad",
                "angle between the two palms; 0 without one",
                |s| s.demonstration_distance().palm_rad,
            ),
            (
                "demonstration_q_rad",
                "rad",
                "root mean square difference of the joint positions; 0 without one",
                |s| s.demonstration_distance().q_rad,
            ),
            (
                "mean_palm_m",
                "m",
                "distance of the palm from the mean of all motions with the object lying so, at the grasp",
                |s| s.from_mean.palm_m,
            ),
            ("mean_palm_rad", "rad", "angle between the two palms", |s| {
                s.from_mean.palm_rad
            }),
            (
                "mean_q_rad",
                "rad",
                "root mean square difference of the joint positions",
                |s| s.from_mean.q_rad,
            ),
        ],
    );
    c
}

/// Name, unit, meaning and value of a column of numbers.
type NumberColumn<'a> = (&'a str, &'a str, &'a str, fn(&Sampled) -> f64);

fn numbers(c: &mut Columns, sampled: &[Sampled], columns: &[NumberColumn<'_>]) {
    for (name, unit, about, value) in columns {
        c.f64(name, unit, about, sampled.iter().map(value));
    }
}

impl Sampled {
    fn demonstration_distance(&self) -> GraspDistance {
        let nearest = self.demonstration.as_ref();
        nearest.map_or(GraspDistance::default(), |&(_, distance)| distance)
    }
}

/// Returns one row per motion; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(sampled: &[Sampled]) -> Result<RecordBatch, SchemaError> {
    columns(sampled).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Sampled>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let row = |row: usize| {
        let distance = |from: &str| -> Result<GraspDistance, SchemaError> {
            Ok(GraspDistance {
                palm_m: r.f64(&format!("{from}_palm_m"), row)?,
                palm_rad: r.f64(&format!("{from}_palm_rad"), row)?,
                q_rad: r.f64(&format!("{from}_q_rad"), row)?,
            })
        };
        let demonstration = match r.utf8("demonstration", row)? {
            "" => None,
            name => Some((name.to_owned(), distance("demonstration")?)),
        };
        Ok(Sampled {
            candidate_id: r.utf8("candidate_id", row)?.to_owned(),
            limit_excess_rad: r.f64("limit_excess_rad", row)?,
            approach_depth_m: r.f64("approach_depth_m", row)?,
            approach_depth_time_s: r.f64("approach_depth_time_s", row)?,
            grasp_depth_m: r.f64("grasp_depth_m", row)?,
            table_depth_m: r.f64("table_depth_m", row)?,
            demonstration,
            from_mean: distance("mean")?,
        })
    };
    (0..r.rows()).map(row).collect()
}

/// The rows of one partition.
pub type Sampling = Vec<Sampled>;

impl Table for Sampling {
    const NAME: &'static str = "sampling";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch)
    }
}
