//! The stage: one unit per object.

use std::f64::consts::TAU;

use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, Outcome, Output, Outputs, Scope, Stage, Sum, Unit,
};
use depth_view::{DepthView, Intrinsics, RenderedObject, looking_at, render};
use lake::WriteArtifact;
use nalgebra::{Isometry3, Point3, UnitQuaternion, UnitVector3, Vector3};
use rand::{Rng, SeedableRng, distr::weighted::WeightedIndex};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use schemas::{
    Table,
    objects::{Object, RestingOrientation},
    views::{View, Views},
};
use spatial::{Camera, Object as InObject, Pose, RestingPose, World};

use crate::CameraConfig;

/// Draws of a camera's pose until it sees the object whole.
const DRAWS: usize = 20;

/// Takes depth images of objects.
pub struct SimulatedCamera;

dataflow::metrics! {
    /// Metrics of an object's images.
    pub struct CameraMetrics {
        /// Number of images.
        views_n: Sum,
        /// Share of the object's pixels that have a depth.
        measured_share: Mean,
    }
}

lake::inputs! {
    /// What a unit reads: an object.
    pub struct CameraInputs {
        /// The object.
        each object: Object, "to look at";
    }
}

impl Stage for SimulatedCamera {
    type Config = CameraConfig;

    const KIND: &'static str = "camera";
    const ABOUT: &'static str = "Takes depth images of objects by a simulated stereo camera";
    const INPUTS: &'static [&'static str] = CameraInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for SimulatedCamera {
    type Stage = Self;
    type Metrics = CameraMetrics;
    type Inputs<'a> = CameraInputs;

    const ARTIFACT: &'static str = Views::NAME;
    const SCHEMA: &'static str = Views::VERSION;
    const PARTITION: &'static str = Views::PARTITION;
    const LINE: Option<Line<CameraMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let (views_n, share) = (metrics.views_n, 100.0 * metrics.measured_share);
        format!(
            "{} objects → {views_n} depth images, {share:.0} % of the objects' pixels measured",
            summary.n_made
        )
    });

    fn units(_config: &CameraConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(CameraInputs::units(scope, &[])?)
    }

    fn make(
        config: &CameraConfig,
        CameraInputs { object }: CameraInputs,
        cx: &Context,
    ) -> Result<Outcome<CameraMetrics>, BoxedDiagnostic> {
        let mut random = ChaCha8Rng::seed_from_u64(cx.seed());
        let Some(rest) = rest(&object.rests, &mut random) else {
            return Ok(Outcome::skipped("object rests in no orientation"));
        };
        let mesh = object_shapes::mesh_of(&object);
        let off = [0; 2].map(|_| random.random_range(-1.0..=1.0) * config.off_center_m);
        let turn =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
        let table_from_object = *rest.table_from_object();
        let placed = Isometry3::from_parts([off[0], off[1], 0.0].into(), turn) * table_from_object;
        let rendered = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::<World, InObject>::new(placed),
        };
        let mut views = Views::new();
        let mut measured = Vec::new();
        for number in 0..config.views_n {
            let Some(image) = image(config, &rendered, &mut random) else {
                return Ok(Outcome::skipped(
                    "no camera sees the whole object: it is too large for `distance_m`",
                ));
            };
            let pixels = image
                .mask
                .iter()
                .zip(&image.depth_m)
                .filter(|(own, _)| **own);
            let depths: Vec<f64> = pixels.map(|(_, &depth_m)| depth_m).collect();
            let measured_n = depths.iter().filter(|&&depth_m| depth_m > 0.0).count();
            measured.push(measured_n as f64 / depths.len() as f64);
            views.push(View {
                world_from_object: vec![rendered.world_from_object],
                ..stored_views::stored(
                    format!("{}-{number}", object.name),
                    &image,
                    stored_views::DEPTH_STEP_M,
                )
            });
        }
        cx.write(&views)?;
        Ok(Outcome::Made(CameraMetrics {
            views_n: views.len() as f64,
            measured_share: measured.iter().sum::<f64>() / measured.len() as f64,
        }))
    }
}

/// Draws the orientation in which an object lies: as often as people found it so, or as it is stable.
fn rest(rests: &[RestingOrientation], random: &mut ChaCha8Rng) -> Option<RestingPose> {
    let seen = WeightedIndex::new(rests.iter().map(|rest| f64::from(rest.seen_n)));
    let stable = || WeightedIndex::new(rests.iter().map(|rest| rest.probability));
    let weights = seen.or_else(|_| stable()).ok()?;
    Some(rests[weights.sample(random)].rest)
}

