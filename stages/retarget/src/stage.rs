//! The stage: a distance field per object, a trajectory per demonstration.

mod fields;
mod retargeted;

use std::{fs, path::Path};

use dataflow::{
    Code, Context, Form, Input, Inputs, Labels, OptionFault, Outcome, Output, Scope, SourceFile,
    Stage, Unit,
};
use robot::RobotModel;
use schemas::{Table, distance_fields::FieldInfo, objects, trajectories::Trajectory};

use crate::{
    HandTable, RetargetConfig, RetargetError, Wrist,
    hand::{self, Hand},
};

/// Moves human demonstrations onto a robot hand.
pub enum Retarget {}

/// The artifact of an object's distances.
pub const FIELDS: &str = "distance_fields";
/// The artifact of a demonstration's motion.
pub const TRAJECTORIES: &str = "trajectories";

/// The robot counts as recordings show it.
const SHOWN_ROBOT: Form = Form {
    name: "shown robot",
    of: robot::shown_form,
};
/// The hand's table counts as it is read.
const TABLE: Form = Form {
    name: "hand table",
    of: |bytes| {
        let text = std::str::from_utf8(bytes).ok()?;
        let table: HandTable = text.parse().ok()?;
        Some(table.to_toml().into_bytes())
    },
};

impl Stage for Retarget {
    type Config = RetargetConfig;
    type Error = RetargetError;

    const KIND: &'static str = "retarget";
    const ABOUT: &'static str = "Moves human demonstrations onto a robot hand";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[
        Input {
            name: "demonstrations",
            artifact: "demonstrations",
        },
        Input {
            name: "objects",
            artifact: "objects",
        },
    ];
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: FIELDS,
            schema: FieldInfo::VERSION,
            partition: "object",
            parallel: true,
        },
        Output {
            artifact: TRAJECTORIES,
            schema: Trajectory::VERSION,
            partition: "sequence",
            parallel: true,
        },
    ];

    fn check(config: &RetargetConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks that the hand has every link that its table names.
    fn prepare(config: &RetargetConfig) -> Result<(), RetargetError> {
        let LoadedHand { hand, .. } = load_hand(&config.hand, &config.hand_table)?;
        check_wrist(config, &hand)
    }

    fn units(
        config: &RetargetConfig,
        output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, RetargetError> {
        match output {
            FIELDS => fields(scope),
            _ => retargeted(config, scope),
        }
    }

    fn foretell(
        _config: &RetargetConfig,
        output: &str,
        unit: &Unit,
        scope: &Scope,
    ) -> Option<Labels> {
        let label = |object: &str| Labels::from([("object".to_owned(), object.to_owned())]);
        if output != TRAJECTORIES {
            return Some(label(&unit.partition));
        }
        let demonstrations = scope.partitions("demonstrations");
        let moved = demonstrations
            .iter()
            .find(|demonstration| demonstration.key == unit.partition)?;
        moved.label("object").map(label)
    }

    fn decides(option: &str, output: &str) -> bool {
        match output {
            FIELDS => option == "field_spacing_m",
            _ => option != "field_spacing_m",
        }
    }

    fn run(
        config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome, RetargetError> {
        match cx.output() {
            FIELDS => fields::make(config, inputs, cx),
            _ => retargeted::make(config, inputs, cx),
        }
    }
}

/// Returns the units of distance fields.
fn fields(scope: &Scope) -> Result<Vec<Unit>, RetargetError> {
    let objects = scope.partitions("objects");
    if objects.is_empty() {
        return Err(RetargetError::NoObjects);
    }
    let unit = |object: &str| {
        Unit::new(object)
            .reading("objects", [object])
            .only_files("objects", [objects::MESH])
    };
    Ok(objects.iter().map(|object| unit(&object.key)).collect())
}

/// Returns the units of trajectories.
fn retargeted(config: &RetargetConfig, scope: &Scope) -> Result<Vec<Unit>, RetargetError> {
    let demonstrations = scope.partitions("demonstrations");
    if demonstrations.is_empty() {
        return Err(RetargetError::NoDemonstrations);
    }
    let (objects, fields) = (scope.partitions("objects"), scope.partitions(FIELDS));
    let meshes = robot_meshes::sources(&config.hand)?;
    Ok(demonstrations
        .iter()
        .map(|demonstration| {
            // A demonstration whose object or field is missing is planned without, and skipped.
            let object = demonstration.label("object");
            let among = |known: &[dataflow::Partition]| {
                object.filter(|name| known.iter().any(|one| one.key == *name))
            };
            let unit = Unit::new(&demonstration.key)
                .reading("demonstrations", [&demonstration.key])
                .reading("objects", among(objects))
                .reading(FIELDS, among(fields))
                .only_files("objects", [objects::MESH])
                .with_file_of_form(SourceFile::named("hand", &config.hand), SHOWN_ROBOT)
                .with_file_of_form(SourceFile::named("hand_table", &config.hand_table), TABLE);
            meshes.iter().cloned().fold(unit, Unit::with_file)
        })
        .collect())
}

/// A hand with the text of its URDF.
struct LoadedHand {
    urdf: String,
    hand: Hand,
    table: HandTable,
}

/// Reads a hand and its table, and finds every link that the table names.
fn load_hand(urdf_path: &Path, table_path: &Path) -> Result<LoadedHand, RetargetError> {
    let read = |path: &Path, what| {
        fs::read_to_string(path).map_err(|source| RetargetError::ReadHand {
            what,
            path: path.to_owned(),
            source,
        })
    };
    let urdf = read(urdf_path, "URDF")?;
    let of_urdf = |err: RetargetError| RetargetError::Hand {
        path: urdf_path.to_owned(),
        source: Box::new(err),
    };
    let model = RobotModel::from_urdf(&urdf).map_err(|err| of_urdf(err.into()))?;
    let model = robot_meshes::with_mesh_shapes(model, urdf_path)?;
    hand::check(&model).map_err(of_urdf)?;
    let in_table = |err: RetargetError| RetargetError::InHandTable {
        path: table_path.to_owned(),
        source: Box::new(err),
    };
    let table: HandTable = read(table_path, "table")?.parse().map_err(in_table)?;
    let hand = Hand::new(model, &table).map_err(|err| in_table(of_urdf(err)))?;
    let urdf = robot::plain_urdf(&urdf);
    Ok(LoadedHand { urdf, hand, table })
}

/// Checks that a wrist that is to be fixed can be placed.
fn check_wrist(config: &RetargetConfig, hand: &Hand) -> Result<(), RetargetError> {
    let found = hand.palm_points.len();
    match config.wrist {
        Wrist::Fixed if found < 3 => Err(RetargetError::TooFewPalmPoints { found }),
        Wrist::Fixed if hand.is_palm_a_line() => Err(RetargetError::PalmPointsInLine { found }),
        Wrist::Fixed | Wrist::Free => Ok(()),
    }
}

fn skipped(reason: impl Into<String>) -> Outcome {
    Outcome::Skipped {
        reason: reason.into(),
    }
}

#[cfg(test)]
mod tests;
