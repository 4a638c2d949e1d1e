//! The pose of one object.

use completion::Observation;
use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, Outcome, Output, Outputs, Scope, Stage, Unit,
};
use depth_view::{DepthView, TablePlane};
use geometry::TriMesh;
use lake::{SiblingTable, WriteArtifact};
use nalgebra::{Point3, Vector3};
use registration::{
    KnownShape, Registration, RegistrationError, RegistrationOptions, mean_surface_distance_m,
    register,
};
use schemas::{
    Table,
    completions::CompletedObject,
    objects::{MESH, Object, RestingOrientation, Surface},
    views::Views,
};
use spatial::{Object as InObject, Pose, RestingPose, World};

use crate::RegisterConfig;

/// Finds objects in views.
pub struct Register;

dataflow::metrics! {
    /// Metrics of an object's pose.
    pub struct RegisterMetrics {
        /// Root mean square distance between the seen points and the surface, in meters.
        residual_m: Mean,
        /// Share of the seen points that lie on the surface.
        explained_share: Mean,
        /// Share of the surface that lies where a camera saw free space.
        free_share: Mean,
        /// Residual of the best pose with the surface elsewhere, relative to that of the best pose, if there is such a pose.
        runner_up_ratio: Option<Mean>,
        /// Angle between the object's vertical and that of the nearest known resting orientation, in radians.
        tilt_rad: Mean,
        /// Mean distance between the surface in the found and in the true pose, if it is known, in meters.
        surface_error_m: Option<Mean>,
        /// Distance between the middles of the object in both, in meters.
        position_error_m: Option<Mean>,
    }
}

lake::inputs! {
    /// What a unit reads: an object's views, and its shape.
    pub struct RegisterInputs {
        /// The views.
        each views: Views, "to register";
        /// The object.
        own object: Object, or "object has no mesh";
    }
}

impl Stage for Register {
    type Config = RegisterConfig;

    const KIND: &'static str = "register";
    const ABOUT: &'static str = "Finds the poses of objects of known shape in depth images";
    const INPUTS: &'static [&'static str] = RegisterInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, CompletedObject>::OUTPUT];
}

impl Output for Register {
    type Stage = Self;
    type Metrics = RegisterMetrics;
    type Inputs<'a> = RegisterInputs;

    const ARTIFACT: &'static str = Object::NAME;
    const SCHEMA: &'static str = Object::VERSION;
    const PARTITION: &'static str = Object::PARTITION;
    const LINE: Option<Line<RegisterMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let residual_mm = 1e3 * metrics.residual_m;
        let found = format!(
            "{} objects found, residual {residual_mm:.1} mm",
            summary.n_made
        );
        match metrics.surface_error_m {
            Some(error_m) => format!("{found}, off by {:.1} mm", 1e3 * error_m),
            None => found,
        }
    });

    fn units(_config: &RegisterConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(RegisterInputs::units(scope, &[])?)
    }

    fn make(
        config: &RegisterConfig,
        RegisterInputs { views, object }: RegisterInputs,
        cx: &Context,
    ) -> Result<Outcome<RegisterMetrics>, BoxedDiagnostic> {
        let images = stored_views::all(&views);
        let (images, table) = images.map_err(BoxedDiagnostic::without_hint)?;
        let mesh = object_shapes::mesh_of(&object);
        let rests: Vec<RestingPose> = object.rests.iter().map(|rest| rest.rest).collect();
        let found = found(&config.registration, &mesh, &rests, &images, table);
        let (observation, registration) = match found {
            Ok(found) => found,
            Err(reason) => return Ok(Outcome::skipped(reason)),
        };
        let truth = views
            .first()
            .and_then(|view| view.world_from_object.first());
        let errors = truth.map(|truth| Errors::of(&registration, &mesh, truth));
        let metrics = metrics(&registration, &rests, errors.as_ref());
        let completion = completion(&object, &observation, &registration, views.len());
        let object = Object {
            rests: vec![RestingOrientation {
                rest: registration.rest,
                seen_n: 1,
                probability: 1.0,
            }],
            ..object
        };
        cx.write(&object)?;
        cx.write(&Surface::from(&object))?;
        cx.write(&completion)?;
        cx.write_file(MESH, mesh.to_obj().as_bytes())?;
        Ok(Outcome::Made(metrics))
    }
}