/// Takes an image from a random direction, with the errors of the depths and of the camera's known pose; nothing if the
/// object is cut off from every direction that is drawn.
fn image(
    config: &CameraConfig,
    object: &RenderedObject<'_>,
    random: &mut ChaCha8Rng,
) -> Option<DepthView> {
    let intrinsics = Intrinsics::of_field(config.width, config.height, config.field_of_view_rad);
    let height_m = object.mesh.vertices_m.iter();
    let height_m = height_m.map(|&vertex| (object.world_from_object * vertex).z);
    let target = Point3::new(0.0, 0.0, 0.5 * height_m.fold(0.0, f64::max));
    for _ in 0..DRAWS {
        let azimuth = random.random_range(0.0..TAU);
        let elevation = random.random_range(config.elevation_least_rad..=config.elevation_most_rad);
        let direction = Vector3::new(
            azimuth.cos() * elevation.cos(),
            azimuth.sin() * elevation.cos(),
            elevation.sin(),
        );
        let camera = looking_at(target + direction * config.distance_m, target);
        let rendered = render(object, &intrinsics, &camera);
        let mask = &rendered.view.mask;
        if intrinsics.is_cut_off(mask) || !mask.contains(&true) {
            continue;
        }
        let mut view = config.noise.measured(&rendered, random.random());
        view.world_from_camera = known(config, &camera, random);
        return Some(view);
    }
    None
}

/// Returns a camera's pose as it is known.
fn known(
    config: &CameraConfig,
    camera: &Pose<World, Camera>,
    random: &mut ChaCha8Rng,
) -> Pose<World, Camera> {
    let mut direction = || {
        let numbers = [0; 3].map(|_| random.sample::<f64, _>(StandardNormal));
        UnitVector3::new_normalize(Vector3::from(numbers))
    };
    let off = direction().into_inner() * config.position_error_m;
    let turn = UnitQuaternion::from_axis_angle(&direction(), config.orientation_error_rad);
    Pose::from_parts(camera.translation.vector + off, turn * camera.rotation)
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, path::Path};

    use dataflow::{Artifact, Inputs};
    use geometry::solid::{loft, rounded_rectangle};
    use object_shapes::{MeshedObject, ShapeOptions};

    use super::*;

    fn artifact(folder: &Path) -> Artifact {
        let file = lake::table::FILE;
        Artifact {
            key: "carton".parse().unwrap(),
            labels: BTreeMap::new(),
            files: [(file.to_owned(), folder.join(file))].into(),
        }
    }

    /// Images of a carton whose long side is `half_m` from its middle.
    fn taken(half_m: f64, views_n: usize, seed: u64) -> Result<Views, String> {
        let folder = tempfile::tempdir().unwrap();
        let [given, out] = ["given", "out"].map(|name| folder.path().join(name));
        for folder in [&given, &out] {
            std::fs::create_dir(folder).unwrap();
        }
        let section = |z: f64| rounded_rectangle(0.02, 0.03, 0.003, z);
        let carton = MeshedObject {
            name: "carton",
            mass_kg: 0.2,
            mesh: &loft(&[section(-half_m), section(half_m)]),
            options: &ShapeOptions {
                points_n: 64,
                max_convex_parts_n: 1,
                part_tolerance_m: 0.0,
            },
            seed: 1,
        };
        lake::table::write(&given, &carton.unseen().unwrap()).unwrap();
        let inputs = BTreeMap::from([(Object::NAME.to_owned(), vec![artifact(&given)])]);
        let config = CameraConfig {
            views_n,
            ..CameraConfig::default()
        };
        let cx = Context::detached(&"carton".parse().unwrap(), seed, &out);
        let inputs = Inputs::new(inputs, Vec::new());
        match SimulatedCamera::read_and_make(&config, &inputs, &cx).unwrap() {
            Outcome::Made(_) => Ok(lake::table::read(&artifact(&out)).unwrap()),
            Outcome::Skipped { reason } => Err(reason),
            _ => panic!("neither made nor skipped"),
        }
    }

    #[test]
    fn images_show_the_whole_object_where_it_lies() {
        let views = taken(0.08, 3, 5).unwrap();
        assert_eq!(views.len(), 3);
        for view in &views {
            let (mask, depths_m) = (view.pixels().unwrap(), view.depths_m().unwrap());
            let pixels_n = mask.iter().filter(|own| **own).count();
            assert!((1000..100_000).contains(&pixels_n), "{pixels_n}");
            // The object's origin is half a centimeter to nine below its surface, and in view.
            let in_camera = view.world_from_camera.inv_mul(&view.world_from_object[0]);
            let own = mask.iter().zip(&depths_m).filter(|(own, _)| **own);
            let measured = own
                .map(|(_, depth_m)| *depth_m)
                .filter(|&depth_m| depth_m > 0.0);
            let nearest_m = measured.fold(f64::INFINITY, f64::min);
            let below_m = in_camera.translation.z - nearest_m;
            assert!((0.005..0.09).contains(&below_m), "{below_m}");
        }
        // All of them are of one object that did not move, from different sides.
        assert_eq!(views[0].world_from_object, views[2].world_from_object);
        assert_ne!(views[0].world_from_camera, views[2].world_from_camera);
        // Equal seeds give equal images.
        assert_eq!(taken(0.08, 3, 5).unwrap(), views);
        assert_ne!(taken(0.08, 3, 6).unwrap()[0].depth, views[0].depth);
    }

    #[test]
    fn an_object_that_no_camera_sees_whole_is_skipped() {
        let reason = taken(0.4, 1, 5).unwrap_err();
        assert!(reason.contains("distance_m"), "{reason}");
    }
}
