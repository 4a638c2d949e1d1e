//! Meshes as convex bodies.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use geometry::{GeometryError, MeshFormat, TriMesh, convex_parts};
use robot::{ConvexBody, Mesh, RobotModel};

use crate::{LoadError, place};

/// Maximum number of convex parts of one mesh: links of hands are nearly convex but for the palm, and every part
/// costs time wherever something may touch it.
const MAX_PARTS: usize = 8;

/// Gives a robot the shapes of the meshes that it collides with; `urdf` is the file that describes it.
///
/// # Errors
///
/// Fails if one is not there, is not read here, or has no volume.
pub fn with_mesh_shapes(model: RobotModel, urdf: &Path) -> Result<RobotModel, LoadError> {
    model.with_mesh_shapes(|link, mesh| convex_bodies(link, mesh, urdf))
}

/// Returns the convex bodies that a mesh of a link consists of, in meters in the mesh's frame.
///
/// # Errors
///
/// Fails if it is not there, is not read here, or has no volume.
pub fn convex_bodies(link: &str, mesh: &Mesh, urdf: &Path) -> Result<Vec<ConvexBody>, LoadError> {
    let path = path(link, mesh, urdf)?;
    let kind = MeshFormat::of(&path).ok_or_else(|| LoadError::Kind {
        link: link.to_owned(),
        path: path.clone(),
    })?;
    let bytes = fs::read(&path).map_err(|source| LoadError::Read {
        link: link.to_owned(),
        path: path.clone(),
        source,
    })?;
    made_once(&bytes, kind, mesh).map_err(|source| LoadError::Mesh {
        link: link.to_owned(),
        path,
        source,
    })
}

/// Returns the path of a link's mesh.
pub(crate) fn path(link: &str, mesh: &Mesh, urdf: &Path) -> Result<PathBuf, LoadError> {
    place::find(&mesh.file, urdf).ok_or_else(|| LoadError::Missing {
        link: link.to_owned(),
        file: mesh.file.clone(),
        urdf: urdf.to_owned(),
    })
}

/// Key of the cached bodies: a file's digest and kind, and the scale.
type Key = ([u8; 32], MeshFormat, [u64; 3]);
/// Bodies that are made, being made, or cannot be made.
type Slot = Arc<OnceLock<Result<Vec<ConvexBody>, GeometryError>>>;

/// As [`made`], which takes a second or so: every unit of a run wants the same hand.
fn made_once(
    bytes: &[u8],
    kind: MeshFormat,
    mesh: &Mesh,
) -> Result<Vec<ConvexBody>, GeometryError> {
    static KNOWN: Mutex<BTreeMap<Key, Slot>> = Mutex::new(BTreeMap::new());
    let scale: [f64; 3] = mesh.scale.into();
    let key = (
        *blake3::hash(bytes).as_bytes(),
        kind,
        scale.map(f64::to_bits),
    );
    let slot = {
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(known.entry(key).or_default())
    };
    slot.get_or_init(|| made(bytes, kind, mesh)).clone()
}

fn made(bytes: &[u8], kind: MeshFormat, mesh: &Mesh) -> Result<Vec<ConvexBody>, GeometryError> {
    let (read, _) = TriMesh::read(bytes, kind)?;
    let parts = convex_parts(&read.scaled(&mesh.scale), MAX_PARTS)?;
    let bodies: Vec<ConvexBody> = parts
        .into_iter()
        .filter_map(|corners| {
            let corners = TriMesh {
                vertices_m: corners,
                triangles: Vec::new(),
            };
            let hull = corners.convex_hull().ok()?;
            ConvexBody::new(hull.vertices_m, hull.triangles)
        })
        .collect();
    if bodies.is_empty() {
        let points = read.vertices_m.len();
        return Err(GeometryError::NoHull { points });
    }
    Ok(bodies)
}

#[cfg(test)]
mod tests;
