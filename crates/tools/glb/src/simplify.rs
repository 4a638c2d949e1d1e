//! Fewer triangles for a mesh that is only looked at.

use std::collections::{BTreeMap, BTreeSet};

use crate::ObjectMesh;

/// Cells along the longest side of the finest grid.
const FINEST: u32 = 128;

/// Returns a mesh of at most about `triangles_n` triangles: vertices in one cell of a grid become their mean
/// (Rossignac and Borrel, *Multi-resolution 3D approximations for rendering complex scenes*, 1993). A mesh
/// that is small enough stays as it is.
pub fn simplified(mesh: &ObjectMesh, triangles_n: usize) -> ObjectMesh {
    if mesh.triangles.len() <= triangles_n {
        return mesh.clone();
    }
    let bounds = |fold: fn(f64, f64) -> f64, start: f64| {
        mesh.vertices_m.iter().fold([start; 3], |end, vertex| {
            [0, 1, 2].map(|axis| fold(end[axis], vertex[axis]))
        })
    };
    let (low, high) = (
        bounds(f64::min, f64::INFINITY),
        bounds(f64::max, f64::NEG_INFINITY),
    );
    let longest = [0, 1, 2]
        .map(|axis| high[axis] - low[axis])
        .into_iter()
        .fold(f64::MIN_POSITIVE, f64::max);
    let mut cells = FINEST;
    loop {
        let coarse = clustered(mesh, &low, longest / f64::from(cells));
        if coarse.triangles.len() <= triangles_n || cells <= 4 {
            return coarse;
        }
        cells = cells * 4 / 5;
    }
}

fn clustered(mesh: &ObjectMesh, low: &[f64; 3], cell_m: f64) -> ObjectMesh {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a mesh spans at most 128 cells"
    )]
    let cell =
        |vertex: &[f64; 3]| [0, 1, 2].map(|axis| ((vertex[axis] - low[axis]) / cell_m) as i64);
    let mut clusters: BTreeMap<[i64; 3], (u32, [f64; 3], f64)> = BTreeMap::new();
    for vertex in &mesh.vertices_m {
        let next = u32::try_from(clusters.len()).unwrap_or(u32::MAX);
        let (_, sum, n) = clusters
            .entry(cell(vertex))
            .or_insert((next, [0.0; 3], 0.0));
        for axis in 0..3 {
            sum[axis] += vertex[axis];
        }
        *n += 1.0;
    }
    let mut vertices_m = vec![[0.0; 3]; clusters.len()];
    for (idx, sum, n) in clusters.values() {
        if let Some(vertex) = vertices_m.get_mut(*idx as usize) {
            *vertex = sum.map(|sum| sum / n);
        }
    }
    let of = |idx: u32| {
        let vertex = mesh.vertices_m.get(idx as usize)?;
        clusters.get(&cell(vertex)).map(|(idx, ..)| *idx)
    };
    let mut seen: BTreeSet<[u32; 3]> = BTreeSet::new();
    let mut triangles = Vec::new();
    for &[a, b, c] in &mesh.triangles {
        let (Some(a), Some(b), Some(c)) = (of(a), of(b), of(c)) else {
            continue;
        };
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        if a != b && b != c && c != a && seen.insert(sorted) {
            triangles.push([a, b, c]);
        }
    }
    ObjectMesh {
        vertices_m,
        triangles,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of `n` by `n` squares of a millimeter.
    fn sheet(n: u32) -> ObjectMesh {
        let at = |x: u32, y: u32| y * (n + 1) + x;
        let mut triangles = Vec::new();
        for y in 0..n {
            for x in 0..n {
                triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
        let vertex = |idx: u32| {
            [
                f64::from(idx % (n + 1)) * 1e-3,
                f64::from(idx / (n + 1)) * 1e-3,
                0.0,
            ]
        };
        ObjectMesh {
            vertices_m: (0..(n + 1) * (n + 1)).map(vertex).collect(),
            triangles,
        }
    }

    #[test]
    fn a_large_mesh_becomes_small_and_stays_where_it_is() {
        let large = sheet(100);
        let small = simplified(&large, 500);
        assert!(small.triangles.len() <= 500 && small.triangles.len() > 100);
        for vertex in &small.vertices_m {
            assert!(
                vertex[..2]
                    .iter()
                    .all(|side| (-1e-9..=0.1 + 1e-9).contains(side))
            );
        }
        assert_eq!(simplified(&large, 20_000), large);
    }
}
