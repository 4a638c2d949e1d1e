//! One file per command.

mod completions;
mod doctor;
mod graph;
mod inspect;
mod pipeline_file;
mod plan;
mod query;
mod run;
mod stages;
mod sweep;

pub(crate) use completions::completions;
pub(crate) use doctor::doctor;
pub(crate) use graph::graph;
pub(crate) use inspect::inspect;
pub(crate) use plan::plan;
pub(crate) use query::query;
pub(crate) use run::run;
pub(crate) use stages::stages;
