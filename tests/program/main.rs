//! The whole program, run as a user runs it, on a small sample and with little training.

mod arm;
mod baseline;
mod bench;
mod bounds;
mod cell;
mod cell_lab;
#[path = "../slurm/cluster.rs"]
mod cluster;
mod commands;
mod dispatch_ledger;
mod doctor;
mod effective;
mod errors;
mod exports;
mod extended;
#[path = "../../stages/dispatch/tests/model/model.rs"]
mod goal_model;
mod history;
mod imports;
mod incremental;
mod interpolation;
mod located;
mod memory;
mod messages;
mod misbehavior;
mod mujoco_judge;
mod older_lake;
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
mod rivals;
mod ros2_cell;
mod routing;
mod sequences;
mod shipped;
mod slurm;
mod stopping;
mod studies;
mod sweeps;
mod tables;
mod terminal;
