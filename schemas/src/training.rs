//! `training`: how a training went, one partition per model, one row per epoch and set of motions that
//! was measured in it.
//!
//! Losses are means over motions, before they are weighted; `total` is their weighted sum.
//!
//! | column          | type | unit | meaning                                                        |
//! |-----------------|------|------|----------------------------------------------------------------|
//! | `epoch`         | i64  |      | number of the epoch, from 1                                    |
//! | `split`         | utf8 |      | `training`, `held_out` or `unseen`                             |
//! | `learning_rate` | f64  | 1    | the optimizer's                                                |
//! | `total`         | f64  | 1    | weighted sum                                                   |
//! | `q`             | f64  | 1    | squared errors of the outputs, in the network's units          |
//! | `translation`   | f64  | 1    | the part of `q` that is the translation's                      |
//! | `origins_m2`    | f64  | m²   | squared distances of the links' origins                        |
//! | `rotations`     | f64  | 1    | squared errors of two columns of the links' rotations          |
//! | `kl_nats`       | f64  | nat  | divergence of the latent codes from the standard normal        |
//! | `contact_m2`    | f64  | m²   | squared distances of the finger tips from contact              |
//! | `penetration_m2` | f64 | m²   | squared depths of the links in object and table                |
//!
//! `training` is as the motions were seen, turned and with noise; the others as they were recorded,
//! after the epoch, decoded from their mean codes.

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "training/2";

/// The losses of one set of motions in one epoch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Row {
    /// Number of the epoch, from 1.
    pub epoch: i64,
    /// `training`, `held_out` or `unseen`.
    pub split: String,
    /// The optimizer's learning rate.
    pub learning_rate: f64,
    /// Weighted sum.
    pub total: f64,
    /// Squared errors of the outputs, in the network's units.
    pub q: f64,
    /// The part of `q` that is the translation's, in the same units.
    pub translation: f64,
    /// Squared distances of the links' origins, in m².
    pub origins_m2: f64,
    /// Squared errors of two columns of the links' rotations.
    pub rotations: f64,
    /// Divergence of the latent codes from the standard normal, in nats.
    pub kl_nats: f64,
    /// Squared distances of the finger tips from contact, in m².
    pub contact_m2: f64,
    /// Squared depths of the links in object and table, in m².
    pub penetration_m2: f64,
}

/// A column: its name, unit, meaning, and where its number is.
type Column = (
    &'static str,
    &'static str,
    &'static str,
    fn(&mut Row) -> &mut f64,
);

/// The columns of numbers.
const NUMBERS: [Column; 9] = [
    ("learning_rate", "1", "the optimizer's", |row| {
        &mut row.learning_rate
    }),
    ("total", "1", "weighted sum of the losses", |row| {
        &mut row.total
    }),
    (
        "q",
        "1",
        "squared errors of the outputs, in the network's units",
        |row| &mut row.q,
    ),
    (
        "translation",
        "1",
        "the part of q that is the translation's",
        |row| &mut row.translation,
    ),
    (
        "origins_m2",
        "m²",
        "squared distances of the links' origins",
        |row| &mut row.origins_m2,
    ),
    (
        "rotations",
        "1",
        "squared errors of two columns of the links' rotations",
        |row| &mut row.rotations,
    ),
    (
        "kl_nats",
        "nat",
        "divergence of the latent codes from the standard normal",
        |row| &mut row.kl_nats,
    ),
    (
        "contact_m2",
        "m²",
        "squared distances of the finger tips from contact",
        |row| &mut row.contact_m2,
    ),
    (
        "penetration_m2",
        "m²",
        "squared depths of the links in object and table",
        |row| &mut row.penetration_m2,
    ),
];

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(rows: &[Row]) -> Columns {
    let mut c = Columns::new(VERSION);
    c.i64(
        "epoch",
        "number of the epoch, from 1",
        rows.iter().map(|row| row.epoch),
    );
    c.utf8(
        "split",
        "training, held_out or unseen",
        rows.iter().map(|row| row.split.clone()),
    );
    for (name, unit, about, number) in NUMBERS {
        let values = rows.iter().map(|row| *number(&mut row.clone()));
        c.f64(name, unit, about, values);
    }
    c
}

/// Returns one row per epoch and set of motions.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(rows: &[Row]) -> Result<RecordBatch, SchemaError> {
    columns(rows).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version.
fn from_batch(batch: &RecordBatch) -> Result<Vec<Row>, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    (0..r.rows())
        .map(|idx| {
            let mut row = Row {
                epoch: r.i64("epoch", idx)?,
                split: r.utf8("split", idx)?.to_owned(),
                ..Row::default()
            };
            for (name, _, _, number) in NUMBERS {
                *number(&mut row) = r.f64(name, idx)?;
            }
            Ok(row)
        })
        .collect()
}

/// The rows of one partition.
pub type Training = Vec<Row>;

impl Table for Training {
    const NAME: &'static str = "training";
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
