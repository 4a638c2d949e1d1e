//! Arguments and their help.

use std::path::PathBuf;

use cell::{PlannedFault, PublicKey};
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use dataflow::{PartitionKey, Sweep};

use crate::outages::DepotDown;

/// Commands of every day, in the order of their use.
const DAILY: [&str; 8] = [
    "new", "run", "plan", "query", "inspect", "report", "export", "doctor",
];
/// The other commands, by what they are about.
const GROUPS: [(&str, &[&str]); 4] = [
    ("Runs", &["runs", "diff", "lineage", "tag", "attach"]),
    ("Stages", &["stages", "graph"]),
    ("Robot cell", &["calibrate", "cell", "router"]),
    ("Lake", &["verify", "gc", "push", "pull"]),
];

/// End of the help: options of every command, and a first command.
const LONG: &str = "
Options of every command:
  -q, --quiet       Print only errors
      --lake <DIR>  Folder that holds artifacts [default: data/lake]
  -h, --help        Print help: `-h` on one screen, `--help` everything
  -V, --version     Print the version

Not in the list: `untag` removes a tag, `unit` makes one partition, as `run --processes` does,
`completions` prints a script that completes commands in a shell.

Start here: pipeline new my_lab, then in my_lab: pipeline run pipelines/cgf.toml";

/// Learn dexterous grasps from human demonstrations
#[derive(Parser)]
#[command(
    version,
    override_usage = "pipeline [-q] [--lake DIR] COMMAND …; `pipeline COMMAND -h` says more",
    help_template = "{about}\nUsage: {usage}{after-help}"
)]
pub(crate) struct Cli {
    /// Print only errors
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    /// Folder that holds artifacts
    #[arg(long, global = true, value_name = "DIR", default_value = "data/lake")]
    pub(crate) lake: PathBuf,
    /// The folder of a run that was detached
    #[arg(long, hide = true, value_name = "DIR")]
    pub(crate) detached_in: Option<PathBuf>,
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Cli {
    /// Returns the command line with its help: the commands of every day, then the others by group, in `-h` by name.
    pub(crate) fn described() -> clap::Command {
        let command = Self::command();
        let describe = |names: &[&str]| {
            let lines = names.iter().map(|name| {
                let about = command
                    .find_subcommand(name)
                    .and_then(clap::Command::get_about);
                format!("  {name:<9} {}\n", about.cloned().unwrap_or_default())
            });
            lines.collect::<String>()
        };
        let daily = format!("Commands:\n{}", describe(&DAILY));
        let (mut short, mut long) = (format!("{daily}\n"), daily);
        for (group, names) in GROUPS {
            short += &format!("{group:<10} {}\n", names.join(", "));
            long += &format!("\n{group}:\n{}", describe(names));
        }
        command.after_help(short).after_long_help(long + LONG)
    }
}

#[derive(Subcommand)]
pub(crate) enum Command {
    /// Create a project with pipelines, hands, robots and the sample
    New(NewArgs),
    /// Run a pipeline, reusing every result that is still valid
    Run(RunArgs),
    /// Show a run that was started with `--detach`
    ///
    /// Its output so far and until it ends, with its exit code. Ctrl-C leaves it running.
    Attach(AttachArgs),
    /// Show what `run` would do, and why
    Plan(PlanArgs),
    /// Query the lake's tables in SQL
    Query(QueryArgs),
    /// Show an artifact: columns, rows, provenance, skipped items
    Inspect(InspectArgs),
    /// Make a page of a run, or of several side by side
    Report(ReportArgs),
    /// Write motions as files for other programs
    Export(ExportArgs),
    /// List runs with their dates, values and outcomes
    Runs(RunsArgs),
    /// Show what differs between two runs
    ///
    /// Values, inputs, code and metrics.
    Diff(DiffArgs),
    /// Trace an artifact to its inputs, or to the artifacts made from it
    Lineage(LineageArgs),
    /// Tag a run, which protects it from `gc`
    ///
    /// `pipeline untag NAME` removes the tag.
    Tag(TagArgs),
    /// Remove a tag
    #[command(hide = true)]
    Untag(UntagArgs),
    /// List the kinds of stages, their inputs, outputs and options
    Stages(StagesArgs),
    /// Draw a pipeline's stages with their inputs and outputs
    Graph(GraphArgs),
    /// Check that the lake, a pipeline's files and its cell are ready
    Doctor(DoctorArgs),
    /// Find a camera's pose relative to the robot, with its residual
    ///
    /// From points that the robot has touched, or from poses of its flange and of a board that the camera sees.
    Calibrate(CalibrateArgs),
    /// Serve a simulated robot cell until interrupted
    Cell(CellArgs),
    /// Forward messages between robot cells, dispatchers and viewers
    Router(RouterArgs),
    /// Check every byte of the lake against its digest
    Verify(VerifyArgs),
    /// Remove unreferenced artifacts
    Gc(GcArgs),
    /// Send results to the depot that machines share
    ///
    /// Sends the results of the lake's runs that the depot lacks. `run` sends new results by itself; this
    /// is for older ones, and for those of runs without a network. `PIPELINE_DEPOT` names the
    /// depot, e.g. `/mnt/lab/depot`.
    Push,
    /// Fetch files of the newest results from the depot
    ///
    /// `run` downloads what it needs; `pull` downloads the rest: recordings, meshes and weights.
    Pull(PullArgs),
    /// Make one partition of one output
    ///
    /// It is what `run --processes` starts, here or on another machine.
    #[command(hide = true)]
    Unit(UnitArgs),
    /// Print a script that completes commands in a shell
    #[command(hide = true)]
    Completions(CompletionsArgs),
}

#[derive(Args)]
pub(crate) struct NewArgs {
    /// The project's name, which is its folder's: ASCII letters, digits, `_` and `-`
    pub(crate) name: String,
}

/// A pipeline file, its values, and the stages to run.
#[derive(Args, Clone)]
pub(crate) struct PipelineArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// Stop after this stage [default: the last]
    #[arg(long, value_name = "STAGE")]
    pub(crate) until: Option<String>,
    /// Run only this stage [default: every stage]
    ///
    /// Its inputs must exist.
    #[arg(long, value_name = "STAGE", conflicts_with = "until")]
    pub(crate) only: Option<String>,
    /// Make a stage's results again [default: none]
    ///
    /// Even if they are in the lake; without a name, those of every stage. May be repeated.
    #[arg(long, value_name = "STAGE", num_args = 0..=1, default_missing_value = "")]
    pub(crate) fresh: Vec<String>,
}

