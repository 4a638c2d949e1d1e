//! Triangle meshes: reading, sampling, distance, mass properties, convex parts, resting orientations,
//! mirror planes, the table that objects stand on.
//!
//! ```
//! use geometry::{TriMesh, mass_properties};
//!
//! let tetrahedron = TriMesh::from_obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")?;
//! assert!(tetrahedron.is_watertight());
//! assert!((tetrahedron.volume_m3() - 1.0 / 6.0).abs() < 1e-12);
//! assert!((mass_properties(&tetrahedron, 2.0).center_of_mass_m.x - 0.25).abs() < 1e-12);
//! # Ok::<(), geometry::GeometryError>(())
//! ```
//!
//! Lengths are in meters, every point is in the mesh's own frame, and a closed mesh winds outward:
//! its triangles are counterclockwise seen from outside.
//! Everything here is a pure function of its arguments, random sampling included.
//! Hulls and trees are built by `parry3d` in `f32`; results that matter are refined in `f64`.
//! Textures, materials and texture coordinates are ignored.

mod distance;
mod error;
mod field;
mod hull;
mod mass;
mod mesh;
mod mirror;
mod obj;
mod parts;
mod ply;
mod polygon;
mod rays;
mod read;
mod repair;
mod rests;
mod sample;
mod similarity;
mod single;
mod size;
pub mod solid;
mod stl;
mod table_plane;
mod winding;

pub use distance::{NearestPoint, SurfaceDistance};
pub use error::GeometryError;
pub use field::DistanceField;
pub use mass::{MassProperties, mass_properties};
pub use mesh::TriMesh;
pub use mirror::{MirrorPlane, mirror_plane};
pub use parts::{MAX_PART_VERTICES, coarse_parts, convex_parts, parts_within};
pub use rays::{RayCaster, RayHit};
pub use read::MeshFormat;
pub use repair::Repairs;
pub use rests::{StablePose, stable_rests};
pub use similarity::mean_distance;
pub use size::OBJECT_SIDES_M;
pub use table_plane::{StillObject, TablePlane, table_plane};
