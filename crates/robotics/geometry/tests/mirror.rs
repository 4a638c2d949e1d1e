//! Mirror planes of shapes whose symmetries are known, and of real objects.

use std::{f64::consts::TAU, fs, time::Instant};

use geometry::{MirrorPlane, TriMesh, mirror_plane};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit, Vector3};

/// Turns and moves a mesh.
fn moved(mesh: &TriMesh, by: &Isometry3<f64>) -> TriMesh {
    TriMesh {
        vertices_m: mesh.vertices_m.iter().map(|at| by * at).collect(),
        triangles: mesh.triangles.clone(),
    }
}

/// A turn and a place that are along no axis.
fn askew() -> Isometry3<f64> {
    let turn = Rotation3::from_euler_angles(0.7, -0.4, 1.9);
    Isometry3::from_parts(Translation3::new(0.03, -0.11, 0.21), turn.into())
}

/// A prism: a polygon in x and y, counterclockwise and star-shaped about its first corner, from
/// −height/2 to height/2.
fn prism(corners: &[(f64, f64)], height: f64) -> TriMesh {
    let n = u32::try_from(corners.len()).unwrap();
    let layer = |z: f64| corners.iter().map(move |&(x, y)| Point3::new(x, y, z));
    let caps = (1..n - 1).flat_map(|k| [[0, k + 1, k], [n, n + k, n + k + 1]]);
    let sides = (0..n).flat_map(|k| {
        let next = (k + 1) % n;
        [[k, next, n + next], [k, n + next, n + k]]
    });
    TriMesh {
        vertices_m: layer(-height / 2.0).chain(layer(height / 2.0)).collect(),
        triangles: caps.chain(sides).collect(),
    }
}

/// An ellipsoid of fine facets about the origin.
fn ellipsoid(axes: [f64; 3]) -> TriMesh {
    let (rings, n) = (60_u32, 120_u32);
    let vertex = |ring: u32, k: u32| {
        let (polar, around) = (
            TAU / 2.0 * f64::from(ring) / f64::from(rings),
            TAU * f64::from(k) / f64::from(n),
        );
        Point3::new(
            axes[0] * polar.sin() * around.cos(),
            axes[1] * polar.sin() * around.sin(),
            axes[2] * polar.cos(),
        )
    };
    TriMesh {
        vertices_m: (0..=rings)
            .flat_map(|ring| (0..n).map(move |k| vertex(ring, k)))
            .collect(),
        triangles: (0..rings)
            .flat_map(|ring| {
                (0..n).flat_map(move |k| {
                    let (here, below) = (ring * n, (ring + 1) * n);
                    let next = (k + 1) % n;
                    [
                        [here + k, below + k, below + next],
                        [here + k, below + next, here + next],
                    ]
                })
            })
            .collect(),
    }
}

/// Checks that the plane of a mesh, turned askew and not, is one of the given ones: a normal and a
/// point on it.
fn check(mesh: &TriMesh, planes: &[(Vector3<f64>, Point3<f64>)], error_m: f64) {
    for by in [Isometry3::identity(), askew()] {
        let plane = mirror_plane(&moved(mesh, &by), 5).unwrap();
        assert!(plane.error_m < error_m, "{plane:?}");
        let is_one = planes.iter().any(|(normal, on)| {
            let normal = by.rotation * normal;
            let away_m = plane.normal.dot(&(by * on).coords) - plane.offset_m;
            plane.normal.cross(&normal).norm() < 2e-3 && away_m.abs() < 1e-4
        });
        assert!(is_one, "{plane:?}");
    }
}

#[test]
fn a_box_and_an_ellipsoid_have_the_planes_across_their_axes() {
    let rectangle = [(-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)];
    let across = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| (axis, Point3::origin()));
    check(&prism(&rectangle, 0.14), &across, 1e-6);
    check(&ellipsoid([0.03, 0.05, 0.08]), &across, 1e-4);
}

#[test]
fn an_l_has_the_plane_through_its_corner_or_across_its_thickness() {
    // Both arms alike: also the diagonal.
    let even = [
        (0.0, 0.0),
        (0.1, 0.0),
        (0.1, 0.02),
        (0.02, 0.02),
        (0.02, 0.1),
        (0.0, 0.1),
    ];
    let flat = (Vector3::z(), Point3::origin());
    let diagonal = (Vector3::new(1.0, -1.0, 0.0).normalize(), Point3::origin());
    check(&prism(&even, 0.03), &[flat, diagonal], 1e-6);
    // One arm longer, and leaning so that only the thickness is left.
    let uneven = [
        (0.0, 0.0),
        (0.1, 0.0),
        (0.1, 0.02),
        (0.02, 0.02),
        (0.02, 0.06),
        (0.0, 0.06),
    ];
    check(&prism(&uneven, 0.03), &[flat], 1e-6);
}

