//! The artifacts that stages exchange: one file per artifact, with columns, units, frames, version.
//!
//! ```
//! use schemas::{Table, latents::{Latents, LatentDimension}};
//!
//! let latents: Latents =
//!     vec![LatentDimension { dimension: 0, kl_nats: 0.5, mean_deviation: 0.9, deviation_mean: 0.4, active: true }];
//! let batch = latents.to_batch()?;
//! assert_eq!(batch.schema().field_with_name("kl_nats")?.metadata()["unit"], "nat");
//! assert_eq!(Latents::from_batch("cgf", &batch)?, latents);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A column is declared once, with its name, type, unit and meaning; its writer, reader and
//! documentation are derived from that. `snapshots/` has the columns of every version. Numbers are
//! SI and radians, finite, and poses are `[x, y, z, qx, qy, qz, qw]`; a reader refuses every other
//! version. This crate does no I/O: `lake` reads and writes.

pub mod candidates;
pub mod checkpoint;
mod columns;
pub mod completions;
pub mod demonstrations;
pub mod distance_fields;
pub mod draws;
mod error;
pub mod executions;
pub mod grasp_networks;
pub mod latents;
pub mod objects;
pub mod pose_errors;
pub mod rates;
pub mod reconstruction;
pub mod robustness;
pub mod rollouts;
pub mod ros2;
pub mod sampling;
pub mod smoothness;
pub mod success;
mod table;
pub mod tally;
pub mod tracking;
pub mod training;
pub mod trajectories;
pub mod trials;
pub mod views;

pub use columns::JOINTS;
pub use error::SchemaError;
pub use table::{TABLE_FILE, Table};
