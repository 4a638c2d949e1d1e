//! `objects`: what can be grasped, one partition and one row per object, in its own frame. The artifact
//! `shapes` has the same columns.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use nalgebra::{Unit, Vector3};
use spatial::RestingPose;

use crate::{
    SchemaError, Table,
    columns::{Reader, Writer, columns},
};

/// Name of the artifact's file that holds the mesh alone, as Wavefront OBJ in the object frame: for
/// readers that do not depend on the object's resting poses.
pub const MESH: &str = "mesh.obj";

/// The label of a generated object: the objects that nothing was learned from, and that it is unlike, by name, with
/// commas between.
pub const APART_FROM: &str = "apart_from";

/// An object's surface and how it rests: what training reads, whatever the object's mass.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Its name in the dataset.
    pub name: String,
    /// Points on the surface, object frame, in meters.
    pub points_m: Vec<[f64; 3]>,
    /// Its resting orientations on a table, as [`Object::rests`].
    pub rests: Vec<RestingOrientation>,
}

impl From<&Object> for Surface {
    fn from(object: &Object) -> Self {
        Self {
            name: object.name.clone(),
            points_m: object.points_m.clone(),
            rests: object.rests.clone(),
        }
    }
}

/// One object.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Its name in the dataset, e.g. `005_tomato_soup_can`.
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
    /// The best mirror plane, if one was found.
    pub mirror: Option<Mirror>,
    /// The mesh's vertices, in meters.
    pub vertices_m: Vec<[f64; 3]>,
    /// The mesh's triangles, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices of each convex part, in meters.
    pub parts_m: Vec<Vec<[f64; 3]>>,
    /// Its resting orientations on a table: demonstrated ones first, the most frequent first.
    pub rests: Vec<RestingOrientation>,
}

/// A plane of exact or approximate mirror symmetry of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mirror {
    /// Unit normal of the plane, object frame.
    pub normal: Unit<Vector3<f64>>,
    /// The plane's distance from the object's origin along the normal, in meters.
    pub offset_m: f64,
    /// Distance between the mirrored surface and the surface, in meters.
    pub error_m: f64,
}

/// A resting orientation of an object on a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestingOrientation {
    /// Up direction and height.
    pub rest: RestingPose,
    /// Number of demonstrations with this orientation.
    pub seen_n: u32,
    /// Share of random drops that end in this orientation, estimated from the mesh.
    pub probability: f64,
}

columns! {
    /// An object, its groups as lists.
    struct Row {
        mass_kg: f64 ["kg"] => "true mass",
        center_of_mass_m: [f64; 3] ["m"] => "center of mass, object frame",
        inertia_kg_m2: [f64; 6] ["kg m2"]
            => "inertia about the center of mass: xx, yy, zz, xy, xz, yz",
        points_m: Vec<[f64; 3]> ["m"] => "points on the surface, object frame",
        normals: Vec<[f64; 3]> ["1"] => "outward unit normal at each point",
        watertight: bool => "whether the mesh is closed",
        mirror_normal: Vec<[f64; 3]> ["1"]
            => "normal of the object's best mirror plane, if any, object frame",
        mirror_offset_m: Vec<f64> ["m"] => "the plane: normal · x = offset, object frame",
        mirror_error_m: Vec<f64> ["m"] => "how far the mirrored surface is from the surface",
        vertices_m: Vec<[f64; 3]> ["m"] => "mesh vertices, object frame",
        triangles: Vec<i64> => "three vertex indices per triangle, outward winding",
        part_points_m: Vec<[f64; 3]> ["m"]
            => "vertices of the convex parts, one part after another",
        part_sizes: Vec<i64> => "number of vertices of each convex part",
        rests: Rests,
    }
}

columns! {
    /// The resting orientations of an object, as lists of equal length.
    struct Rests {
        up as rest_up: Vec<[f64; 3]> ["1"]
            => "resting orientations: unit vector against gravity, object frame",
        height_m as rest_height_m: Vec<f64> ["m"] => "height of the object's origin above the table",
        seen_n as rest_seen_n: Vec<i64> => "demonstrations in which it lay so",
        probability as rest_probability: Vec<f64> ["1"] => "share of random drops that end so",
    }
}

columns! {
    /// An object's surface.
    struct SurfaceRow {
        points_m: Vec<[f64; 3]> ["m"] => "points on the surface, object frame",
        rests: Rests,
    }
}

impl Rests {
    fn of(rests: &[RestingOrientation]) -> Self {
        Self {
            up: rests
                .iter()
                .map(|r| r.rest.up_in_object.into_inner().into())
                .collect(),
            height_m: rests.iter().map(|r| r.rest.height_m).collect(),
            seen_n: rests.iter().map(|r| r.seen_n.into()).collect(),
            probability: rests.iter().map(|r| r.probability).collect(),
        }
    }

    fn orientations(&self) -> Result<Vec<RestingOrientation>, SchemaError> {
        let n = self.up.len();
        SchemaError::check_length("rest_height_m", "orientations", &self.height_m, n)?;
        SchemaError::check_length("rest_seen_n", "orientations", &self.seen_n, n)?;
        let probabilities = &self.probability;
        SchemaError::check_length("rest_probability", "orientations", probabilities, n)?;
        let rest = |idx: usize| {
            Ok(RestingOrientation {
                rest: RestingPose {
                    up_in_object: SchemaError::check_direction("rest_up", self.up[idx])?,
                    height_m: self.height_m[idx],
                },
                seen_n: count("rest_seen_n", self.seen_n[idx])?,
                probability: self.probability[idx],
            })
        };
        (0..n).map(rest).collect()
    }
}

