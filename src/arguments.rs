//! Arguments and their help.

use std::path::PathBuf;

use cell::PlannedFault;
use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use dataflow::Sweep;

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
    /// List what was run: when, with which values, how it ended
    Runs(RunsArgs),
    /// Show what differs between two runs: values, inputs, code and figures
    Diff(DiffArgs),
    /// Show what an artifact was made of, or what was made of it
    Lineage(LineageArgs),
    /// Name a run, which keeps it
    Tag(TagArgs),
    /// Take a name away from its run
    Untag(UntagArgs),
    /// List the kinds of stages, their inputs, outputs and options
    Stages(StagesArgs),
    /// Draw what a pipeline's stages read and make
    Graph(GraphArgs),
    /// Check that the lake, what a pipeline file names and the robot cell are ready
    Doctor(DoctorArgs),
    /// Serve a simulated robot cell until it is interrupted
    Cell(CellArgs),
    /// Forward between robot cells, dispatchers and those who watch, until it is interrupted
    Router(RouterArgs),
    /// Check every byte of the lake against what was stored
    Verify(VerifyArgs),
    /// Remove what no run that counts, and no pipeline file, refers to any more
    Gc(GcArgs),
    /// Make one partition of one output: what `run --processes` starts, here or on another machine
    Unit(UnitArgs),
    /// Print a script that completes commands and options in a shell
    Completions(CompletionsArgs),
}

/// Which pipeline, with which values.
#[derive(Args, Clone)]
pub(crate) struct PipelineArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// Stop after this stage [default: the last one]
    #[arg(long, value_name = "STAGE")]
    pub(crate) until: Option<String>,
    /// Go through this stage alone; what it reads must have been made [default: every stage]
    #[arg(long, value_name = "STAGE", conflicts_with = "until")]
    pub(crate) only: Option<String>,
    /// Run this stage even if its results are in the lake; without a name, every stage; may be
    /// repeated [default: none]
    #[arg(long, value_name = "STAGE", num_args = 0..=1, default_missing_value = "")]
    pub(crate) fresh: Vec<String>,
}

/// Which cell, and how it serves.
#[derive(Args)]
pub(crate) struct CellArgs {
    /// Pipeline file whose `dispatch` says what the simulated cell is like
    #[arg(default_value = "pipelines/cgf.toml")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// URDF of the robot hand
    #[arg(
        long,
        value_name = "FILE",
        default_value = "data/robots/allegro_right.urdf"
    )]
    pub(crate) hand: PathBuf,
    /// Where to listen: `tcp/HOST:PORT` on the loopback interface, or `tls/HOST:PORT` with `--access`;
    /// port 0 takes any free one, which is printed
    #[arg(
        long,
        value_name = "ENDPOINT",
        default_value = "tcp/127.0.0.1:7447",
        conflicts_with = "connect"
    )]
    pub(crate) listen: String,
    /// Router to connect to instead of listening; when it is lost the cell comes back by itself
    /// [default: the cell listens]
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Option<String>,
    /// File with the cell's certificates or password, and where it listens with whom it trusts and
    /// who may do what; see `data/access` [default: none, on the loopback interface alone]
    #[arg(long, value_name = "FILE")]
    pub(crate) access: Option<PathBuf>,
    /// Folder in which the cell keeps what it has done [default: cells/NAME in the lake]
    #[arg(long, value_name = "DIR")]
    pub(crate) journal: Option<PathBuf>,
    /// Simulate as fast as possible, without a heartbeat [default: motions take as long as they say]
    #[arg(long)]
    pub(crate) fast: bool,
    /// Show the joints to ROS 2 in this domain, as `/joint_states` and `/joint_trajectory` under the
    /// keys of `rmw_zenoh` [default: not]
    #[arg(long, value_name = "DOMAIN")]
    pub(crate) ros2_domain: Option<u32>,
    /// Let something go wrong, to try a dispatcher: e.g. `die_after_answer@2`, at the second goal;
    /// may be repeated [default: nothing]
    #[arg(long, value_name = "FAULT")]
    pub(crate) fault: Vec<PlannedFault>,
}

/// Where to forward, and for whom.
#[derive(Args)]
pub(crate) struct RouterArgs {
    /// Where to listen: `tcp/HOST:PORT` on the loopback interface, or `tls/HOST:PORT` with `--access`;
    /// port 0 takes any free one, which is printed
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub(crate) listen: String,
    /// File with the router's certificate, whom it trusts and who may do what, which `zenohd --config`
    /// reads as well; see `data/access` [default: none, on the loopback interface alone]
    #[arg(long, visible_alias = "config", value_name = "FILE")]
    pub(crate) access: Option<PathBuf>,
}

/// Values that replace those of a pipeline file.
#[derive(Args, Clone, Default)]
pub(crate) struct ValueArgs {
    /// Take the values of this table under `profiles` in the file [default: the file's own values]
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Replace one value, e.g. `ingest.root=/data/dexycb`; may be repeated. `run` and `plan` take
    /// several, e.g. `train.training.kl_weight=1e-3,1e-2`, and go through every variant; text with
    /// a comma in it is put in double quotes [default: the file's own values]
    #[arg(long = "set", value_name = "STAGE.KEY=VALUE")]
    pub(crate) overrides: Vec<Sweep>,
}

