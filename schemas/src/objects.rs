//! `objects`: what can be grasped, one partition and one row per object, in its own frame.
//!
//! | column               | type           | unit  | meaning                                            |
//! |----------------------|----------------|-------|----------------------------------------------------|
//! | `mass_kg`            | f64            | kg    | true mass                                          |
//! | `center_of_mass_m`   | f64 × 3        | m     | center of mass, object frame                       |
//! | `inertia_kg_m2`      | f64 × 6        | kg m² | about it: xx, yy, zz, xy, xz, yz, object axes      |
//! | `points_m`           | list f64 × 3   | m     | points on the surface, area-weighted, object frame |
//! | `normals`            | list f64 × 3   | 1     | outward unit normal at each point                  |
//! | `watertight`         | bool           |       | whether the mesh is closed                         |
//! | `mirror_normal`      | list f64 × 3   | 1     | normal of the object's best mirror plane, if any   |
//! | `mirror_offset_m`    | list f64       | m     | the plane: normal · x = offset, object frame       |
//! | `mirror_error_m`     | list f64       | m     | how far the mirrored surface is from the surface   |
//! | `vertices_m`         | list f64 × 3   | m     | the mesh's vertices                                |
//! | `triangles`          | list i64       | 1     | three vertex indices per triangle, outward winding |
//! | `part_points_m`      | list f64 × 3   | m     | vertices of the convex parts, one part after another |
//! | `part_sizes`         | list i64       | 1     | how many of them each convex part has              |
//! | `rest_up`            | list f64 × 3   | 1     | resting orientations: unit vector against gravity  |
//! | `rest_height_m`      | list f64       | m     | height of the object's origin above the table      |
//! | `rest_seen_n`        | list i64       | 1     | demonstrations in which it lay so; 0: only stable  |
//! | `rest_probability`   | list f64       | 1     | share of random drops that end so, by the mesh     |

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use nalgebra::{Unit, Vector3};
use spatial::Rest;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError, count};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "objects/2";

/// Name of the artifact's file that holds the mesh alone, as Wavefront OBJ in the object frame: for
/// readers that do not depend on how the object was seen to lie.
pub const MESH: &str = "mesh.obj";

/// One object.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// The dataset's name of it, e.g. `005_tomato_soup_can`.
    pub name: String,
    /// Mass in kilograms.
    pub mass_kg: f64,
    /// Center of mass in the object frame, in meters.
    pub center_of_mass_m: [f64; 3],
    /// Inertia about the center of mass along the object's axes: xx, yy, zz, xy, xz, yz.
    pub inertia_kg_m2: [f64; 6],
    /// Points on the surface, in meters.
    pub points_m: Vec<[f64; 3]>,
    /// Outward unit normal at each point.
    pub normals: Vec<[f64; 3]>,
    /// Whether the mesh is closed.
    pub watertight: bool,
    /// The plane in which it is most nearly its own mirror image, if one was found.
    pub mirror: Option<Mirror>,
    /// The mesh's vertices, in meters.
    pub vertices_m: Vec<[f64; 3]>,
    /// The mesh's triangles, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices of each convex part, in meters.
    pub parts_m: Vec<Vec<[f64; 3]>>,
    /// How it can lie on a table: orientations seen first, most often seen first.
    pub rests: Vec<RestingOrientation>,
}

/// A plane in which an object is its own mirror image, or nearly so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mirror {
    /// Unit normal of the plane, object frame.
    pub normal: Unit<Vector3<f64>>,
    /// The plane's distance from the object's origin along the normal, in meters.
    pub offset_m: f64,
    /// How far the mirrored surface is from the surface, in meters.
    pub error_m: f64,
}

