//! `candidates`: motions that have not been screened, one partition per object, one row per motion.
//!
//! | column                      | type          | unit | meaning                                             |
//! |-----------------------------|---------------|------|-----------------------------------------------------|
//! | `candidate_id`              | utf8          |      | unique in the lake                                  |
//! | `generator`                 | utf8          |      | what drew it, e.g. `cgf`                            |
//! | `latent`                    | list of f64   | 1    | latent code it came from; empty if there is none    |
//! | `table_from_object`         | f64 × 7       | m, 1 | how the object lies: `xyz`, `xyzw`                  |
//! | `limit_excess_rad`          | f64           | rad  | farthest that a joint was drawn outside its limits, before it was put back to them |
//! | `time_s`                    | list of f64   | s    | since the first step; the last step is the grasp    |
//! | `object_from_palm`          | list f64 × 7  | m, 1 | palm pose in the object frame at each step          |
//! | `q_rad`                     | list of f64   | rad  | joint positions, step after step, order of `joints` |
//! | `palm_velocity`             | list f64 × 6  | m/s, rad/s | the palm's velocity and spin at each step, object frame |
//! | `palm_acceleration`         | list f64 × 6  | m/s², rad/s² | how fast these change                       |
//! | `q_velocity_rad_per_s`      | list of f64   | rad/s | joint velocities, as `q_rad`; 0 at a limit to which a joint was put back |
//! | `q_acceleration_rad_per_s2` | list of f64   | rad/s² | joint accelerations, likewise                     |
//!
//! Positions of prismatic joints are in meters, and so are their rates and how far they were outside.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use motion::{HandRates, JointRates, Motion, MotionError};
use spatial::{Object, Palm, Pose, Table, Twist};

use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
pub const VERSION: &str = "candidates/2";

/// A motion to be screened.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Unique name, e.g. `005_tomato_soup_can-0007`.
    pub candidate_id: String,
    /// What drew it, e.g. `cgf`.
    pub generator: String,
    /// The latent code it came from; empty if there is none.
    pub latent: Vec<f64>,
    /// How the object lies on the table.
    pub table_from_object: Pose<Table, Object>,
    /// Farthest that a joint was drawn outside its limits, before it was put back to them, in radians
    /// (meters if prismatic); 0 if none was.
    pub limit_excess_rad: f64,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Seconds since the first step.
    pub time_s: f64,
    /// Pose of the palm in the object frame (the object as it lies before it is touched).
    pub object_from_palm: Pose<Object, Palm>,
    /// Joint positions in radians, in the order of the joints' names.
    pub q_rad: Vec<f64>,
    /// How it moves.
    pub rates: Rates,
}

/// How the hand moves at a step of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Velocity of the palm's origin (m/s), then its angular velocity (rad/s), both along the
    /// object's axes.
    pub palm_velocity: [f64; 6],
    /// How fast these change, in m/s² and rad/s².
    pub palm_acceleration: [f64; 6],
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
            palm_acceleration: [0.0; 6],
            q_velocity_rad_per_s: vec![0.0; dof],
            q_acceleration_rad_per_s2: vec![0.0; dof],
        }
    }
}

/// All candidates of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// The object's name.
    pub object: String,
    /// Names of the hand's joints, in the order of [`Step::q_rad`].
    pub joints: Vec<String>,
    /// The motions.
    pub candidates: Vec<Candidate>,
}

impl Candidates {
    /// Returns the motion of one of them.
    ///
    /// # Errors
    ///
    /// Fails if its steps are no motion.
    pub fn motion(&self, candidate: &Candidate) -> Result<Motion<Object>, MotionError> {
        let steps = candidate.steps.iter().map(|step| motion::Step {
            time_s: step.time_s,
            frame_from_palm: step.object_from_palm,
            q_rad: step.q_rad.clone(),
            rates: HandRates {
                palm_velocity: Twist::from_array(step.rates.palm_velocity),
                palm_acceleration: Twist::from_array(step.rates.palm_acceleration),
                joints: JointRates {
                    velocity: step.rates.q_velocity_rad_per_s.clone(),
                    acceleration: step.rates.q_acceleration_rad_per_s2.clone(),
                },
            },
        });
        Motion::new(&self.joints, steps.collect())
    }
}

/// Returns the Arrow schema for a hand with these joints.
pub fn schema(joints: &[String]) -> Schema {
    columns(joints, &[]).schema()
}

fn columns(joints: &[String], candidates: &[Candidate]) -> Columns {
    let rows = || candidates.iter();
    let mut c = Columns::new(VERSION).with_joints(joints);
    c.utf8(
        "candidate_id",
        "unique name of the motion",
        rows().map(|m| m.candidate_id.clone()),
    );
    c.utf8(
        "generator",
        "what drew it",
        rows().map(|m| m.generator.clone()),
    );
    c.f64_list(
        "latent",
        "1",
        "latent code it came from",
        rows().map(|m| m.latent.clone()),
    );
    c.f64_array(
        "table_from_object",
        "m, 1",
        "how the object lies: xyz, xyzw",
        rows().map(|m| m.table_from_object.to_array()),
    );
    c.f64(
        "limit_excess_rad",
        "rad",
        "farthest that a joint was drawn outside its limits, before it was put back to them",
        rows().map(|m| m.limit_excess_rad),
    );
    steps(&mut c, candidates);
    c
}