#[derive(Args, Clone)]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// Number of worker threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) jobs: Option<u16>,
    /// Make each unit in a process of its own instead of a thread: `pipeline unit`
    #[arg(long)]
    pub(crate) processes: bool,
    /// Show what would run, as `plan` does, and run nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Let `dispatch` move a robot that is not simulated; without this it sends nothing to one
    #[arg(long)]
    pub(crate) execute: bool,
}

#[derive(Args, Clone)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct QueryArgs {
    /// The question, e.g. `select object, count(*) as n from rollouts group by object`
    pub(crate) sql: String,
    /// How to print
    #[arg(long, value_enum, default_value_t = QueryFormat::Table)]
    pub(crate) format: QueryFormat,
    /// Give the tables as this run had them [default: each as the newest run that made it]
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum QueryFormat {
    /// Aligned columns, cut to fit a terminal
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
    /// One partition of it, e.g. an object's name [default: an overview of all]
    pub(crate) partition: Option<String>,
    /// List what was skipped or filtered, with the reasons
    #[arg(long)]
    pub(crate) skipped: bool,
    /// The run: its number, a tag, `newest`, or `newest~1` for the one before [default: newest]
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// For people; long lists are cut
    Text,
    /// Everything, for programs
    Json,
}

#[derive(Args)]
pub(crate) struct RunsArgs {
    /// List only runs of this pipeline [default: of all]
    #[arg(long, value_name = "NAME")]
    pub(crate) pipeline: Option<String>,
    /// List only so many, the newest [default: all]
    #[arg(long, value_name = "N")]
    pub(crate) last: Option<usize>,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct DiffArgs {
    /// The run before: its number, a tag, `newest`, or `newest~1` for the one before the newest
    pub(crate) old: String,
    /// The run after
    #[arg(default_value = "newest")]
    pub(crate) new: String,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct LineageArgs {
    /// The artifact, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// One partition of it, e.g. an object's name [default: how outputs depend on each other]
    pub(crate) partition: Option<String>,
    /// Show what was made of it instead of what it was made of
    #[arg(long)]
    pub(crate) down: bool,
    /// The run: its number, a tag, `newest`, or `newest~1` for the one before [default: newest]
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct TagArgs {
    /// The run: its number, a tag, `newest`, or `newest~1` for the one before
    pub(crate) run: String,
    /// The name, e.g. `best`; a run that has it already loses it
    pub(crate) name: String,
}

#[derive(Args)]
pub(crate) struct UntagArgs {
    /// The name
    pub(crate) name: String,
}

#[derive(Args)]
pub(crate) struct StagesArgs {
    /// Show the options of this kind [default: a list of the kinds]
    pub(crate) kind: Option<String>,
}

#[derive(Args)]
pub(crate) struct GraphArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// How to print
    #[arg(long, value_enum, default_value_t = GraphFormat::Text)]
    pub(crate) format: GraphFormat,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum GraphFormat {
    /// A list of the stages, each below what it reads
    Text,
    /// Graphviz, e.g. for `dot -Tsvg`
    Dot,
    /// Mermaid, e.g. for a Markdown page
    Mermaid,
}

#[derive(Args)]
pub(crate) struct DoctorArgs {
    /// Pipeline file
    #[arg(default_value = "pipelines/cgf.toml")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// Check this robot instead: what its URDF describes, what is unphysical in it, and a first
    /// proposal of a hand's table [default: the pipeline file is checked]
    #[arg(long, value_name = "URDF", conflicts_with_all = ["file", "profile", "overrides"])]
    pub(crate) robot: Option<PathBuf>,
}

#[derive(Args)]
pub(crate) struct CompletionsArgs {
    /// The shell, e.g. `bash`: `pipeline completions bash > ~/.local/share/bash-completion/completions/pipeline`
    pub(crate) shell: Shell,
}

#[derive(Args)]
pub(crate) struct VerifyArgs {
    /// Check also the files outside the lake that it has read: finds those that were changed behind
    /// an unchanged size, time and inode, and has them read again
    #[arg(long)]
    pub(crate) inputs: bool,
    /// Drop what is damaged, so that the next run makes it again
    #[arg(long)]
    pub(crate) drop: bool,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct GcArgs {
    /// Pipeline files of which everything stays that they use now [default: those of the lake's runs]
    pub(crate) files: Vec<PathBuf>,
    /// Number of finished runs of each pipeline, the newest, of which everything stays; of tagged
    /// runs it always does
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) keep: u16,
    /// Say what would go and how many bytes that is, and remove nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct UnitArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    pub(crate) file: PathBuf,
    /// The output, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// The partition, e.g. an object's name
    pub(crate) partition: String,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// Make it even if its result is in the lake
    #[arg(long)]
    pub(crate) fresh: bool,
    /// How to print
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
    /// Stop as soon as stdin closes, as it does when the process that started this one ends
    #[arg(long)]
    pub(crate) with_parent: bool,
}
