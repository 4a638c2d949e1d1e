//! The stage `ingest`: its units and how each is made.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::Write,
    path::Path,
};

use dataflow::{
    Artifact, Code, Context, Input, Inputs, Labels, Made, Outcome, Output, Scope, SourceFile,
    Stage, Summary, Unit,
};
use geometry::TriMesh;
use nalgebra::{Unit as UnitVector, Vector3};
use schemas::{
    SchemaError,
    demonstrations::{Demonstration, Side},
    objects::Object,
};

use crate::{
    aftermath::{self, After},
    config::{IngestConfig, Landmarks},
    dexycb,
    error::{IngestError, Unusable},
    film, mirror, objects, reach,
    reader::{self, Listed, Reader},
    recording::Recording,
    rests,
    selection::{self, Cameras, Choice},
    table, ycb,
};

/// Largest accepted mesh file: the dataset's own have 1 MB.
const MAX_MESH_BYTES: u64 = 256 << 20;

/// Name of the recording in a demonstration's artifact.
const FILM: &str = "demonstration.mcap";

const SHAPES: &str = "shapes";
const DEMONSTRATIONS: &str = "demonstrations";
const OBJECTS: &str = "objects";

/// Where meshes lie: in the dataset, and by the pipeline file.
const MESH_FOLDERS: [&str; 2] = ["models/", "meshes/"];

/// Why a recording is left out, found out while listing.
const LEFT_OUT: &str = "left out";
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
            schema: schemas::objects::VERSION,
            partition: "object",
            parallel: true,
        },
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
        check_chosen(config, reader::reader(config).as_ref())
    }

    fn units(config: &IngestConfig, output: &str, scope: &Scope) -> Result<Vec<Unit>, IngestError> {
        match output {
            SHAPES => shape_units(config),
            OBJECTS => Ok(object_units(scope)),
            _ => demonstration_units(config, scope),
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
            let mut labels = added(&unit.files);
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
            SHAPES => make_shape(config, inputs, cx),
            OBJECTS => make_object(inputs, cx),
            _ => make_demonstration(config, inputs, cx),
        }
    }

    fn describe(output: &str, summary: &Summary) -> String {
        let skipped = counted(summary.n_skipped, "skipped");
        match output {
            SHAPES => format!(
                "{} shapes in {} convex parts{skipped}",
                summary.n_made,
                summary.total("convex_parts_n")
            ),
            OBJECTS => format!("{} objects{skipped}", summary.n_made),
            _ => {
                let n_recordings = summary.n_made + summary.n_skipped + summary.n_filtered;
                format!(
                    "{n_recordings} recordings → {} demonstrations{}{skipped}",
                    summary.n_made,
                    counted(summary.n_filtered, "left out"),
                )
            }
        }
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
        ("max_mirror_error_m", config.max_mirror_error_m),
        ("camera_agreement_m", config.camera_agreement_m),
        ("move_threshold_m", config.move_threshold_m),
        ("move_threshold_rad", config.move_threshold_rad),
        ("jitter_factor", config.jitter_factor),
        ("max_table_error_m", config.max_table_error_m),
        ("points_n", config.points_n as f64),
        ("max_convex_parts_n", config.max_convex_parts_n as f64),
        ("min_steps_n", config.min_steps_n as f64),
        ("settle_n", config.settle_n as f64),
    ];
    let masses = config.masses_kg.values().map(|&kg| ("masses_kg", kg));
    let added = config.meshes.values().map(|mesh| ("mass_kg", mesh.mass_kg));
    for (key, found) in positive.into_iter().chain(masses).chain(added) {
        if !(found.is_finite() && found > 0.0) {
            return Err(IngestError::Option {
                key,
                expected: "positive",
                found,
            });
        }
    }
    check_hand_models(config)?;
    for (object, mesh) in &config.meshes {
        if !mesh.file.is_file() {
            return Err(IngestError::NoMesh {
                object: object.clone(),
                path: mesh.file.clone(),
            });
        }
    }
    Ok(())
}

