//! Artifacts on disk: content-addressed blobs, records of units and runs, tables and recordings.
//!
//! A lake is a folder:
//!
//! ```text
//! blobs/ab/abcd…           bytes of artifacts, named by their BLAKE3 digest, read-only
//! recipes/abcd….json       what units of one output have in common: kind, code, configuration, schema
//! units/ab/abcd….json      what each unit depended on and gave, named by its fingerprint's digest,
//!                          with when and where it was made (never part of an artifact)
//! manifests/abcd….json     lists of the units of runs, named by their digest
//! runs/000012.json         what each run did, with which values
//! again.json               which older run was gone through again last, and so is the newest
//! tags/NAME.json           names for runs, which keep them
//! copies/…                 recipes, manifests, runs and tags once more: nothing could make them again
//! tables/…                 Hive-partitioned Parquet: the newest partitions of every artifact, and what
//!                          runs did (`runs`, `settings`, `units`, `artifacts`, `metrics`)
//! every/…                  Hive-partitioned Parquet: every partition that any unit made
//! files/…                  recordings, meshes and weights of the newest partitions
//! reports/PIPELINE/STAGE/… charts of the newest partitions
//! views.sql                the tables as views for DuckDB
//! newest/PIPELINE.cache    a cache: the newest state of every unit of a pipeline
//! seen.cache               a cache: what everything that people see looked like when it was right
//! changing/PIPELINE.…      whose tables and files are being changed
//! sources.json             a cache: digests of files outside, by size, times and inode
//! staging/, locks/         units in the making
//! resume/abcd…/            what a unit goes on from that was interrupted, until its result is kept
//! ```
//!
//! A stage reads and writes by type, and every error in it is a [`LakeError`]:
//!
//! ```
//! use dataflow::{Context, Inputs};
//! use lake::{LakeError, ReadInputs, WriteArtifact};
//! use schemas::{objects::Object, rollouts::Rollouts, trajectories::Trajectory};
//!
//! fn make(inputs: &Inputs, cx: &Context) -> Result<(), LakeError> {
//!     let trajectories: Vec<Trajectory> = inputs.all()?;
//!     let object: Option<Object> = inputs.optional()?;
//!     cx.write(&Rollouts::new())
//! }
//! ```
//!
//! Invariants: a file under its final name is complete (written beside, synced, renamed); every
//! file is named by a digest of its bytes or contains one, and is checked before use; two processes
//! never make the same unit at the same time; a dead process's lock and staging folder are taken
//! over.

mod abandon;
mod again;
mod artifact;
mod atomic;
mod blobs;
mod cache;
mod changing;
mod clock;
mod collect;
mod compact;
mod digests;
mod error;
mod flight;
mod folder;
mod history;
mod lake;
mod lock;
mod making;
mod mend;
mod newest;
mod published;
mod recorded;
pub mod recording;
mod records;
mod register;
mod sealed;
mod seen;
mod sources;
mod stamp;
mod stamps;
mod store;
pub mod table;
mod tags;
mod twice;
mod unit;
mod verify;
mod views;

pub use artifact::ReadArtifact;
pub use atomic::write_whole;
pub use collect::{Collected, CollectedUnits, Collecting};
pub use digests::OnBytes;
pub use error::LakeError;
pub use lake::Lake;
pub use recorded::{StageTable, TableFiles};
pub use records::Provenance;
pub use register::Run;
pub use unit::{ReadInputs, WriteArtifact};
pub use verify::{Fault, Verified};
