//! Making of each unit.

use std::mem;

use dataflow::{BoxedDiagnostic, Context, Inputs, Outcome, Output, SourceFile};
use geometry::{Repairs, TriMesh};
use lake::{LakeError, WriteArtifact};
use object_shapes::MeshedObject;
use schemas::{
    demonstrations::Demonstration,
    objects::{Object, Surface},
};

use super::{
    Agreement, DemonstrationMetrics, Demonstrations, LEFT_OUT, MASS, MESHES, ShapeMetrics, Shapes,
    UNREADABLE,
};
use crate::{
    after_grasp::{self, ImageAfterGrasp},
    config::{Format, IngestConfig},
    demonstration_recording,
    error::RecordingError,
    mirror, reach,
    reader::{self, MAX_MESH_BYTES, MODELS},
    recording::Recording,
    table_pose,
};

/// Name of the recording in a demonstration's artifact.
const RECORDING: &str = "demonstration.mcap";

/// Makes what follows from an object's mesh and its mass.
pub(super) fn shape(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<ShapeMetrics>, BoxedDiagnostic> {
    if let Some(reason) = inputs.fact(UNREADABLE) {
        return Ok(Outcome::skipped(reason));
    }
    let name = cx.partition().as_str();
    let mass_kg = inputs.fact(MASS).and_then(|kg| kg.parse().ok());
    let (Some(file), Some(mass_kg)) = (inputs.files().first(), mass_kg) else {
        // Its unit has both.
        let missing = RecordingError::Missing {
            file: format!("{MODELS}{name}"),
        };
        return Ok(Outcome::skipped(missing.to_string()));
    };
    cx.progress(0.0, "convex parts");
    let unusable = |reason: String| RecordingError::Mesh {
        file: file.name.clone(),
        reason,
    };
    let made = reader::read(file, MAX_MESH_BYTES).and_then(|bytes| {
        let (mesh, repairs) = object_shapes::mesh(&file.name, &bytes).map_err(unusable)?;
        let meshed = MeshedObject {
            name,
            mass_kg,
            mesh: &mesh,
            options: &config.shape,
            seed: cx.seed(),
        };
        let object = meshed.shape().map_err(|err| unusable(err.to_string()))?;
        Ok((object, mesh, repairs))
    });
    match made {
        Ok((object, mesh, repairs)) => Ok(write_object(cx, &object, &mesh, repairs)?),
        Err(unusable) => Ok(Outcome::skipped(unusable.to_string())),
    }
}

/// Makes a demonstration and its recording.
pub(super) fn demonstration(
    config: &IngestConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<DemonstrationMetrics>, BoxedDiagnostic> {
    if let Some(reason) = inputs.fact(LEFT_OUT) {
        return Ok(Outcome::filtered(reason));
    }
    if let Some(reason) = inputs.fact(UNREADABLE) {
        return Ok(Outcome::skipped(reason));
    }
    let shapes = inputs
        .artifacts(Shapes::ARTIFACT)
        .iter()
        .map(lake::table::read)
        .collect::<Result<Vec<Object>, _>>()?;
    let mesh = mesh_among(inputs.files());
    let read = reader::reader(config).read(inputs.files());
    let made = read.and_then(|mut recording| {
        let made = parts(config, &mut recording, mesh.as_ref(), &shapes, cx)?;
        Ok((recording, made))
    });
    let (recording, (demonstration, after)) = match made {
        Ok(made) => made,
        Err(unusable) => return Ok(Outcome::skipped(unusable.to_string())),
    };
    cx.write(&demonstration)?;
    let path = cx.folder().join(RECORDING);
    demonstration_recording::write(&path, &demonstration, &after, mesh.as_ref())?;
    let bridged = demonstration.steps.iter().filter(|step| step.bridged);
    let metrics = DemonstrationMetrics {
        steps_n: demonstration.steps.len() as f64,
        bridged_n: bridged.count() as f64,
        assumed_rate_n: (config.format == Format::Tracks)
            .then(|| f64::from(u8::from(recording.rate_hz.is_none()))),
        agreement: recording.agreement,
    };
    Ok(Outcome::Made(metrics))
}

/// Makes a recording's demonstration, and the images after it.
fn parts(
    config: &IngestConfig,
    recording: &mut Recording,
    mesh: Option<&TriMesh>,
    shapes: &[Object],
    cx: &Context,
) -> Result<(Demonstration, Vec<ImageAfterGrasp>), RecordingError> {
    let departure = reach::departure(recording, config)?;
    let lying = table_pose::lying(
        recording,
        &departure.world_from_object,
        shapes,
        config.min_table_objects_n,
    )?;
    if let Some(plane) = &lying.plane {
        recording.agreement = Agreement {
            table_objects_n: Some(plane.agreeing_n as f64),
            table_spread_m: Some(plane.spread_m),
            table_spread_rad: Some(plane.spread_rad),
            ..mem::take(&mut recording.agreement)
        };
    }
    // A mesh that cannot be used is reported where the shape is made.
    if let Some(found_m) = mesh.and_then(|mesh| table_pose::lowest_m(mesh, &lying.rest))
        && found_m.abs() > config.max_table_error_m
    {
        return Err(RecordingError::OffTable { found_m });
    }
    let mut demonstration = reach::reach(
        cx.partition().as_str(),
        recording,
        &departure,
        lying.rest,
        config,
    )?;
    let mut after = after_grasp::after(recording, &departure, demonstration.steps.len());
    if recording.hand != config.hand {
        let shape = shapes.iter().find(|shape| shape.name == recording.object);
        let plane = mirror::plane(shape, config.max_mirror_error_m).map_err(|reason| {
            RecordingError::NotMirrored {
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
    let is_mesh = |file: &&SourceFile| [MODELS, MESHES].iter().any(|f| file.name.starts_with(f));
    let file = files.iter().find(is_mesh)?;
    let bytes = reader::read(file, MAX_MESH_BYTES).ok()?;
    let (mesh, _) = object_shapes::mesh(&file.name, &bytes).ok()?;
    Some(mesh)
}

/// Puts a shape and the orientations in which it was seen to lie together.
pub(super) fn object(
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<ShapeMetrics>, BoxedDiagnostic> {
    let seen_up = inputs
        .artifacts(Demonstrations::ARTIFACT)
        .iter()
        .map(|artifact| {
            Ok(lake::table::read::<Demonstration>(artifact)?
                .rest
                .up_in_object)
        })
        .collect::<Result<Vec<_>, LakeError>>()?;
    let Some(shape) = inputs.artifacts(Shapes::ARTIFACT).first() else {
        let missing = RecordingError::Missing {
            file: format!("shape of {}", cx.partition()),
        };
        return Ok(Outcome::skipped(missing.to_string()));
    };
    let mut object: Object = lake::table::read(shape)?;
    object.rests = object_shapes::rests(&object, &seen_up);
    let mesh = object_shapes::mesh_of(&object);
    write_object(cx, &object, &mesh, Repairs::default())
}

/// Writes an object's table, its mesh and its surface.
fn write_object(
    cx: &Context,
    object: &Object,
    mesh: &TriMesh,
    repairs: Repairs,
) -> Result<Outcome<ShapeMetrics>, BoxedDiagnostic> {
    cx.write(object)?;
    cx.write(&Surface::from(object))?;
    cx.write_file(schemas::objects::MESH, mesh.to_obj().as_bytes())?;
    let mended = |n: usize| (n > 0).then_some(n as f64);
    let metrics = ShapeMetrics {
        convex_parts_n: object.parts_m.len() as f64,
        rests_n: object.rests.len() as f64,
        watertight: f64::from(u8::from(object.watertight)),
        unused_vertices_n: mended(repairs.unused_vertices_n),
        turned_triangles_n: mended(repairs.turned_triangles_n),
    };
    Ok(Outcome::Made(metrics))
}