/// Refuses to begin without the hand models that the options ask for.
fn check_hand_models(config: &IngestConfig) -> Result<(), IngestError> {
    let Some(folder) = &config.mano_models else {
        return match config.landmarks {
            Landmarks::Mano => Err(IngestError::NoHandModels),
            Landmarks::Either | Landmarks::Labels => Ok(()),
        };
    };
    let hands = match (config.mirror, config.hand) {
        (true, _) => vec![Side::Right, Side::Left],
        (false, hand) => vec![hand],
    };
    let mut paths = hands
        .into_iter()
        .map(|hand| folder.join(dexycb::model_file(hand)));
    match paths.find(|path| !path.is_file()) {
        Some(path) => Err(IngestError::NoHandModel { path }),
        None => Ok(()),
    }
}

/// Refuses to begin where the options leave out every recording, or none can be told what it is about.
fn check_chosen(config: &IngestConfig, reader: &dyn Reader) -> Result<(), IngestError> {
    let chosen = chosen(config, reader)?;
    let is_told = |(listed, choice): &(Listed, Choice)| listed.about.is_some() && choice.is_taken();
    if chosen.iter().any(is_told) || !config.meshes.is_empty() {
        return Ok(());
    }
    let found = chosen.len();
    if let Some((listed, _)) = chosen.iter().find(|(_, choice)| choice.is_taken()) {
        let files = reader.files(listed, Cameras::ALL)?;
        if let Err(source) = reader.about(&files) {
            return Err(IngestError::NoneTold { found, source });
        }
    }
    let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
    for (_, choice) in chosen {
        if let Choice::Leave(reason) = choice {
            *reasons.entry(reason).or_default() += 1;
        }
    }
    Err(IngestError::NoneChosen { found, reasons })
}

/// The recordings that are listed, each with what becomes of it.
fn chosen(
    config: &IngestConfig,
    reader: &dyn Reader,
) -> Result<Vec<(Listed, Choice)>, IngestError> {
    let listed = reader.list()?;
    let choices = selection::choose(config, &listed)?;
    Ok(listed.into_iter().zip(choices).collect())
}

/// Lists one unit per object that is grasped, that says where a table is, or that the pipeline file
/// adds.
fn shape_units(config: &IngestConfig) -> Result<Vec<Unit>, IngestError> {
    let reader = reader::reader(config);
    let mut names: BTreeSet<String> = config.meshes.keys().cloned().collect();
    for (listed, choice) in chosen(config, reader.as_ref())? {
        let (Some(about), Choice::Take(_)) = (listed.about, choice) else {
            continue;
        };
        if !about.marks_table {
            names.extend(about.scene);
        }
        names.insert(about.object);
    }
    names
        .into_iter()
        .map(|object| {
            // Said before anything is computed, not after.
            let mass_kg = mass_kg(config, &object)?;
            let file = mesh_file(config, reader.as_ref(), &object);
            let mut unit = Unit::new(object).with_fact(MASS, mass_kg.to_string());
            unit.files.extend(file);
            Ok(unit)
        })
        .collect()
}

/// Returns the pipeline file's mesh of an object, or the dataset's.
fn mesh_file(config: &IngestConfig, reader: &dyn Reader, object: &str) -> Option<SourceFile> {
    match config.meshes.get(object) {
        Some(added) => Some(SourceFile {
            name: format!("meshes/{object}.obj"),
            path: added.file.clone(),
        }),
        None => reader.mesh(object),
    }
}

/// The label of a shape whose mesh comes from the pipeline file.
fn added(files: &[SourceFile]) -> Labels {
    let is_added = files.iter().any(|file| file.name.starts_with("meshes/"));
    is_added
        .then(|| (ADDED.to_owned(), "true".to_owned()))
        .into_iter()
        .collect()
}

fn mass_kg(config: &IngestConfig, object: &str) -> Result<f64, IngestError> {
    let added = config.meshes.get(object).map(|mesh| mesh.mass_kg);
    added
        .or_else(|| config.masses_kg.get(object).copied())
        .or_else(|| ycb::mass_kg(object))
        .ok_or_else(|| IngestError::UnknownMass {
            object: object.to_owned(),
        })
}

