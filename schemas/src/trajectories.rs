//! `trajectories`: demonstrations retargeted to a robot hand, one partition per sequence, one row
//! per step.
//!
//! | column                      | type        | unit      | meaning                                        |
//! |-----------------------------|-------------|-----------|------------------------------------------------|
//! | `object`                    | utf8        |           | name of the grasped object                     |
//! | `step`                      | i64         |           | number of the row, from 0                      |
//! | `time_s`                    | f64         | s         | since the first step                           |
//! | `object_from_palm`          | f64 × 7     | m, 1      | palm pose in the object frame: `xyz`, `xyzw`   |
//! | `q_rad`                     | list of f64 | rad       | joint positions, order of metadata `joints`    |
//! | `palm_velocity`             | f64 × 6     | m/s rad/s | the palm's velocity and spin, object frame     |
//! | `q_velocity_rad_per_s`      | list of f64 | rad/s     | joint velocities                               |
//! | `q_acceleration_rad_per_s2` | list of f64 | rad/s²    | joint accelerations                            |
//! | `keypoint_errors_m`         | list of f64 | m         | distance to each landmark, order of metadata `keypoints` |
//! | `keypoint_error_m`          | f64         | m         | their root mean square                         |
//! | `tip_errors_m`              | list of f64 | m         | those of finger tips, order of metadata `tips` |
//! | `contact_gaps_m`            | list of f64 | m         | signed distance from the surface of each tip that should touch it |
//! | `limit_margin_rad`          | f64         | rad       | least distance of a joint to its limit         |
//! | `penetration_m`             | f64         | m         | greatest depth of a link inside the object     |
//! | `table_penetration_m`       | f64         | m         | greatest depth of a link below the table       |
//! | `rest_up`                   | f64 × 3     | 1         | unit vector against gravity, object frame      |
//! | `rest_height_m`             | f64         | m         | height of the object's origin above the table  |
//!
//! Positions of prismatic joints are in meters, and so are their margins.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use spatial::{Object, Palm, Pose, Rest};

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError, count};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "trajectories/2";

/// Key of the followed landmarks' names in the metadata.
const KEYPOINTS_KEY: &str = "keypoints";
/// Key of the names of those that are finger tips.
const TIPS_KEY: &str = "tips";

/// One motion of a robot hand that follows a demonstration.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// The demonstration's sequence.
    pub sequence: String,
    /// The grasped object's name.
    pub object: String,
    /// Names of the hand's joints, in the order of [`Step::q_rad`].
    pub joints: Vec<String>,
    /// Names of the landmarks that are followed, in the order of [`Tracking::keypoint_errors_m`].
    pub keypoints: Vec<String>,
    /// Names of those that are finger tips, in the order of [`Tracking::tip_errors_m`].
    pub tips: Vec<String>,
    /// How the object lay.
    pub rest: Rest,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Seconds since the first step.
    pub time_s: f64,
    /// Pose of the palm in the object frame.
    pub object_from_palm: Pose<Object, Palm>,
    /// Joint positions in radians.
    pub q_rad: Vec<f64>,
    /// How fast it moves.
    pub rates: Rates,
    /// How well it follows.
    pub tracking: Tracking,
}

/// How fast the hand moves at a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Velocity of the palm's origin (m/s), then its angular velocity (rad/s), both along the
    /// object's axes.
    pub palm_velocity: [f64; 6],
    /// Joint velocities in rad/s.
    pub q_velocity_rad_per_s: Vec<f64>,
    /// Joint accelerations in rad/s².
    pub q_acceleration_rad_per_s2: Vec<f64>,
}

impl Rates {
    /// Returns the rates of a hand of `dof` joints that does not move.
    pub fn still(dof: usize) -> Self {
        Self {
            palm_velocity: [0.0; 6],
            q_velocity_rad_per_s: vec![0.0; dof],
            q_acceleration_rad_per_s2: vec![0.0; dof],
        }
    }
}

/// How well the hand follows the demonstration at a step, and what it keeps from.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracking {
    /// Distance of each point of the robot to its landmark, in meters.
    pub keypoint_errors_m: Vec<f64>,
    /// Those of finger tips.
    pub tip_errors_m: Vec<f64>,
    /// Signed distance from the object's surface of each finger tip that should touch it, in meters.
    pub contact_gaps_m: Vec<f64>,
    /// Least distance of a joint to one of its limits, in radians.
    pub limit_margin_rad: f64,
    /// Greatest depth of a link inside the object, in meters.
    pub penetration_m: f64,
    /// Greatest depth of a link below the table, in meters.
    pub table_penetration_m: f64,
}

impl Tracking {
    /// Returns the root mean square distance of the points to their landmarks, in meters.
    pub fn keypoint_error_m(&self) -> f64 {
        let squares: f64 = self
            .keypoint_errors_m
            .iter()
            .map(|error| error.powi(2))
            .sum();
        (squares / self.keypoint_errors_m.len().max(1) as f64).sqrt()
    }

    /// Returns the largest distance of a finger tip to its landmark, in meters.
    pub fn fingertip_error_m(&self) -> f64 {
        self.tip_errors_m.iter().copied().fold(0.0, f64::max)
    }
}

/// Returns the Arrow schema for a hand with these joints that follows these landmarks.
fn schema(joints: &[String], keypoints: &[String], tips: &[String]) -> Schema {
    named(joints, keypoints, tips, &[]).schema()
}

fn named(
    joints: &[String],
    keypoints: &[String],
    tips: &[String],
    trajectories: &[&Trajectory],
) -> Columns {
    let mut c = Columns::new(VERSION)
        .with_joints(joints)
        .with_names(KEYPOINTS_KEY, keypoints)
        .with_names(TIPS_KEY, tips);
    motion(&mut c, trajectories);
    tracking(&mut c, trajectories);
    c
}

