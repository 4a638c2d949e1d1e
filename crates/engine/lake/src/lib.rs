//! Artifacts on disk: content-addressed blobs, records of units and runs, tables and recordings.
//!
//! A lake is a folder:
//!
//! ```text
//! blobs/ab/abcd…           bytes of artifacts, named by their BLAKE3 digest, read-only
//! recipes/abcd….json       shared by the units of one output: kind, code, configuration, schema
//! units/ab/abcd….json      fingerprint and outcome of each unit, named by the fingerprint's digest,
//!                          with when and where it was made (never part of an artifact)
//! manifests/abcd….json     lists of the units of runs, named by their digest
//! runs/000012.json         record of each run, with its values
//! again.json               the repeated runs, which count as newer than those before the repetition
//! tags/NAME.json           names for runs, which keep them
//! copies/…                 backup of recipes, manifests, runs and tags, which are irreplaceable
//! tables/…                 Hive-partitioned Parquet: the newest partitions of every artifact, and what
//!                          runs did (`runs`, `settings`, `units`, `artifacts`, `metrics`)
//! every/…                  Hive-partitioned Parquet: each version of each partition, by the unit that made it;
//! files/…                  recordings, meshes and weights of the newest partitions
//! reports/PIPELINE/STAGE/… charts of the newest partitions
//! views.sql                the tables as views for DuckDB
//! newest/PIPELINE.cache    a cache: the newest state of every unit of a pipeline
//! seen.cache               a cache: stamps of the watched files at the last full check
//! changing/PIPELINE.…      marks of pipelines whose tables and files are being changed
//! sources.cache            a cache: digests of files outside, by size, times and inode
//! staging/, locks/         units in progress
//! outbox/                  marks of units and runs that are to be sent to the depot
//! identity                 what tells this lake from others and from its copies, once it has claimed a unit in the depot
//! detached/N/              what the program's runs in the background said, and how they ended
//! unfetched/               marks of blobs that are in the depot and not here, until they are asked for
//! logs/abcd….log           what the program of a unit printed, until its unit is collected
//! effects/KIND/            what stages of a kind have done in the world, apart from units and runs: never collected
//! resume/abcd…/            resume state of an interrupted unit, until its result is stored
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

mod abort;
mod artifact;
mod atomic;
mod blobs;
mod cache;
mod catalog;
mod changing;
mod clock;
mod codec;
mod collect;
mod depot_commands;
mod depot_tables;
mod digests;
mod error;
mod folder;
mod history;
mod in_flight;
#[doc(hidden)]
pub mod inputs;
mod lake;
mod lock;
mod mount;
mod newest;
mod published;
pub mod recording;
mod records;
mod register;
mod repair;
mod repeated_runs;
mod replicas;
mod replicated_files;
mod scratch;
mod sealed;
mod shared;
mod sibling_table;
mod snapshot;
mod sources;
mod staging;
mod stamps;
mod store;
pub mod table;
mod table_file;
mod tags;
mod unit;
mod verify;
mod views;

pub use artifact::ReadArtifact;
pub use atomic::write_atomic;
pub use catalog::{StageTable, TableFiles};
pub use clock::{host, name_program, time_until};
pub use collect::{GcMode, GcReport, GcUnits};
pub use depot_tables::DepotTables;
pub use digests::OnBytes;
pub use error::LakeError;
pub use lake::Lake;
pub use records::Provenance;
pub use register::Run;
pub use shared::{DepotOutage, DepotOutageListener, OutagePolicy, Sharing, SharingReport};
pub use sibling_table::{SiblingMetrics, SiblingTable};
pub use table_file::TableFile;
pub use unit::{ReadInputs, WriteArtifact};
pub use verify::{Fault, VerificationReport};
