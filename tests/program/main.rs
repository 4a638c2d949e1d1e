//! The whole program, run as a user runs it, on a small sample and with little training.

mod arm;
mod baseline;
mod bench;
mod bounds;
mod cell;
mod cell_lab;
mod commands;
mod doctor;
mod effective;
mod errors;
mod extended;
mod history;
mod incremental;
mod interpolation;
mod messages;
mod mujoco_judge;
mod output;
mod own_hand;
mod page;
#[path = "../../crates/cell/tests/cell/papers.rs"]
mod papers;
mod projects;
mod python;
mod questions;
mod readme;
mod recipes;
mod refinement;
mod repeatable;
mod retargeting;
mod routing;
mod shipped;
mod stopping;
mod studies;
mod sweeps;
mod tables;
mod terminal;
