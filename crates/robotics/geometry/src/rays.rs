//! The first point of a mesh along a ray.

use nalgebra::{Point3, Vector3};
use parry3d::{
    math::Vector,
    query::{Ray, RayCast},
    shape::TriMesh as Tree,
};

use crate::{
    TriMesh,
    single::{single, singles},
};

/// Where a ray meets a surface first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance from the ray's origin in lengths of its direction: meters where that is of unit length.
    pub distance: f64,
    /// Unit normal of the surface there, toward the side from which the ray comes.
    pub normal: Vector3<f64>,
}

/// A mesh prepared for rays.
pub struct RayCaster {
    /// `None` where the mesh has no triangle.
    tree: Option<Tree>,
}

impl RayCaster {
    /// Prepares a mesh, closed or not.
    pub fn new(mesh: &TriMesh) -> Self {
        let triangles = mesh.triangles.clone();
        Self {
            tree: Tree::new(singles(&mesh.vertices_m), triangles).ok(),
        }
    }

    /// Returns where a ray from `origin` along `direction`, both in the mesh's frame, meets the surface first, on either
    /// side of it, to a few micrometers.
    pub fn first_hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<RayHit> {
        let ray = Ray::new(single(origin), single(&Point3::from(*direction)));
        let hit = self
            .tree
            .as_ref()?
            .cast_local_ray_and_get_normal(&ray, f32::MAX, false)?;
        let normal: Vector = hit.normal;
        let normal = Vector3::new(normal.x, normal.y, normal.z).map(f64::from);
        let normal = normal.try_normalize(1e-12)?;
        Some(RayHit {
            distance: f64::from(hit.time_of_impact),
            normal: if normal.dot(direction) > 0.0 {
                -normal
            } else {
                normal
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_meets_the_nearer_side_of_a_box() {
        let cuboid = TriMesh::cuboid(Point3::new(-0.1, -0.1, 0.0), Point3::new(0.1, 0.1, 0.2));
        let rays = RayCaster::new(&cuboid);
        let down = Vector3::new(0.0, 0.0, -2.0);
        let hit = rays
            .first_hit(&Point3::new(0.03, 0.02, 0.6), &down)
            .unwrap();
        assert!((hit.distance - 0.2).abs() < 1e-6);
        assert!((hit.normal - Vector3::z()).norm() < 1e-6);
        // From inside it meets the bottom, whose normal is turned toward the origin.
        let hit = rays
            .first_hit(&Point3::new(0.03, 0.02, 0.1), &down)
            .unwrap();
        assert!((hit.distance - 0.05).abs() < 1e-6);
        assert!((hit.normal - Vector3::z()).norm() < 1e-6);
        assert_eq!(rays.first_hit(&Point3::new(0.2, 0.0, 0.6), &down), None);
    }
}