/// One way in which an object lies on a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingOrientation {
    /// Up direction and height.
    pub rest: Rest,
    /// Number of demonstrations in which it lay so.
    pub seen_n: u32,
    /// Share of random drops that end so, estimated from the mesh.
    pub probability: f64,
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(objects: &[Object]) -> Columns {
    let mut c = Columns::new(VERSION);
    c.f64(
        "mass_kg",
        "kg",
        "true mass",
        objects.iter().map(|o| o.mass_kg),
    );
    c.f64_array(
        "center_of_mass_m",
        "m",
        "center of mass, object frame",
        objects.iter().map(|o| o.center_of_mass_m),
    );
    c.f64_array(
        "inertia_kg_m2",
        "kg m2",
        "inertia about the center of mass: xx, yy, zz, xy, xz, yz",
        objects.iter().map(|o| o.inertia_kg_m2),
    );
    c.f64_arrays(
        "points_m",
        "m",
        "points on the surface, object frame",
        objects.iter().map(|o| o.points_m.clone()),
    );
    c.f64_arrays(
        "normals",
        "1",
        "outward unit normal at each point",
        objects.iter().map(|o| o.normals.clone()),
    );
    c.bool(
        "watertight",
        "whether the mesh is closed",
        objects.iter().map(|o| o.watertight),
    );
    mirror_columns(&mut c, objects);
    c.f64_arrays(
        "vertices_m",
        "m",
        "mesh vertices, object frame",
        objects.iter().map(|o| o.vertices_m.clone()),
    );
    c.i64_list(
        "triangles",
        "three vertex indices per triangle, outward winding",
        objects.iter().map(|o| {
            o.triangles
                .iter()
                .flatten()
                .map(|&idx| i64::from(idx))
                .collect()
        }),
    );
    c.f64_arrays(
        "part_points_m",
        "m",
        "vertices of the convex parts, one part after another",
        objects.iter().map(|o| o.parts_m.concat()),
    );
    c.i64_list(
        "part_sizes",
        "number of vertices of each convex part",
        objects
            .iter()
            .map(|o| o.parts_m.iter().map(|part| count(part.len())).collect()),
    );
    rest_columns(&mut c, objects);
    c
}

fn mirror_columns(c: &mut Columns, objects: &[Object]) {
    c.f64_arrays(
        "mirror_normal",
        "1",
        "normal of the object's best mirror plane, if any, object frame",
        objects.iter().map(|o| {
            o.mirror
                .iter()
                .map(|m| m.normal.into_inner().into())
                .collect()
        }),
    );
    c.f64_list(
        "mirror_offset_m",
        "m",
        "the plane: normal · x = offset, object frame",
        objects
            .iter()
            .map(|o| o.mirror.iter().map(|m| m.offset_m).collect()),
    );
    c.f64_list(
        "mirror_error_m",
        "m",
        "how far the mirrored surface is from the surface",
        objects
            .iter()
            .map(|o| o.mirror.iter().map(|m| m.error_m).collect()),
    );
}

fn rest_columns(c: &mut Columns, objects: &[Object]) {
    let rests = |f: fn(&RestingOrientation) -> f64| {
        objects
            .iter()
            .map(|o| o.rests.iter().map(f).collect())
            .collect::<Vec<Vec<f64>>>()
    };
    c.f64_arrays(
        "rest_up",
        "1",
        "resting orientations: unit vector against gravity, object frame",
        objects.iter().map(|o| {
            o.rests
                .iter()
                .map(|r| r.rest.up_in_object.into_inner().into())
                .collect()
        }),
    );
    c.f64_list(
        "rest_height_m",
        "m",
        "height of the object's origin above the table",
        rests(|r| r.rest.height_m).into_iter(),
    );
    c.i64_list(
        "rest_seen_n",
        "demonstrations in which it lay so",
        objects
            .iter()
            .map(|o| o.rests.iter().map(|r| i64::from(r.seen_n)).collect()),
    );
    c.f64_list(
        "rest_probability",
        "1",
        "share of random drops that end so",
        rests(|r| r.probability).into_iter(),
    );
}

/// Returns one row per object; the name is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(objects: &[Object]) -> Result<RecordBatch, SchemaError> {
    columns(objects).into_batch()
}