/// Runs to report, and the page to write.
#[derive(Args)]
pub(crate) struct ReportArgs {
    /// Runs by number, tag, `newest` or `newest~1`; several are compared [default: newest]
    pub(crate) runs: Vec<String>,
    /// Folder for the page and its tables
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub(crate) out: PathBuf,
    /// File or URDF of the robot hand, with its meshes [default: that of the recordings, without meshes]
    #[arg(long, value_name = "FILE")]
    pub(crate) hand: Option<PathBuf>,
    /// Motions of the first run to look at
    #[arg(long, value_name = "N", default_value_t = 48)]
    pub(crate) motions: usize,
}

/// Format of an export.
#[derive(Args)]
pub(crate) struct ExportArgs {
    #[command(subcommand)]
    pub(crate) format: ExportFormat,
}

/// The format of exported motions.
#[derive(Subcommand)]
pub(crate) enum ExportFormat {
    /// Write glTF 2.0 for Blender, browsers and viewers, one animation
    #[command(after_help = GLB_LOSES)]
    Glb(GlbArgs),
    /// Write a LeRobot dataset, v3.0: states and actions at a uniform rate
    #[command(after_help = LEROBOT_LOSES)]
    Lerobot(LerobotArgs),
    /// Write grasps and objects for DexGraspBench's evaluator
    #[command(after_help = DEXGRASPBENCH_LOSES)]
    Dexgraspbench(DexgraspbenchArgs),
    /// Write one table with a row per step, as comma-separated values
    #[command(after_help = CSV_LOSES)]
    Csv(MotionsArgs),
}

