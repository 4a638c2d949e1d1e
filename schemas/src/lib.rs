//! The artifacts that stages exchange: one file per artifact, with columns, units, frames, version.
//!
//! Each artifact is a plain struct and a pair of functions between it and an Arrow record batch.
//! Numbers are SI and radians; poses are `[x, y, z, qx, qy, qz, qw]`; see each file's table.
//! This crate does no input or output: `lake` reads and writes.

pub mod candidates;
pub mod checkpoint;
mod columns;
pub mod demonstrations;
pub mod distance_fields;
pub mod executions;
pub mod latents;
pub mod objects;
pub mod reconstruction;
pub mod rollouts;
pub mod ros2;
pub mod sampling;
pub mod success;
mod table;
pub mod tracking;
pub mod training;
pub mod trajectories;
pub mod trials;

pub use columns::SchemaError;
pub use table::Table;
