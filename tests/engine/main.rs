//! The engine, driven by stages that cost nothing: `own_stages`, a program with stages of its own.
//!
//! The tests look at the program's outputs, at what a lake shows under `tables` and `files`, and at a
//! log that the stages write; how a lake keeps things is its own affair. Longer versions are the same
//! tests with larger counts: `PIPELINE_EDITS`, `PIPELINE_KILLS`, `PIPELINE_FLIPS` and `PIPELINE_FAULTS`; `PIPELINE_SEED` draws others.

#[path = "../own_stages/stages.rs"]
mod own_stages;
mod place;

mod concurrency;
mod corruption;
mod crash;
mod defaults;
mod elsewhere;
mod faults;
mod full_disk;
mod garbage;
mod interrupt;
mod logged;
mod meanwhile;
mod memory;
mod plan_equals_run;
mod precision;
mod reports;
mod resume;
