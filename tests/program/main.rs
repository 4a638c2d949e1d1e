//! The whole program, run as a user runs it, on a small sample and with little training.

mod baseline;
mod bench;
mod cell;
mod commands;
mod doctor;
mod errors;
mod history;
mod incremental;
mod interpolation;
mod questions;
mod repeatable;
mod retargeting;
mod studies;
mod sweeps;
