//! Input of a unit: one object's candidates with their hand.

use std::path::PathBuf;

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Outcome, Partition, Scope, SourceFile, Stage, Unit,
};
use lake::ReadInputs;
use robot::RobotModel;
use robot_meshes::HandMismatch;
use schemas::{Table, candidates::Candidates, objects::Object};
use screening::{PlacedMotion, Screening};
use simulation::{ObjectShape, SimulationError};

use crate::{Screen, ScreenConfig, ScreenError};

/// The inputs of a unit.
pub(crate) struct ScreeningInputs {
    partition: String,
    urdf: PathBuf,
    /// The hand's URDF.
    pub(crate) xml: String,
    /// The hand.
    pub(crate) hand: RobotModel,
    /// The object.
    pub(crate) object: Object,
    /// Its candidates.
    pub(crate) candidates: Candidates,
}

/// Returns one unit for each partition, which reads the candidates, the object and the hand.
pub(crate) fn units(
    config: &ScreenConfig,
    scope: &Scope,
    partitions: &[Partition],
) -> Result<Vec<Unit>, BoxedDiagnostic> {
    let meshes = robot_meshes::sources(&config.hand)?;
    let unit = |partition: &Partition| {
        // An object that is missing is planned without, and skipped.
        let unit = Unit::new(&partition.key)
            .with_label("object", &partition.key)
            .reading(Candidates::NAME, [&partition.key])
            .reading_own(Object::NAME, scope)
            .with_file_of_form(
                SourceFile::named("hand", &config.hand),
                robot_meshes::URDF_FORM,
            );
        meshes.iter().cloned().fold(unit, Unit::with_file)
    };
    Ok(partitions.iter().map(unit).collect())
}

impl ScreeningInputs {
    /// Reads a unit's inputs; nothing if the object is missing.
    pub(crate) fn read(inputs: &Inputs, cx: &Context) -> Result<Option<Self>, BoxedDiagnostic> {
        let urdf = inputs.source("hand")?.path.clone();
        let loaded = robot_meshes::load(&urdf)?;
        let (xml, hand) = (robot::plain_urdf(&loaded.urdf), loaded.model);
        let candidates: Candidates = inputs.one()?;
        let Some(object) = inputs.optional::<Object>()? else {
            return Ok(None);
        };
        let partition = cx.partition().to_string();
        let of_object = (partition.as_str(), &candidates.joints[..]);
        HandMismatch::check(Screen::KIND, of_object, (&urdf, &hand))?;
        Ok(Some(Self {
            partition,
            urdf,
            xml,
            hand,
            object,
            candidates,
        }))
    }

    /// Returns the candidates, to be carried out.
    pub(crate) fn screening<'a>(&'a self, config: &'a ScreenConfig, seed: u64) -> Screening<'a> {
        screening(config, &self.hand, &self.object, &self.candidates, seed)
    }

    /// Returns the outcome where the object is at fault; fails where the hand or the options are, and so
    /// every unit will.
    pub(crate) fn skip_or_fail<M>(
        &self,
        source: SimulationError,
    ) -> Result<Outcome<M>, BoxedDiagnostic> {
        if source.is_of_object() {
            return Ok(Outcome::skipped(source.to_string()));
        }
        Err(ScreenError::Simulation {
            partition: self.partition.clone(),
            path: self.urdf.clone(),
            source,
        }
        .into())
    }
}

/// Returns an object's candidates, to be carried out by a hand under [resolved](ScreenConfig::resolved) options.
pub fn screening<'a>(
    config: &'a ScreenConfig,
    hand: &'a RobotModel,
    object: &Object,
    candidates: &'a Candidates,
    seed: u64,
) -> Screening<'a> {
    let motions = candidates.candidates.iter();
    let motions = motions.map(|candidate| PlacedMotion {
        table_from_object: candidate.table_from_object,
        motion: &candidate.motion,
    });
    let object = (ObjectShape::from_artifact(object), &object.points_m[..]);
    Screening::new(config.screening(seed), hand, object, motions.collect())
}
