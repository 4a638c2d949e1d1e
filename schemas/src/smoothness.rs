//! `smoothness`: how smooth each candidate is as drawn and as the simulated hand executed it, one partition per object, one
//! row per candidate.

pub use motion::{Smoothness, Variation, Variations};

use crate::{
    SchemaError,
    columns::{Reader, Row, Writer, columns},
    table::table,
};

columns! {
    /// The smoothness of one candidate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct CandidateSmoothness {
        candidate_id: String => "the motion",
        /// Smoothness of the candidate as drawn; the default of an infeasible one, whose columns are null.
        drawn: Smoothness,
        /// Smoothness of the hand's motion as executed.
        executed: ExecutedSmoothness,
    }
}

/// The smoothness of one object's candidates.
pub type SmoothnessTable = Vec<CandidateSmoothness>;
table! {"smoothness", 1, per "object", rows: CandidateSmoothness, beside "rollouts"}

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
