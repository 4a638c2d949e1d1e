//! `candidates`: unscreened motions, one partition per object, one row per candidate.
//!
//! A generator may draw a motion several times and keep one draw, the candidate; `draws` has all of them. A stage that
//! reads candidates writes them again: in a run, `stage = 'refine'` selects those that are screened. Names are unique
//! in a stage.
//!
//! Positions of prismatic joints are in meters, and so are their rates (per second) and limit
//! excess.

use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use motion::{HandRates, JointRates, Motion, Step};
use spatial::{Object, Palm, Pose, Twist};

use crate::{
    SchemaError, Table,
    columns::{JOINTS, Reader, Writer, columns, words},
    draws::Refusal,
};

/// A motion to be screened.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Unique name, e.g. `005_tomato_soup_can-0007`.
    pub candidate_id: String,
    /// Its generator, e.g. `cgf`.
    pub generator: String,
    /// Source of the motion.
    pub source: DrawSource,
    /// The latent code it came from; empty if there is none.
    pub latent: Vec<f64>,
    /// Pose of the object on the table.
    pub table_from_object: Pose<spatial::Table, Object>,
    /// Greatest joint limit excess as drawn, before clamping, in radians (meters if prismatic); 0
    /// if none.
    pub limit_excess_rad: f64,
    /// Greatest depth of the hand in object or table as drawn, in meters; none if not measured.
    pub depth_m: Option<f64>,
    /// Residual of the refinement, in m²; none if not refined.
    pub residual_m2: Option<f64>,
    /// The hand in the object's frame, with the joints of [`Candidates`]; its last step is the grasp.
    pub motion: Motion<Object>,
}

impl Candidate {
    /// Returns the candidate of another motion to the same grasp, within the joints' limits, which `generator` made;
    /// its name is this one's with a suffix.
    #[must_use]
    pub fn remade(
        &self,
        suffix: &str,
        generator: &str,
        origin: Origin,
        motion: Motion<Object>,
    ) -> Self {
        Self {
            candidate_id: format!("{}-{suffix}", self.candidate_id),
            generator: generator.to_owned(),
            source: DrawSource {
                draw_n: 1,
                origin,
                ..self.source.clone()
            },
            latent: self.latent.clone(),
            table_from_object: self.table_from_object,
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion,
        }
    }
}

/// All candidates of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// The object's name.
    pub object: String,
    /// Names of the hand's joints.
    pub joints: Arc<[String]>,
    /// The motions.
    pub candidates: Vec<Candidate>,
}

columns! {
    /// Source of a motion.
    #[derive(Debug, Clone, PartialEq, Eq)]
    pub struct DrawSource {
        draw_n: u32 => "which draw of its motion it is, from 1; 1 of generators that do not draw",
        origin: Origin
            => "`prior`, `posterior` or `path`: its latent code's; `demonstration`: replayed; `line`: interpolated; `grasp`: synthesized; `planner`: planned",
        demonstration: String
            => "sequence that code or motion comes from, of a path the first; empty if there is none",
        object_split: Option<ObjectSplit>
            => "whether its function was trained on motions to the object: `seen` or `unseen`; empty without training",
    }
}

impl DrawSource {
    /// Returns the source of a demonstration that is replayed.
    pub fn replayed(sequence: &str) -> Self {
        Self {
            draw_n: 1,
            origin: Origin::Demonstration,
            demonstration: sequence.to_owned(),
            object_split: None,
        }
    }
}

words! {
    /// Kind of source of a motion.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Origin: "origin" {
        /// A latent code from the standard normal distribution.
        Prior = "prior",
        /// A latent code from a demonstration's posterior.
        Posterior = "posterior",
        /// A latent code between those of two demonstrations.
        Path = "path",
        /// A demonstration itself, retargeted and replayed.
        Demonstration = "demonstration",
        /// A straight line between the ends of another motion.
        Line = "line",
        /// A synthesized grasp with a scripted approach.
        Grasp = "grasp",
        /// A planner's way to another motion's grasp.
        Planner = "planner",
    }
}

words! {
    /// Whether a function was trained on motions to an object.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum ObjectSplit: "object split" {
        /// It was.
        Seen = "seen",
        /// It was not.
        Unseen = "unseen",
    }
}

columns! {
    /// A candidate, its steps as lists.
    struct Row {
        candidate_id: String => "unique name of the motion",
        generator: String => "what drew it",
        source: DrawSource,
        depth_m: Option<f64> ["m"]
            => "deepest that the hand was in object or table when it was drawn; null if not measured",
        residual_m2: Option<f64> ["m²"]
            => "residual of the refinement: depth, missing contact, unbalanced force; null if not refined",
        latent: Vec<f64> ["1"] => "latent code it came from; empty if there is none",
        table_from_object: Pose<spatial::Table, Object> ["m, 1"] => "how the object lies: xyz, xyzw",
        limit_excess_rad: f64 ["rad"]
            => "farthest that a joint was drawn outside its limits, before it was put back to them",
        time_s: Vec<f64> ["s"] => "since the first step",
        object_from_palm: Vec<Pose<Object, Palm>> ["m, 1"]
            => "palm pose in the object frame at each step: xyz, xyzw",
        q_rad: Vec<f64> ["rad"] => "joint positions, step after step, order of metadata `joints`",
        q_velocity_rad_per_s: Vec<f64> ["rad/s"]
            => "joint velocities, step after step; 0 at a limit to which a joint was put back",
        q_acceleration_rad_per_s2: Vec<f64> ["rad/s²"]
            => "joint accelerations, step after step; 0 at a limit to which a joint was put back",
        palm_velocity: Vec<[f64; 6]> ["m/s, rad/s"]
            => "the palm's velocity and angular velocity along the object's axes at each step",
        palm_acceleration: Vec<[f64; 6]> ["m/s², rad/s²"]
            => "how fast the palm's velocity and angular velocity change at each step",
    }
}

