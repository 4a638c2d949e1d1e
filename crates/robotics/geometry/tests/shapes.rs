//! Meshes with closed forms, and properties of what is computed from them.

use std::f64::consts::{PI, TAU};

use geometry::{
    MAX_PART_VERTICES, SurfaceDistance, TriMesh, coarse_parts, convex_parts, mass_properties,
    parts_within, stable_rests,
};
use nalgebra::{Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A box from `low` to `high`.
fn cuboid(low: [f64; 3], high: [f64; 3]) -> TriMesh {
    TriMesh::cuboid(low.into(), high.into())
}

/// A surface of revolution about z through (radius, height) pairs, bottom first, poles at radius 0.
fn revolved(profile: &[(f64, f64)], n: u32) -> TriMesh {
    let rows = u32::try_from(profile.len()).unwrap();
    let vertices_m = profile
        .iter()
        .flat_map(|&(r, z)| {
            (0..n).map(move |i| {
                let angle = TAU * f64::from(i) / f64::from(n);
                Point3::new(r * angle.cos(), r * angle.sin(), z)
            })
        })
        .collect();
    let triangles = (0..rows - 1)
        .flat_map(|row| {
            (0..n).flat_map(move |i| {
                let (a, b) = (row * n + i, row * n + (i + 1) % n);
                [[a, b, b + n], [a, b + n, a + n]]
            })
        })
        .collect();
    TriMesh {
        vertices_m,
        triangles,
    }
}

fn cylinder(radius: f64, height: f64) -> TriMesh {
    let half = height / 2.0;
    revolved(
        &[(0.0, -half), (radius, -half), (radius, half), (0.0, half)],
        96,
    )
}

fn sphere(radius: f64) -> TriMesh {
    let profile: Vec<_> = (0..=48)
        .map(|i| {
            let angle = PI * (f64::from(i) / 48.0 - 0.5);
            let pole = i % 48 == 0;
            (
                if pole { 0.0 } else { radius * angle.cos() },
                radius * angle.sin(),
            )
        })
        .collect();
    revolved(&profile, 96)
}

/// A cup with a wall of 4 mm, open above.
fn cup() -> TriMesh {
    revolved(
        &[
            (0.0, 0.0),
            (0.04, 0.0),
            (0.04, 0.08),
            (0.036, 0.08),
            (0.036, 0.004),
            (0.0, 0.004),
        ],
        48,
    )
}

fn close(found: f64, expected: f64, relative: f64) {
    assert!(
        (found - expected).abs() <= relative * expected.abs(),
        "{found} for {expected}"
    );
}

#[test]
fn box_sphere_and_cylinder_have_their_volume_and_inertia() {
    let brick = cuboid([0.1, 0.2, 0.3], [0.2, 0.5, 0.8]);
    assert!(brick.is_watertight());
    close(brick.volume_m3(), 0.1 * 0.3 * 0.5, 1e-12);
    let mass = mass_properties(&brick, 6.0);
    assert!((mass.center_of_mass_m - Point3::new(0.15, 0.35, 0.55)).norm() < 1e-12);
    close(mass.inertia_kg_m2[(0, 0)], 6.0 / 12.0 * (0.09 + 0.25), 1e-9);
    close(mass.inertia_kg_m2[(2, 2)], 6.0 / 12.0 * (0.01 + 0.09), 1e-9);
    assert!(mass.inertia_kg_m2[(0, 1)].abs() < 1e-12);

    let ball = sphere(0.05);
    close(ball.volume_m3(), 4.0 / 3.0 * PI * 0.05_f64.powi(3), 0.01);
    close(
        mass_properties(&ball, 0.2).inertia_kg_m2[(1, 1)],
        0.4 * 0.2 * 0.0025,
        0.01,
    );

    let can = cylinder(0.03, 0.1);
    close(can.volume_m3(), PI * 0.0009 * 0.1, 0.01);
    let inertia = mass_properties(&can, 0.3).inertia_kg_m2;
    close(inertia[(2, 2)], 0.5 * 0.3 * 0.0009, 0.01);
    close(inertia[(0, 0)], 0.3 * (3.0 * 0.0009 + 0.01) / 12.0, 0.01);
}

#[test]
fn open_and_flat_meshes_still_get_mass_properties() {
    let mut open = cuboid([0.0; 3], [0.1; 3]);
    open.triangles.truncate(6);
    let mass = mass_properties(&open, 1.0);
    close(mass.inertia_kg_m2[(0, 0)], 0.01 / 6.0, 1e-6);
    let flat = TriMesh {
        vertices_m: vec![
            Point3::origin(),
            Point3::new(0.1, 0.0, 0.0),
            Point3::new(0.0, 0.1, 0.0),
        ],
        triangles: vec![[0, 1, 2]],
    };
    assert!(flat.convex_hull().is_err());
    assert!(mass_properties(&flat, 1.0).inertia_kg_m2.determinant() > 0.0);
    assert!(stable_rests(&flat, &Point3::origin()).is_empty());
}

#[test]
fn sampled_points_lie_on_the_surface_evenly_and_alike_for_a_seed() {
    let can = cylinder(0.03, 0.1);
    let (points, normals) = can.sample_surface(4000, 3);
    assert_eq!(points.len(), 4000);
    assert_eq!(can.sample_surface(4000, 3).0, points);
    assert_ne!(can.sample_surface(4000, 4).0, points);
    let distance = SurfaceDistance::new(&can);
    for (point, normal) in points.iter().zip(&normals) {
        assert!(distance.signed_distance(point).distance_m.abs() < 1e-6);
        assert!(
            distance
                .signed_distance(&(point + normal * 1e-3))
                .distance_m
                > 0.0
        );
    }
    let side = normals.iter().filter(|normal| normal.z.abs() < 0.5).count();
    close(side as f64 / 4000.0, 0.1 / (0.1 + 0.03), 0.03);
}

/// The distance to the nearest of all triangles, by dense sampling of each one's barycentric grid.
fn brute_distance(mesh: &TriMesh, p: &Point3<f64>) -> f64 {
    let segment = |a: Point3<f64>, b: Point3<f64>| {
        let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared().max(1e-30)).clamp(0.0, 1.0);
        (a + (b - a) * along - p).norm()
    };
    let mut best = f64::INFINITY;
    for &triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|idx| mesh.vertices_m[idx as usize]);
        best = best
            .min(segment(a, b))
            .min(segment(b, c))
            .min(segment(c, a));
        let n = (b - a).cross(&(c - a));
        if n.norm() < 1e-15 {
            continue;
        }
        let foot = p - n * ((p - a).dot(&n) / n.norm_squared());
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| (to - from).cross(&(foot - from)).dot(&n) >= 0.0);
        if inside {
            best = best.min((foot - p).norm());
        }
    }
    best
}

