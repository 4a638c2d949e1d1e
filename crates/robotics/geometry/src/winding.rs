//! Nodes of a grid inside a surface, by their winding numbers.

use nalgebra::Point3;

use crate::TriMesh;

/// Returns for each node of a grid whether it is inside a mesh; x runs fastest, then y.
///
/// Along each line of the grid, the signed crossings of the surface beyond a node add up to the
/// surface's winding number around it (Nooruddin and Turk, "Simplification and repair of polygonal
/// models using volumetric techniques", 2003, §3.1, with signs in place of parity). The lines along
/// the three axes vote, so that a hole misleads those lines alone that leave through it.
pub(crate) fn inside(
    mesh: &TriMesh,
    least: &Point3<f64>,
    spacing_m: f64,
    counts: [usize; 3],
) -> Vec<bool> {
    let strides = [1, counts[0], counts[0] * counts[1]];
    let mut votes = vec![0_u8; counts.iter().product()];
    for along in 0..3 {
        let [across, up] = [(along + 1) % 3, (along + 2) % 3];
        let crossings = crossings(mesh, least, spacing_m, counts, along);
        for v in 0..counts[up] {
            for u in 0..counts[across] {
                let Some(line) = crossings.get(u + counts[across] * v) else {
                    continue;
                };
                let mut line = line.clone();
                line.sort_by(|a, b| a.0.total_cmp(&b.0));
                // Walk towards the greater coordinates: what is crossed no longer lies beyond.
                let mut beyond: i32 = line.iter().map(|&(_, sign)| sign).sum();
                let mut next = line.iter().peekable();
                for n in 0..counts[along] {
                    let at = least[along] + n as f64 * spacing_m;
                    while let Some(&(_, sign)) = next.next_if(|&&(place, _)| place <= at) {
                        beyond -= sign;
                    }
                    let node = n * strides[along] + u * strides[across] + v * strides[up];
                    if let Some(votes) = votes.get_mut(node) {
                        *votes += u8::from(beyond > 0);
                    }
                }
            }
        }
    }
    votes.into_iter().map(|votes| votes >= 2).collect()
}

/// Returns where each line of the grid along an axis crosses the surface, and whether it leaves (1)
/// or enters (−1) there.
fn crossings(
    mesh: &TriMesh,
    least: &Point3<f64>,
    spacing_m: f64,
    counts: [usize; 3],
    along: usize,
) -> Vec<Vec<(f64, i32)>> {
    let [across, up] = [(along + 1) % 3, (along + 2) % 3];
    let mut lines = vec![Vec::new(); counts[across] * counts[up]];
    for &triangle in &mesh.triangles {
        let corners = mesh.corners(triangle);
        let flat = corners.map(|c| [c[across], c[up]]);
        // Twice the signed area as the line sees it: positive where the surface faces along it.
        let area = cross(flat[0], flat[1], flat[2]);
        if area == 0.0 || !area.is_finite() {
            continue;
        }
        let range = |part: usize, axis: usize| {
            let places = flat.map(|corner| (corner[part] - least[axis]) / spacing_m);
            let low = places.iter().copied().fold(f64::INFINITY, f64::min).ceil();
            let high = places
                .iter()
                .copied()
                .fold(f64::NEG_INFINITY, f64::max)
                .floor();
            let end = (counts[axis] - 1) as f64;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to the grid"
            )]
            let nodes = low.clamp(0.0, end) as usize..=high.clamp(0.0, end) as usize;
            nodes
        };
        for v in range(1, up) {
            for u in range(0, across) {
                let at = [
                    least[across] + u as f64 * spacing_m,
                    least[up] + v as f64 * spacing_m,
                ];
                if let Some(place) = pierced(&corners.map(|c| c[along]), &flat, at)
                    && let Some(line) = lines.get_mut(u + counts[across] * v)
                {
                    line.push((place, if area > 0.0 { 1 } else { -1 }));
                }
            }
        }
    }
    lines
}

/// Returns where a line through `at` pierces a triangle with these corners across the line and
/// heights along it; `None` if it misses.
fn pierced(heights: &[f64; 3], flat: &[[f64; 2]; 3], at: [f64; 2]) -> Option<f64> {
    let [a, b, c] = *flat;
    let weights = [edge(b, c, at), edge(c, a, at), edge(a, b, at)];
    let is_left = weights.iter().all(|&weight| weight >= 0.0);
    let is_right = weights.iter().all(|&weight| weight <= 0.0);
    let sum: f64 = weights.iter().sum();
    if !(is_left || is_right) || sum == 0.0 {
        return None;
    }
    Some(
        weights
            .iter()
            .zip(heights)
            .map(|(weight, height)| weight * height)
            .sum::<f64>()
            / sum,
    )
}

/// Returns on which side of the edge from `a` to `b` a point lies, exactly opposite for the edge
/// from `b` to `a`: a line near a shared edge then pierces one of its triangles, not both or none.
fn edge(a: [f64; 2], b: [f64; 2], at: [f64; 2]) -> f64 {
    if (a[0], a[1]) < (b[0], b[1]) {
        cross(a, b, at)
    } else {
        -cross(b, a, at)
    }
}

/// Returns twice the signed area of a triangle.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
