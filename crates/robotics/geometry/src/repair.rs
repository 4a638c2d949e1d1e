//! What is mended of a mesh that was read: vertices that no triangle uses, and triangles that wind
//! inward or against their neighbors.

mod bodies;
mod edges;

use std::fmt;

use nalgebra::Point3;

use self::{bodies::Bodies, edges::Edges};
use crate::TriMesh;

/// What was mended of a mesh while it was read.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Repairs {
    /// Number of vertices left out because no triangle uses them.
    pub unused_vertices_n: usize,
    /// Number of triangles whose back was turned to the front.
    pub turned_triangles_n: usize,
}

impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let said = [
            counted(
                self.unused_vertices_n,
                "unused vertex",
                "unused vertices",
                "left out",
            ),
            counted(
                self.turned_triangles_n,
                "triangle",
                "triangles",
                "turned outward",
            ),
        ];
        f.write_str(&said.into_iter().flatten().collect::<Vec<_>>().join(", "))
    }
}

fn counted(n: usize, one: &str, more: &str, done: &str) -> Option<String> {
    (n > 0).then(|| format!("{n} {} {done}", if n == 1 { one } else { more }))
}

/// Mends a mesh as it was read.
///
/// Triangles that share an edge are made to wind alike, most of the area as it was, and each body to
/// wind outward, what lies inside of another (a cavity, an inner part) turned with that one alone.
/// Bodies that enclose nothing stay as they are unless all of them together wind inward.
pub(crate) fn repaired(mut mesh: TriMesh) -> (TriMesh, Repairs) {
    let unused_vertices_n = leave_out_unused(&mut mesh);
    let mut edges = Edges::of(&mesh);
    let mut turned = edges.against_neighbors(&mesh);
    if turned.contains(&true) {
        turn(&mut mesh, &turned);
        edges = Edges::of(&mesh);
    }
    let outward = Bodies::of(&mesh, &edges).inward(&mesh);
    turn(&mut mesh, &outward);
    for (turned, again) in turned.iter_mut().zip(outward) {
        *turned ^= again;
    }
    let repairs = Repairs {
        unused_vertices_n,
        turned_triangles_n: turned.into_iter().filter(|&turned| turned).count(),
    };
    (mesh, repairs)
}

impl TriMesh {
    /// Returns the mesh without the vertices that no triangle uses, the others in their order.
    #[must_use]
    pub fn without_unused(mut self) -> Self {
        leave_out_unused(&mut self);
        self
    }
}

/// Turns the triangles that are marked.
fn turn(mesh: &mut TriMesh, marked: &[bool]) {
    for (triangle, _) in mesh
        .triangles
        .iter_mut()
        .zip(marked)
        .filter(|(_, marked)| **marked)
    {
        triangle.swap(1, 2);
    }
}

/// Leaves out the vertices that no triangle uses, the others in their order; returns their number.
fn leave_out_unused(mesh: &mut TriMesh) -> usize {
    let mut used = vec![false; mesh.vertices_m.len()];
    for &idx in mesh.triangles.iter().flatten() {
        if let Some(used) = used.get_mut(idx as usize) {
            *used = true;
        }
    }
    let unused_n = used.iter().filter(|&&used| !used).count();
    if unused_n > 0 {
        let mut next = 0;
        let new_index: Vec<u32> = used
            .iter()
            .map(|&used| {
                let own = next;
                next += u32::from(used);
                own
            })
            .collect();
        let kept = mesh.vertices_m.iter().zip(used).filter(|&(_, used)| used);
        mesh.vertices_m = kept
            .map(|(&vertex, _)| vertex)
            .collect::<Vec<Point3<f64>>>();
        for idx in mesh.triangles.iter_mut().flatten() {
            *idx = new_index.get(*idx as usize).copied().unwrap_or(*idx);
        }
    }
    unused_n
}

#[cfg(test)]
mod tests;
