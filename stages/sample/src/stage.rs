//! The stage: the candidates of one object, and how plausible and different they are.

mod candidates;
mod charts;
mod sampling;

use std::{fs, path::Path};

use dataflow::{
    Artifact, Code, Context, Form, Input, Inputs, Labels, OptionFault, Outcome, Output, Scope,
    SourceFile, Stage, Summary, Unit,
};
use geometry::DistanceField;
use robot::{JointOrder, RobotModel};
use schemas::{SchemaError, distance_fields};

use crate::{SampleConfig, SampleError};

/// Draws candidate motions from a grasping function.
pub enum Sample {}

/// The hand counts as it is read.
const ROBOT: Form = Form {
    name: "robot",
    of: robot::read_form,
};
/// The robot counts as recordings show it.
const SHOWN_ROBOT: Form = Form {
    name: "shown robot",
    of: robot::shown_form,
};
/// The artifact of an object's motions.
const CANDIDATES: &str = "candidates";
/// The artifact that says how plausible and different they are.
const SAMPLING: &str = "sampling";
/// The artifact of an object's distances.
const FIELDS: &str = "distance_fields";
/// The artifact of a demonstration's motion.
const TRAJECTORIES: &str = "trajectories";

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
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: CANDIDATES,
            schema: schemas::candidates::VERSION,
            partition: "object",
            parallel: true,
        },
        Output {
            artifact: SAMPLING,
            schema: schemas::sampling::VERSION,
            partition: "object",
            parallel: true,
        },
    ];

    fn check(config: &SampleConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the hand's URDF.
    fn prepare(config: &SampleConfig) -> Result<(), SampleError> {
        read_hand(&config.hand).map(drop)
    }

    fn units(config: &SampleConfig, output: &str, scope: &Scope) -> Result<Vec<Unit>, SampleError> {
        match output {
            SAMPLING => sampling::units(config, scope),
            _ => candidates::units(config, scope),
        }
    }

    fn foretell(
        _config: &SampleConfig,
        _output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        Some(labels(&unit.partition))
    }

    fn decides(option: &str, output: &str) -> bool {
        output == CANDIDATES && option != "objects"
    }

    fn run(config: &SampleConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, SampleError> {
        match cx.output() {
            SAMPLING => sampling::make(inputs, cx),
            _ => candidates::make(config, inputs, cx),
        }
    }

    fn describe(output: &str, summary: &Summary) -> String {
        match output {
            SAMPLING => sampling::describe(summary),
            _ => candidates::describe(summary),
        }
    }
}

fn labels(object: &str) -> Labels {
    Labels::from([("object".to_owned(), object.to_owned())])
}

/// The meshes that the hand collides with.
fn hand_meshes(config: &SampleConfig) -> Result<Vec<SourceFile>, SampleError> {
    Ok(robot_meshes::sources(&config.hand)?)
}

/// The hand's URDF, of which some units read nothing.
fn hand_file(config: &SampleConfig) -> SourceFile {
    SourceFile::named("hand", &config.hand)
}

/// Reads the hand's URDF and meshes: its plain text and what it says.
fn read_hand(path: &Path) -> Result<(String, RobotModel), SampleError> {
    let xml = fs::read_to_string(path).map_err(|source| SampleError::ReadHand {
        path: path.to_owned(),
        source,
    })?;
    let model = RobotModel::from_urdf(&xml).map_err(|source| SampleError::Hand {
        path: path.to_owned(),
        source,
    })?;
    let model = robot_meshes::with_mesh_shapes(model, path)?;
    Ok((robot::plain_urdf(&xml), model))
}

/// Reads the distances about an object.
fn read_field(artifact: &Artifact) -> Result<DistanceField, SampleError> {
    let path = artifact
        .file(distance_fields::FIELD)
        .ok_or(SampleError::Missing {
            what: "distance field of an object",
        })?;
    let bytes = fs::read(path).map_err(|source| SampleError::ReadField {
        object: artifact.key.clone(),
        source,
    })?;
    DistanceField::from_bytes(&bytes).ok_or_else(|| SampleError::BadField {
        object: artifact.key.clone(),
    })
}

/// Returns how vectors of `joints`, those of `what`, are put into the order of the hand's.
fn order(model: &RobotModel, joints: &[String], what: &str) -> Result<JointOrder, SampleError> {
    JointOrder::new(joints, &model.joint_names()).map_err(|source| SampleError::AnotherHand {
        what: what.to_owned(),
        source,
    })
}

/// Returns the one artifact of an input.
fn only<'a>(
    inputs: &'a Inputs,
    input: &str,
    what: &'static str,
) -> Result<&'a Artifact, SampleError> {
    let artifact = inputs.artifacts(input).first();
    artifact.ok_or(SampleError::Missing { what })
}

fn schema(key: &str) -> impl Fn(SchemaError) -> SampleError {
    move |source| SampleError::Schema {
        key: key.to_owned(),
        source,
    }
}
