//! `pipeline cell`

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use cell::{Access, CellError, ServiceConfig, SimulatedCell};
use dataflow::{BoxedDiagnostic, Diagnostic, Pipeline, missing};
use lake::{Lake, table};
use robot::{RobotError, RobotModel};
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    iterator::Signals,
};
use simulation::ObjectShape;
use stage_dispatch::{Dispatch, DispatchConfig, simulated_cell};

use crate::{
    arguments::CellArgs,
    command_line::Program,
    commands::{
        pipeline_file,
        router::{warn_of_nameless, warn_of_stale},
    },
    label::Label,
    outcome::{CommandError, CommandOutcome},
    progress::Quiet,
    report,
};

/// Interval at which the router's connection is checked.
const LOOK: Duration = Duration::from_millis(200);

/// Warning for a cell without an access file.
const UNGUARDED: &str =
    "without TLS there is no authentication: any program on this machine can drive the robot";

/// Serves a simulated robot cell until it is interrupted.
pub(crate) fn cell(program: &Program, args: &CellArgs) -> Result<CommandOutcome, CommandError> {
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let options = dispatch_options(&pipeline, &args.file)?;
    let config = simulated_cell(options, args.listen.clone());
    let mut config = config.map_err(CommandError::with_hint(BoxedDiagnostic::hint))?;
    let journal = args.journal.clone();
    let journal = journal.unwrap_or_else(|| program.lake.join("cells").join(&config.name));
    config.service = ServiceConfig {
        journal: Some(journal.clone()),
        real_time: !args.fast,
        silence: None,
        ros2_domain: args.ros2_domain,
        router: args.connect.clone(),
        access: args.access.clone(),
        dispatchers: args.dispatcher.clone(),
        faults: args.fault.clone(),
    };
    let name = config.name.clone();
    let path = args.hand.as_ref().unwrap_or(&options.hand);
    let path = &hand_files::urdf_of(path).map_err(CommandError::with_hint(Diagnostic::hint))?;
    let (urdf, hand) = read_hand(path)?;
    // Before anything is served, so that an early signal is handled too.
    let mut signals =
        Signals::new([SIGINT, SIGTERM]).map_err(|err| CommandError::failed(err, None))?;
    let served = SimulatedCell::start_with(config, &urdf, hand);
    let served = served.map_err(CommandError::with_hint(CellError::hint))?;
    serve_objects(&served, program.lake.clone());
    if program.quiet == Quiet::No {
        served.on_outcome(Box::new(|over| {
            report::line(
                Label::Goal,
                format!(
                    "{} {}: {}",
                    over.goal_id,
                    over.outcome.as_str(),
                    over.message
                ),
            );
        }));
    }
    report::data(format!("{}\n", served.endpoint()).as_bytes())?;
    program.say(
        Label::Cell,
        format!(
            "`{name}` at `{}`{}, what it has done is in `{}`; Ctrl-C ends it",
            served.endpoint(),
            if args.fast { "" } else { " in real time" },
            journal.display()
        ),
    );
    warn_of_access(program, args)?;
    let ended = AtomicBool::new(false);
    let router = args
        .connect
        .as_deref()
        .filter(|_| program.quiet == Quiet::No);
    thread::scope(|scope| {
        if let Some(router) = router {
            scope.spawn(|| watch(&served, router, &ended));
        }
        signals.forever().next();
        ended.store(true, Ordering::Relaxed);
    });
    served.stop();
    Ok(CommandOutcome::Done)
}

/// Returns the options of the pipeline's first stage that dispatches.
fn dispatch_options<'a>(
    pipeline: &'a Pipeline,
    file: &Path,
) -> Result<&'a DispatchConfig, CommandError> {
    let mut stages = pipeline.stages.iter();
    stages
        .find_map(|stage| stage.options::<Dispatch>())
        .ok_or_else(|| {
            CommandError::usage(
                format!("`{}` has no stage of kind `dispatch`", file.display()),
                "name a pipeline file that dispatches, e.g. `pipelines/cgf.toml`",
            )
        })
}

/// Reads a hand's URDF, and the hand that it describes with the shapes of its meshes.
fn read_hand(path: &Path) -> Result<(String, RobotModel), CommandError> {
    let urdf = fs::read_to_string(path).map_err(|err| {
        CommandError::usage(
            format!("cannot read the hand's URDF `{}`: {err}", path.display()),
            format!(
                "name the URDF of a robot hand with `--hand FILE`; {}",
                missing(path)
            ),
        )
    })?;
    let hand = RobotModel::from_urdf(&urdf);
    let hand = hand.map_err(CommandError::with_hint(RobotError::hint))?;
    let hand = robot_meshes::with_mesh_shapes(hand, path);
    let hand = hand.map_err(CommandError::with_hint(Diagnostic::hint))?;
    Ok((urdf, hand))
}

/// Lets the cell find objects in a lake.
fn serve_objects(served: &SimulatedCell, lake: PathBuf) {
    // Reported once per object: a dispatcher may request it repeatedly.
    let told = Mutex::new(BTreeSet::new());
    served.find_objects(Box::new(move |object| {
        find(&lake, object).inspect_err(|why| {
            let mut told = told.lock().unwrap_or_else(PoisonError::into_inner);
            if told.insert(object.to_owned()) {
                report::line(Label::Object, format!("`{object}`: {why}"));
            }
        })
    }));
}

/// Warns where programs other than the dispatchers that are meant may drive the robot.
fn warn_of_access(program: &Program, args: &CellArgs) -> Result<(), CommandError> {
    match &args.access {
        None => program.say_plain(UNGUARDED),
        Some(access) => {
            let access = Access::read(access).map_err(CommandError::with_hint(CellError::hint))?;
            if args.connect.is_none() {
                warn_of_stale(&access);
            } else {
                warn_of_nameless(&access);
            }
        }
    }
    Ok(())
}

/// Reports when the router is lost and when it is back.
fn watch(served: &SimulatedCell, router: &str, ended: &AtomicBool) {
    let mut was = served.router();
    while !ended.load(Ordering::Relaxed) {
        let is = served.router();
        match (&was, &is) {
            (Some(_), None) => report::line(
                Label::Router,
                format!("`{router}` is lost; the cell comes back when it is there again"),
            ),
            (None, Some(_)) => report::line(Label::Router, format!("`{router}` is there again")),
            (Some(old), Some(new)) if old != new => report::line(
                Label::Router,
                format!("`{router}` was lost for a moment and is there again"),
            ),
            _ => {}
        }
        was = is;
        thread::park_timeout(LOOK);
    }
}

/// Looks for an object in the lake's newest table of them.
fn find(lake: &Path, name: &str) -> Result<Option<ObjectShape>, String> {
    let said = |err: anyhow::Error| {
        format!(
            "cannot look for it in the lake `{}`: {}",
            lake.display(),
            report::chain(&err)
        )
    };
    let objects = Lake::open(lake).newest_partitions("objects", None);
    let objects = objects.map_err(|err| said(err.into()))?;
    let Some(artifact) = objects.get(name) else {
        return Ok(None);
    };
    let object = table::read(artifact).map_err(|err| said(err.into()))?;
    Ok(Some(ObjectShape::from_artifact(&object)))
}