/// Reads what [`to_batch`] wrote for the object `name`.
///
/// # Errors
///
/// Fails if the columns are of another version, or there is not exactly one row.
fn from_batch(name: &str, batch: &RecordBatch) -> Result<Object, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_rows(1)?;
    let vertices: Vec<[f64; 3]> = r.f64_arrays("vertices_m", 0)?;
    let mut part_points: std::vec::IntoIter<[f64; 3]> =
        r.f64_arrays("part_points_m", 0)?.into_iter();
    let indices = r.i64_list("triangles", 0)?;
    let mut triangles = Vec::with_capacity(indices.len() / 3);
    for corner in indices.chunks_exact(3) {
        let mut triangle = [0; 3];
        for (slot, &idx) in triangle.iter_mut().zip(corner) {
            *slot = u32::try_from(idx)
                .ok()
                .filter(|&idx| (idx as usize) < vertices.len())
                .ok_or_else(|| {
                    r.invalid("triangles", format!("vertex index {idx} is out of range"))
                })?;
        }
        triangles.push(triangle);
    }
    let mut parts_m = Vec::new();
    for size in r.i64_list("part_sizes", 0)? {
        let size = counted(&r, "part_sizes", size)?;
        let part: Vec<[f64; 3]> = part_points.by_ref().take(size).collect();
        if part.len() != size {
            let message = format!("a part of {size} points has {} of them", part.len());
            return Err(r.invalid("part_sizes", message));
        }
        parts_m.push(part);
    }
    let ups: Vec<[f64; 3]> = r.f64_arrays("rest_up", 0)?;
    let heights = r.f64_list("rest_height_m", 0)?;
    let seen = r.i64_list("rest_seen_n", 0)?;
    let probabilities = r.f64_list("rest_probability", 0)?;
    let rests = ups
        .iter()
        .zip(heights)
        .zip(seen.iter().zip(probabilities))
        .map(|((&up, height_m), (&seen_n, probability))| {
            Ok(RestingOrientation {
                rest: Rest {
                    up_in_object: Unit::new_normalize(Vector3::from(up)),
                    height_m,
                },
                seen_n: counted(&r, "rest_seen_n", seen_n)?,
                probability,
            })
        })
        .collect::<Result<_, SchemaError>>()?;
    let normals: Vec<[f64; 3]> = r.f64_arrays("mirror_normal", 0)?;
    let offsets = r.f64_list("mirror_offset_m", 0)?;
    let errors = r.f64_list("mirror_error_m", 0)?;
    let mirror = match (normals.as_slice(), offsets.as_slice(), errors.as_slice()) {
        (&[normal], &[offset_m], &[error_m]) => Some(Mirror {
            normal: Unit::new_normalize(Vector3::from(normal)),
            offset_m,
            error_m,
        }),
        ([], [], []) => None,
        _ => {
            return Err(r.invalid("mirror_normal", "more or fewer than one plane".to_owned()));
        }
    };
    Ok(Object {
        name: name.to_owned(),
        mass_kg: r.f64("mass_kg", 0)?,
        center_of_mass_m: r.f64_array("center_of_mass_m", 0)?,
        inertia_kg_m2: r.f64_array("inertia_kg_m2", 0)?,
        points_m: r.f64_arrays("points_m", 0)?,
        normals: r.f64_arrays("normals", 0)?,
        watertight: r.bool("watertight", 0)?,
        mirror,
        vertices_m: vertices,
        triangles,
        parts_m,
        rests,
    })
}

/// Takes a count as it is stored.
fn counted<T: TryFrom<i64>>(r: &Reader<'_>, column: &str, n: i64) -> Result<T, SchemaError> {
    T::try_from(n).map_err(|_no_count| r.invalid(column, format!("{n} is no count")))
}

impl Table for Object {
    const NAME: &'static str = "objects";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(std::slice::from_ref(self))
    }

    fn from_batch(key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(key, batch)
    }
}
