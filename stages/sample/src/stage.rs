//! The stage: one unit per object.

use std::collections::BTreeMap;

use cgf::{Cgf, Grasp, Random, Scene};
use dataflow::{
    Artifact, Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, Stage, Summary,
    Unit,
};
use nalgebra::Point3;
use schemas::{
    SchemaError, candidates,
    candidates::{Candidate, Candidates, Step},
    checkpoint, objects,
    objects::Object,
};
use spatial::Rest;

use crate::{
    Epoch, SampleConfig, SampleError,
    draw::{self, Draw, Source},
};

/// Draws candidate motions from a grasping function.
pub enum Sample {}

/// What the candidates say drew them.
const GENERATOR: &str = "cgf";

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
    ];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "candidates",
        schema: candidates::VERSION,
        partition: "object",
        parallel: true,
    }];

    /// Checks the options.
    fn prepare(config: &SampleConfig) -> Result<(), SampleError> {
        check(config)
    }

    fn units(
        config: &SampleConfig,
        _output: &str,
        scope: &Scope,
    ) -> Result<Vec<Unit>, SampleError> {
        check(config)?;
        let objects = scope.partitions("objects");
        for object in &config.objects {
            if !objects.iter().any(|known| known.key == *object) {
                return Err(SampleError::UnknownObject {
                    object: object.clone(),
                    known: objects.iter().map(|known| known.key.clone()).collect(),
                });
            }
        }
        let checkpoint = scope
            .partitions("checkpoint")
            .iter()
            .map(|model| &model.key);
        let units = objects
            .iter()
            .map(|object| &object.key)
            .filter(|object| config.objects.is_empty() || config.objects.contains(object))
            .map(|object| {
                Unit::new(object.as_str())
                    .reading("checkpoint", checkpoint.clone().map(String::as_str))
                    .reading("objects", [object.as_str()])
            });
        Ok(units.collect())
    }

    fn foretell(
        _config: &SampleConfig,
        _output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        let object = unit.partition.clone();
        Some(Labels::from([("object".to_owned(), object)]))
    }

    fn run(config: &SampleConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, SampleError> {
        check(config)?;
        let cgf = read_checkpoint(config.epoch, inputs.artifacts("checkpoint"))?;
        let artifact = inputs
            .artifacts("objects")
            .first()
            .ok_or(SampleError::Missing { what: "object" })?;
        let schema = |source: SchemaError| SampleError::Schema {
            key: artifact.key.clone(),
            source,
        };
        let object =
            objects::from_batch(&artifact.key, &lake::table::read(artifact)?).map_err(schema)?;
        let candidates = Candidates {
            object: object.name.clone(),
            joints: cgf.description().joints.clone(),
            candidates: sample(config, &cgf, &object, cx.seed())?,
        };
        lake::table::write(
            cx.folder(),
            &candidates::to_batch(&candidates).map_err(schema)?,
        )?;
        let n = candidates.candidates.len() as f64;
        Ok(Outcome::Made(Made {
            labels: BTreeMap::from([("object".to_owned(), object.name)]),
            metrics: BTreeMap::from([("candidates".to_owned(), n)]),
        }))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        format!(
            "{} objects → {} candidates",
            summary.n_made,
            summary.total("candidates")
        )
    }
}

fn check(config: &SampleConfig) -> Result<(), SampleError> {
    let check = |key, value: f64, usable: bool, expected| {
        if usable {
            Ok(())
        } else {
            Err(SampleError::Config {
                key,
                value,
                expected,
            })
        }
    };
    check(
        "per_object",
        config.per_object as f64,
        config.per_object > 0,
        "at least 1",
    )?;
    check("steps", config.steps as f64, config.steps > 1, "at least 2")?;
    check(
        "duration_s",
        config.duration_s,
        config.duration_s > 0.0,
        "more than 0",
    )?;
    check("spread", config.spread, config.spread >= 0.0, "0 or more")?;
    let share = config.demonstrated_share;
    check(
        "demonstrated_share",
        share,
        (0.0..=1.0).contains(&share),
        "from 0 to 1",
    )
}

fn read_checkpoint(epoch: Epoch, artifacts: &[Artifact]) -> Result<Cgf, SampleError> {
    let file = |name| {
        let file = artifacts.first().and_then(|artifact| artifact.file(name));
        file.ok_or(SampleError::Missing { what: "checkpoint" })
    };
    let files = match epoch {
        Epoch::Best => checkpoint::BEST,
        Epoch::Last => checkpoint::LAST,
    };
    Ok(Cgf::load(file(files.weights)?, file(files.description)?)?)
}

/// Draws and decodes all motions of one object.
fn sample(
    config: &SampleConfig,
    cgf: &Cgf,
    object: &Object,
    seed: u64,
) -> Result<Vec<Candidate>, SampleError> {
    let rests = draw::rests(object);
    let source = Source::new(config, cgf, object, &rests);
    let draws: Vec<Draw> = (0..config.per_object as u64)
        .map(|stream| source.draw(&mut Random::new(seed, stream)))
        .collect();
    let times = Cgf::times(config.steps);
    let mut candidates: Vec<Option<Candidate>> = vec![None; draws.len()];
    for (idx, rest) in rests.iter().enumerate() {
        let numbers: Vec<usize> = (0..draws.len())
            .filter(|&number| draws[number].rest == idx)
            .collect();
        if numbers.is_empty() {
            continue;
        }
        let feature = cgf.feature(&Scene {
            object: object.name.clone(),
            rest: *rest,
            points_in_object: object
                .points_m
                .iter()
                .map(|&point| Point3::from(point))
                .collect(),
        })?;
        let latents: Vec<Vec<f64>> = numbers
            .iter()
            .map(|&number| draws[number].latent.clone())
            .collect();
        let motions = cgf.decode(&feature, &latents, &times)?;
        for ((number, latent), motion) in numbers.into_iter().zip(latents).zip(motions) {
            candidates[number] = Some(Candidate {
                candidate_id: format!("{}-{number:05}", object.name),
                generator: GENERATOR.to_owned(),
                latent,
                table_from_object: rest.table_from_object(),
                steps: steps(&motion, &times, rest, cgf, config.duration_s),
            });
        }
    }
    Ok(candidates.into_iter().flatten().collect())
}

/// Puts a motion into the object's frame, its joints within their limits, its time into seconds.
fn steps(motion: &[Grasp], times: &[f64], rest: &Rest, cgf: &Cgf, duration_s: f64) -> Vec<Step> {
    let object_from_table = rest.table_from_object().inverse();
    let ranges = &cgf.description().joint_ranges;
    let step = |(grasp, t): (&Grasp, &f64)| Step {
        time_s: (1.0 - t) * duration_s,
        object_from_palm: object_from_table * grasp.table_from_palm,
        q_rad: grasp
            .q_rad
            .iter()
            .zip(ranges)
            .map(|(&q, range)| range.clamp(q))
            .collect(),
    };
    motion.iter().zip(times).map(step).collect()
}
