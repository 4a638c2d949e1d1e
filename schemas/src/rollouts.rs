//! `rollouts`: what physics did with each candidate, one partition per object, one row per candidate.
//!
//! | column                 | type    | unit | meaning                                                     |
//! |------------------------|---------|------|-------------------------------------------------------------|
//! | `candidate_id`         | utf8    |      | the motion                                                  |
//! | `generator`            | utf8    |      | what drew it                                                |
//! | `success`              | bool    |      | lifted, held to the end and still in contact                |
//! | `reason`               | utf8    |      | `held`, or why it failed (see [`Verdict`])                  |
//! | `cost_n`               | i64     |      | control steps simulated                                     |
//! | `saved_n`              | i64     |      | control steps of the script that were not simulated         |
//! | `lift_m`               | f64     | m    | rise of the object's origin at the end of the rollout       |
//! | `slip_m`               | f64     | m    | motion of the object in the palm frame, lift to end         |
//! | `displacement_m`       | f64     | m    | motion of the object on the table before the squeeze        |
//! | `penetration_m`        | f64     | m    | deepest contact between hand and object while held          |
//! | `contacts_n`           | i64     |      | hand links in contact with the object at the end            |
//! | `paper_…`              | f64 × 6 | 1    | smoothness of the candidate, see [`Smoothness`]: as the paper has it |
//! | `released_…`           | f64 × 6 | 1    | as the paper's released code computes it                    |
//! | `robust_…`             | f64 × 6 | 1    | without its sensitivity to channels that hardly move        |
//!
//! The six of each are `joints_position`, `joints_velocity`, `joints_acceleration`, `cartesian_position`,
//! `cartesian_velocity` and `cartesian_acceleration`.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "rollouts/2";

/// How a rollout ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Lifted and held to the end.
    Held,
    /// A joint position outside its limits was asked for.
    Limit,
    /// The hand would have to go through the table.
    Table,
    /// The hand would have to go through the object before the grasp.
    EarlyContact,
    /// The object was pushed away or over before the squeeze.
    KnockedOver,
    /// Nothing was lifted.
    NotGrasped,
    /// The object moved in the hand while it was held.
    Slipped,
    /// Lifted, and fell before the end.
    Dropped,
    /// The simulation left the realm of finite, plausible numbers.
    Diverged,
}

impl Verdict {
    /// Every verdict, success first.
    pub const ALL: [Self; 9] = [
        Self::Held,
        Self::Limit,
        Self::Table,
        Self::EarlyContact,
        Self::KnockedOver,
        Self::NotGrasped,
        Self::Slipped,
        Self::Dropped,
        Self::Diverged,
    ];

    /// Returns the word stored in column `reason`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Held => "held",
            Self::Limit => "limit",
            Self::Table => "table",
            Self::EarlyContact => "early_contact",
            Self::KnockedOver => "knocked_over",
            Self::NotGrasped => "not_grasped",
            Self::Slipped => "slipped",
            Self::Dropped => "dropped",
            Self::Diverged => "diverged",
        }
    }

    /// Reads the word stored in column `reason`.
    pub fn parse(word: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|verdict| verdict.as_str() == word)
    }
}

/// How much a motion goes to and fro: its total variation, that of its velocity and that of its
/// acceleration, all without unit. Less is smoother.
///
/// Of a channel x with n steps, taken as equally long: y = (x − x₀)/(xₙ₋₁ − x₀), which goes from 0 to 1;
/// v its gradient by the time in units of the duration (central differences, one-sided at the ends), a
/// the gradient of v; and of each of them Σ|difference of neighbors|. A straight line has 1, 0 and 0.
/// A motion that ends where it began has no such measure, and every number of it is 0.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Variation {
    /// Of the position.
    pub position: f64,
    /// Of the velocity.
    pub velocity: f64,
    /// Of the acceleration.
    pub acceleration: f64,
}

/// How smooth a candidate is, by one definition.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Variations {
    /// Of the joints.
    pub joints: Variation,
    /// Of the hand's links in space.
    pub cartesian: Variation,
}

/// How smooth a candidate is as it was drawn, by three definitions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Smoothness {
    /// The mean over channels (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand
    /// from Human Demonstrations*, 2023, section IV): one channel per joint; one per coordinate of each
    /// link's origin in the object's frame. A channel that ends within 10⁻⁶ of where it began is left
    /// out. The paper's tables have the logarithm (base 10) of its mean over motions, but for the
    /// position.
    pub paper: Variations,
    /// The same as the released code computes it (github.com/jianglongye/cgf): joints and the three
    /// coordinates of the palm together; the time of a step 1/n, not 1/(n − 1), of the duration; the root
    /// link counted twice; and links placed with the palm's Euler angles (about its own x, y, z) read as a
    /// rotation vector, which is a mistake of that code.
    pub released: Variations,
    /// With all joints (or all coordinates of all links) as one vector: y = (x − x₀)/‖xₙ₋₁ − x₀‖ and
    /// Σ‖difference of neighbors‖, so that a channel that hardly moves cannot outweigh the others.
    pub robust: Variations,
}

