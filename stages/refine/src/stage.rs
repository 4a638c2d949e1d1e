//! The stage: one unit per object.

use std::{fs, path::Path, sync::Arc};

use dataflow::{
    Code, Context, Form, Inputs, Line, Max, Mean, OptionFault, OptionsUsed, Outcome, Output,
    Outputs, Scope, SourceFile, Stage, Sum, Unit,
};
use geometry::DistanceField;
use lake::{ReadArtifact, ReadInputs, WriteArtifact};
use posture::{Environment, Hand, HandTable, PostureError};
use rayon::prelude::*;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    distance_fields::{self, FieldInfo},
};
use spatial::RestingPose;

use crate::{
    RefineConfig, RefineError,
    refiner::{Refined, Refiner},
};

/// Refines candidate motions against object and table before physics.
pub struct Refine;

/// The hand's table counts as it is read.
const HAND_TABLE: Form = Form {
    name: "hand table",
    of: |bytes| {
        let text = std::str::from_utf8(bytes).ok()?;
        let table: HandTable = text.parse().ok()?;
        Some(table.to_toml().into_bytes())
    },
};

dataflow::metrics! {
    /// Metrics of an object's refined motions.
    pub struct RefineMetrics {
        /// How many there are.
        candidates: Sum,
        /// How far the palm was moved at the grasp, in meters.
        palm_moved_m: Mean,
        /// Deepest that a refined hand is in the object before it closes, in meters.
        approach_penetration_m: Max,
    }
}

impl Stage for Refine {
    type Config = RefineConfig;
    type Error = RefineError;

    const KIND: &'static str = "refine";
    const ABOUT: &'static str = "Refines candidate motions against object and table before physics";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [&'static str] = &[Candidates::NAME, FieldInfo::NAME];
    const OUTPUTS: Outputs<Self> = &[&Self];

    fn check(config: &RefineConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the hand and its table.
    fn prepare(config: &RefineConfig) -> Result<(), RefineError> {
        load_hand(&config.hand, &config.hand_table).map(drop)
    }
}

impl Output for Refine {
    type Stage = Self;
    type Metrics = RefineMetrics;
    type Error = RefineError;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::All;
    const LINE: Option<Line<RefineMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        format!(
            "{} motions refined, palm moved {:.0} mm at the grasp",
            metrics.candidates,
            1000.0 * metrics.palm_moved_m
        )
    });

    fn units(config: &RefineConfig, scope: &Scope) -> Result<Vec<Unit>, RefineError> {
        let given = scope.partitions(Candidates::NAME);
        if given.is_empty() {
            return Err(RefineError::NoCandidates);
        }
        let fields = scope.partitions(FieldInfo::NAME);
        let meshes = robot_meshes::sources(&config.hand)?;
        let units = given.iter().map(|given| {
            let object = given.key.as_str();
            let field = fields.iter().find(|field| field.key == *object);
            let unit = Unit::new(object)
                .with_label("object", object)
                .reading(Candidates::NAME, [object])
                .only_files(Candidates::NAME, [lake::table::FILE])
                .reading(FieldInfo::NAME, field.map(|field| &field.key))
                .with_file_of_form(
                    SourceFile::named("hand", &config.hand),
                    robot_meshes::MODEL_FORM,
                )
                .with_file_of_form(
                    SourceFile::named("hand_table", &config.hand_table),
                    HAND_TABLE,
                );
            meshes.iter().cloned().fold(unit, Unit::with_file)
        });
        Ok(units.collect())
    }

    fn make(
        config: &RefineConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<RefineMetrics>, RefineError> {
        let Some(field) = inputs.artifacts(FieldInfo::NAME).first() else {
            return Ok(Outcome::skipped(
                "it is not among the objects with a surface",
            ));
        };
        let info: FieldInfo = lake::table::read(field)?;
        let field = field.parsed(distance_fields::FIELD, DistanceField::from_bytes)?;
        let field = Arc::new(field);
        let hand = load_hand(
            &inputs.source("hand")?.path,
            &inputs.source("hand_table")?.path,
        )?;
        let given: Candidates = inputs.one()?;
        let tried: Vec<(Candidate, Result<Refined, RefineError>)> = given
            .candidates
            .into_par_iter()
            .map_init(
                || Refiner::new(&hand, config, info.center_of_mass_m.into()),
                |refiner, candidate| {
                    let rest = RestingPose::of(&candidate.table_from_object);
                    let environment = Environment::new(Arc::clone(&field), rest);
                    let refined = refiner.refine(&environment, &candidate.motion);
                    (candidate, refined)
                },
            )
            .collect();
        let mut refined: Vec<(Candidate, Refined)> = Vec::new();
        for (candidate, tried) in tried {
            match tried {
                Ok(moved) => refined.push((candidate, moved)),
                Err(RefineError::Motion(err)) => {
                    let id = candidate.candidate_id;
                    return Ok(Outcome::skipped(format!("candidate `{id}`: {err}")));
                }
                Err(err) => return Err(err),
            }
        }
        let n = refined.len() as f64;
        let metrics = RefineMetrics {
            candidates: n,
            palm_moved_m: refined.iter().map(|(_, one)| one.palm_moved_m).sum::<f64>() / n.max(1.0),
            approach_penetration_m: refined
                .iter()
                .map(|(_, one)| one.approach_penetration_m)
                .fold(0.0, f64::max),
        };
        let candidates = refined.into_iter().map(|(candidate, refined)| Candidate {
            limit_excess_rad: 0.0,
            depth_m: 0.0,
            motion: refined.motion,
            ..candidate
        });
        let joints = hand.model.joint_names();
        cx.write(&Candidates {
            object: given.object,
            joints: joints.as_slice().into(),
            candidates: candidates.collect(),
        })?;
        Ok(Outcome::Made(metrics))
    }
}

/// Reads a hand and its table, and finds every link that the table names.
fn load_hand(urdf_path: &Path, table_path: &Path) -> Result<Hand, RefineError> {
    let model = robot_meshes::load(urdf_path)?.model;
    let of_urdf = |source: PostureError| RefineError::Hand {
        path: urdf_path.to_owned(),
        source,
    };
    Hand::check(&model).map_err(of_urdf)?;
    let table = fs::read_to_string(table_path).map_err(|source| RefineError::ReadHandTable {
        path: table_path.to_owned(),
        source,
    })?;
    let table: HandTable = table.parse().map_err(|source| RefineError::HandTable {
        path: table_path.to_owned(),
        source,
    })?;
    Hand::new(model, &table).map_err(of_urdf)
}
