//! Runs a program of the user's for each unit: `kind = "program"`.
//!
//! The program gets a folder with its inputs, a file `job.json` that says what to make with which
//! options and seed, and an empty table with the columns to fill; it writes Parquet into `out`. What it
//! wrote is checked against the artifact's schema and rules before anything is kept, and stored as this
//! program would have written it: equal rows are equal bytes, whatever library wrote them.
//!
//! Invariants: a program that fails, hangs or breaks a rule leaves nothing in the lake but its log; no
//! process of it outlives its unit, nor the process that started it.

mod artifacts;
mod code;
mod columns;
mod config;
mod error;
mod folder;
mod job;
mod limits;
mod log;
mod own_table;
mod process;
mod processes;
mod program;
mod result;
mod script;
mod units;

pub use artifacts::{Artifacts, KnownArtifact, ProjectArtifacts};
pub use config::{ColumnConfig, ColumnType, ProgramConfig};
pub use error::ProgramError;
pub use process::stop_all;
pub use program::{Program, ProgramMetrics};
pub use script::FirstLine;