fn steps(c: &mut Columns, candidates: &[Candidate]) {
    let rows = || candidates.iter();
    c.f64_list(
        "time_s",
        "s",
        "since the first step",
        rows().map(|m| m.steps.iter().map(|s| s.time_s).collect()),
    );
    c.f64_arrays(
        "object_from_palm",
        "m, 1",
        "palm pose in the object frame at each step: xyz, xyzw",
        rows().map(|m| {
            m.steps
                .iter()
                .map(|s| s.object_from_palm.to_array())
                .collect()
        }),
    );
    let mut of_joints = |name: &str, unit: &str, about: &str, numbers: fn(&Step) -> &[f64]| {
        let all = |m: &Candidate| m.steps.iter().flat_map(numbers).copied().collect();
        c.f64_list(name, unit, about, rows().map(all));
    };
    of_joints(
        "q_rad",
        "rad",
        "joint positions, step after step, order of metadata `joints`",
        |s| &s.q_rad,
    );
    of_joints(
        "q_velocity_rad_per_s",
        "rad/s",
        "joint velocities, step after step; 0 at a limit to which a joint was put back",
        |s| &s.rates.q_velocity_rad_per_s,
    );
    of_joints(
        "q_acceleration_rad_per_s2",
        "rad/s²",
        "joint accelerations, step after step; 0 at a limit to which a joint was put back",
        |s| &s.rates.q_acceleration_rad_per_s2,
    );
    let mut of_palm = |name: &str, unit: &str, about: &str, numbers: fn(&Step) -> [f64; 6]| {
        let all = |m: &Candidate| m.steps.iter().map(numbers).collect();
        c.f64_arrays(name, unit, about, rows().map(all));
    };
    of_palm(
        "palm_velocity",
        "m/s, rad/s",
        "the palm's velocity and angular velocity along the object's axes at each step",
        |s| s.rates.palm_velocity,
    );
    of_palm(
        "palm_acceleration",
        "m/s², rad/s²",
        "how fast the palm's velocity and angular velocity change at each step",
        |s| s.rates.palm_acceleration,
    );
}

/// Returns one row per motion; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
pub fn to_batch(candidates: &Candidates) -> Result<RecordBatch, SchemaError> {
    columns(&candidates.joints, &candidates.candidates).into_batch()
}

/// Reads what [`to_batch`] wrote for `object`.
///
/// # Errors
///
/// Fails if the columns are of another version or the lists of a row do not fit together.
pub fn from_batch(object: &str, batch: &RecordBatch) -> Result<Candidates, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let joints = r.joints()?;
    let mut candidates = Vec::with_capacity(r.rows());
    for row in 0..r.rows() {
        let times = r.f64_list("time_s", row)?;
        let poses: Vec<[f64; 7]> = of_steps(&r, "object_from_palm", row, times.len())?;
        let velocities: Vec<[f64; 6]> = of_steps(&r, "palm_velocity", row, times.len())?;
        let accelerations: Vec<[f64; 6]> = of_steps(&r, "palm_acceleration", row, times.len())?;
        let of_joints = |name: &str| r.joint_positions(name, row, joints.len() * times.len());
        let [q, q_velocities, q_accelerations] = [
            of_joints("q_rad")?,
            of_joints("q_velocity_rad_per_s")?,
            of_joints("q_acceleration_rad_per_s2")?,
        ];
        let at = |numbers: &[f64], step: usize| -> Vec<f64> {
            numbers[step * joints.len()..(step + 1) * joints.len()].to_vec()
        };
        let palm = poses.into_iter().zip(velocities).zip(accelerations);
        let mut steps = Vec::with_capacity(times.len());
        for (idx, (&time_s, ((pose, palm_velocity), palm_acceleration))) in
            times.iter().zip(palm).enumerate()
        {
            steps.push(Step {
                time_s,
                object_from_palm: r.pose("object_from_palm", pose)?,
                q_rad: at(&q, idx),
                rates: Rates {
                    palm_velocity,
                    palm_acceleration,
                    q_velocity_rad_per_s: at(&q_velocities, idx),
                    q_acceleration_rad_per_s2: at(&q_accelerations, idx),
                },
            });
        }
        candidates.push(Candidate {
            candidate_id: r.utf8("candidate_id", row)?.to_owned(),
            generator: r.utf8("generator", row)?.to_owned(),
            latent: r.f64_list("latent", row)?,
            table_from_object: r
                .pose("table_from_object", r.f64_array("table_from_object", row)?)?,
            limit_excess_rad: r.f64("limit_excess_rad", row)?,
            steps,
        });
    }
    Ok(Candidates {
        object: object.to_owned(),
        joints,
        candidates,
    })
}

/// Reads a list of arrays, one for each step.
fn of_steps<const N: usize>(
    r: &Reader<'_>,
    name: &str,
    row: usize,
    n_steps: usize,
) -> Result<Vec<[f64; N]>, SchemaError> {
    let arrays: Vec<[f64; N]> = r.f64_arrays(name, row)?;
    if arrays.len() == n_steps {
        return Ok(arrays);
    }
    let message = format!("{} entries for {n_steps} times", arrays.len());
    Err(r.invalid(name, message))
}
