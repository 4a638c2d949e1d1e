//! Every test of the whole program in one binary.
//!
//! It links once, and tests that wait (for a timeout, a scheduler, a killed process) share the processor with tests
//! that compute.

mod bench_tools;
mod code_digest;
mod dependencies;
mod engine;
mod folder;
mod program;

#[path = "slurm/cluster.rs"]
mod cluster;
