//! `latents`: what a model uses of its latent code, one partition per model, one row per dimension.
//!
//! All figures are over the motions that were learned from. A dimension is active if the variance of its
//! means is more than 0.01 (Burda, Grosse and Salakhutdinov, *Importance Weighted Autoencoders*, 2016,
//! section 5.2): the others say the same of every motion.
//!
//! | column            | type | unit | meaning                                                      |
//! |-------------------|------|------|--------------------------------------------------------------|
//! | `dimension`       | i64  |      | place in the code, from 0                                    |
//! | `kl_nats`         | f64  | nat  | divergence from the standard normal, mean over the motions   |
//! | `mean_deviation`  | f64  | 1    | standard deviation of the motions' means                     |
//! | `deviation_mean`  | f64  | 1    | mean of the motions' standard deviations                     |
//! | `active`          | bool |      | whether motions differ in it                                 |

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "latents/1";

/// What is used of one dimension.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Place in the code, from 0.
    pub dimension: i64,
    /// Divergence from the standard normal, mean over the motions, in nats.
    pub kl_nats: f64,
    /// Standard deviation of the motions' means.
    pub mean_deviation: f64,
    /// Mean of the motions' standard deviations.
    pub deviation_mean: f64,
    /// Whether motions differ in it.
    pub active: bool,
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(rows: &[Row]) -> Columns {
    let mut c = Columns::new(VERSION);
    c.i64(
        "dimension",
        "place in the code, from 0",
        rows.iter().map(|row| row.dimension),
    );
    c.f64(
        "kl_nats",
        "nat",
        "divergence from the standard normal, mean over the motions",
        rows.iter().map(|row| row.kl_nats),
    );
    c.f64(
        "mean_deviation",
        "1",
        "standard deviation of the motions' means",
        rows.iter().map(|row| row.mean_deviation),
    );
    c.f64(
        "deviation_mean",
        "1",
        "mean of the motions' standard deviations",
        rows.iter().map(|row| row.deviation_mean),
    );
    c.bool(
        "active",
        "whether motions differ in it",
        rows.iter().map(|row| row.active),
    );
    c
}

/// Returns one row per dimension.
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
            Ok(Row {
                dimension: r.i64("dimension", idx)?,
                kl_nats: r.f64("kl_nats", idx)?,
                mean_deviation: r.f64("mean_deviation", idx)?,
                deviation_mean: r.f64("deviation_mean", idx)?,
                active: r.bool("active", idx)?,
            })
        })
        .collect()
}

/// The rows of one partition.
pub type Latents = Vec<Row>;

impl Table for Latents {
    const NAME: &'static str = "latents";
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
