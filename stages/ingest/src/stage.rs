//! The stage `ingest`: its units and how each is made.

use std::{collections::BTreeMap, fs::File, io::Write, path::Path};

use dataflow::{
    Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, SourceFile, Stage, Summary,
    Unit,
};
use nalgebra::{Unit as UnitVector, Vector3};

use crate::{
    config::IngestConfig,
    dataset::{self, SequenceFiles},
    demonstrations::{self, Names},
    dexycb,
    error::{IngestError, Unusable},
    film, objects, ycb,
};

/// Largest accepted mesh file: the dataset's own have 1 MB.
const MAX_MESH_BYTES: u64 = 256 << 20;

/// Name of the recording in a demonstration's artifact.
const FILM: &str = "demonstration.mcap";

const DEMONSTRATIONS: &str = "demonstrations";
const OBJECTS: &str = "objects";

/// Reads recordings of people grasping objects.
pub enum Ingest {}

impl Stage for Ingest {
    type Config = IngestConfig;
    type Error = IngestError;

    const KIND: &'static str = "ingest";
    const ABOUT: &'static str = "reads recordings of people grasping objects, in DexYCB's layout";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [Input] = &[];
    const OUTPUTS: &'static [Output] = &[
        Output {
            artifact: DEMONSTRATIONS,
            schema: schemas::demonstrations::VERSION,
            partition: "sequence",
            parallel: true,
        },
        Output {
            artifact: OBJECTS,
            schema: schemas::objects::VERSION,
            partition: "object",
            parallel: true,
        },
    ];

    fn prepare(config: &IngestConfig) -> Result<(), IngestError> {
        check(config)?;
        // Its presence marks a dataset that is made, not downloaded.
        if config.root.join(demonstrator::RECIPE_FILE).is_file() {
            demonstrator::ensure_sample(&config.root).map_err(|source| IngestError::Sample {
                root: config.root.clone(),
                source,
            })?;
        }
        dataset::sequences(&config.root).map(|_| ())
    }

    fn units(config: &IngestConfig, output: &str, scope: &Scope) -> Result<Vec<Unit>, IngestError> {
        if output == OBJECTS {
            object_units(config, scope)
        } else {
            demonstration_units(config)
        }
    }

    fn foretell(
        _config: &IngestConfig,
        output: &str,
        unit: &Unit,
        _scope: &Scope,
    ) -> Option<Labels> {
        let label = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        if output == OBJECTS {
            return Some(Labels::from([label("object", &unit.partition)]));
        }
        let files = SequenceFiles::sort(&unit.files);
        let meta = dexycb::meta(&files).ok()?;
        let object = dexycb::grasped_object(&meta, &files).ok()?;
        Some(Labels::from([
            label("object", object),
            label("subject", &files.subject),
        ]))
    }

    fn run(config: &IngestConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, IngestError> {
        if cx.output() == OBJECTS {
            make_object(config, inputs, cx)
        } else {
            make_demonstration(config, inputs, cx)
        }
    }

    fn describe(output: &str, summary: &Summary) -> String {
        if output == OBJECTS {
            let skipped = counted(summary.n_skipped, "skipped");
            return format!("{} objects{skipped}", summary.n_made);
        }
        let n_recordings = summary.n_made + summary.n_skipped + summary.n_filtered;
        format!(
            "{n_recordings} recordings → {} demonstrations{}{}",
            summary.n_made,
            counted(summary.n_filtered, "left hands filtered"),
            counted(summary.n_skipped, "skipped"),
        )
    }
}

/// Returns `, 3 skipped`, or nothing for none.
fn counted(n: usize, what: &str) -> String {
    if n == 0 {
        String::new()
    } else {
        format!(", {n} {what}")
    }
}

/// Refuses options with which nothing can be made.
fn check(config: &IngestConfig) -> Result<(), IngestError> {
    let positive = [
        ("rate_hz", config.rate_hz),
        ("move_threshold_m", config.move_threshold_m),
        ("move_threshold_rad", config.move_threshold_rad),
        ("jitter_factor", config.jitter_factor),
        ("points_n", config.points_n as f64),
        ("max_convex_parts_n", config.max_convex_parts_n as f64),
        ("min_steps_n", config.min_steps_n as f64),
        ("settle_n", config.settle_n as f64),
    ];
    let masses = config
        .masses_kg
        .values()
        .map(|&mass_kg| ("masses_kg", mass_kg));
    for (key, found) in positive.into_iter().chain(masses) {
        if !(found.is_finite() && found > 0.0) {
            return Err(IngestError::Option {
                key,
                expected: "positive",
                found,
            });
        }
    }
    Ok(())
}

fn demonstration_units(config: &IngestConfig) -> Result<Vec<Unit>, IngestError> {
    dataset::sequences(&config.root)?
        .into_iter()
        .map(|sequence| {
            let files = sequence.files(&config.root)?;
            let mut unit = Unit::new(sequence.key);
            unit.files = files;
            Ok(unit)
        })
        .collect()
}

