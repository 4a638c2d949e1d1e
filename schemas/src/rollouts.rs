//! `rollouts`: the outcome of each candidate in simulation, one partition per object, one row per
//! candidate.

pub use motion::{Smoothness, Variation, Variations};

use crate::{
    SchemaError,
    candidates::{Candidate, DrawSource},
    columns::{Reader, Row, Writer, columns, words},
    table::table,
};

columns! {
    /// What a simulation measures of one motion, verdict and smoothness aside; the default is that of a motion that was
    /// not simulated.
    #[derive(Debug, Clone, Copy, Default, PartialEq)]
    pub struct Measures {
        control_steps_n: u32 => "control steps simulated; with `skipped_steps_n` those of the full script",
        skipped_steps_n: u32 => "control steps of the script that were not simulated",
        lift_m: f64 ["m"] => "rise of the object's origin at the end",
        slip_m: f64 ["m"] => "motion of the object in the palm frame between lift and end",
        displacement_m: f64 ["m"] => "motion of the object on the table before the squeeze",
        penetration_m: f64 ["m"] => "deepest that the hand was in the object while it was held",
        contacts_n: u32 => "hand links in contact with the object at the end",
    }
}

columns! {
    /// The outcome of one candidate in simulation.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Rollout {
        candidate_id: String => "the motion",
        generator: String => "what drew it",
        /// Source of the candidate.
        source: DrawSource,
        + success: bool = |rollout| rollout.verdict == Verdict::Held
            => "lifted, held to the end and still in contact",
        verdict as reason: Verdict => "`held`, or why it failed",
        /// What the simulation measured.
        measures: Measures,
        /// Smoothness of the candidate as drawn; the default of an infeasible one, whose columns are null.
        smoothness: Smoothness,
        /// Smoothness of the hand's motion as executed.
        executed: ExecutedSmoothness,
    }
}

impl Rollout {
    /// Returns the row of a candidate of which nothing was simulated.
    pub fn unsimulated(candidate: &Candidate, verdict: Verdict) -> Self {
        Self {
            candidate_id: candidate.candidate_id.clone(),
            generator: candidate.generator.clone(),
            source: candidate.source.clone(),
            verdict,
            measures: Measures::default(),
            smoothness: Smoothness::default(),
            executed: ExecutedSmoothness(None),
        }
    }
}

/// The rollouts of one object's candidates.
pub type Rollouts = Vec<Rollout>;
table! {"rollouts", 7, per "object", rows: Rollout}

words! {
    /// Outcome of a rollout; success is first.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Verdict: "verdict" {
        /// Lifted and held to the end.
        Held = "held",
        /// A commanded joint position violates its limits.
        Limit = "limit",
        /// The motion would pass through the table.
        Table = "table",
        /// The motion would pass through the object before the grasp.
        EarlyContact = "early_contact",
        /// The object was pushed away or over before the squeeze.
        KnockedOver = "knocked_over",
        /// Nothing was lifted.
        NotGrasped = "not_grasped",
        /// The object moved in the hand while it was held.
        Slipped = "slipped",
        /// Lifted, and fell before the end.
        Dropped = "dropped",
        /// Held to the end, with the hand deeper in the object than solid bodies can be.
        TooDeep = "too_deep",
        /// Object and table loaded the palm more than an arm bears.
        Overloaded = "overloaded",
        /// The simulation became non-finite or implausible.
        Diverged = "diverged",
        /// The hand cannot execute the motion, or the object does not come to rest as it lies in it;
        /// nothing was simulated.
        Infeasible = "infeasible",
    }
}

/// Smoothness of the hand's motion as executed: of its palm and joints at the control steps of the reach. Nothing of a
/// motion whose reach was not simulated to its end.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ExecutedSmoothness(pub Option<Smoothness>);

/// A part of a measure: its name, its meaning and its accessor.
type Part<Of, Is> = (&'static str, &'static str, fn(&Of) -> &Is);

const DEFINITIONS: [Part<Smoothness, Variations>; 3] = [
    ("paper", "as the paper defines it", |of| &of.paper),
    ("released", "as the released code computes it", |of| {
        &of.released
    }),
    ("robust", "of all channels as one vector", |of| &of.robust),
];
const SPACES: [Part<Variations, Variation>; 2] = [
    ("joints", "joints", |of| &of.joints),
    ("cartesian", "links in space", |of| &of.cartesian),
];
const ORDERS: [Part<Variation, f64>; 3] = [
    ("position", "position", |of| &of.position),
    ("velocity", "velocity", |of| &of.velocity),
    ("acceleration", "acceleration", |of| &of.acceleration),
];

/// Writes one column for each definition, space and order, e.g. `paper_joints_position`.
fn write_smoothness(rows: &[&Smoothness], to: &mut Writer, prefix: &str, motion: &str) {
    for (definition, how, variations) in DEFINITIONS {
        for (space, of, variation) in SPACES {
            for (order, what, number) in ORDERS {
                let name = format!("{prefix}{definition}_{space}_{order}");
                let about = format!("total variation of the {of}' {what}{motion}, {how}");
                let cells = rows.iter().map(|row| {
                    let measured = variation(variations(row));
                    (measured.position > 0.0).then(|| *number(measured))
                });
                to.computed(
                    &name,
                    Some("1"),
                    &about,
                    &cells.collect::<Vec<Option<f64>>>(),
                );
            }
        }
    }
}

/// Reads what [`write_smoothness`] wrote.
fn read_smoothness(from: &Reader<'_>, row: usize, prefix: &str) -> Result<Smoothness, SchemaError> {
    let variations = |definition: &str| -> Result<Variations, SchemaError> {
        let variation = |space: &str| -> Result<Variation, SchemaError> {
            let number = |order: &str| -> Result<f64, SchemaError> {
                let name = format!("{prefix}{definition}_{space}_{order}");
                Ok(from.cell::<Option<f64>>(&name, row)?.unwrap_or_default())
            };
            Ok(Variation {
                position: number("position")?,
                velocity: number("velocity")?,
                acceleration: number("acceleration")?,
            })
        };
        Ok(Variations {
            joints: variation("joints")?,
            cartesian: variation("cartesian")?,
        })
    };
    Ok(Smoothness {
        paper: variations("paper")?,
        released: variations("released")?,
        robust: variations("robust")?,
    })
}

impl Row for Smoothness {
    fn write(rows: &[&Self], to: &mut Writer) {
        write_smoothness(rows, to, "", "");
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        read_smoothness(from, row, "")
    }
}

/// The column `reached`, and those of [`Smoothness`], e.g. `executed_paper_joints_position`, which are null where
/// it is false.
impl Row for ExecutedSmoothness {
    fn write(rows: &[&Self], to: &mut Writer) {
        let reached: Vec<bool> = rows.iter().map(|row| row.0.is_some()).collect();
        let about = "whether the reach was simulated to its end";
        to.column("reached", None, about, &reached.iter().collect::<Vec<_>>());
        let executed: Vec<Smoothness> = rows.iter().map(|row| row.0.unwrap_or_default()).collect();
        let executed: Vec<&Smoothness> = executed.iter().collect();
        write_smoothness(&executed, to, EXECUTED, " as executed");
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        let executed = read_smoothness(from, row, EXECUTED)?;
        Ok(Self(from.cell::<bool>("reached", row)?.then_some(executed)))
    }
}

/// Prefix of the columns of a motion as executed.
const EXECUTED: &str = "executed_";
