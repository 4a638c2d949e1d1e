//! A carton, seen once by a camera.

use std::{collections::BTreeMap, path::Path};

use dataflow::{Artifact, Inputs};
use depth_view::{Intrinsics, RenderedObject, looking_at, render};
use geometry::solid::{loft, rounded_rectangle};
use nalgebra::UnitQuaternion;
use object_shapes::{MeshedObject, ShapeOptions};
use schemas::views::View;

use super::*;

fn artifact(folder: &Path, file: &str) -> Artifact {
    Artifact {
        key: "carton".parse().unwrap(),
        labels: BTreeMap::new(),
        files: [(file.to_owned(), folder.join(file))].into(),
    }
}

fn given<T: Table>(folder: &Path, table: &T) -> (String, Vec<Artifact>) {
    let folder = folder.join(T::NAME);
    std::fs::create_dir(&folder).unwrap();
    lake::table::write(&folder, table).unwrap();
    (T::NAME.to_owned(), vec![artifact(&folder, T::FILE)])
}

/// A carton of 4 by 6 cm, half as high as given, about the origin.
fn mesh(half_m: f64) -> TriMesh {
    let section = |z: f64| rounded_rectangle(0.02, 0.03, 0.003, z);
    loft(&[section(-half_m), section(half_m)])
}

fn carton(half_m: f64) -> Object {
    let carton = MeshedObject {
        name: "carton",
        mass_kg: 0.2,
        mesh: &mesh(half_m),
        options: &ShapeOptions {
            points_n: 256,
            max_convex_parts_n: 1,
            part_tolerance_m: 0.0,
        },
        seed: 1,
    };
    carton.unseen().unwrap()
}

/// The carton of 16 cm stands on its end.
fn truth() -> Pose<World, InObject> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.6);
    Pose::from_parts([0.3, 0.1, 0.08], turn)
}

fn view(world_from_object: Vec<Pose<World, InObject>>) -> View {
    let object = RenderedObject {
        mesh: &mesh(0.08),
        world_from_object: truth(),
    };
    let camera = looking_at(Point3::new(0.7, 0.3, 0.5), Point3::new(0.3, 0.1, 0.08));
    let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera).view;
    View {
        world_from_object,
        ..stored_views::stored("carton-0".to_owned(), &rendered, stored_views::DEPTH_STEP_M)
    }
}

/// Registers an object in a view; its reason if it is skipped.
fn run(object: Option<Object>, view: View, out: &Path) -> Result<RegisterMetrics, String> {
    let folder = tempfile::tempdir().unwrap();
    let mut inputs = BTreeMap::from([given(folder.path(), &vec![view])]);
    inputs.extend(object.map(|object| given(folder.path(), &object)));
    let inputs = Inputs::new(inputs, Vec::new());
    let cx = Context::detached(&"carton".parse().unwrap(), 0, out);
    let config = RegisterConfig {
        registration: RegistrationOptions::default(),
    };
    match Register::read_and_make(&config, &inputs, &cx).unwrap() {
        Outcome::Made(metrics) => Ok(metrics),
        Outcome::Skipped { reason } => Err(reason),
        other => panic!("{other:?}"),
    }
}

#[test]
fn an_object_rests_where_and_as_it_was_seen() {
    let out = tempfile::tempdir().unwrap();
    let given = carton(0.08);
    assert!(given.rests.len() > 1);
    let metrics = run(Some(given.clone()), view(vec![truth()]), out.path()).unwrap();
    let surface_error_m = metrics.surface_error_m.unwrap();
    assert!(surface_error_m < 0.001, "{metrics:?}");
    assert!(metrics.tilt_rad < 0.01 && metrics.position_error_m.unwrap() < 0.001);

    let object: Object = lake::table::read(&artifact(out.path(), lake::table::FILE)).unwrap();
    let [rest] = &object.rests[..] else {
        panic!("{:?}", object.rests);
    };
    assert!(rest.seen_n == 1 && rest.rest.up_in_object.z.abs() > 0.999);
    assert!((rest.rest.height_m - 0.08).abs() < 0.001);
    assert_eq!(
        (object.vertices_m, object.parts_m),
        (given.vertices_m, given.parts_m)
    );

    let completion: CompletedObject =
        lake::table::read(&artifact(out.path(), CompletedObject::FILE)).unwrap();
    let mesh = mesh(0.08);
    let off_m = mean_surface_distance_m(&mesh, &completion.world_from_object, &truth());
    assert!((off_m - surface_error_m).abs() < 1e-9);
    // What is seen lies on the mesh, in its own frame; what is on the far side is not seen.
    let surface = geometry::SurfaceDistance::new(&mesh);
    let seen = completion.seen_m.iter().map(|&point| {
        let nearest = surface.signed_distance(&point.into());
        nearest.distance_m.abs()
    });
    assert!(seen.fold(0.0, f64::max) < 0.004);
    assert_eq!(completion.unseen_m.len(), object.points_m.len());
    let farthest_m = completion.unseen_m.iter().copied().fold(0.0, f64::max);
    assert!((0.02..0.08).contains(&farthest_m), "{farthest_m}");
}

#[test]
fn without_a_true_pose_there_is_no_error() {
    let out = tempfile::tempdir().unwrap();
    let metrics = run(Some(carton(0.08)), view(Vec::new()), out.path()).unwrap();
    assert_eq!(
        (metrics.surface_error_m, metrics.position_error_m),
        (None, None)
    );
}

#[test]
fn what_is_not_found_is_skipped_with_its_reason() {
    let out = tempfile::tempdir().unwrap();
    let reason = |object: Option<Object>, view: View| run(object, view, out.path()).unwrap_err();
    assert_eq!(reason(None, view(Vec::new())), "object has no mesh");
    let wrong = reason(Some(carton(0.05)), view(Vec::new()));
    assert!(
        wrong.contains("no pose fits") && wrong.contains("check that the mask"),
        "{wrong}"
    );
    let mut alone = view(Vec::new());
    let mask = alone.pixels().unwrap();
    for (depth, own) in alone.depth.iter_mut().zip(mask) {
        *depth *= i64::from(own);
    }
    assert!(reason(Some(carton(0.08)), alone).contains("give `table`"));
    let mut nowhere = carton(0.08);
    nowhere.rests.clear();
    assert!(reason(Some(nowhere), view(Vec::new())).contains("no resting orientation"));
}
