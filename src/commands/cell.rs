//! `pipeline cell`

use std::{fs, path::Path, thread, time::Duration};

use cell::{Keys, Report, Service, SimulatedCell, subscribe};
use dataflow::Stage;
use lake::{Lake, table};
use robot::RobotModel;
use schemas::objects;
use signal_hook::{
    consts::{SIGINT, SIGTERM},
    iterator::Signals,
};
use simulation::ObjectShape;
use stage_dispatch::{Dispatch, simulated_cell};

use crate::{
    arguments::CellArgs,
    command_line::Program,
    commands::pipeline_file,
    outcome::{Outcome, Trouble},
    progress::Quiet,
    report,
};

/// How long the cell gets to be reached by its own program.
const SOON: Duration = Duration::from_secs(10);

/// Serves a simulated robot cell until it is interrupted.
pub(crate) fn cell(program: &Program, args: &CellArgs) -> Result<Outcome, Trouble> {
    let pipeline = pipeline_file::read_with(program.kinds, &args.file, &args.values)?;
    let mut stages = pipeline.stages.iter();
    let stage = stages
        .find(|stage| stage.kind.name == Dispatch::KIND)
        .ok_or_else(|| {
            Trouble::usage(
                format!("`{}` has no stage of kind `dispatch`", args.file.display()),
                "name a pipeline file that dispatches, e.g. `pipelines/cgf.toml`",
            )
        })?;
    let mut config = simulated_cell(stage.config(), args.listen.clone())
        .map_err(|err| Trouble::failed(err, None))?;
    let journal = args.journal.clone();
    let journal = journal.unwrap_or_else(|| program.lake.join("cells").join(&config.name));
    config.service = Service {
        journal: Some(journal.clone()),
        real_time: !args.fast,
        ros2_domain: args.ros2_domain,
        faults: args.fault.clone(),
    };
    let name = config.name.clone();
    let urdf = fs::read_to_string(&args.hand).map_err(|err| {
        Trouble::usage(
            format!(
                "cannot read the hand's URDF `{}`: {err}",
                args.hand.display()
            ),
            "name the URDF of a robot hand with `--hand FILE`",
        )
    })?;
    RobotModel::from_urdf(&urdf).map_err(|err| {
        let hint = err.hint();
        Trouble::failed(err, hint)
    })?;
    // Before anything is served: whoever stops it may be quick.
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(|err| Trouble::failed(err, None))?;
    let served = SimulatedCell::start(config, &urdf).map_err(|err| {
        let hint = err.hint();
        Trouble::failed(err, hint)
    })?;
    let lake = program.lake.clone();
    served.find_objects(Box::new(move |object| find(&lake, object)));
    report::data(format!("{}\n", served.endpoint()).as_bytes());
    if program.quiet == Quiet::No {
        report::line(&format!(
            "cell   `{name}` at `{}`{}, what it has done is in `{}`; Ctrl-C ends it",
            served.endpoint(),
            if args.fast { "" } else { " in real time" },
            journal.display()
        ));
        tell(&served, &name)?;
    }
    signals.forever().next();
    served.stop();
    Ok(Outcome::Done)
}

/// Prints a line for each goal that is over.
fn tell(served: &SimulatedCell, name: &str) -> Result<(), Trouble> {
    let failed = |err: cell::CellError| {
        let hint = err.hint();
        Trouble::failed(err, hint)
    };
    let outcomes = Keys::new(name).map_err(failed)?.outcome("*");
    let (session, subscriber) = subscribe(served.endpoint(), &outcomes, SOON).map_err(failed)?;
    thread::spawn(move || {
        let _session = session;
        while let Ok(sample) = subscriber.recv() {
            if let Ok(over) = Report::from_bytes(&sample.payload().to_bytes()) {
                report::line(&format!(
                    "goal   {} {}: {}",
                    over.goal_id,
                    over.outcome.as_str(),
                    over.message
                ));
            }
        }
    });
    Ok(())
}

/// Looks for an object in the lake's newest table of them.
fn find(lake: &Path, name: &str) -> Option<ObjectShape> {
    let objects = Lake::open(lake).newest_partitions("objects").ok()?;
    let object = objects::from_batch(name, &table::read(objects.get(name)?).ok()?).ok()?;
    Some(ObjectShape::from_artifact(&object))
}
