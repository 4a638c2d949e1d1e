//! `steps`: many steps, each from the one before, resumable after an interrupt.

use std::{fs, io, path::Path};

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    OwnError,
    bytes::{self, Tally},
    hooks,
};

/// Adds up the numbers of steps.
pub(crate) struct Steps<const VERSION: u8>;

/// Options of `kind = "steps"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct StepsConfig {
    /// Number of steps.
    count: u64,
}

impl dataflow::Options for StepsConfig {}

/// Progress through the steps.
#[derive(Debug, Default, Deserialize, Serialize)]
struct State {
    done: u64,
    sum: u64,
}

impl State {
    /// Reads the progress of an earlier attempt.
    fn read(path: &Path) -> Result<Self, OwnError> {
        match fs::read(path) {
            Ok(bytes) => serde_json::from_slice(&bytes)
                .map_err(|err| OwnError::at(path)(io::Error::other(err))),
            Err(err) if err.kind() == io::ErrorKind::NotFound => Ok(Self::default()),
            Err(err) => Err(OwnError::at(path)(err)),
        }
    }
}

impl<const VERSION: u8> Stage for Steps<VERSION> {
    type Config = StepsConfig;

    const KIND: &'static str = "steps";
    const ABOUT: &'static str = "Adds up the numbers of steps";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const VERSION: u8> Output for Steps<VERSION> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "sum";
    const SCHEMA: &'static str = "sum/1";
    const PARTITION: &'static str = "of";
    const LINE: Option<Line<()>> = Some(|summary| format!("{} sum of steps", summary.n_made));

    fn units(_config: &StepsConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(vec![Unit::new("steps")])
    }

    fn make(
        config: &StepsConfig,
        _inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<()>, BoxedDiagnostic> {
        let path = cx.resume_folder().join("state.json");
        let mut state = State::read(&path)?;
        while state.done < config.count {
            let moment = format!("step{}", state.done);
            hooks::note::<Self>(&moment, cx)?;
            hooks::hold(&moment);
            hooks::fail(&moment)?;
            state.sum += state.done;
            state.done += 1;
            lake::write_atomic(&path, format!("{}", serde_json::json!(state)).as_bytes())?;
        }
        let tally = Tally {
            name: cx.partition().to_string(),
            bytes: state.done,
            sum: state.sum,
        };
        bytes::write_table(cx.folder(), &[tally])?;
        hooks::fail("end")?;
        Ok(Outcome::Made(()))
    }
}