/// Returns the winding number of the surface around a point (van Oosterom and Strackee 1983).
fn winding(mesh: &TriMesh, p: &Point3<f64>) -> f64 {
    let mut sum = 0.0;
    for &triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|idx| mesh.vertices_m[idx as usize] - p);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let denominator = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        sum += 2.0 * a.dot(&b.cross(&c)).atan2(denominator);
    }
    sum / (4.0 * PI)
}

fn distance_is_that_of_brute_force(mesh: &TriMesh, n: usize) {
    let distance = SurfaceDistance::new(mesh);
    let (low, high) = mesh.bounds();
    let margin = (high - low) * 0.3;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..n {
        let part = Vector3::from_fn(|_, _| rng.random::<f64>());
        let p = low - margin + (high - low + margin * 2.0).component_mul(&part);
        let found = distance.signed_distance(&p);
        let expected = brute_distance(mesh, &p);
        assert!(
            (found.distance_m.abs() - expected).abs() < 1e-6,
            "{found:?} for {expected}"
        );
        assert!(((found.point - p).norm() - expected).abs() < 1e-6);
        if expected > 1e-5 {
            let inside = winding(mesh, &p) > 0.5;
            assert_eq!(
                found.distance_m < 0.0,
                inside,
                "{p} at {expected}, {:.3} {:.3}",
                (p - found.point).normalize().dot(&found.normal),
                winding(mesh, &p)
            );
        }
    }
}

#[test]
fn signed_distance_is_that_of_brute_force() {
    for mesh in [
        cuboid([0.0; 3], [0.1, 0.02, 0.05]),
        cylinder(0.03, 0.1),
        sphere(0.04),
        cup(),
    ] {
        distance_is_that_of_brute_force(&mesh, 500);
    }
}

