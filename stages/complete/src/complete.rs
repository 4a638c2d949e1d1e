//! The shape of one object.

use completion::{CompletedShape, Observation, complete};
use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, OptionsUsed, Outcome, Output, Outputs, Scope, Stage, Sum,
    Unit,
};
use lake::{SiblingTable, WriteArtifact};
use nalgebra::{Point3, Vector3};
use schemas::{
    Table,
    completions::CompletedObject,
    objects::{MESH, Object, RestingOrientation, Surface},
    views::Views,
};
use spatial::RestingPose;

use crate::{CompleteConfig, fields::DistanceFields};

/// Least and greatest mass of an estimated object, in kilograms.
const MASSES_KG: [f64; 2] = [0.02, 1.2];

/// Estimates objects from views.
pub struct Complete;

dataflow::metrics! {
    /// Metrics of an estimated object.
    pub struct CompleteMetrics {
        /// Number of points that views show.
        seen_n: Sum,
        /// 1 if a symmetry completed it.
        symmetric: Mean,
        /// Processor time from depth images to the closed surface, in seconds.
        surface_cpu_s: Mean,
        /// Processor time from there to points, convex parts and mass, in seconds.
        parts_cpu_s: Mean,
    }
}

lake::inputs! {
    /// What a unit reads: an object's views.
    pub struct CompleteInputs {
        /// The views.
        each views: Views, "to complete";
    }
}

impl Stage for Complete {
    type Config = CompleteConfig;

    const KIND: &'static str = "complete";
    const ABOUT: &'static str = "Estimates closed shapes of objects from depth images";
    const INPUTS: &'static [&'static str] = CompleteInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[
        &Self,
        &SiblingTable::<Self, CompletedObject>::OUTPUT,
        &DistanceFields,
    ];
}

impl Output for Complete {
    type Stage = Self;
    type Metrics = CompleteMetrics;
    type Inputs<'a> = CompleteInputs;

    const ARTIFACT: &'static str = Object::NAME;
    const SCHEMA: &'static str = Object::VERSION;
    const PARTITION: &'static str = Object::PARTITION;
    const LINE: Option<Line<CompleteMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        format!(
            "{} objects estimated, {:.0} % by a symmetry, in {:.0} ms each",
            summary.n_made,
            100.0 * metrics.symmetric,
            1000.0 * (metrics.surface_cpu_s + metrics.parts_cpu_s)
        )
    });
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["field_spacing_m"]);

    fn units(_config: &CompleteConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(CompleteInputs::units(scope, &[])?)
    }

    fn make(
        config: &CompleteConfig,
        CompleteInputs { views }: CompleteInputs,
        cx: &Context,
    ) -> Result<Outcome<CompleteMetrics>, BoxedDiagnostic> {
        let images = stored_views::all(&views);
        let (images, table) = images.map_err(BoxedDiagnostic::without_hint)?;
        let (shape, surface_cpu_s) = cpu_time::measured(|| {
            let observation = Observation::new(&images, table)?;
            complete(&observation, config.completion)
        });
        let shape: CompletedShape = match shape {
            Ok(shape) => shape,
            Err(err) => return Ok(Outcome::skipped(err.reason())),
        };
        let (object, parts_cpu_s) = cpu_time::measured(|| estimated(config, &shape, cx));
        let object = match object {
            Ok(object) => object,
            Err(err) => return Ok(Outcome::skipped(format!("its estimated shape: {err}"))),
        };
        let observation = &shape.observation;
        let completion = CompletedObject {
            world_from_object: observation.world_from_object,
            views_n: i64::try_from(views.len()).unwrap_or(i64::MAX),
            seen_m: observation
                .points
                .iter()
                .map(|&point| point.into())
                .collect(),
            seen_normals: observation
                .normals
                .iter()
                .map(|&normal| normal.into())
                .collect(),
            unseen_m: observation.unseen_m(object.points_m.iter().map(|&point| point.into())),
            symmetric: shape.is_symmetric,
            free_share: shape.free_share,
        };
        let metrics = CompleteMetrics {
            seen_n: observation.points.len() as f64,
            symmetric: f64::from(u8::from(shape.is_symmetric)),
            surface_cpu_s,
            parts_cpu_s,
        };
        cx.write(&object)?;
        cx.write(&Surface::from(&object))?;
        cx.write(&completion)?;
        cx.write_file(MESH, shape.mesh.to_obj().as_bytes())?;
        Ok(Outcome::Made(metrics))
    }
}

