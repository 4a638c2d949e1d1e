//! `logged`: a whole stage in one file, as a lab would add it: hand-logged trials become the table
//! `trials`, one row per object.

use std::collections::BTreeMap;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Outcome, Output, Outputs, Scope, Stage, Sum, Unit,
};
use lake::WriteArtifact;
use options::options;
use schemas::executions::Outcome::{Failed, Succeeded};
use schemas::{Table, tally::Tally, trials::AllTrials, trials::Trials};

/// Options of `kind = "logged"`.
#[options]
pub(crate) struct LoggedConfig {
    /// Numbers of successes and of failures for each object.
    objects: BTreeMap<String, [i64; 2]>,
}

dataflow::metrics! {
    /// Metrics of the trials of an object.
    pub(crate) struct Count {
        /// Number of trials.
        trials_n: Sum,
    }
}

/// Takes trials that a person wrote down.
pub(crate) struct Logged;

impl Stage for Logged {
    type Config = LoggedConfig;

    const KIND: &'static str = "logged";
    const ABOUT: &'static str = "Takes trials that a person wrote down";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for Logged {
    type Stage = Self;
    type Metrics = Count;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = AllTrials::NAME;
    const SCHEMA: &'static str = AllTrials::VERSION;
    const PARTITION: &'static str = AllTrials::PARTITION;
    const LINE: Option<Line<Count>> =
        Some(|summary| format!("{} trials by hand", summary.metrics.trials_n));

    fn units(_config: &LoggedConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(vec![Unit::new("all")])
    }

    fn make(
        config: &LoggedConfig,
        _: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<Count>, BoxedDiagnostic> {
        let trials = config.objects.iter();
        let trials = trials.map(|(object, &[succeeded, failed])| Trials {
            object: object.clone(),
            cell: "bench".to_owned(),
            simulated: false,
            gap: String::new(),
            outcomes: Tally::from_iter([(Succeeded, succeeded), (Failed, failed)]),
        });
        let trials: AllTrials = trials.collect();
        cx.write(&trials)?;
        let trials_n = trials
            .iter()
            .map(|row| row.outcomes.total_count())
            .sum::<i64>() as f64;
        Ok(Outcome::Made(Count { trials_n }))
    }
}