/// Returns the steps of all, each with its trajectory and number.
fn rows<'a>(
    trajectories: &'a [&'a Trajectory],
) -> impl Iterator<Item = (&'a Trajectory, usize, &'a Step)> + Clone {
    trajectories.iter().flat_map(|&trajectory| {
        let steps = trajectory.steps.iter().enumerate();
        steps.map(move |(idx, step)| (trajectory, idx, step))
    })
}

fn motion(c: &mut Columns, trajectories: &[&Trajectory]) {
    let rows = || rows(trajectories);
    c.utf8(
        "object",
        "name of the grasped object",
        rows().map(|(t, _, _)| t.object.clone()),
    );
    c.i64(
        "step",
        "number of the row, from 0",
        rows().map(|(_, idx, _)| count(idx)),
    );
    c.f64(
        "time_s",
        "s",
        "since the first step",
        rows().map(|(_, _, s)| s.time_s),
    );
    c.f64_array(
        "object_from_palm",
        "m, 1",
        "palm pose in the object frame: xyz, xyzw",
        rows().map(|(_, _, s)| s.object_from_palm.to_array()),
    );
    c.f64_list(
        "q_rad",
        "rad",
        "joint positions, in the order of metadata `joints`",
        rows().map(|(_, _, s)| s.q_rad.clone()),
    );
    c.f64_array(
        "palm_velocity",
        "m/s, rad/s",
        "the palm's velocity and angular velocity along the object's axes",
        rows().map(|(_, _, s)| s.rates.palm_velocity),
    );
    c.f64_list(
        "q_velocity_rad_per_s",
        "rad/s",
        "joint velocities",
        rows().map(|(_, _, s)| s.rates.q_velocity_rad_per_s.clone()),
    );
    c.f64_list(
        "q_acceleration_rad_per_s2",
        "rad/s²",
        "joint accelerations",
        rows().map(|(_, _, s)| s.rates.q_acceleration_rad_per_s2.clone()),
    );
}

fn tracking(c: &mut Columns, trajectories: &[&Trajectory]) {
    let tracking = || rows(trajectories).map(|(_, _, s)| &s.tracking);
    c.f64_list(
        "keypoint_errors_m",
        "m",
        "distance to each landmark, in the order of metadata `keypoints`",
        tracking().map(|t| t.keypoint_errors_m.clone()),
    );
    c.f64(
        "keypoint_error_m",
        "m",
        "root mean square distance to the landmarks followed",
        tracking().map(Tracking::keypoint_error_m),
    );
    c.f64_list(
        "tip_errors_m",
        "m",
        "distance of each finger tip to its landmark, in the order of metadata `tips`",
        tracking().map(|t| t.tip_errors_m.clone()),
    );
    c.f64_list(
        "contact_gaps_m",
        "m",
        "signed distance from the surface of each finger tip that should touch it",
        tracking().map(|t| t.contact_gaps_m.clone()),
    );
    let mut number = |name: &str, unit: &str, about: &str, value: fn(&Tracking) -> f64| {
        c.f64(name, unit, about, tracking().map(value));
    };
    number(
        "limit_margin_rad",
        "rad",
        "least distance of a joint to one of its limits",
        |t| t.limit_margin_rad,
    );
    number(
        "penetration_m",
        "m",
        "greatest depth of a link inside the object",
        |t| t.penetration_m,
    );
    number(
        "table_penetration_m",
        "m",
        "greatest depth of a link below the table",
        |t| t.table_penetration_m,
    );
    c.rest(rows(trajectories).map(|(t, _, _)| t.rest));
}

/// Returns one row per step; the sequence is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(trajectory: &Trajectory) -> Result<RecordBatch, SchemaError> {
    let Trajectory {
        joints,
        keypoints,
        tips,
        ..
    } = trajectory;
    named(joints, keypoints, tips, &[trajectory]).into_batch()
}

/// Reads what [`to_batch`] wrote for `sequence`.
///
/// # Errors
///
/// Fails if the columns are of another version, there is no row, or a row has another number of
/// joint positions than there are joints.
fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Trajectory, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_some_rows()?;
    let joints = r.joints()?;
    let mut steps = Vec::with_capacity(r.rows());
    for row in 0..r.rows() {
        let of_joints = |name: &str| r.joint_positions(name, row, joints.len());
        steps.push(Step {
            time_s: r.f64("time_s", row)?,
            object_from_palm: r.pose("object_from_palm", r.f64_array("object_from_palm", row)?)?,
            q_rad: of_joints("q_rad")?,
            rates: Rates {
                palm_velocity: r.f64_array("palm_velocity", row)?,
                q_velocity_rad_per_s: of_joints("q_velocity_rad_per_s")?,
                q_acceleration_rad_per_s2: of_joints("q_acceleration_rad_per_s2")?,
            },
            tracking: Tracking {
                keypoint_errors_m: r.f64_list("keypoint_errors_m", row)?,
                tip_errors_m: r.f64_list("tip_errors_m", row)?,
                contact_gaps_m: r.f64_list("contact_gaps_m", row)?,
                limit_margin_rad: r.f64("limit_margin_rad", row)?,
                penetration_m: r.f64("penetration_m", row)?,
                table_penetration_m: r.f64("table_penetration_m", row)?,
            },
        });
    }
    Ok(Trajectory {
        sequence: sequence.to_owned(),
        object: r.utf8("object", 0)?.to_owned(),
        keypoints: r.names(KEYPOINTS_KEY),
        tips: r.names(TIPS_KEY),
        joints,
        rest: r.rest(0)?,
        steps,
    })
}

impl Table for Trajectory {
    const NAME: &'static str = "trajectories";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema(&[], &[], &[])
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(key, batch)
    }
}
