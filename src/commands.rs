//! One file per command.

mod cell;
mod chosen;
mod completions;
mod diff;
mod doctor;
mod gc;
mod graph;
mod inspect;
mod lineage;
mod pipeline_file;
mod plan;
mod query;
mod run;
mod runs;
mod stages;
mod sweep;
mod tags;
mod unit;
mod verify;

pub(crate) use cell::cell;
pub(crate) use completions::completions;
pub(crate) use diff::diff;
pub(crate) use doctor::doctor;
pub(crate) use gc::gc;
pub(crate) use graph::graph;
pub(crate) use inspect::inspect;
pub(crate) use lineage::lineage;
pub(crate) use plan::plan;
pub(crate) use query::query;
pub(crate) use run::run;
pub(crate) use runs::runs;
pub(crate) use stages::stages;
pub(crate) use tags::{tag, untag};
pub(crate) use unit::unit;
pub(crate) use verify::verify;
