//! Artifacts on disk: content-addressed blobs, records of units and runs, tables and recordings.
//!
//! A lake is a folder:
//!
//! ```text
//! blobs/ab/abcd…           bytes of artifacts, named by their BLAKE3 digest, read-only
//! units/ab/abcd….json      what each unit depended on and gave, named by its fingerprint's digest
//! runs/…json               what each run did
//! newest/PIPELINE.json     the newest fingerprint of every unit of a pipeline
//! provenance/abcd….jsonl   when and where each unit was made (never part of an artifact)
//! tables/…                 Hive-partitioned Parquet: the newest partitions of every artifact
//! files/…                  recordings, meshes and weights of the newest partitions
//! views.sql                the tables as views for DuckDB
//! staging/, locks/         units in the making
//! sources.json             digests of files outside, by size, time and inode
//! ```
//!
//! Invariants: what stands under its final name is whole (written beside, synced, renamed); bytes are
//! checked against their digest before a unit reads them; two processes never make the same unit at
//! the same time; a dead process's lock and staging folder are taken over.

mod atomic;
mod blobs;
mod clock;
mod error;
mod folder;
mod lock;
mod making;
mod published;
pub mod recording;
mod sources;
pub mod table;

pub use error::LakeError;
pub use folder::Lake;