impl From<&Candidate> for Row {
    fn from(candidate: &Candidate) -> Self {
        let steps = || candidate.motion.steps().iter();
        Self {
            candidate_id: candidate.candidate_id.clone(),
            generator: candidate.generator.clone(),
            source: candidate.source.clone(),
            depth_m: candidate.depth_m,
            residual_m2: candidate.residual_m2,
            latent: candidate.latent.clone(),
            table_from_object: candidate.table_from_object,
            limit_excess_rad: candidate.limit_excess_rad,
            time_s: steps().map(|s| s.time_s).collect(),
            object_from_palm: steps().map(|s| s.frame_from_palm).collect(),
            q_rad: steps().flat_map(|s| &s.q_rad).copied().collect(),
            q_velocity_rad_per_s: steps()
                .flat_map(|s| &s.rates.joints.velocity)
                .copied()
                .collect(),
            q_acceleration_rad_per_s2: steps()
                .flat_map(|s| &s.rates.joints.acceleration)
                .copied()
                .collect(),
            palm_velocity: steps().map(|s| s.rates.palm_velocity.to_array()).collect(),
            palm_acceleration: steps()
                .map(|s| s.rates.palm_acceleration.to_array())
                .collect(),
        }
    }
}

impl Row {
    /// Returns the motion of a hand with these joints, if every step is complete.
    fn candidate(self, joints: &Arc<[String]>) -> Result<Candidate, SchemaError> {
        let (dof, steps_n) = (joints.len(), self.time_s.len());
        let of_joints = |column, numbers: &[f64]| {
            SchemaError::check_length(column, "joint positions", numbers, dof * steps_n)
        };
        of_joints("q_rad", &self.q_rad)?;
        of_joints("q_velocity_rad_per_s", &self.q_velocity_rad_per_s)?;
        of_joints("q_acceleration_rad_per_s2", &self.q_acceleration_rad_per_s2)?;
        let of_palm =
            |column, rates: &[[f64; 6]]| SchemaError::check_length(column, "steps", rates, steps_n);
        of_palm("palm_velocity", &self.palm_velocity)?;
        of_palm("palm_acceleration", &self.palm_acceleration)?;
        let poses = &self.object_from_palm;
        SchemaError::check_length("object_from_palm", "steps", poses, steps_n)?;
        let step = |idx: usize| {
            let of_step = |numbers: &[f64]| numbers[idx * dof..(idx + 1) * dof].to_vec();
            Step {
                time_s: self.time_s[idx],
                frame_from_palm: self.object_from_palm[idx],
                q_rad: of_step(&self.q_rad),
                rates: HandRates {
                    palm_velocity: Twist::from_array(self.palm_velocity[idx]),
                    palm_acceleration: Twist::from_array(self.palm_acceleration[idx]),
                    joints: JointRates {
                        velocity: of_step(&self.q_velocity_rad_per_s),
                        acceleration: of_step(&self.q_acceleration_rad_per_s2),
                    },
                },
            }
        };
        let motion = Motion::of_joints(Arc::clone(joints), (0..steps_n).map(step).collect());
        Ok(Candidate {
            motion: motion.map_err(|source| SchemaError::Motion {
                name: self.candidate_id.clone(),
                source,
            })?,
            candidate_id: self.candidate_id,
            generator: self.generator,
            source: self.source,
            latent: self.latent,
            table_from_object: self.table_from_object,
            limit_excess_rad: self.limit_excess_rad,
            depth_m: self.depth_m,
            residual_m2: self.residual_m2,
        })
    }
}

impl Table for Candidates {
    const NAME: &'static str = "candidates";
    const PARTITION: &'static str = "object";
    const VERSION: &'static str = "candidates/6";

    fn schema() -> Schema {
        Writer::of::<Row>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let mut candidates = self.candidates.iter();
        if let Some(other) = candidates.find(|one| *one.motion.joints() != self.joints) {
            let message = format!("`{}` has other joints", other.candidate_id);
            return Err(SchemaError::invalid(JOINTS, message));
        }
        let rows: Vec<Row> = self.candidates.iter().map(Row::from).collect();
        let writer = Writer::of(Self::VERSION, &rows);
        writer.with_names(JOINTS, &self.joints).into_batch()
    }

    fn from_batch(object: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let reader = Reader::new(batch, Self::VERSION)?;
        let joints = reader.joints()?.into();
        let mut candidates = Vec::with_capacity(batch.num_rows());
        for row in 0..batch.num_rows() {
            // In older versions refused draws are rows, too.
            let refused: Option<Option<Refusal>> = reader.cell_if_there("refused", row)?;
            if refused.flatten().is_none() {
                candidates
                    .push(<Row as crate::columns::Row>::read(&reader, row)?.candidate(&joints)?);
            }
        }
        Ok(Self {
            object: object.to_owned(),
            joints,
            candidates,
        })
    }
}