const GLB_LOSES: &str = "\
Lost: names and values of measurements, joint limits, masses, and times between keyframes
to 0.1 mm.";
const LEROBOT_LOSES: &str = "\
Lost: motion between samples, digits beyond 32 bits, rates, contacts, forces, latent codes,
metrics, shapes, images. The export prints how much.";
const DEXGRASPBENCH_LOSES: &str = "\
Lost: the reach but for pregrasp, grasp and squeeze; times, rates, contacts, metrics, outcomes;
true masses; the hand's limits and shapes, of which the evaluator has its own.";
const CSV_LOSES: &str = "\
Lost: rates, contacts, forces, latent codes, metrics, shapes.";

/// Motions to export, and the folder to write.
#[derive(Args)]
pub(crate) struct MotionsArgs {
    /// The artifact: candidates, trajectories, rollouts or executions, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// Its partitions, e.g. objects' names [default: all]
    pub(crate) partitions: Vec<String>,
    /// Folder to write, which must not exist
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// The run [default: the newest]
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
    /// Only motions with this outcome [default: all]
    ///
    /// Of rollouts the `reason`, e.g. `held`; of executions the `outcome`, e.g. `succeeded`.
    #[arg(long, value_name = "OUTCOME")]
    pub(crate) outcome: Option<String>,
    /// File or URDF of the robot hand [default: that of the run's screen]
    #[arg(long, value_name = "FILE")]
    pub(crate) hand: Option<PathBuf>,
}

/// Motions to export, and their rate.
#[derive(Args)]
pub(crate) struct LerobotArgs {
    #[command(flatten)]
    pub(crate) motions: MotionsArgs,
    /// Frames per second (Hz)
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) fps: u32,
}

/// Motions to export, and the times of their grasps.
#[derive(Args)]
pub(crate) struct DexgraspbenchArgs {
    #[command(flatten)]
    pub(crate) motions: MotionsArgs,
    /// Time of the pregrasp, as a fraction of the motion's duration
    #[arg(long, value_name = "FRACTION", default_value_t = 0.75)]
    pub(crate) pregrasp_at: f64,
    /// Time of the grasp, as a fraction of the motion's duration
    ///
    /// The squeeze is the end: of refined motions the last tenth. Without a squeeze, 1.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.9)]
    pub(crate) grasp_at: f64,
    /// Folder of objects that the grasps name [default: `objects` in the folder that is written]
    #[arg(long, value_name = "DIR")]
    pub(crate) objects_at: Option<String>,
}

/// Motion to export, and the file to write.
#[derive(Args)]
pub(crate) struct GlbArgs {
    /// The artifact: candidates, trajectories, rollouts or executions, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// The motion: its candidate or sequence, e.g. `025_mug-00000`
    pub(crate) name: String,
    /// The run [default: the newest]
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
    /// File to write [default: the motion's name and `.glb`]
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// File or URDF of the robot hand
    ///
    /// For candidates, and for the meshes that a recording lacks. [default: that of the recording]
    #[arg(long, value_name = "FILE")]
    pub(crate) hand: Option<PathBuf>,
}

