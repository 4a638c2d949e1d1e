//! From an object's mesh to what grasping and physics need to know of it.

use std::path::Path;

use geometry::{GeometryError, MeshFormat, OBJECT_SIDES_M, Repairs, StablePose, TriMesh};
use nalgebra::Point3;
use schemas::objects::{Mirror, Object, RestingOrientation};

use crate::{config::ShapeOptions, rests::rests};

/// An object by its mesh and its mass.
pub struct MeshedObject<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its mass in kilograms.
    pub mass_kg: f64,
    /// Its mesh, in meters, in its own frame.
    pub mesh: &'a TriMesh,
    /// What is made of the mesh.
    pub options: &'a ShapeOptions,
    /// Seed of the points on its surface.
    pub seed: u64,
}

impl MeshedObject<'_> {
    /// Returns the object as one that nobody has seen yet: it rests as its shape is stable, the most probable way first.
    ///
    /// # Errors
    ///
    /// Fails if the mesh spans no volume.
    pub fn unseen(&self) -> Result<Object, GeometryError> {
        let mut object = self.shape()?;
        object.rests = rests(&object, &[]);
        Ok(object)
    }

    /// Makes the object's shape, with all orientations in which it is stable.
    ///
    /// # Errors
    ///
    /// Fails if the mesh spans no volume.
    pub fn shape(&self) -> Result<Object, GeometryError> {
        let (mesh, options) = (self.mesh, self.options);
        let mass = geometry::mass_properties(mesh, self.mass_kg);
        let stable = geometry::stable_rests(mesh, &mass.center_of_mass_m);
        let limit = options.max_convex_parts_n;
        let parts = if options.part_tolerance_m > 0.0 {
            geometry::parts_within(mesh, limit, options.part_tolerance_m, &stable)
        } else {
            geometry::convex_parts(mesh, limit)
        }?;
        let (points, normals) = mesh.sample_surface(options.points_n, self.seed);
        let inertia = mass.inertia_kg_m2;
        Ok(Object {
            name: self.name.to_owned(),
            mass_kg: mass.mass_kg,
            center_of_mass_m: mass.center_of_mass_m.into(),
            inertia_kg_m2: [
                inertia.m11,
                inertia.m22,
                inertia.m33,
                inertia.m12,
                inertia.m13,
                inertia.m23,
            ],
            points_m: arrays(&points),
            normals: normals.into_iter().map(Into::into).collect(),
            watertight: mesh.is_watertight(),
            mirror: geometry::mirror_plane(mesh, self.seed).map(|plane| Mirror {
                normal: plane.normal,
                offset_m: plane.offset_m,
                error_m: plane.error_m,
            }),
            vertices_m: arrays(&mesh.vertices_m),
            triangles: mesh.triangles.clone(),
            parts_m: parts.iter().map(|part| arrays(part)).collect(),
            rests: stable.iter().map(of_shape).collect(),
        })
    }
}

/// Returns the mesh of a stored object.
pub fn mesh_of(object: &Object) -> TriMesh {
    TriMesh {
        vertices_m: object.vertices_m.iter().map(|&at| at.into()).collect(),
        triangles: object.triangles.clone(),
    }
}

fn of_shape(stable: &StablePose) -> RestingOrientation {
    RestingOrientation {
        rest: stable.rest,
        seen_n: 0,
        probability: stable.probability,
    }
}

/// Reads a mesh from the bytes of a file of this name, and says what was mended of it; it is as large as what a hand
/// grasps.
///
/// # Errors
///
/// Fails with what is wrong with it.
pub fn mesh(file: &str, bytes: &[u8]) -> Result<(TriMesh, Repairs), String> {
    let said = |err: GeometryError| match err {
        GeometryError::LfsPointer => {
            format!("{err}; {}", err.hint().unwrap_or_default())
        }
        err => err.to_string(),
    };
    // Datasets have OBJ; what the pipeline file adds says what it is.
    let format = MeshFormat::of(Path::new(file)).unwrap_or(MeshFormat::Obj);
    let (mesh, repairs) = TriMesh::read(bytes, format).map_err(said)?;
    mesh.check_size(&OBJECT_SIDES_M).map_err(said)?;
    Ok((mesh, repairs))
}

fn arrays(points: &[Point3<f64>]) -> Vec<[f64; 3]> {
    points.iter().map(|&point| point.into()).collect()
}