fn demonstration_units(config: &IngestConfig, scope: &Scope) -> Result<Vec<Unit>, IngestError> {
    let reader = reader::reader(config);
    let shapes: BTreeSet<&str> = scope
        .partitions(SHAPES)
        .iter()
        .map(|s| s.key.as_str())
        .collect();
    chosen(config, reader.as_ref())?
        .into_iter()
        .map(|(listed, choice)| match choice {
            Choice::Leave(reason) => {
                // What it is about is all that is read of it.
                let cameras = Cameras { first: 0, end: 0 };
                let mut unit = Unit::new(&listed.key).with_fact(LEFT_OUT, reason);
                unit.files = reader.files(&listed, cameras)?;
                unit.files.truncate(1);
                Ok(unit)
            }
            Choice::Take(cameras) => {
                let mut unit = Unit::new(&listed.key);
                unit.files = reader.files(&listed, cameras)?;
                let object = listed.about.as_ref().map(|about| about.object.as_str());
                let mesh = object.and_then(|object| mesh_file(config, reader.as_ref(), object));
                unit.files.extend(mesh);
                let read = listed.about.iter().flat_map(|about| {
                    let scene = about.scene.iter().filter(|_| !about.marks_table);
                    let mirrored = (about.hand != config.hand).then_some(&about.object);
                    scene.chain(mirrored).map(String::as_str)
                });
                let read: BTreeSet<&str> = read.filter(|name| shapes.contains(name)).collect();
                Ok(if read.is_empty() {
                    unit
                } else {
                    unit.reading(SHAPES, read)
                })
            }
        })
        .collect()
}

/// Lists one unit per shape that is grasped in a demonstration or that the pipeline file adds.
fn object_units(scope: &Scope) -> Vec<Unit> {
    let mut by_object: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for demonstration in scope.partitions(DEMONSTRATIONS) {
        if let Some(object) = demonstration.label("object") {
            by_object
                .entry(object)
                .or_default()
                .push(&demonstration.key);
        }
    }
    let shapes = scope.partitions(SHAPES).iter();
    shapes
        .filter_map(|shape| {
            let unit = Unit::new(&shape.key).reading(SHAPES, [&shape.key]);
            match by_object.remove(shape.key.as_str()) {
                Some(keys) => Some(unit.reading(DEMONSTRATIONS, keys)),
                None => shape.label(ADDED).is_some().then_some(unit),
            }
        })
        .collect()
}

