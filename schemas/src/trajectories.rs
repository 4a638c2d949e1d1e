//! `trajectories`: demonstrations retargeted to a robot hand, one partition per sequence, one row
//! per step.
//!
//! Positions of prismatic joints are in meters, and so are their margins.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use motion::JointRates;
use spatial::{Object, Palm, Pose, Rest, Twist};

use crate::{
    SchemaError, Table,
    columns::{JOINTS, Reader, Writer, columns},
};

/// Key of the followed landmarks' names in the metadata.
const KEYPOINTS: &str = "keypoints";
/// Key of the names of those that are finger tips.
const TIPS: &str = "tips";

/// One motion of a robot hand that follows a demonstration.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    /// The demonstration's sequence.
    pub sequence: String,
    /// The grasped object's name.
    pub object: String,
    /// Names of the hand's joints, in the order of the steps' joint positions.
    pub joints: Vec<String>,
    /// Names of the landmarks that are followed, in the order of [`Tracking::keypoint_errors_m`].
    pub keypoints: Vec<String>,
    /// Names of the fingertips among them, in the order of [`Tracking::tip_errors_m`].
    pub tips: Vec<String>,
    /// The object's resting pose.
    pub rest: Rest,
    /// The steps in time order; the last one is the grasp.
    pub steps: Vec<Step>,
}

/// One step of a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// The hand.
    pub hand: motion::Step<Object, Rates>,
    /// Its tracking of the demonstration.
    pub tracking: Tracking,
}

/// Velocities of the hand at a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Rates {
    /// Of the palm.
    pub palm_velocity: Twist<Object>,
    /// Of the joints.
    pub joints: JointRates,
}

impl Rates {
    /// Returns the zero rates of a hand of `dof` joints.
    pub fn still(dof: usize) -> Self {
        Self {
            palm_velocity: Twist::zero(),
            joints: JointRates::still(dof),
        }
    }
}

/// Tracking errors of the hand at a step, and its margins.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracking {
    /// Distance of each point of the robot to its landmark, in meters.
    pub keypoint_errors_m: Vec<f64>,
    /// Those of fingertips.
    pub tip_errors_m: Vec<f64>,
    /// Signed distance from the object's surface of each fingertip that should touch it, in meters.
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

    /// Returns the greatest distance of a fingertip to its landmark, in meters.
    pub fn fingertip_error_m(&self) -> f64 {
        self.tip_errors_m.iter().copied().fold(0.0, f64::max)
    }
}

columns! {
    /// A step with the constants of its trajectory.
    struct Row {
        object: String => "name of the grasped object",
        step: i64 => "number of the row, from 0",
        time_s: f64 ["s"] => "since the first step",
        object_from_palm: Pose<Object, Palm> ["m, 1"] => "palm pose in the object frame: xyz, xyzw",
        q_rad: Vec<f64> ["rad"] => "joint positions, in the order of metadata `joints`",
        palm_velocity: [f64; 6] ["m/s, rad/s"]
            => "the palm's velocity and angular velocity along the object's axes",
        q_velocity_rad_per_s: Vec<f64> ["rad/s"] => "joint velocities",
        q_acceleration_rad_per_s2: Vec<f64> ["rad/s²"] => "joint accelerations",
        keypoint_errors_m: Vec<f64> ["m"]
            => "distance to each landmark, in the order of metadata `keypoints`",
        keypoint_error_m: f64 ["m"] => "root mean square distance to the landmarks followed",
        tip_errors_m: Vec<f64> ["m"]
            => "distance of each finger tip to its landmark, in the order of metadata `tips`",
        contact_gaps_m: Vec<f64> ["m"]
            => "signed distance from the surface of each finger tip that should touch it",
        limit_margin_rad: f64 ["rad"] => "least distance of a joint to one of its limits",
        penetration_m: f64 ["m"] => "greatest depth of a link inside the object",
        table_penetration_m: f64 ["m"] => "greatest depth of a link below the table",
        rest: Rest,
    }
}

impl Table for Trajectory {
    const NAME: &'static str = "trajectories";
    const VERSION: &'static str = "trajectories/2";

    fn schema() -> Schema {
        Writer::of::<Row>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let steps = (0..).zip(self.steps.iter().cloned());
        let rows = steps.map(|(number, step)| Row {
            object: self.object.clone(),
            step: number,
            time_s: step.hand.time_s,
            object_from_palm: step.hand.frame_from_palm,
            q_rad: step.hand.q_rad,
            palm_velocity: step.hand.rates.palm_velocity.to_array(),
            q_velocity_rad_per_s: step.hand.rates.joints.velocity,
            q_acceleration_rad_per_s2: step.hand.rates.joints.acceleration,
            keypoint_error_m: step.tracking.keypoint_error_m(),
            keypoint_errors_m: step.tracking.keypoint_errors_m,
            tip_errors_m: step.tracking.tip_errors_m,
            contact_gaps_m: step.tracking.contact_gaps_m,
            limit_margin_rad: step.tracking.limit_margin_rad,
            penetration_m: step.tracking.penetration_m,
            table_penetration_m: step.tracking.table_penetration_m,
            rest: self.rest,
        });
        Writer::of(Self::VERSION, &rows.collect::<Vec<_>>())
            .with_names(JOINTS, &self.joints)
            .with_names(KEYPOINTS, &self.keypoints)
            .with_names(TIPS, &self.tips)
            .into_batch()
    }

    fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let reader = Reader::new(batch, Self::VERSION)?;
        let first: Row = reader.first()?;
        let joints = reader.joints()?;
        let (keypoints, tips) = (reader.names(KEYPOINTS), reader.names(TIPS));
        let tracking_errors = |column, errors: Vec<f64>, names: &[String]| {
            SchemaError::check_length(column, "errors", &errors, names.len()).map(|()| errors)
        };
        let of_joints = |column, numbers: Vec<f64>| {
            SchemaError::check_length(column, "joint positions", &numbers, joints.len())
                .map(|()| numbers)
        };
        let steps = reader.rows()?.into_iter().map(|row: Row| {
            Ok(Step {
                hand: motion::Step {
                    time_s: row.time_s,
                    frame_from_palm: row.object_from_palm,
                    q_rad: of_joints("q_rad", row.q_rad)?,
                    rates: Rates {
                        palm_velocity: Twist::from_array(row.palm_velocity),
                        joints: JointRates {
                            velocity: of_joints("q_velocity_rad_per_s", row.q_velocity_rad_per_s)?,
                            acceleration: of_joints(
                                "q_acceleration_rad_per_s2",
                                row.q_acceleration_rad_per_s2,
                            )?,
                        },
                    },
                },
                tracking: Tracking {
                    keypoint_errors_m: tracking_errors(
                        "keypoint_errors_m",
                        row.keypoint_errors_m,
                        &keypoints,
                    )?,
                    tip_errors_m: tracking_errors("tip_errors_m", row.tip_errors_m, &tips)?,
                    contact_gaps_m: row.contact_gaps_m,
                    limit_margin_rad: row.limit_margin_rad,
                    penetration_m: row.penetration_m,
                    table_penetration_m: row.table_penetration_m,
                },
            })
        });
        let steps = steps.collect::<Result<_, SchemaError>>()?;
        Ok(Self {
            sequence: sequence.to_owned(),
            object: first.object,
            keypoints,
            tips,
            joints,
            rest: first.rest,
            steps,
        })
    }
}