impl Smoothness {
    /// Name, meaning, and place of each number.
    fn columns() -> Vec<(String, String)> {
        let definitions = [
            ("paper", "as the paper defines it"),
            ("released", "as the released code computes it"),
            ("robust", "of all channels as one vector"),
        ];
        let mut columns = Vec::new();
        for (definition, how) in definitions {
            for (space, of) in [("joints", "joints"), ("cartesian", "links in space")] {
                for order in ["position", "velocity", "acceleration"] {
                    columns.push((
                        format!("{definition}_{space}_{order}"),
                        format!("total variation of the {of}' {order}, {how}"),
                    ));
                }
            }
        }
        columns
    }

    fn numbers(&self) -> [f64; 18] {
        let definitions = [self.paper, self.released, self.robust];
        let spaces = definitions.map(|of| [of.joints, of.cartesian]);
        let numbers = spaces
            .as_flattened()
            .iter()
            .flat_map(|of| [of.position, of.velocity, of.acceleration]);
        let mut all = [0.0; 18];
        for (place, number) in all.iter_mut().zip(numbers) {
            *place = number;
        }
        all
    }

    fn from_numbers(numbers: &[f64; 18]) -> Self {
        let at = |idx: usize| Variation {
            position: numbers[idx],
            velocity: numbers[idx + 1],
            acceleration: numbers[idx + 2],
        };
        let both = |idx: usize| Variations {
            joints: at(idx),
            cartesian: at(idx + 3),
        };
        Self {
            paper: both(0),
            released: both(6),
            robust: both(12),
        }
    }
}

/// What physics did with one candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Rollout {
    /// The motion.
    pub candidate_id: String,
    /// What drew it.
    pub generator: String,
    /// How it ended; success is [`Verdict::Held`].
    pub verdict: Verdict,
    /// Control steps simulated.
    pub cost_n: u32,
    /// Control steps of the script that were not simulated.
    pub saved_n: u32,
    /// Rise of the object's origin at the end, in meters.
    pub lift_m: f64,
    /// Motion of the object in the palm frame between lift and end, in meters.
    pub slip_m: f64,
    /// Motion of the object on the table before the squeeze, in meters.
    pub displacement_m: f64,
    /// Deepest contact between hand and object while held, in meters.
    pub penetration_m: f64,
    /// Hand links in contact with the object at the end.
    pub contacts_n: u32,
    /// How smooth the candidate itself is.
    pub smoothness: Smoothness,
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(rollouts: &[Rollout]) -> Columns {
    let rows = || rollouts.iter();
    let mut c = Columns::new(VERSION);
    c.utf8(
        "candidate_id",
        "the motion",
        rows().map(|r| r.candidate_id.clone()),
    );
    c.utf8(
        "generator",
        "what drew it",
        rows().map(|r| r.generator.clone()),
    );
    c.bool(
        "success",
        "lifted, held to the end and still in contact",
        rows().map(|r| r.verdict == Verdict::Held),
    );
    c.utf8(
        "reason",
        "`held`, or why it failed",
        rows().map(|r| r.verdict.as_str().to_owned()),
    );
    c.i64(
        "cost_n",
        "control steps simulated",
        rows().map(|r| i64::from(r.cost_n)),
    );
    c.i64(
        "saved_n",
        "control steps of the script that were not simulated",
        rows().map(|r| i64::from(r.saved_n)),
    );
    c.f64(
        "lift_m",
        "m",
        "rise of the object's origin at the end",
        rows().map(|r| r.lift_m),
    );
    c.f64(
        "slip_m",
        "m",
        "motion of the object in the palm frame between lift and end",
        rows().map(|r| r.slip_m),
    );
    c.f64(
        "displacement_m",
        "m",
        "motion of the object on the table before the squeeze",
        rows().map(|r| r.displacement_m),
    );
    c.f64(
        "penetration_m",
        "m",
        "deepest contact between hand and object while held",
        rows().map(|r| r.penetration_m),
    );
    c.i64(
        "contacts_n",
        "hand links in contact with the object at the end",
        rows().map(|r| i64::from(r.contacts_n)),
    );
    for (idx, (name, about)) in Smoothness::columns().iter().enumerate() {
        c.f64(
            name,
            "1",
            about,
            rows().map(|r| r.smoothness.numbers()[idx]),
        );
    }
    c
}

/// Returns one row per rollout; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(rollouts: &[Rollout]) -> Result<RecordBatch, SchemaError> {
    columns(rollouts).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version or hold an unknown reason.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Rollout>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    let names = Smoothness::columns();
    (0..r.rows())
        .map(|row| {
            let mut numbers = [0.0; 18];
            for (number, (name, _)) in numbers.iter_mut().zip(&names) {
                *number = r.f64(name, row)?;
            }
            let word = r.utf8("reason", row)?;
            Ok(Rollout {
                candidate_id: r.utf8("candidate_id", row)?.to_owned(),
                generator: r.utf8("generator", row)?.to_owned(),
                verdict: Verdict::parse(word)
                    .ok_or_else(|| r.invalid("reason", format!("`{word}` is no verdict")))?,
                cost_n: r.u32("cost_n", row)?,
                saved_n: r.u32("saved_n", row)?,
                lift_m: r.f64("lift_m", row)?,
                slip_m: r.f64("slip_m", row)?,
                displacement_m: r.f64("displacement_m", row)?,
                penetration_m: r.f64("penetration_m", row)?,
                contacts_n: r.u32("contacts_n", row)?,
                smoothness: Smoothness::from_numbers(&numbers),
            })
        })
        .collect()
}

/// The rows of one partition.
pub type Rollouts = Vec<Rollout>;

impl Table for Rollouts {
    const NAME: &'static str = "rollouts";
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