/// Measurements of a camera beside a robot or on it.
#[derive(Args)]
#[command(after_help = CALIBRATION_FILES)]
pub(crate) struct CalibrateArgs {
    /// File of measurements, e.g. `touched.json`
    pub(crate) file: PathBuf,
    /// Largest residual, RMS in mm; with more the command fails
    ///
    /// The result is printed all the same.
    #[arg(long, value_name = "MM", default_value_t = 5.0, value_parser = millimeters)]
    pub(crate) max_error_mm: f64,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

const CALIBRATION_FILES: &str = "\
The file, of a camera that stands still (`fixed`) or is on the flange (`wrist`):
  {\"points\": [{\"in_base_m\": [x, y, z], \"in_camera_m\": [x, y, z]}, …]}
  {\"camera\": \"fixed\" or \"wrist\", \"poses\": [
    {\"base_from_flange\": POSE, \"camera_from_board\": POSE}, …]}
  POSE is {\"position_m\": [x, y, z], \"quaternion_xyzw\": [x, y, z, w]}
  or {\"matrix\": four rows of four numbers}";

/// Reads a length in millimeters.
fn millimeters(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let length = number.filter(|it: &f64| it.is_finite() && *it > 0.0);
    length.ok_or_else(|| "it is no length in millimeters".to_owned())
}

/// Simulated cell to serve, and its connections.
#[derive(Args)]
pub(crate) struct CellArgs {
    /// Pipeline file
    ///
    /// Its `dispatch` describes the simulated cell.
    #[arg(default_value = "pipelines/cgf.toml")]
    pub(crate) file: PathBuf,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// File or URDF of the robot hand [default: that of the stage]
    #[arg(long, value_name = "FILE")]
    pub(crate) hand: Option<PathBuf>,
    /// Endpoint to listen on
    ///
    /// `tcp/HOST:PORT` on the loopback interface, or `tls/HOST:PORT` with `--access`; port 0 takes any
    /// free one, which is printed.
    #[arg(
        long,
        value_name = "ENDPOINT",
        default_value = "tcp/127.0.0.1:7447",
        conflicts_with = "connect"
    )]
    pub(crate) listen: String,
    /// Router to connect to [default: the cell listens]
    ///
    /// The cell reconnects after losing it.
    #[arg(long, value_name = "ENDPOINT")]
    pub(crate) connect: Option<String>,
    /// Certificates or password [default: loopback only]
    ///
    /// A file with the cell's certificates or password, and, where it listens, whom it trusts and
    /// who may do what; see `data/access`. Without one it is reached on the loopback interface alone.
    #[arg(long, value_name = "FILE")]
    pub(crate) access: Option<PathBuf>,
    /// Dispatcher whose goals are taken [default: any]
    ///
    /// Its public key; that of a lake is in `effects/dispatch/key.pub` once it has asked a cell. Goals that another
    /// key signed are refused. May be repeated.
    #[arg(long, value_name = "KEY")]
    pub(crate) dispatcher: Vec<PublicKey>,
    /// Journal folder [default: LAKE/cells/NAME]
    ///
    /// The folder in which the cell records the goals that it has answered.
    #[arg(long, value_name = "DIR")]
    pub(crate) journal: Option<PathBuf>,
    /// Simulate as fast as possible
    ///
    /// Faster than real time, without a heartbeat.
    #[arg(long)]
    pub(crate) fast: bool,
    /// ROS 2 domain that sees the joints [default: none]
    ///
    /// As `/joint_states` and `/joint_trajectory` under the keys of `rmw_zenoh`.
    #[arg(long, value_name = "DOMAIN")]
    pub(crate) ros2_domain: Option<u32>,
    /// Inject a fault [default: none]
    ///
    /// To try a dispatcher: e.g. `die_after_answer@2`, at the second goal. May be repeated.
    #[arg(long, value_name = "FAULT")]
    pub(crate) fault: Vec<PlannedFault>,
}

/// Endpoint and access rules of a router.
#[derive(Args)]
pub(crate) struct RouterArgs {
    /// Endpoint to listen on
    ///
    /// `tcp/HOST:PORT` on the loopback interface, or `tls/HOST:PORT` with `--access`; port 0 takes any
    /// free one, which is printed.
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7447")]
    pub(crate) listen: String,
    /// Certificates and rules [default: loopback only]
    ///
    /// A file with the router's certificate, whom it trusts and who may do what, which
    /// `zenohd --config` reads as well; see `data/access`. Without one it is reached on the loopback
    /// interface alone.
    #[arg(long, visible_alias = "config", value_name = "FILE")]
    pub(crate) access: Option<PathBuf>,
}

/// Values that replace those of a pipeline file.
#[derive(Args, Clone, Default)]
pub(crate) struct ValueArgs {
    /// Values of this profile [default: the file's]
    ///
    /// A table under `profiles` in the file.
    #[arg(long, value_name = "NAME")]
    pub(crate) profile: Option<String>,
    /// Replace a value [default: the file's]
    ///
    /// E.g. `ingest.root=/data/dexycb`. May be repeated. `run` and `plan` take several values, e.g.
    /// `train.training.kl_weight=1e-3,1e-2`, and go through every variant; text with a comma in it is
    /// put in double quotes.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) overrides: Vec<Sweep>,
}

#[derive(Args, Clone)]
#[expect(clippy::struct_excessive_bools, reason = "each is a flag of its own")]
pub(crate) struct RunArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// Number of worker threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) jobs: Option<u16>,
    /// Make units in processes of their own
    ///
    /// Instead of a thread: `pipeline unit`.
    #[arg(long)]
    pub(crate) processes: bool,
    /// Make units on other machines [default: on this one]
    ///
    /// `slurm`, or an executor of the file that `PIPELINE_EXECUTORS` names; `crates/engine/depot` has examples. Short
    /// units, and stages that move a robot, stay here.
    #[arg(long, value_name = "NAME", conflicts_with = "processes")]
    pub(crate) on: Option<String>,
    /// Wait, fail or go on alone if the depot is down [default: wait]
    ///
    /// `fail` waits half a minute, `alone` 5 s. Without the depot results of other machines are not found, and would be made again.
    #[arg(long, value_name = "WHAT", value_enum, default_value_t = DepotDown::Wait, hide_default_value = true, hide_possible_values = true)]
    pub(crate) depot_down: DepotDown,
    /// Longest wait for the depot, in minutes [default: 480]
    ///
    /// A night: a disk that is full at three is freed in the morning.
    #[arg(long, value_name = "MIN", value_parser = minutes, hide_short_help = true)]
    pub(crate) depot_patience_min: Option<f64>,
    /// Run in the background, until it is done
    ///
    /// A terminal that closes does not stop it; `pipeline attach` shows it.
    #[arg(long, conflicts_with = "dry_run")]
    pub(crate) detach: bool,
    /// Show what would run, as `plan` does
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Let `dispatch` move a robot that is not simulated
    ///
    /// Without this it sends nothing to one.
    #[arg(long)]
    pub(crate) execute: bool,
    /// Output format
    ///
    /// `json` writes each event of the run to stdout, one JSON object per line.
    #[arg(long, value_enum, default_value_t = Format::Text, hide_short_help = true)]
    pub(crate) format: Format,
}

/// Reads a number of minutes.
fn minutes(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let time = number.filter(|it: &f64| it.is_finite() && *it >= 0.0);
    time.ok_or_else(|| "it is no number of minutes".to_owned())
}

#[derive(Args)]
pub(crate) struct AttachArgs {
    /// Number that `run --detach` printed [default: the newest]
    pub(crate) number: Option<u32>,
}

#[derive(Args, Clone)]
pub(crate) struct PlanArgs {
    #[command(flatten)]
    pub(crate) pipeline: PipelineArgs,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct QueryArgs {
    /// SQL query, e.g. `select * from objects`
    // A query may begin with a comment, `--`.
    #[arg(allow_hyphen_values = true)]
    pub(crate) sql: String,
    /// Output format
    #[arg(long, value_enum, default_value_t = QueryFormat::Table)]
    pub(crate) format: QueryFormat,
    /// Tables of this run [default: the newest]
    ///
    /// Without it: each table of the newest run that made it.
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
    /// Tables of all machines that share the depot
    ///
    /// Only the tables that the query names are fetched. A run is named `MACHINE:NUMBER-DIGITS`.
    #[arg(long, conflicts_with = "run")]
    pub(crate) depot: bool,
    /// Let the query read this file, or what is below this folder [default: the lake alone]
    ///
    /// `read_parquet('PATH')` and `read_csv('PATH')` are tables in a query. May be given more than once.
    #[arg(long, value_name = "PATH")]
    pub(crate) allow_files: Vec<PathBuf>,
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
    /// One partition, e.g. an object's name [default: all, in short]
    pub(crate) partition: Option<String>,
    /// List what was skipped or filtered, with the reasons
    #[arg(long)]
    pub(crate) skipped: bool,
    /// The run: its number or tag, `newest~1`, … [default: newest]
    ///
    /// `newest~1` is the one before the newest.
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
    /// List only the newest N [default: all]
    #[arg(long, value_name = "N")]
    pub(crate) last: Option<usize>,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct DiffArgs {
    /// The run before: its number, a tag, `newest`, `newest~1`, …
    ///
    /// `newest~1` is the one before the newest.
    pub(crate) old: String,
    /// The run after
    #[arg(default_value = "newest")]
    pub(crate) new: String,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct LineageArgs {
    /// The artifact, e.g. `screen.rollouts`
    pub(crate) artifact: String,
    /// One partition, e.g. an object's name [default: all, in short]
    ///
    /// Without one: how outputs depend on each other.
    pub(crate) partition: Option<String>,
    /// Show the artifacts made from it
    #[arg(long)]
    pub(crate) down: bool,
    /// The run: its number or tag, `newest~1`, … [default: newest]
    ///
    /// `newest~1` is the one before the newest.
    #[arg(long, value_name = "RUN")]
    pub(crate) run: Option<String>,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct TagArgs {
    /// The run: its number, a tag, `newest`, `newest~1`, …
    pub(crate) run: String,
    /// The name, e.g. `best`; it moves here if another run has it
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
    /// Output format
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
    /// Also test this executor: start a worker there that makes nothing [default: none]
    #[arg(long, value_name = "NAME")]
    pub(crate) on: Option<String>,
    /// Check this robot [default: check the pipeline file]
    ///
    /// The contents of its URDF, the unphysical values in it, and a first proposal of the hand's file.
    #[arg(long, value_name = "URDF", conflicts_with_all = ["file", "profile", "overrides"])]
    pub(crate) robot: Option<PathBuf>,
}

#[derive(Args)]
pub(crate) struct CompletionsArgs {
    /// The shell
    ///
    /// E.g. `pipeline completions bash > ~/.local/share/bash-completion/completions/pipeline`.
    pub(crate) shell: Shell,
}

/// Outputs to fetch.
#[derive(Args)]
pub(crate) struct PullArgs {
    /// Outputs to fetch, e.g. `train.checkpoint` [default: all]
    pub(crate) artifacts: Vec<String>,
}

#[derive(Args)]
pub(crate) struct VerifyArgs {
    /// Check also the input files of the lake's runs
    ///
    /// Rehashes them; the next run rereads those that changed.
    #[arg(long)]
    pub(crate) inputs: bool,
    /// Check the depot instead of the lake
    ///
    /// Every byte in it, and that no file is missing.
    #[arg(long, conflicts_with = "inputs")]
    pub(crate) depot: bool,
    /// Delete damaged artifacts; the next run makes them again
    #[arg(long)]
    pub(crate) drop: bool,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct GcArgs {
    /// Pipeline files to keep [default: those of the lake's runs]
    ///
    /// Everything that they use now stays.
    pub(crate) files: Vec<PathBuf>,
    /// Finished runs of each pipeline to keep, the newest
    ///
    /// Tagged runs of the lake are always kept; a depot has no tags.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) keep: u16,
    /// Clean the depot instead of the lake
    ///
    /// The newest runs of each pipeline on each machine are kept, and everything younger than a week.
    #[arg(long, conflicts_with = "files")]
    pub(crate) depot: bool,
    /// List what would be removed, and remove nothing
    #[arg(long)]
    pub(crate) dry_run: bool,
    /// Output format
    #[arg(long, value_enum, default_value_t = Format::Text)]
    pub(crate) format: Format,
}

#[derive(Args)]
pub(crate) struct UnitArgs {
    /// Pipeline file, e.g. `pipelines/cgf.toml`
    #[arg(required_unless_present = "order")]
    pub(crate) file: Option<PathBuf>,
    /// The output, e.g. `screen.rollouts`
    #[arg(required_unless_present = "order")]
    pub(crate) artifact: Option<String>,
    /// The partition, e.g. an object's name
    #[arg(required_unless_present = "order")]
    pub(crate) partition: Option<PartitionKey>,
    #[command(flatten)]
    pub(crate) values: ValueArgs,
    /// Make it even if its result is in the lake
    #[arg(long)]
    pub(crate) fresh: bool,
    /// Make the work items that a run sends, and write events to stdout
    ///
    /// `-` reads work items from stdin, and stops when stdin closes; any other name is that of a job
    /// in the depot, whose work items are made one after the other.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["file", "fresh"])]
    pub(crate) order: Option<String>,
    /// Use a lake of its own in this folder, which is removed at the end [default: that of `--lake`]
    #[arg(long, value_name = "DIR", requires = "order")]
    pub(crate) scratch: Option<PathBuf>,
    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) jobs: Option<u16>,
}
