//! Which triangles share an edge.

use crate::TriMesh;

/// The edges of a mesh, vertices at equal places taken as one.
pub(super) struct Edges {
    /// Each side of a triangle, those of one edge after one another.
    sides: Vec<Side>,
}

/// A side of a triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The ends of its edge, the lesser first.
    ends: (u32, u32),
    /// The triangle.
    pub(super) triangle: usize,
    /// Whether the triangle goes from the lesser end to the greater.
    pub(super) is_ahead: bool,
}

impl Edges {
    pub(super) fn of(mesh: &TriMesh) -> Self {
        let place = mesh.welded();
        let at = |idx: u32| place.get(idx as usize).copied().unwrap_or(idx);
        let mut sides = Vec::with_capacity(3 * mesh.triangles.len());
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            let [a, b, c] = corners.map(at);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if from != to {
                    sides.push(Side {
                        ends: (from.min(to), from.max(to)),
                        triangle,
                        is_ahead: from < to,
                    });
                }
            }
        }
        sides.sort_unstable();
        Self { sides }
    }

    /// Returns the sides of each edge.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[Side]> {
        self.sides.chunk_by(|a, b| a.ends == b.ends)
    }

    /// Marks the triangles that wind against their neighbors: of triangles that are connected by
    /// edges of two, those with the lesser area. A surface of one side only stays as it is.
    pub(super) fn against_neighbors(&self, mesh: &TriMesh) -> Vec<bool> {
        let mut marked = vec![false; mesh.triangles.len()];
        let pairs: Vec<(usize, usize, bool)> = self
            .iter()
            .filter_map(|sides| match sides {
                [a, b] => Some((a.triangle, b.triangle, a.is_ahead == b.is_ahead)),
                _ => None,
            })
            .collect();
        if !pairs.iter().any(|&(.., differ)| differ) {
            return marked;
        }
        let mut neighbors: Vec<Vec<(usize, bool)>> = vec![Vec::new(); mesh.triangles.len()];
        for &(a, b, differ) in &pairs {
            for (own, other) in [(a, b), (b, a)] {
                if let Some(neighbors) = neighbors.get_mut(own) {
                    neighbors.push((other, differ));
                }
            }
        }
        let mut turned: Vec<Option<bool>> = vec![None; mesh.triangles.len()];
        for first in 0..mesh.triangles.len() {
            if turned.get(first).copied().flatten().is_some() {
                continue;
            }
            let Some(patch) = patch(first, &neighbors, &mut turned) else {
                continue;
            };
            let area = |of: bool| -> f64 {
                let such = patch.iter().filter(|&&(_, is_turned)| is_turned == of);
                let triangles = such.filter_map(|&(idx, _)| mesh.triangles.get(idx));
                triangles
                    .map(|&corners| mesh.area_normal(corners).norm())
                    .sum()
            };
            let fewer = area(true) <= area(false);
            for (idx, is_turned) in patch {
                if let Some(marked) = marked.get_mut(idx) {
                    *marked = is_turned == fewer;
                }
            }
        }
        marked
    }
}

/// Walks over all triangles connected with one, and says of each whether it winds against that one;
/// `None` if there is one that does both.
fn patch(
    first: usize,
    neighbors: &[Vec<(usize, bool)>],
    turned: &mut [Option<bool>],
) -> Option<Vec<(usize, bool)>> {
    let mut patch = vec![(first, false)];
    let mut has_sides = true;
    if let Some(own) = turned.get_mut(first) {
        *own = Some(false);
    }
    let mut next = 0;
    while let Some(&(at, is_turned)) = patch.get(next) {
        next += 1;
        for &(other, differ) in neighbors.get(at).into_iter().flatten() {
            let wanted = is_turned ^ differ;
            match turned.get_mut(other) {
                Some(own @ None) => {
                    *own = Some(wanted);
                    patch.push((other, wanted));
                }
                Some(Some(own)) => has_sides &= *own == wanted,
                None => {}
            }
        }
    }
    has_sides.then_some(patch)
}
