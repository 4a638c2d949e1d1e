//! The stage: a distance field per object, a trajectory per demonstration.

mod fields;
mod library;
mod retargeted;

use std::path::Path;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, OptionsUsed, Outcome, Output, Outputs, Scope, SourceFile,
    Stage, Unit,
};
use posture::{Hand, HandTable, PostureError};
use robot_meshes::LoadedRobot;
use schemas::{
    Table,
    demonstrations::{Demonstration, TERMS},
    distance_fields::FieldInfo,
    objects::{self, Object},
    trajectories::Trajectory,
};

pub use self::{fields::FieldMetrics, retargeted::TrajectoryMetrics};
use crate::{RetargetConfig, RetargetError};

/// Moves human demonstrations onto a robot hand.
pub enum Retarget {}

impl Stage for Retarget {
    type Config = RetargetConfig;

    const KIND: &'static str = "retarget";
    const ABOUT: &'static str = "Retargets human demonstrations to a robot hand";
    const INPUTS: &'static [&'static str] = &[Demonstration::NAME, Object::NAME];
    const OUTPUTS: Outputs<Self> = &[&DistanceFields, &Trajectories];

    /// Checks that the hand has every link that its table names.
    fn prepare(config: &RetargetConfig) -> Result<(), BoxedDiagnostic> {
        let LoadedHand { hand, urdf, .. } = load_hand(&config.hand, &config.hand_table)?;
        if let Some(path) = &config.dex_retargeting {
            library::problem(path, &hand, &urdf)?;
        }
        let fits = config.retargeting.check_wrist(&hand);
        Ok(fits.map_err(RetargetError::from)?)
    }
}

/// The artifact `distance_fields`: an object's distances.
pub struct DistanceFields;

impl Output for DistanceFields {
    type Stage = Retarget;
    type Metrics = FieldMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = FieldInfo::NAME;
    const SCHEMA: &'static str = FieldInfo::VERSION;
    const PARTITION: &'static str = FieldInfo::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::Only(&["field_spacing_m"]);

    fn units(_config: &RetargetConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let objects = scope.partitions(Object::NAME);
        if objects.is_empty() {
            return Err(RetargetError::NoObjects.into());
        }
        let unit = |object: &str| {
            Unit::new(object)
                .with_label("object", object)
                .reading(Object::NAME, [object])
                .only_files(Object::NAME, [objects::MESH])
        };
        Ok(objects
            .iter()
            .map(|object| unit(object.key.as_str()))
            .collect())
    }

    fn make(
        config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<FieldMetrics>, BoxedDiagnostic> {
        fields::make(config, inputs, cx)
    }
}

/// The artifact `trajectories`: a demonstration's motion.
pub struct Trajectories;

impl Output for Trajectories {
    type Stage = Retarget;
    type Metrics = TrajectoryMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = Trajectory::NAME;
    const SCHEMA: &'static str = Trajectory::VERSION;
    const PARTITION: &'static str = Trajectory::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["field_spacing_m"]);

    fn units(config: &RetargetConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let demonstrations = scope.non_empty(Demonstration::NAME, "to retarget")?;
        let (objects, fields) = (
            scope.partitions(Object::NAME),
            scope.partitions(FieldInfo::NAME),
        );
        let meshes = robot_meshes::sources(&config.hand)?;
        Ok(demonstrations
            .iter()
            .map(|demonstration| {
                // A demonstration whose object or field is missing is planned without, and skipped.
                let object = demonstration.label("object");
                let among = |known: &[dataflow::Partition]| {
                    object.filter(|name| known.iter().any(|one| one.key == **name))
                };
                let unit = Unit::new(&demonstration.key)
                    .with_label_of("object", demonstration)
                    .with_label_of(TERMS, demonstration)
                    .reading(Demonstration::NAME, [&demonstration.key])
                    .reading(Object::NAME, among(objects))
                    .reading(FieldInfo::NAME, among(fields))
                    .only_files(Object::NAME, [objects::MESH])
                    .with_file_of_form(
                        SourceFile::named("hand", &config.hand),
                        robot_meshes::URDF_FORM,
                    )
                    .with_file_of_form(
                        SourceFile::named("hand_table", &config.hand_table),
                        hand_files::HAND_TABLE,
                    );
                let configured = config.dex_retargeting.as_deref();
                let configured = configured.map(|path| SourceFile::named(library::FILE, path));
                let files = meshes.iter().cloned().chain(configured);
                files.fold(unit, Unit::with_file)
            })
            .collect())
    }

    fn make(
        config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrajectoryMetrics>, BoxedDiagnostic> {
        retargeted::make(config, inputs, cx)
    }
}

/// A hand with the text of its URDF.
struct LoadedHand {
    urdf: String,
    hand: Hand,
    table: HandTable,
}

/// Reads a hand and its table, and finds every link that the table names.
fn load_hand(urdf_path: &Path, table_path: &Path) -> Result<LoadedHand, RetargetError> {
    let LoadedRobot { urdf, model } = robot_meshes::load(urdf_path)?;
    let of_urdf = |source: PostureError| RetargetError::Hand {
        path: urdf_path.to_owned(),
        source,
    };
    Hand::check(&model).map_err(of_urdf)?;
    let table = hand_files::load_table(table_path)?;
    let hand = Hand::new(model, &table).map_err(|err| RetargetError::InHandTable {
        path: table_path.to_owned(),
        source: Box::new(of_urdf(err)),
    })?;
    let urdf = robot::plain_urdf(&urdf);
    Ok(LoadedHand { urdf, hand, table })
}

#[cfg(test)]
mod tests;
