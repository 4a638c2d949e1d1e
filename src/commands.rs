//! One file per command.

mod inspect;
mod pipeline_file;
mod plan;
mod query;
mod run;
mod stages;

pub(crate) use inspect::inspect;
pub(crate) use plan::plan;
pub(crate) use query::query;
pub(crate) use run::run;
pub(crate) use stages::stages;
