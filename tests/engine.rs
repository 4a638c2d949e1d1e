//! The engine, driven by trivial stages: `own_stages`, a program with its own stages.
//!
//! The tests check the program's output, the lake's published `tables` and `files`, and a log that
//! the stages write; the lake's internal storage is not checked. Longer versions are the same tests
//! with larger counts: `PIPELINE_EDITS`, `PIPELINE_KILLS`, `PIPELINE_FLIPS`, `PIPELINE_FAULTS` and
//! `PIPELINE_ROUNDS`;
//! `PIPELINE_SEED` changes the random draws.

#[path = "own_stages/stages.rs"]
mod own_stages;
mod place;

mod attacks;
mod concurrency;
mod corruption;
mod crash;
mod defaults;
mod detached;
mod elsewhere;
mod faults;
mod full_disk;
mod garbage;
mod hiccups;
mod in_the_way;
mod interrupt;
mod logged;
mod meanwhile;
mod memory;
mod object_store;
mod plan_equals_run;
mod precision;
mod program_maps;
mod programs;
mod questions;
mod remote;
mod reports;
mod resume;
mod sharing;
mod slurm;
mod two_mounts;