/// Lists one unit per object among the demonstrations.
fn object_units(config: &IngestConfig, scope: &Scope) -> Result<Vec<Unit>, IngestError> {
    let mut by_object: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for demonstration in scope.partitions(DEMONSTRATIONS) {
        if let Some(object) = demonstration.label("object") {
            by_object
                .entry(object)
                .or_default()
                .push(&demonstration.key);
        }
    }
    by_object
        .into_iter()
        .map(|(object, keys)| {
            // Said before anything is computed, not after.
            mass_kg(config, object)?;
            let unit = Unit::new(object).reading(DEMONSTRATIONS, keys);
            let name = dataset::mesh_name(object);
            let path = config.root.join(&name);
            Ok(if path.is_file() {
                unit.with_file(SourceFile { name, path })
            } else {
                unit
            })
        })
        .collect()
}

fn mass_kg(config: &IngestConfig, object: &str) -> Result<f64, IngestError> {
    config
        .masses_kg
        .get(object)
        .copied()
        .or_else(|| ycb::mass_kg(object))
        .ok_or_else(|| IngestError::UnknownMass {
            object: object.to_owned(),
        })
}

fn make_demonstration(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, IngestError> {
    let files = SequenceFiles::sort(inputs.files());
    let meta = match dexycb::meta(&files) {
        Ok(meta) => meta,
        Err(unusable) => return Ok(skipped(&unusable)),
    };
    if let Some(side) = meta
        .mano_sides
        .iter()
        .find(|side| *side != config.hand.as_str())
    {
        return Ok(Outcome::Filtered {
            reason: format!("{side} hand, `hand` asks for {}", config.hand.as_str()),
        });
    }
    let names = Names {
        sequence: cx.partition(),
        subject: &files.subject,
    };
    let demonstration = match dexycb::recording(&meta, &files)
        .and_then(|recording| demonstrations::reach(&recording, config, &names))
    {
        Ok(demonstration) => demonstration,
        Err(unusable) => return Ok(skipped(&unusable)),
    };
    let batch = schemas::demonstrations::to_batch(&demonstration).map_err(|source| {
        IngestError::Schema {
            action: "build",
            partition: cx.partition().to_owned(),
            source,
        }
    })?;
    lake::table::write(cx.folder(), &batch)?;
    // A mesh that cannot be used is reported where the object is made; it is only drawn here.
    let mesh = files
        .mesh
        .and_then(|file| dexycb::read(file, MAX_MESH_BYTES).ok())
        .and_then(|bytes| objects::mesh(&bytes).ok());
    film::write(&cx.folder().join(FILM), &demonstration, mesh.as_ref())?;
    Ok(Outcome::Made(Made {
        labels: BTreeMap::from([
            ("object".to_owned(), demonstration.object),
            ("subject".to_owned(), demonstration.subject),
        ]),
        metrics: BTreeMap::from([("steps_n".to_owned(), demonstration.steps.len() as f64)]),
    }))
}

fn make_object(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, IngestError> {
    let name = cx.partition();
    let mass_kg = mass_kg(config, name)?;
    let seen_up = inputs
        .artifacts(DEMONSTRATIONS)
        .iter()
        .map(|artifact| {
            let batch = lake::table::read(artifact)?;
            schemas::demonstrations::from_batch(&artifact.key, &batch)
                .map(|demonstration| demonstration.rest.up_in_object)
                .map_err(|source| IngestError::Schema {
                    action: "read",
                    partition: artifact.key.clone(),
                    source,
                })
        })
        .collect::<Result<Vec<UnitVector<Vector3<f64>>>, IngestError>>()?;
    let Some(file) = inputs.files().first() else {
        return Ok(skipped(&Unusable::Missing {
            file: dataset::mesh_name(name),
        }));
    };
    cx.progress(0.0, "convex parts");
    let made = dexycb::read(file, MAX_MESH_BYTES).and_then(|mesh| {
        objects::object(&objects::Source {
            name,
            mass_kg,
            mesh_file: &file.name,
            mesh: &mesh,
            seen_up: &seen_up,
            points_n: config.points_n,
            max_convex_parts_n: config.max_convex_parts_n,
            seed: cx.seed(),
        })
    });
    let (object, mesh) = match made {
        Ok(made) => made,
        Err(unusable) => return Ok(skipped(&unusable)),
    };
    let metrics = BTreeMap::from([
        ("convex_parts_n".to_owned(), object.parts_m.len() as f64),
        ("rests_n".to_owned(), object.rests.len() as f64),
    ]);
    let batch = schemas::objects::to_batch(&[object]).map_err(|source| IngestError::Schema {
        action: "build",
        partition: name.to_owned(),
        source,
    })?;
    lake::table::write(cx.folder(), &batch)?;
    write(
        &cx.folder().join(schemas::objects::MESH),
        mesh.to_obj().as_bytes(),
    )?;
    Ok(Outcome::Made(Made {
        labels: BTreeMap::from([("object".to_owned(), name.to_owned())]),
        metrics,
    }))
}

fn skipped(unusable: &Unusable) -> Outcome {
    Outcome::Skipped {
        reason: unusable.to_string(),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), IngestError> {
    File::create(path)
        .and_then(|mut file| file.write_all(bytes))
        .map_err(|source| IngestError::Write {
            path: path.to_owned(),
            source,
        })
}
