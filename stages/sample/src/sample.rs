//! The stage: the candidates of one object.

mod candidates;

use dataflow::{
    BoxedDiagnostic, Context, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum, Unit,
};
use lake::SiblingTable;
use schemas::{
    Table, candidates::Candidates, checkpoint, distance_fields::FieldInfo, draws::Draws,
    objects::Object, trajectories::Trajectory,
};

use crate::SampleConfig;
use candidates::SampleInputs;

pub use candidates::Drawing;

/// Draws candidate motions from a grasping function.
pub struct Sample;

dataflow::metrics! {
    /// Metrics of an object's candidates.
    pub struct SampleMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of draws from which they were chosen.
        draws: Sum,
    }
}

impl Stage for Sample {
    type Config = SampleConfig;

    const KIND: &'static str = "sample";
    const ABOUT: &'static str = "Samples motions for each object from a grasping function";
    const INPUTS: &'static [&'static str] = &[checkpoint::NAME, Object::NAME, FieldInfo::NAME];
    /// Demonstrations, with which the report compares the samples.
    const OPTIONAL_INPUTS: &'static [&'static str] = &[Trajectory::NAME];
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];

    /// Checks the hand's URDF.
    fn prepare(config: &SampleConfig) -> Result<(), BoxedDiagnostic> {
        Ok(robot_meshes::load(&config.hand).map(drop)?)
    }
}

impl Output for Sample {
    type Stage = Self;
    type Metrics = SampleMetrics;
    type Inputs<'a> = SampleInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    /// `objects` only chooses units.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects"]);

    fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        candidates::units(config, scope)
    }

    fn make(
        config: &SampleConfig,
        inputs: SampleInputs,
        cx: &Context,
    ) -> Result<Outcome<SampleMetrics>, BoxedDiagnostic> {
        candidates::make(config, inputs, cx)
    }
}
