//! Tests of mending a mesh, on bodies whose right form is known.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::{SurfaceDistance, mass_properties};

/// A box about a place, in meters.
fn cuboid(middle: [f64; 3], side: f64) -> TriMesh {
    let middle = Point3::from(middle);
    let half = Vector3::repeat(side / 2.0);
    TriMesh::cuboid(middle - half, middle + half)
}

fn joined(meshes: &[&TriMesh]) -> TriMesh {
    let mut all = TriMesh {
        vertices_m: Vec::new(),
        triangles: Vec::new(),
    };
    for mesh in meshes {
        let first = u32::try_from(all.vertices_m.len()).unwrap();
        all.vertices_m.extend(&mesh.vertices_m);
        all.triangles.extend(
            mesh.triangles
                .iter()
                .map(|triangle| triangle.map(|idx| first + idx)),
        );
    }
    all
}

/// Turns the triangles of these numbers.
fn turned(mesh: &TriMesh, which: impl Fn(usize) -> bool) -> TriMesh {
    let mut mesh = mesh.clone();
    for (idx, triangle) in mesh.triangles.iter_mut().enumerate() {
        if which(idx) {
            triangle.swap(0, 1);
        }
    }
    mesh
}

/// Returns the triangles as sets of corners that wind alike.
fn winding(mesh: &TriMesh) -> Vec<[u32; 3]> {
    let mut triangles: Vec<_> = mesh.triangles.clone();
    for triangle in &mut triangles {
        let least = (0..3).min_by_key(|&at| triangle[at]).unwrap();
        triangle.rotate_left(least);
    }
    triangles
}

#[test]
fn every_wrong_winding_of_a_box_becomes_the_right_one() {
    let whole = cuboid([0.1, 0.2, 0.3], 0.06);
    // Corners of its own for each triangle, as STL has them.
    let soup = TriMesh {
        vertices_m: whole
            .triangles
            .iter()
            .flat_map(|&t| whole.corners(t))
            .collect(),
        triangles: (0..12).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
    };
    let mut open = whole.clone();
    open.triangles.pop();
    for right in [&whole, &soup, &open] {
        let n = right.triangles.len();
        for (what, wrong) in [
            ("right", turned(right, |_| false)),
            ("inward", turned(right, |_| true)),
            ("mixed", turned(right, |idx| idx % 3 == 0)),
            ("mostly inward", turned(right, |idx| idx % 3 != 0)),
            ("one face", turned(right, |idx| idx == 4)),
        ] {
            let n_wrong = winding(&wrong)
                .iter()
                .zip(winding(right))
                .filter(|(a, b)| *a != b)
                .count();
            let (mended, repairs) = repaired(wrong);
            assert_eq!(winding(&mended), winding(right), "{what} of {n}");
            assert_eq!(repairs.turned_triangles_n, n_wrong, "{what} of {n}");
            let surface = SurfaceDistance::new(&mended);
            let middle = Point3::new(0.1, 0.2, 0.3);
            assert!(
                surface.signed_distance(&middle).distance_m < -0.02,
                "{what}"
            );
            let outside = middle + Vector3::new(0.05, 0.0, 0.0);
            assert!(
                surface.signed_distance(&outside).distance_m > 0.01,
                "{what}"
            );
        }
    }
}

#[test]
fn bodies_are_turned_alone_and_cavities_with_what_is_around_them() {
    let [large, small, beside] = [
        cuboid([0.0; 3], 0.1),
        cuboid([0.01, 0.0, 0.0], 0.04),
        cuboid([0.2, 0.0, 0.0], 0.05),
    ];
    let inward = |mesh: &TriMesh| turned(mesh, |_| true);
    let hollow = joined(&[&large, &inward(&small), &beside]);
    let full = joined(&[&large, &small, &beside]);
    for (right, wrong, n) in [
        (&hollow, hollow.clone(), 0),
        (&full, full.clone(), 0),
        (
            &hollow,
            joined(&[&large, &inward(&small), &inward(&beside)]),
            12,
        ),
        (&hollow, joined(&[&inward(&large), &small, &beside]), 24),
        (
            &hollow,
            joined(&[&inward(&large), &small, &inward(&beside)]),
            36,
        ),
        (
            &full,
            joined(&[&inward(&large), &inward(&small), &beside]),
            24,
        ),
    ] {
        let (mended, repairs) = repaired(wrong);
        assert_eq!(winding(&mended), winding(right));
        assert_eq!(repairs.turned_triangles_n, n);
    }
}

#[test]
fn a_flat_sheet_stays_as_it_is_and_a_surface_of_one_side_has_no_neighbors_to_follow() {
    let sheet = TriMesh {
        vertices_m: vec![
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(1.0, 1.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    };
    let strip = TriMesh {
        vertices_m: (0..5)
            .flat_map(|k| {
                let angle = f64::from(k) / 5.0 * std::f64::consts::TAU;
                let tilt = angle / 2.0;
                let at = |side: f64| {
                    let radius = 1.0 + 0.3 * side * tilt.cos();
                    Point3::new(
                        radius * angle.cos(),
                        radius * angle.sin(),
                        0.3 * side * tilt.sin(),
                    )
                };
                [at(-1.0), at(1.0)]
            })
            .collect(),
        triangles: vec![
            [0, 1, 2],
            [1, 3, 2],
            [2, 3, 4],
            [3, 5, 4],
            [4, 5, 6],
            [5, 7, 6],
            [6, 7, 8],
            [7, 9, 8],
            [8, 9, 1],
            [9, 0, 1],
        ],
    };
    assert_eq!(repaired(sheet.clone()), (sheet, Repairs::default()));
    assert!(!Edges::of(&strip).against_neighbors(&strip).contains(&true));
}

#[test]
fn vertices_that_no_triangle_uses_have_no_part_in_hull_mass_and_bounds() {
    let right = cuboid([0.0, 0.0, 0.05], 0.1);
    for at in [0, 3, 8] {
        let mut stray = right.clone();
        stray.vertices_m.insert(at, Point3::new(8.7, 0.0, 0.0));
        stray.vertices_m.push(Point3::new(0.0, 0.0, -3.0));
        for idx in stray.triangles.iter_mut().flatten() {
            *idx += u32::from(*idx as usize >= at);
        }
        let (mended, repairs) = repaired(stray);
        assert_eq!(mended, right);
        assert_eq!(repairs.to_string(), "2 unused vertices left out");
        let middle = mass_properties(&mended, 0.3).center_of_mass_m;
        assert!((middle - Point3::new(0.0, 0.0, 0.05)).norm() < 1e-12);
    }
}
