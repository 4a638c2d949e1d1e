//! The stage `ingest`: what it makes, and of which parts.

mod check;
mod make;
mod units;

use dataflow::{
    Code, Context, Input, Inputs, Labels, OptionFault, Outcome, Output, Scope, Stage, Unit,
};
use schemas::{Table, demonstrations::Demonstration, objects::Object};

use crate::{config::IngestConfig, error::IngestError, reader};

/// The artifact of what follows from an object's mesh and its mass.
pub const SHAPES: &str = "shapes";
const DEMONSTRATIONS: &str = "demonstrations";
/// The artifact of an object with the orientations in which it was seen to lie.
pub const OBJECTS: &str = "objects";

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
    type Error = IngestError;

    const KIND: &'static str = "ingest";
    const ABOUT: &'static str = "reads recordings of people grasping objects";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[];
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: SHAPES,
            schema: Object::VERSION,
            partition: "object",
            parallel: true,
        },
        Output {
            artifact: DEMONSTRATIONS,
            schema: Demonstration::VERSION,
            partition: "sequence",
            parallel: true,
        },
        Output {
            artifact: OBJECTS,
            schema: Object::VERSION,
            partition: "object",
            parallel: true,
        },
    ];

    fn check(config: &IngestConfig) -> Vec<OptionFault> {
        check::faults(config)
    }

    fn prepare(config: &IngestConfig) -> Result<(), IngestError> {
        check::options(config)?;
        check::chosen(config, reader::reader(config).as_ref())
    }

    fn units(config: &IngestConfig, output: &str, scope: &Scope) -> Result<Vec<Unit>, IngestError> {
        match output {
            SHAPES => units::shapes(config),
            OBJECTS => Ok(units::objects(scope)),
            _ => units::demonstrations(config, scope),
        }
    }

    fn foretell(
        config: &IngestConfig,
        output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        let label = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        if output == SHAPES {
            let mut labels = units::added(&unit.files);
            labels.extend([label("object", &unit.partition)]);
            return Some(labels);
        }
        if output == OBJECTS {
            return Some(Labels::from([label("object", &unit.partition)]));
        }
        let about = reader::reader(config).about(&unit.files).ok()?;
        Some(Labels::from([
            label("object", &about.object),
            label("subject", &about.subject),
        ]))
    }

    fn decides(option: &str, output: &str) -> bool {
        match option {
            // They choose units and files, or are told to the unit as its mass.
            "subjects" | "objects" | "split" | "mirror" | "masses_kg" | "meshes" => false,
            "points_n" | "max_convex_parts_n" => output == SHAPES,
            _ => output == DEMONSTRATIONS,
        }
    }

    fn run(config: &IngestConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, IngestError> {
        match cx.output() {
            SHAPES => make::shape(config, inputs, cx),
            OBJECTS => make::object(inputs, cx),
            _ => make::demonstration(config, inputs, cx),
        }
    }
}