#[test]
fn a_can_has_a_plane_and_it_is_always_the_same() {
    let circle: Vec<(f64, f64)> = (0..90)
        .map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / 90.0).sin_cos();
            (0.033 * cos, 0.033 * sin)
        })
        .collect();
    let can = prism(&circle, 0.1);
    let plane = mirror_plane(&can, 5).unwrap();
    assert!(plane.error_m < 1e-4, "{plane:?}");
    assert_eq!(mirror_plane(&can, 5).unwrap(), plane);
    let other_seed = mirror_plane(&can, 6).unwrap();
    assert!(other_seed.normal.cross(&plane.normal).norm() < 2e-3);
}

#[test]
fn a_small_part_without_counterpart_does_not_turn_the_plane() {
    let kite = [(-0.07, 0.0), (0.03, -0.04), (0.05, 0.0), (0.03, 0.04)];
    let mut mesh = prism(&kite, 0.05);
    // Only y = 0 is left once the top is not the bottom.
    for vertex in &mut mesh.vertices_m[4..] {
        vertex.x *= 0.6;
        vertex.y *= 0.6;
    }
    check(&mesh, &[(Vector3::y(), Point3::origin())], 1e-6);
    let knob = moved(
        &prism(
            &[(0.0, 0.0), (0.006, 0.0), (0.006, 0.006), (0.0, 0.006)],
            0.006,
        ),
        &Isometry3::translation(0.0, 0.03, 0.0),
    );
    let first = u32::try_from(mesh.vertices_m.len()).unwrap();
    mesh.vertices_m.extend(knob.vertices_m);
    mesh.triangles.extend(
        knob.triangles
            .iter()
            .map(|triangle| triangle.map(|idx| first + idx)),
    );
    let plane = mirror_plane(&mesh, 5).unwrap();
    assert!(plane.normal.cross(&Vector3::y()).norm() < 0.01, "{plane:?}");
    assert!(plane.offset_m.abs() < 5e-4, "{plane:?}");
}

#[test]
fn a_shape_without_symmetry_says_so() {
    let skew = TriMesh {
        vertices_m: [
            [0.0, 0.0, 0.0],
            [0.1, 0.01, 0.0],
            [0.02, 0.06, 0.01],
            [0.05, -0.01, 0.13],
        ]
        .map(Point3::from)
        .to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    };
    let plane = mirror_plane(&skew, 5).unwrap();
    assert!(plane.error_m > 3e-3, "{plane:?}");
    let no_area = TriMesh {
        vertices_m: vec![Point3::origin(); 3],
        triangles: vec![[0, 1, 2]],
    };
    assert!(mirror_plane(&no_area, 5).is_none());
}

#[test]
fn reflection_is_its_own_inverse_and_keeps_the_plane() {
    let plane = MirrorPlane {
        normal: Unit::new_normalize(Vector3::new(1.0, 2.0, 2.0)),
        offset_m: 3.0,
        error_m: 0.0,
    };
    // The foot of the origin's perpendicular is (1, 2, 2).
    let image = plane.reflect_point(&Point3::origin());
    assert!((image - Point3::new(2.0, 4.0, 4.0)).norm() < 1e-12);
    assert!(plane.reflect_point(&image).coords.norm() < 1e-12);
    let direction = Vector3::new(1.0, 2.0, 2.0);
    assert!((plane.reflect_direction(&direction) + direction).norm() < 1e-12);
    let along = Vector3::new(0.0, 1.0, -1.0);
    assert!((plane.reflect_direction(&along) - along).norm() < 1e-12);
}

#[test]
fn real_objects_have_planes_and_an_error_that_tells_which_are_good() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    let folder = root.join("models");
    let mut meshes: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    meshes.sort();
    for path in meshes {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let text = fs::read_to_string(path.join("textured_simple.obj")).unwrap();
        let mesh = TriMesh::from_obj(&text).unwrap();
        let start = Instant::now();
        let plane = mirror_plane(&mesh, 5).unwrap();
        let took = start.elapsed();
        let normal = plane.normal.map(|part| (part * 1000.0).round() / 1000.0);
        println!(
            "{name:24} {:6} triangles, error {:5.2} mm, normal {:?}, offset {:7.2} mm, {took:.0?}",
            mesh.triangles.len(),
            plane.error_m * 1e3,
            normal.as_slice(),
            plane.offset_m * 1e3,
        );
        // Each is symmetric by its design, but for the lid of the pitcher.
        let limit_m = if name.contains("pitcher") {
            0.015
        } else {
            0.005
        };
        assert!(plane.error_m < limit_m, "{name}: {plane:?}");
        if name == "025_mug" {
            // The handle is along x.
            assert!(plane.normal.cross(&Vector3::y()).norm() < 0.1, "{plane:?}");
        }
    }
}
