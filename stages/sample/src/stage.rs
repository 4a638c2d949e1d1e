//! The stage: the candidates of one object.

mod candidates;

use dataflow::{
    Code, Context, Form, Input, Inputs, Labels, OptionFault, Outcome, Output, Scope, Stage, Unit,
};
use schemas::{Table, candidates::Candidates};

use crate::{
    SampleConfig, SampleError,
    inputs::{FIELDS, read_hand},
};

/// Draws candidate motions from a grasping function.
pub enum Sample {}

/// The robot counts as recordings show it.
const SHOWN_ROBOT: Form = Form {
    name: "shown robot",
    of: robot::shown_form,
};
/// The artifact of an object's motions.
pub const CANDIDATES: &str = "candidates";
/// The artifact of a demonstration's motion.
pub const TRAJECTORIES: &str = "trajectories";

impl Stage for Sample {
    type Config = SampleConfig;
    type Error = SampleError;

    const KIND: &'static str = "sample";
    const ABOUT: &'static str = "Draws candidate motions for each object from a grasping function";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "checkpoint",
            artifact: "checkpoint",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
        Input {
            name: FIELDS,
            artifact: FIELDS,
        },
        Input {
            name: TRAJECTORIES,
            artifact: TRAJECTORIES,
        },
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: CANDIDATES,
        schema: Candidates::VERSION,
        partition: "object",
        parallel: true,
    }];

    fn check(config: &SampleConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the hand's URDF.
    fn prepare(config: &SampleConfig) -> Result<(), SampleError> {
        read_hand(&config.hand).map(drop)
    }

    fn units(
        config: &SampleConfig,
        _output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, SampleError> {
        candidates::units(config, scope)
    }

    fn foretell(
        _config: &SampleConfig,
        _output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        Some(labels(&unit.partition))
    }

    fn decides(option: &str, _output: &str) -> bool {
        option != "objects"
    }

    fn run(config: &SampleConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, SampleError> {
        candidates::make(config, inputs, cx)
    }
}

fn labels(object: &str) -> Labels {
    Labels::from([("object".to_owned(), object.to_owned())])
}
