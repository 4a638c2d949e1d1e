//! From an object's mesh to what grasping and physics need to know of it.

use std::path::Path;

use geometry::{GeometryError, MeshFormat, OBJECT_SIDES_M, Repairs, StablePose, TriMesh};
use nalgebra::Point3;
use schemas::objects::{Mirror, Object, RestingOrientation};

use crate::error::RecordingError;

/// Inputs of a shape.
pub(crate) struct Source<'a> {
    /// The dataset's name of it.
    pub(crate) name: &'a str,
    /// Its mass in kilograms.
    pub(crate) mass_kg: f64,
    /// Name of its mesh file in the dataset.
    pub(crate) mesh_file: &'a str,
    /// The bytes of that file.
    pub(crate) mesh: &'a [u8],
    /// Points on its surface.
    pub(crate) points_n: usize,
    /// Most convex parts.
    pub(crate) max_convex_parts_n: usize,
    /// Largest distance between a part and its simplification, in meters; 0 for few corners instead.
    pub(crate) part_tolerance_m: f64,
    /// Seed of the points.
    pub(crate) seed: u64,
}

/// Makes an object that nobody has seen yet, its mesh, and what was mended of it: its resting orientations are those in
/// which its shape is stable.
///
/// # Errors
///
/// Fails if the mesh cannot be read or spans no volume.
pub(crate) fn shape(source: &Source<'_>) -> Result<(Object, TriMesh, Repairs), RecordingError> {
    let unusable = |reason: String| RecordingError::Mesh {
        file: source.mesh_file.to_owned(),
        reason,
    };
    let (mesh, repairs) = mesh(source.mesh_file, source.mesh).map_err(unusable)?;
    let mass = geometry::mass_properties(&mesh, source.mass_kg);
    let stable = geometry::stable_rests(&mesh, &mass.center_of_mass_m);
    let limit = source.max_convex_parts_n;
    let parts = if source.part_tolerance_m > 0.0 {
        geometry::parts_within(&mesh, limit, source.part_tolerance_m, &stable)
    } else {
        geometry::convex_parts(&mesh, limit)
    };
    let parts = parts.map_err(|err| unusable(err.to_string()))?;
    let (points, normals) = mesh.sample_surface(source.points_n, source.seed);
    let inertia = mass.inertia_kg_m2;
    let object = Object {
        name: source.name.to_owned(),
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
        mirror: geometry::mirror_plane(&mesh, source.seed).map(|plane| Mirror {
            normal: plane.normal,
            offset_m: plane.offset_m,
            error_m: plane.error_m,
        }),
        vertices_m: arrays(&mesh.vertices_m),
        triangles: mesh.triangles.clone(),
        parts_m: parts.iter().map(|part| arrays(part)).collect(),
        rests: stable.iter().map(unseen).collect(),
    };
    Ok((object, mesh, repairs))
}

fn unseen(stable: &StablePose) -> RestingOrientation {
    RestingOrientation {
        rest: stable.rest,
        seen_n: 0,
        probability: stable.probability,
    }
}

/// Reads a mesh from a file's bytes, or says what is wrong with it; it is as large as what a hand
/// grasps.
pub(crate) fn mesh(file: &str, bytes: &[u8]) -> Result<(TriMesh, Repairs), String> {
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
