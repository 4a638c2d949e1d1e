//! `trajectories`: demonstrations retargeted to a robot hand, one partition per sequence, one row
//! per step.
//!
//! Positions of prismatic joints are in meters, and so are their margins.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use motion::{JointRates, Motion, Step};
use nalgebra::UnitQuaternion;
use robot::{JointOrder, WrongDof};
use spatial::{Object, Palm, Pose, RestingPose, Twist};

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
    /// Names of the landmarks that are followed, in the order of [`Tracking::keypoint_errors_m`].
    pub keypoints: Vec<String>,
    /// Names of the fingertips among them, in the order of [`Tracking::tip_errors_m`].
    pub tips: Vec<String>,
    /// The object's resting pose.
    pub rest: RestingPose,
    /// The hand in the object's frame; its last step is the grasp.
    pub motion: Motion<Object, TrajectoryRates>,
    /// Its tracking of the demonstration at each step.
    pub tracking: Vec<Tracking>,
}

/// Velocities of palm and joints, and accelerations of joints, at a step.
#[derive(Debug, Clone, PartialEq)]
pub struct TrajectoryRates {
    /// Of the palm.
    pub palm_velocity: Twist<Object>,
    /// Of the joints.
    pub joints: JointRates,
}

impl TrajectoryRates {
    /// Returns the zero rates of a hand of `dof` joints.
    pub fn zero(dof: usize) -> Self {
        Self {
            palm_velocity: Twist::zero(),
            joints: JointRates::zero(dof),
        }
    }
}

impl motion::Rates for TrajectoryRates {
    fn joints(&self) -> Option<&JointRates> {
        Some(&self.joints)
    }

    fn is_whole(&self, dof: usize) -> bool {
        self.palm_velocity.is_finite() && self.joints.is_whole(dof)
    }

    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(Self {
            joints: self.joints.reordered(order)?,
            ..self.clone()
        })
    }

    fn rotated(&self, by: &UnitQuaternion<f64>) -> Self {
        Self {
            palm_velocity: self.palm_velocity.rotated(by),
            joints: self.joints.clone(),
        }
    }
}

columns! {
    /// Tracking errors of the hand at a step, and its margins.
    #[derive(Debug, Clone, Default, PartialEq)]
    pub struct Tracking {
        keypoint_errors_m: Vec<f64> ["m"]
            => "distance to each landmark, in the order of metadata `keypoints`",
        + keypoint_error_m: f64 ["m"] = Self::keypoint_error_m
            => "root mean square distance to the landmarks followed",
        tip_errors_m: Vec<f64> ["m"]
            => "distance of each finger tip to its landmark, in the order of metadata `tips`",
        contact_gaps_m: Vec<f64> ["m"]
            => "signed distance from the surface of each finger tip that should touch it",
        limit_margin_rad: f64 ["rad"] => "least distance of a joint to one of its limits",
        penetration_m: f64 ["m"] => "greatest depth of a link inside the object",
        table_penetration_m: f64 ["m"] => "greatest depth of a link below the table",
    }
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
        tracking: Tracking,
        rest: RestingPose,
    }
}

impl Table for Trajectory {
    const NAME: &'static str = "trajectories";
    const PARTITION: &'static str = "sequence";
    const VERSION: &'static str = "trajectories/2";

    fn schema() -> Schema {
        Writer::of::<Row>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let steps = self.motion.steps();
        let column = "keypoint_errors_m";
        SchemaError::check_length(column, "steps", &self.tracking, steps.len())?;
        let steps = steps.iter().cloned().zip(&self.tracking);
        let rows = (0..).zip(steps).map(|(number, (step, tracking))| Row {
            object: self.object.clone(),
            step: number,
            time_s: step.time_s,
            object_from_palm: step.frame_from_palm,
            q_rad: step.q_rad,
            palm_velocity: step.rates.palm_velocity.to_array(),
            q_velocity_rad_per_s: step.rates.joints.velocity,
            q_acceleration_rad_per_s2: step.rates.joints.acceleration,
            tracking: tracking.clone(),
            rest: self.rest,
        });
        Writer::of(Self::VERSION, &rows.collect::<Vec<_>>())
            .with_names(JOINTS, self.motion.joints())
            .with_names(KEYPOINTS, &self.keypoints)
            .with_names(TIPS, &self.tips)
            .into_batch()
    }

    fn from_batch(sequence: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let reader = Reader::new(batch, Self::VERSION)?;
        let first: Row = reader.first()?;
        let (keypoints, tips) = (reader.names(KEYPOINTS), reader.names(TIPS));
        let (mut steps, mut tracking) = (Vec::new(), Vec::new());
        for row in reader.rows::<Row>()? {
            let errors = &row.tracking.keypoint_errors_m;
            SchemaError::check_length("keypoint_errors_m", "errors", errors, keypoints.len())?;
            let errors = &row.tracking.tip_errors_m;
            SchemaError::check_length("tip_errors_m", "errors", errors, tips.len())?;
            tracking.push(row.tracking);
            steps.push(Step {
                time_s: row.time_s,
                frame_from_palm: row.object_from_palm,
                q_rad: row.q_rad,
                rates: TrajectoryRates {
                    palm_velocity: Twist::from_array(row.palm_velocity),
                    joints: JointRates {
                        velocity: row.q_velocity_rad_per_s,
                        acceleration: row.q_acceleration_rad_per_s2,
                    },
                },
            });
        }
        let motion = Motion::of_joints(reader.joints()?.into(), steps);
        Ok(Self {
            sequence: sequence.to_owned(),
            object: first.object,
            keypoints,
            tips,
            rest: first.rest,
            motion: motion.map_err(|source| SchemaError::Motion {
                name: sequence.to_owned(),
                source,
            })?,
            tracking,
        })
    }
}
