//! The stage `ingest`: what it makes, and of which parts.

mod check;
mod make;
mod metrics;
mod units;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use schemas::{Table, demonstrations::Demonstration, objects::Object};

pub use self::metrics::{Agreement, DemonstrationMetrics, ShapeMetrics};
use crate::{config::IngestConfig, reader};

/// Names of the pipeline file's meshes, among the files of a unit, begin so.
const MESHES: &str = "meshes/";
/// Why a recording is left out, found out while listing.
const LEFT_OUT: &str = "left out";
/// Why a recording or a mesh cannot be read, found out while listing.
const UNREADABLE: &str = "unreadable";
/// The label of objects that the pipeline file adds.
const ADDED: &str = "added";
/// An object's mass in kilograms.
const MASS: &str = "mass in kg";

/// Reads recordings of people grasping objects.
pub enum Ingest {}

impl Stage for Ingest {
    type Config = IngestConfig;

    const KIND: &'static str = "ingest";
    const ABOUT: &'static str = "Reads recordings of people grasping objects";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Shapes, &Demonstrations, &Objects];

    fn prepare(config: &IngestConfig) -> Result<(), BoxedDiagnostic> {
        check::options(config)?;
        Ok(check::chosen(config, reader::reader(config).as_ref())?)
    }
}

/// The artifact `shapes`: what follows from an object's mesh and its mass.
pub struct Shapes;

impl Output for Shapes {
    type Stage = Ingest;
    type Metrics = ShapeMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "shapes";
    const SCHEMA: &'static str = Object::VERSION;
    const PARTITION: &'static str = "object";
    const OPTIONS: OptionsUsed =
        OptionsUsed::Only(&["points_n", "max_convex_parts_n", "part_tolerance_m"]);

    fn units(config: &IngestConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        units::shapes(config)
    }

    fn make(
        config: &IngestConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ShapeMetrics>, BoxedDiagnostic> {
        make::shape(config, inputs, cx)
    }
}

/// The artifact `demonstrations`: recordings of people grasping, up to the moment the object moves.
pub struct Demonstrations;

impl Output for Demonstrations {
    type Stage = Ingest;
    type Metrics = DemonstrationMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Demonstration::NAME;
    const SCHEMA: &'static str = Demonstration::VERSION;
    const PARTITION: &'static str = Demonstration::PARTITION;
    /// The others choose units and files, or decide shapes.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&[
        "subjects",
        "objects",
        "split",
        "mirror",
        "masses_kg",
        "meshes",
        "points_n",
        "max_convex_parts_n",
        "part_tolerance_m",
    ]);

    fn units(config: &IngestConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        units::demonstrations(config, scope)
    }

    fn make(
        config: &IngestConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<DemonstrationMetrics>, BoxedDiagnostic> {
        make::demonstration(config, inputs, cx)
    }
}

/// The artifact `objects`: a shape with the orientations in which it was seen to lie.
pub struct Objects;

impl Output for Objects {
    type Stage = Ingest;
    type Metrics = ShapeMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Object::NAME;
    const SCHEMA: &'static str = Object::VERSION;
    const PARTITION: &'static str = Object::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;

    fn units(_config: &IngestConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(units::objects(scope))
    }

    fn make(
        _config: &IngestConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<ShapeMetrics>, BoxedDiagnostic> {
        make::object(inputs, cx)
    }
}
