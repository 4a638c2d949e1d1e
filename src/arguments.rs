//! Arguments and their help.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use dataflow::Override;

/// Learn dexterous grasps from human demonstrations
#[derive(Parser)]
#[command(version, after_help = "Start here: pipeline run pipelines/cgf.toml")]
pub(crate) struct Cli {
    /// Print only errors
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Directory that holds artifacts
    #[arg(long, global = true, value_name = "DIR", default_value = "data/lake")]
    pub(crate) lake: PathBuf,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Run a pipeline, reusing every result that is still valid
    Run(RunArgs),
    /// Show what `run` would do, and why
    Plan(PlanArgs),
    /// Ask the lake's tables a question in SQL
    Query(QueryArgs),
    /// Show an artifact: columns, rows, provenance, skipped items
    Inspect(InspectArgs),
    /// List the kinds of stages, their inputs, outputs and options
    Stages(StagesArgs),
}

/// Which pipeline, with which values.
#[derive(Args)]
pub(crate) struct PipelineArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    pub(crate) file: PathBuf,
    /// Take the values of this table under `profiles` in the file
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Replace one value, e.g. `ingest.root=/data/dexycb` or `train.training.epochs=500`; may be repeated
    #[arg(long = "set", value_name = "STAGE.KEY=VALUE")]
    pub(crate) overrides: Vec<Override>,
    /// Stop after this stage
    #[arg(long, value_name = "STAGE")]
    pub(crate) until: Option<String>,
    /// Go through this stage alone; what it reads must have been made
    #[arg(long, value_name = "STAGE", conflicts_with = "until")]
    pub(crate) only: Option<String>,
    /// Run this stage even if its results are in the lake; without a name, every stage
    #[arg(long, value_name = "STAGE", num_args = 0..=1, default_missing_value = "")]
    pub(crate) fresh: Vec<String>,
}

#[derive(Args)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// Number of worker threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) jobs: Option<u16>,
    /// Show what would run, as `plan` does, and run nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Let `dispatch` move a robot that is not simulated; without this it sends nothing to one
    #[arg(long)]
    pub(crate) execute: bool,
}

#[derive(Args)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// How to print
    #[arg(long, value_enum, default_value_t = PlanFormat::Text)]
    pub(crate) format: PlanFormat,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum PlanFormat {
    /// One line per output and cause
    Text,
    /// Every unit with its causes
    Json,
}

#[derive(Args)]
pub(crate) struct QueryArgs {
    /// The question, e.g. `select object, count(*) as n from rollouts group by object`
    pub(crate) sql: String,
    /// How to print
    #[arg(long, value_enum, default_value_t = QueryFormat::Table)]
    pub(crate) format: QueryFormat,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum QueryFormat {
    /// Aligned columns
    Table,
    /// Comma-separated values with a header
    Csv,
    /// One JSON object per line
    Json,
    /// A Parquet file on stdout
    Parquet,
}

#[derive(Args)]
pub(crate) struct InspectArgs {
    /// The artifact, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// One partition of it, e.g. an object's name
    pub(crate) partition: Option<String>,
    /// List what was skipped or filtered, with the reasons
    #[arg(long)]
    pub(crate) skipped: bool,
}

#[derive(Args)]
pub(crate) struct StagesArgs {
    /// Show the options of this kind
    pub(crate) kind: Option<String>,
}
