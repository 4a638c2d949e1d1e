//! Poses of known shapes in rendered depth images, with and without the errors of a stereo camera.

#![expect(clippy::unwrap_used, reason = "a test may break off")]

use std::f64::consts::{FRAC_PI_2, PI};

use completion::Observation;
use depth_view::{DepthView, Intrinsics, RenderedObject, StereoNoise, looking_at, render};
use geometry::{
    TriMesh,
    solid::{ellipse, level_set, loft, rounded_box, rounded_rectangle, tapered},
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use registration::{
    Ambiguous, Freedom, KnownShape, Registration, RegistrationError, RegistrationOptions,
    mean_surface_distance_m, register,
};
use spatial::{Object, Pose, RestingPose, World};

/// A box with three different sides, about the origin.
fn carton() -> TriMesh {
    loft(&[-0.07, 0.07].map(|z| rounded_rectangle(0.025, 0.04, 0.003, z)))
}

/// A standing can.
fn can() -> TriMesh {
    loft(&[-0.05, 0.05].map(|z| ellipse(0.033, 0.033, 2.0, z, 64)))
}

/// An L of two bars, which no turn maps to itself.
fn angle_bracket() -> TriMesh {
    let distance_m = |point: &Point3<f64>| {
        let long = rounded_box(
            &(point - Vector3::new(0.0, 0.03, 0.0)),
            Vector3::new(0.02, 0.07, 0.025),
            0.003,
        );
        let short = rounded_box(
            &(point - Vector3::new(0.03, -0.02, 0.0)),
            Vector3::new(0.05, 0.02, 0.025),
            0.003,
        );
        long.min(short)
    };
    let corner = Point3::new(0.1, 0.12, 0.04);
    level_set(distance_m, -corner, corner, 0.003)
}

/// A closed cup with a handle along x.
fn mug() -> TriMesh {
    let distance_m = |point: &Point3<f64>| {
        let radius_m = point.x.hypot(point.y);
        let cup = (radius_m - 0.04).max(point.z.abs() - 0.045);
        let [low, high] = [-0.022, 0.022].map(|z| [0.036, 0.07].map(|x| Point3::new(x, 0.0, z)));
        let bars = [[low[0], low[1]], [low[1], high[1]], [high[1], high[0]]];
        let handle = bars.map(|[from, to]| tapered(point, from, to, 0.006, 0.006));
        handle.into_iter().fold(cup, f64::min)
    };
    let corner = Point3::new(0.09, 0.06, 0.06);
    level_set(distance_m, -corner, corner, 0.003)
}

/// The orientations in which a mesh rests.
fn rests(mesh: &TriMesh) -> Vec<RestingPose> {
    let mass = geometry::mass_properties(mesh, 0.3);
    let rests = geometry::stable_rests(mesh, &mass.center_of_mass_m);
    rests.into_iter().map(|stable| stable.rest).collect()
}

/// Puts a mesh on the table in its first resting orientation with z up, turned and off the middle.
fn placed(rests: &[RestingPose], yaw_rad: f64) -> Pose<World, Object> {
    let upright = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: 0.0,
    };
    let (_, rest) = upright.nearest(rests.iter().copied()).unwrap();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    let on_table = Isometry3::from_parts([0.03, -0.02, 0.0].into(), turn);
    Pose::new(on_table * *rest.table_from_object())
}

/// Looks at a mesh from an azimuth, 40 degrees above the table.
fn seen(
    mesh: &TriMesh,
    pose: Pose<World, Object>,
    azimuth_rad: f64,
    noise: &StereoNoise,
) -> DepthView {
    let object = RenderedObject {
        mesh,
        world_from_object: pose,
    };
    let elevation_rad = 40.0_f64.to_radians();
    let level = Vector3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0) * elevation_rad.cos();
    let target = Point3::new(0.0, 0.0, 0.05);
    let eye = target + (level + Vector3::z() * elevation_rad.sin()) * 0.6;
    let camera = looking_at(eye, target);
    let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera);
    noise.measured(&rendered, 5)
}

fn exact() -> StereoNoise {
    StereoNoise {
        level: 0.0,
        ..StereoNoise::default()
    }
}

fn registered(
    mesh: &TriMesh,
    views: &[DepthView],
    options: &RegistrationOptions,
) -> Result<Registration, RegistrationError> {
    let shape = KnownShape::new(mesh, &rests(mesh)).unwrap();
    register(&shape, &Observation::new(views, None).unwrap(), options)
}

#[test]
fn poses_are_found_with_and_without_noise() {
    let options = RegistrationOptions::default();
    for mesh in [carton(), can(), angle_bracket(), mug()] {
        let rests = rests(&mesh);
        for (yaw_rad, noise) in [
            (0.3, exact()),
            (0.3, StereoNoise::default()),
            (2.2, exact()),
        ] {
            let truth = placed(&rests, yaw_rad);
            let view = seen(&mesh, truth, 0.5, &noise);
            let found = registered(&mesh, &[view], &options).unwrap();
            let pose = found.best.world_from_object;
            let off_m = mean_surface_distance_m(&mesh, &pose, &truth);
            assert!(off_m < 0.001, "{off_m} {found:?}");
            assert!(found.best.score.explained_share > 0.98, "{found:?}");
        }
    }
}