impl From<&Object> for Row {
    fn from(object: &Object) -> Self {
        let mirror = || object.mirror.iter();
        let part_sizes = object.parts_m.iter();
        Self {
            mass_kg: object.mass_kg,
            center_of_mass_m: object.center_of_mass_m,
            inertia_kg_m2: object.inertia_kg_m2,
            points_m: object.points_m.clone(),
            normals: object.normals.clone(),
            watertight: object.watertight,
            mirror_normal: mirror().map(|m| m.normal.into_inner().into()).collect(),
            mirror_offset_m: mirror().map(|m| m.offset_m).collect(),
            mirror_error_m: mirror().map(|m| m.error_m).collect(),
            vertices_m: object.vertices_m.clone(),
            triangles: object
                .triangles
                .iter()
                .flatten()
                .map(|&idx| idx.into())
                .collect(),
            part_points_m: object.parts_m.concat(),
            // No count in memory exceeds `i64::MAX`.
            part_sizes: part_sizes
                .map(|part| i64::try_from(part.len()).unwrap_or(i64::MAX))
                .collect(),
            rests: Rests::of(&object.rests),
        }
    }
}

impl Row {
    fn triangles(&self) -> Result<Vec<[u32; 3]>, SchemaError> {
        let vertex = |idx: i64| {
            let known = u32::try_from(idx).ok();
            let known = known.filter(|&idx| (idx as usize) < self.vertices_m.len());
            known.ok_or_else(|| {
                let message = format!("vertex index {idx} is out of range");
                SchemaError::invalid("triangles", message)
            })
        };
        let (triangles, rest) = self.triangles.as_chunks();
        SchemaError::check_length("triangles", "vertices of an unfinished triangle", rest, 0)?;
        triangles
            .iter()
            .map(|&[a, b, c]| Ok([vertex(a)?, vertex(b)?, vertex(c)?]))
            .collect()
    }

    fn parts_m(&self) -> Result<Vec<Vec<[f64; 3]>>, SchemaError> {
        let mut points = self.part_points_m.iter().copied();
        let part = |&size: &i64| {
            let size: usize = count("part_sizes", size)?;
            let part: Vec<[f64; 3]> = points.by_ref().take(size).collect();
            SchemaError::check_length("part_sizes", "points of a part", &part, size)?;
            Ok(part)
        };
        self.part_sizes.iter().map(part).collect()
    }

    fn mirror(&self) -> Result<Option<Mirror>, SchemaError> {
        match (
            self.mirror_normal.as_slice(),
            self.mirror_offset_m.as_slice(),
            self.mirror_error_m.as_slice(),
        ) {
            (&[normal], &[offset_m], &[error_m]) => Ok(Some(Mirror {
                normal: SchemaError::check_direction("mirror_normal", normal)?,
                offset_m,
                error_m,
            })),
            ([], [], []) => Ok(None),
            _ => Err(SchemaError::invalid(
                "mirror_normal",
                "more or fewer than one plane".to_owned(),
            )),
        }
    }
}

/// Converts a stored count.
fn count<T: TryFrom<i64>>(column: &str, n: i64) -> Result<T, SchemaError> {
    T::try_from(n).map_err(|_no_count| SchemaError::invalid(column, format!("{n} is not a count")))
}

impl Table for Object {
    const NAME: &'static str = "objects";
    const PARTITION: &'static str = "object";
    const VERSION: &'static str = "objects/2";

    fn schema() -> Schema {
        Writer::of::<Row>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        Writer::of(Self::VERSION, &[Row::from(self)]).into_batch()
    }

    fn from_batch(name: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let row: Row = Reader::new(batch, Self::VERSION)?.row()?;
        Ok(Self {
            name: name.to_owned(),
            mirror: row.mirror()?,
            triangles: row.triangles()?,
            parts_m: row.parts_m()?,
            rests: row.rests.orientations()?,
            mass_kg: row.mass_kg,
            center_of_mass_m: row.center_of_mass_m,
            inertia_kg_m2: row.inertia_kg_m2,
            points_m: row.points_m,
            normals: row.normals,
            watertight: row.watertight,
            vertices_m: row.vertices_m,
        })
    }
}

impl Table for Surface {
    const NAME: &'static str = Object::NAME;
    const PARTITION: &'static str = Object::PARTITION;
    const VERSION: &'static str = "surfaces/1";
    const FILE: &'static str = "surface.parquet";

    fn schema() -> Schema {
        Writer::of::<SurfaceRow>(Self::VERSION, &[]).schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        let row = SurfaceRow {
            points_m: self.points_m.clone(),
            rests: Rests::of(&self.rests),
        };
        Writer::of(Self::VERSION, &[row]).into_batch()
    }

    fn from_batch(name: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        let row: SurfaceRow = Reader::new(batch, Self::VERSION)?.row()?;
        Ok(Self {
            name: name.to_owned(),
            rests: row.rests.orientations()?,
            points_m: row.points_m,
        })
    }
}