fn make_shape(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, IngestError> {
    let name = cx.partition();
    let mass_kg = inputs.fact(MASS).and_then(|kg| kg.parse().ok());
    let (Some(file), Some(mass_kg)) = (inputs.files().first(), mass_kg) else {
        return Ok(skipped(&Unusable::Missing {
            file: reader::mesh_name(name),
        }));
    };
    cx.progress(0.0, "convex parts");
    let made = reader::read(file, MAX_MESH_BYTES).and_then(|mesh| {
        objects::shape(&objects::Source {
            name,
            mass_kg,
            mesh_file: &file.name,
            mesh: &mesh,
            points_n: config.points_n,
            max_convex_parts_n: config.max_convex_parts_n,
            seed: cx.seed(),
        })
    });
    match made {
        Ok((object, mesh)) => write_object(cx, object, &mesh, added(inputs.files())),
        Err(unusable) => Ok(skipped(&unusable)),
    }
}

fn make_demonstration(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome, IngestError> {
    if let Some(reason) = inputs.fact(LEFT_OUT) {
        return Ok(Outcome::Filtered {
            reason: reason.to_owned(),
        });
    }
    let shapes = inputs
        .artifacts(SHAPES)
        .iter()
        .map(read_object)
        .collect::<Result<Vec<_>, _>>()?;
    let mesh = mesh_among(inputs.files());
    let read = reader::reader(config).read(inputs.files());
    let made = read.and_then(|mut recording| {
        let made = demonstration(config, &mut recording, mesh.as_ref(), &shapes, cx)?;
        Ok((recording, made))
    });
    let (recording, (demonstration, after)) = match made {
        Ok(made) => made,
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
    let film = cx.folder().join(FILM);
    film::write(&film, &demonstration, &after, mesh.as_ref())?;
    let bridged = demonstration.steps.iter().filter(|step| step.bridged);
    let mut metrics = BTreeMap::from([
        ("steps_n".to_owned(), demonstration.steps.len() as f64),
        ("bridged_n".to_owned(), bridged.count() as f64),
    ]);
    let agreement = recording.agreement.iter();
    metrics.extend(agreement.map(|&(name, value)| (name.to_owned(), value)));
    Ok(Outcome::Made(Made {
        labels: BTreeMap::from([
            ("object".to_owned(), demonstration.object),
            ("subject".to_owned(), demonstration.subject),
        ]),
        metrics,
    }))
}

/// Makes a recording's demonstration, and what is filmed after it.
fn demonstration(
    config: &IngestConfig,
    recording: &mut Recording,
    mesh: Option<&TriMesh>,
    shapes: &[Object],
    cx: &Context,
) -> Result<(Demonstration, Vec<After>), Unusable> {
    let still = reach::still(recording, config)?;
    let lying = table::lying(
        recording,
        &still.world_from_object,
        shapes,
        config.min_table_objects_n,
    )?;
    recording.agreement.extend(lying.agreement);
    // A mesh that cannot be used is reported where the shape is made.
    if let Some(found_m) = mesh.and_then(|mesh| table::lowest_m(mesh, &lying.rest))
        && found_m.abs() > config.max_table_error_m
    {
        return Err(Unusable::OffTable { found_m });
    }
    let mut demonstration = reach::reach(cx.partition(), recording, &still, lying.rest, config)?;
    let mut after = aftermath::after(recording, &still, demonstration.steps.len(), config);
    if recording.hand != config.hand {
        let shape = shapes.iter().find(|shape| shape.name == recording.object);
        let plane = mirror::plane(shape, config.max_mirror_error_m).map_err(|reason| {
            Unusable::NotMirrored {
                hand: recording.hand.as_str(),
                reason,
            }
        })?;
        mirror::mirror(&mut demonstration, &plane, config.hand);
        for after in &mut after {
            after.mirror(&plane);
        }
    }
    Ok((demonstration, after))
}

/// Returns the mesh among the files that a unit reads, if it can be used.
fn mesh_among(files: &[SourceFile]) -> Option<TriMesh> {
    let is_mesh = |file: &&SourceFile| MESH_FOLDERS.iter().any(|f| file.name.starts_with(f));
    let bytes = reader::read(files.iter().find(is_mesh)?, MAX_MESH_BYTES).ok()?;
    objects::mesh(&bytes).ok()
}

fn make_object(inputs: &Inputs, cx: &Context) -> Result<Outcome, IngestError> {
    let seen_up = inputs
        .artifacts(DEMONSTRATIONS)
        .iter()
        .map(|artifact| {
            let batch = lake::table::read(artifact)?;
            schemas::demonstrations::from_batch(&artifact.key, &batch)
                .map(|demonstration| demonstration.rest.up_in_object)
                .map_err(unread(&artifact.key))
        })
        .collect::<Result<Vec<UnitVector<Vector3<f64>>>, IngestError>>()?;
    let Some(shape) = inputs.artifacts(SHAPES).first() else {
        return Ok(skipped(&Unusable::Missing {
            file: format!("shape of {}", cx.partition()),
        }));
    };
    let mut object = read_object(shape)?;
    object.rests = rests::rests(&object, &seen_up);
    let mesh = TriMesh {
        vertices_m: object.vertices_m.iter().map(|&v| v.into()).collect(),
        triangles: object.triangles.clone(),
    };
    write_object(cx, object, &mesh, Labels::new())
}

/// Writes an object's table and its mesh.
fn write_object(
    cx: &Context,
    object: Object,
    mesh: &TriMesh,
    mut labels: Labels,
) -> Result<Outcome, IngestError> {
    let metrics = BTreeMap::from([
        ("convex_parts_n".to_owned(), object.parts_m.len() as f64),
        ("rests_n".to_owned(), object.rests.len() as f64),
        (
            "watertight".to_owned(),
            f64::from(u8::from(object.watertight)),
        ),
    ]);
    labels.insert("object".to_owned(), object.name.clone());
    let batch = schemas::objects::to_batch(&[object]).map_err(|source| IngestError::Schema {
        action: "build",
        partition: cx.partition().to_owned(),
        source,
    })?;
    lake::table::write(cx.folder(), &batch)?;
    let path = cx.folder().join(schemas::objects::MESH);
    write(&path, mesh.to_obj().as_bytes())?;
    Ok(Outcome::Made(Made { labels, metrics }))
}

fn read_object(artifact: &Artifact) -> Result<Object, IngestError> {
    let batch = lake::table::read(artifact)?;
    schemas::objects::from_batch(&artifact.key, &batch).map_err(unread(&artifact.key))
}

fn unread(partition: &str) -> impl FnOnce(SchemaError) -> IngestError {
    let partition = partition.to_owned();
    move |source| IngestError::Schema {
        action: "read",
        partition,
        source,
    }
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