#[test]
fn an_asymmetric_object_is_found_to_a_few_degrees() {
    let mesh = angle_bracket();
    let rests = rests(&mesh);
    for freedom in [Freedom::Table, Freedom::All] {
        let options = RegistrationOptions {
            freedom,
            ..RegistrationOptions::default()
        };
        for azimuth_rad in [0.0, 2.0, 4.0] {
            let truth = placed(&rests, 1.1);
            let view = seen(&mesh, truth, azimuth_rad, &StereoNoise::default());
            let found = registered(&mesh, &[view], &options).unwrap();
            let found_from_true = found.best.world_from_object.inv_mul(&truth);
            assert!(found_from_true.rotation.angle() < 0.02, "{found:?}");
            assert!(
                found_from_true.translation.vector.norm() < 0.002,
                "{found:?}"
            );
            // It rests as it lies.
            let lies = RestingPose::of(&truth.reinterpret());
            assert!(found.rest.up_in_object.angle(&lies.up_in_object) < 0.02);
            assert!((found.rest.height_m - lies.height_m).abs() < 0.002);
        }
    }
}

#[test]
fn a_tilted_table_in_a_cameras_frame_is_no_trouble() {
    let mesh = carton();
    let truth = placed(&rests(&mesh), 0.8);
    let mut view = seen(&mesh, truth, 0.0, &StereoNoise::default());
    // Nothing is known of the camera: its frame is the world.
    let camera_from_world = view.world_from_camera.inverse();
    view.world_from_camera = Pose::identity();
    let found = registered(&mesh, &[view], &RegistrationOptions::default()).unwrap();
    let truth: Pose<World, Object> = (camera_from_world * truth).reinterpret();
    let off_m = mean_surface_distance_m(&mesh, &found.best.world_from_object, &truth);
    assert!(off_m < 0.001, "{off_m}");
    assert!((found.rest.height_m - 0.07).abs() < 0.002, "{found:?}");
}

#[test]
fn a_hidden_handle_is_ambiguous_until_another_view_shows_it() {
    let mesh = mug();
    let truth = placed(&rests(&mesh), 0.0);
    // The handle points away from the camera, and then to its side.
    let behind = seen(&mesh, truth, PI, &StereoNoise::default());
    let beside = seen(&mesh, truth, FRAC_PI_2, &StereoNoise::default());
    let options = RegistrationOptions::default();
    let one = std::slice::from_ref(&behind);
    let refused = registered(&mesh, one, &options).unwrap_err();
    let RegistrationError::Ambiguous {
        best_mm, other_mm, ..
    } = refused
    else {
        panic!("{refused}");
    };
    assert!(best_mm <= other_mm && other_mm < 1.1 * best_mm, "{refused}");
    let best = RegistrationOptions {
        ambiguous: Ambiguous::Best,
        ..options.clone()
    };
    assert!(registered(&mesh, one, &best).is_ok());
    let found = registered(&mesh, &[behind, beside], &options).unwrap();
    let off_m = mean_surface_distance_m(&mesh, &found.best.world_from_object, &truth);
    assert!(off_m < 0.001, "{off_m}");
}

#[test]
fn another_mesh_is_refused() {
    let meshes = [carton(), can(), angle_bracket(), mug()];
    for (seen_idx, shown) in meshes.iter().enumerate() {
        let view = seen(
            shown,
            placed(&rests(shown), 0.4),
            0.5,
            &StereoNoise::default(),
        );
        for (idx, mesh) in meshes.iter().enumerate() {
            if idx != seen_idx {
                let found = registered(
                    mesh,
                    std::slice::from_ref(&view),
                    &RegistrationOptions::default(),
                );
                assert!(
                    matches!(found, Err(RegistrationError::PoorFit { .. })),
                    "{idx} in {seen_idx}: {found:?}"
                );
            }
        }
    }
}

#[test]
fn equal_images_give_equal_poses_and_a_shape_needs_a_rest_and_a_surface() {
    let mesh = carton();
    let view = seen(
        &mesh,
        placed(&rests(&mesh), 0.4),
        0.5,
        &StereoNoise::default(),
    );
    let again = || {
        registered(
            &mesh,
            std::slice::from_ref(&view),
            &RegistrationOptions::default(),
        )
    };
    assert_eq!(again(), again());
    let none = KnownShape::new(&mesh, &[]).err();
    assert_eq!(none, Some(RegistrationError::NoRest));
    let empty = TriMesh {
        vertices_m: Vec::new(),
        triangles: Vec::new(),
    };
    let empty = KnownShape::new(&empty, &rests(&mesh)).err();
    assert_eq!(empty, Some(RegistrationError::NoSurface));
}
