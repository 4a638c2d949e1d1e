//! One file per command.

mod completions;
mod doctor;
mod gc;
mod graph;
mod inspect;
mod pipeline_file;
mod plan;
mod query;
mod run;
mod stages;
mod sweep;
mod unit;
mod verify;

pub(crate) use completions::completions;
pub(crate) use doctor::doctor;
pub(crate) use gc::gc;
pub(crate) use graph::graph;
pub(crate) use inspect::inspect;
pub(crate) use plan::plan;
pub(crate) use query::query;
pub(crate) use run::run;
pub(crate) use stages::stages;
pub(crate) use unit::unit;
pub(crate) use verify::verify;