#[test]
fn the_hull_contains_the_mesh_and_is_closed() {
    for mesh in [
        cuboid([0.0; 3], [0.1, 0.02, 0.05]),
        cylinder(0.03, 0.1),
        sphere(0.04),
        cup(),
    ] {
        let hull = mesh.convex_hull().unwrap();
        assert!(hull.is_watertight());
        let distance = SurfaceDistance::new(&hull);
        for vertex in &mesh.vertices_m {
            assert!(distance.signed_distance(vertex).distance_m < 1e-6);
        }
    }
    close(
        cup().convex_hull().unwrap().volume_m3(),
        PI * 0.0016 * 0.08,
        0.01,
    );
}

#[test]
fn nearly_convex_meshes_stay_one_part() {
    for mesh in [
        cuboid([0.0; 3], [0.1, 0.02, 0.05]),
        cylinder(0.03, 0.1),
        sphere(0.04),
    ] {
        let parts = convex_parts(&mesh, 16).unwrap();
        assert_eq!(parts.len(), 1);
        assert!(parts[0].len() <= MAX_PART_VERTICES);
        let hull = TriMesh {
            vertices_m: parts[0].clone(),
            triangles: Vec::new(),
        }
        .convex_hull()
        .unwrap();
        assert!(hull.volume_m3() > 0.8 * mesh.volume_m3());
    }
}

#[test]
fn parts_within_a_tolerance_are_as_close_and_keep_the_faces_of_rests() {
    let tolerance_m = 1e-4;
    for (mesh, is_convex) in [(cylinder(0.03, 0.1), true), (cup(), false)] {
        let hull = mesh.convex_hull().unwrap();
        let center = mass_properties(&mesh, 1.0).center_of_mass_m;
        let rests = stable_rests(&mesh, &center);
        let parts = parts_within(&mesh, 24, tolerance_m, &rests).unwrap();
        let corners = parts.concat();
        for rest in &rests {
            let above_m = |corner: &Point3<f64>| {
                rest.rest.up_in_object.dot(&corner.coords) + rest.rest.height_m
            };
            let feet = |points: &[Point3<f64>]| {
                points
                    .iter()
                    .filter(|corner| above_m(corner) < 1e-5)
                    .count()
            };
            assert!(feet(&corners) >= feet(&hull.vertices_m), "{rest:?}");
        }
        assert_eq!(parts.len() == 1, is_convex);
        if is_convex {
            let cut = TriMesh {
                vertices_m: corners,
                triangles: Vec::new(),
            };
            let surface = SurfaceDistance::new(&cut.convex_hull().unwrap());
            for corner in &hull.vertices_m {
                let distance_m = surface.signed_distance(corner).distance_m;
                assert!(distance_m < 1.5 * tolerance_m, "{distance_m} m");
            }
        }
    }
}

#[test]
fn a_cup_is_split_into_parts_that_leave_it_open() {
    let cup = cup();
    let parts = convex_parts(&cup, 24).unwrap();
    assert_eq!(parts, convex_parts(&cup, 24).unwrap());
    assert!(parts.len() > 4 && parts.len() <= 24, "{}", parts.len());
    let mut volume = 0.0;
    for part in &parts {
        assert!(part.len() <= MAX_PART_VERTICES);
        let hull = TriMesh {
            vertices_m: part.clone(),
            triangles: Vec::new(),
        }
        .convex_hull()
        .unwrap();
        volume += hull.volume_m3();
        let inside = SurfaceDistance::new(&hull).signed_distance(&Point3::new(0.0, 0.0, 0.05));
        assert!(inside.distance_m > 0.01, "a part fills the cup");
    }
    println!(
        "{} parts of {:.1} cm3 for {:.1} cm3",
        parts.len(),
        volume * 1e6,
        cup.volume_m3() * 1e6
    );
    let own = cup.volume_m3();
    assert!(
        volume > 0.8 * own && volume < 1.8 * own,
        "parts {volume} of {own}"
    );
}

#[test]
fn coarse_parts_leave_a_cup_open_and_a_box_whole() {
    let cup = cup();
    let parts = coarse_parts(&cup, 12).unwrap();
    assert!(parts.len() > 4 && parts.len() <= 12, "{}", parts.len());
    let (low, high) = cup.bounds();
    let longest_m = (high - low).max();
    let surface = SurfaceDistance::new(&cup);
    for part in &parts {
        assert!(part.len() <= MAX_PART_VERTICES);
        // Off by a voxel, 1/40 of the longest side, and its diagonal.
        for corner in part {
            let distance_m = surface.signed_distance(corner).distance_m;
            assert!(distance_m < 0.05 * longest_m, "{distance_m} m");
        }
        let hull = TriMesh {
            vertices_m: part.clone(),
            triangles: Vec::new(),
        };
        let hull = SurfaceDistance::new(&hull.convex_hull().unwrap());
        let inside = hull.signed_distance(&Point3::new(0.0, 0.0, 0.05));
        assert!(inside.distance_m > 0.005, "a part fills the cup");
    }
    let brick = cuboid([0.0; 3], [0.05, 0.06, 0.07]);
    let parts = coarse_parts(&brick, 12).unwrap();
    assert_eq!((parts.len(), parts[0].len()), (1, 8));
}