/// Finds an object; the reason if it is not found.
fn found(
    options: &RegistrationOptions,
    mesh: &TriMesh,
    rests: &[RestingPose],
    images: &[DepthView],
    table: Option<TablePlane>,
) -> Result<(Observation, Registration), String> {
    let observation = Observation::new(images, table).map_err(|err| err.reason())?;
    let shape = KnownShape::new(mesh, rests).map_err(|err| refused(&err))?;
    let registration = register(&shape, &observation, options).map_err(|err| refused(&err))?;
    Ok((observation, registration))
}

/// Returns why an object is not found, with what to do.
fn refused(err: &RegistrationError) -> String {
    match err {
        RegistrationError::PoorFit { .. } => format!(
            "{err}; check that the mask shows this object alone, lying as one of its `rests` says, or raise \
             `explained_m` for a camera with larger errors"
        ),
        RegistrationError::Ambiguous { .. } => {
            format!("{err}; give another view, or set `ambiguous = \"best\"`")
        }
        _ => err.to_string(),
    }
}

/// How far a pose is from the true one, in meters.
struct Errors {
    surface_m: f64,
    position_m: f64,
}

impl Errors {
    fn of(registration: &Registration, mesh: &TriMesh, truth: &Pose<World, InObject>) -> Self {
        let pose = &registration.best.world_from_object;
        let (low, high) = mesh.bounds();
        let middle = nalgebra::center(&low, &high);
        Self {
            surface_m: mean_surface_distance_m(mesh, pose, truth),
            position_m: (*pose * middle - *truth * middle).norm(),
        }
    }
}

fn metrics(
    registration: &Registration,
    rests: &[RestingPose],
    errors: Option<&Errors>,
) -> RegisterMetrics {
    let score = &registration.best.score;
    let up = registration.rest.up_in_object;
    let nearest = registration.rest.nearest(rests.iter().copied());
    let other = registration.runner_up;
    RegisterMetrics {
        residual_m: score.distance_m,
        explained_share: score.explained_share,
        free_share: score.free_share,
        runner_up_ratio: other.map(|(other, _)| other.score.residual_m / score.residual_m),
        tilt_rad: nearest.map_or(0.0, |(_, rest)| rest.up_in_object.angle(&up)),
        surface_error_m: errors.map(|errors| errors.surface_m),
        position_error_m: errors.map(|errors| errors.position_m),
    }
}

/// Returns what is seen of an object, in the frame of its mesh.
fn completion(
    object: &Object,
    observation: &Observation,
    registration: &Registration,
    views_n: usize,
) -> CompletedObject {
    let world_from_object = registration.best.world_from_object;
    // The observation's frame is of the views alone.
    let object_from_seen: Pose<InObject, InObject> =
        world_from_object.inv_mul(&observation.world_from_object);
    let seen_from_object = object_from_seen.inverse();
    let points = observation.points.iter();
    let normals = observation.normals.iter();
    let own = object.points_m.iter().map(|&point| Point3::from(point));
    CompletedObject {
        world_from_object,
        views_n: i64::try_from(views_n).unwrap_or(i64::MAX),
        seen_m: points
            .map(|&point| (object_from_seen * point).into())
            .collect(),
        seen_normals: normals
            .map(|&normal: &Vector3<f64>| (object_from_seen * normal).into())
            .collect(),
        unseen_m: observation.unseen_m(own.map(|point| seen_from_object * point)),
        symmetric: false,
        free_share: 0.0,
    }
}

#[cfg(test)]
mod tests;