/// Returns the estimated object, at rest as it was seen.
fn estimated(
    config: &CompleteConfig,
    shape: &CompletedShape,
    cx: &Context,
) -> Result<Object, geometry::GeometryError> {
    let mass_kg = config.density_kg_per_m3 * shape.mesh.volume_m3();
    let mesh = &shape.mesh;
    let mass = geometry::mass_properties(mesh, mass_kg.clamp(MASSES_KG[0], MASSES_KG[1]));
    let (points, normals) = mesh.sample_surface(config.points_n, cx.seed());
    let parts = geometry::coarse_parts(mesh, config.max_convex_parts_n)?;
    let (low, _) = mesh.bounds();
    let inertia = mass.inertia_kg_m2;
    Ok(Object {
        name: cx.partition().to_string(),
        mass_kg: mass.mass_kg,
        center_of_mass_m: mass.center_of_mass_m.into(),
        inertia_kg_m2: [
            inertia.m11,
            inertia.m22,
            inertia.m33,
            inertia.m12,
            inertia.m13,
            inertia.m23,
        ],
        points_m: arrays(&points),
        normals: normals.into_iter().map(Into::into).collect(),
        watertight: mesh.is_watertight(),
        mirror: None,
        vertices_m: arrays(&mesh.vertices_m),
        triangles: mesh.triangles.clone(),
        parts_m: parts.iter().map(|part| arrays(part)).collect(),
        rests: vec![RestingOrientation {
            rest: RestingPose {
                up_in_object: Vector3::z_axis(),
                // The lowest point is on the table.
                height_m: -low.z,
            },
            seen_n: 1,
            probability: 1.0,
        }],
    })
}

fn arrays(points: &[Point3<f64>]) -> Vec<[f64; 3]> {
    points.iter().map(|&point| point.into()).collect()
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, path::Path};

    use dataflow::{Artifact, Inputs};
    use depth_view::{Intrinsics, RenderedObject, looking_at, render};
    use geometry::solid::{loft, rounded_rectangle};
    use schemas::views::View;
    use spatial::Pose;

    use super::*;

    fn artifact(folder: &Path, file: &str) -> Artifact {
        Artifact {
            key: "carton".parse().unwrap(),
            labels: BTreeMap::new(),
            files: [(file.to_owned(), folder.join(file))].into(),
        }
    }

    /// An image of a standing carton of 4 by 6 by 16 cm.
    fn view() -> View {
        let section = |z: f64| rounded_rectangle(0.02, 0.03, 0.003, z);
        let mesh = loft(&[section(0.0), section(0.16)]);
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::from_parts(
                [0.3, 0.1, 0.0],
                nalgebra::UnitQuaternion::identity(),
            ),
        };
        let camera = looking_at(Point3::new(0.7, 0.3, 0.5), Point3::new(0.3, 0.1, 0.08));
        let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera).view;
        stored_views::stored("carton-0".to_owned(), &rendered, stored_views::DEPTH_STEP_M)
    }

    fn run(views: &Views, out: &Path) -> Outcome<CompleteMetrics> {
        let folder = tempfile::tempdir().unwrap();
        lake::table::write(folder.path(), views).unwrap();
        let given = vec![artifact(folder.path(), lake::table::FILE)];
        let inputs = Inputs::new(
            BTreeMap::from([(Views::NAME.to_owned(), given)]),
            Vec::new(),
        );
        let cx = Context::detached(&"carton".parse().unwrap(), 0, out);
        Complete::read_and_make(&CompleteConfig::default(), &inputs, &cx).unwrap()
    }

    #[test]
    fn an_object_is_estimated_as_it_stands() {
        let out = tempfile::tempdir().unwrap();
        assert!(matches!(run(&vec![view()], out.path()), Outcome::Made(_)));
        let object: Object = lake::table::read(&artifact(out.path(), lake::table::FILE)).unwrap();
        // 0.38 l of the density of water, by chance and errors of a fifth.
        assert!(
            (object.mass_kg / 0.384 - 1.0).abs() < 0.2,
            "{}",
            object.mass_kg
        );
        let [rest] = &object.rests[..] else {
            panic!("{:?}", object.rests);
        };
        assert!(rest.rest.up_in_object.z == 1.0 && rest.rest.height_m.abs() < 1e-3);
        let completion: CompletedObject =
            lake::table::read(&artifact(out.path(), CompletedObject::FILE)).unwrap();
        let at = completion.world_from_object.translation.vector;
        assert!((at - Vector3::new(0.3, 0.1, 0.0)).norm() < 0.005, "{at}");
        // A half of it is not seen, and as far from what is seen as it is wide.
        assert_eq!(completion.unseen_m.len(), object.points_m.len());
        let farthest_m = completion.unseen_m.iter().copied().fold(0.0, f64::max);
        assert!((0.02..0.08).contains(&farthest_m), "{farthest_m}");
    }

    #[test]
    fn a_view_without_object_or_table_is_skipped_with_its_reason() {
        let out = tempfile::tempdir().unwrap();
        let reason = |view: View| match run(&vec![view], out.path()) {
            Outcome::Skipped { reason } => reason,
            other => panic!("{other:?}"),
        };
        let unmasked = View {
            mask: vec![640 * 480],
            ..view()
        };
        assert!(reason(unmasked).contains("points of the object"));
        let mut alone = view();
        let mask = alone.pixels().unwrap();
        for (depth, own) in alone.depth.iter_mut().zip(mask) {
            *depth *= i64::from(own);
        }
        assert!(reason(alone).contains("give `table`"));
    }
}