#[test]
fn a_box_rests_on_six_faces_and_most_often_on_the_largest() {
    let rests = stable_rests(
        &cuboid([0.0; 3], [0.1, 0.02, 0.05]),
        &Point3::new(0.05, 0.01, 0.025),
    );
    assert_eq!(rests.len(), 6);
    close(rests.iter().map(|rest| rest.probability).sum(), 1.0, 1e-9);
    assert!(rests[0].rest.up_in_object.y.abs() > 0.999);
    assert!(rests[0].probability > rests[2].probability);
    for rest in &rests {
        let up = rest.rest.up_in_object;
        let on_face = if up.sum() > 0.0 {
            0.0
        } else {
            up.abs().dot(&Vector3::new(0.1, 0.02, 0.05))
        };
        assert!((rest.rest.height_m - on_face).abs() < 1e-6, "{rest:?}");
    }
}

#[test]
fn a_body_does_not_rest_where_it_would_tip() {
    // The center of mass is beyond the edge of the small end.
    let mesh = cuboid([0.0; 3], [0.1, 0.02, 0.02]);
    let rests = stable_rests(&mesh, &Point3::new(0.01, 0.01, 0.01));
    assert!(
        rests
            .iter()
            .all(|rest| rest.rest.up_in_object.x > -0.9 || rest.probability < 0.05)
    );
    let can = stable_rests(&cylinder(0.03, 0.1), &Point3::origin());
    assert!(
        can.iter()
            .any(|rest| rest.rest.up_in_object.z > 0.999 && rest.rest.height_m > 0.0499)
    );
    assert!(can.iter().any(|rest| rest.rest.up_in_object.z.abs() < 1e-3));
    assert!(can.len() < 50, "{}", can.len());
    // 1 cm above the top, no body's center of mass is.
    let cube = cuboid([0.0; 3], [0.1; 3]);
    assert!(stable_rests(&cube, &Point3::new(0.05, 0.05, 0.11)).is_empty());
}

/// Reads the dataset's own meshes where `PIPELINE_REAL_DATA` names a folder that has them.
#[test]
fn real_meshes_are_handled() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    let mut models: Vec<_> = std::fs::read_dir(root.join("models"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    models.sort();
    for folder in models {
        let text = std::fs::read_to_string(folder.join("textured_simple.obj")).unwrap();
        let mesh = TriMesh::from_obj(&text).unwrap();
        let started = std::time::Instant::now();
        let mass = mass_properties(&mesh, 1.0);
        let rests = stable_rests(&mesh, &mass.center_of_mass_m);
        let rested = started.elapsed();
        let parts = convex_parts(&mesh, 16).unwrap();
        let volumes: f64 = parts
            .iter()
            .map(|part| {
                TriMesh {
                    vertices_m: part.clone(),
                    triangles: Vec::new(),
                }
                .convex_hull()
                .unwrap()
                .volume_m3()
            })
            .sum();
        println!(
            "{}: {} faces, closed {}, {:.1} cm3, hull {:.1}, com {:.4?}, {} rests in {rested:?}, {} parts {:.1} cm3 in {:?}",
            folder.file_name().unwrap().display(),
            mesh.triangles.len(),
            mesh.is_watertight(),
            mesh.volume_m3() * 1e6,
            mesh.convex_hull().unwrap().volume_m3() * 1e6,
            mass.center_of_mass_m.coords.as_slice(),
            rests.len(),
            parts.len(),
            volumes * 1e6,
            started.elapsed().saturating_sub(rested),
        );
        for rest in rests.iter().take(4) {
            println!(
                "    up {:.3?} height {:.4} p {:.3}",
                rest.rest.up_in_object.as_slice(),
                rest.rest.height_m,
                rest.probability
            );
        }
        assert!(!rests.is_empty() && !parts.is_empty());
        if mesh.is_watertight() {
            distance_is_that_of_brute_force(&mesh, 100);
        }
    }
}
