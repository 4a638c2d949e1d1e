//! `distance_fields`: how far the space about an object is from its surface, one partition and one
//! row per object; the grid itself is the file [`FIELD`] beside the table.
//!
//! | column             | type         | unit | meaning                                          |
//! |--------------------|--------------|------|--------------------------------------------------|
//! | `spacing_m`        | f64          | m    | distance between neighboring nodes of the grid   |
//! | `margin_m`         | f64          | m    | room around the mesh's bounds that it covers     |
//! | `center_of_mass_m` | f64 × 3      | m    | the solid's center of mass, object frame         |
//! | `hull_m`           | list f64 × 3 | m    | vertices of its convex hull, object frame        |

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns or to the file; readers reject every other version.
const VERSION: &str = "distance_fields/1";

/// Name of the artifact's file that holds the grid: signed distances in meters, negative inside, as
/// `geometry::DistanceField` writes them.
pub const FIELD: &str = "field.bin";

/// What is known beside the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldInfo {
    /// Distance between neighboring nodes, in meters.
    pub spacing_m: f64,
    /// Room around the mesh's bounds that the grid covers, in meters.
    pub margin_m: f64,
    /// Center of mass of the solid, object frame, in meters.
    pub center_of_mass_m: [f64; 3],
    /// Vertices of the convex hull, object frame, in meters.
    pub hull_m: Vec<[f64; 3]>,
}

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(fields: &[&FieldInfo]) -> Columns {
    let rows = || fields.iter();
    let mut c = Columns::new(VERSION);
    c.f64(
        "spacing_m",
        "m",
        "distance between neighboring nodes of the grid",
        rows().map(|f| f.spacing_m),
    );
    c.f64(
        "margin_m",
        "m",
        "room around the mesh's bounds that it covers",
        rows().map(|f| f.margin_m),
    );
    c.f64_array(
        "center_of_mass_m",
        "m",
        "the solid's center of mass, object frame",
        rows().map(|f| f.center_of_mass_m),
    );
    c.f64_arrays(
        "hull_m",
        "m",
        "vertices of its convex hull, object frame",
        rows().map(|f| f.hull_m.clone()),
    );
    c
}

/// Returns one row; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(field: &FieldInfo) -> Result<RecordBatch, SchemaError> {
    columns(&[field]).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version or there is not one row.
fn from_batch(batch: &RecordBatch) -> Result<FieldInfo, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_rows(1)?;
    Ok(FieldInfo {
        spacing_m: r.f64("spacing_m", 0)?,
        margin_m: r.f64("margin_m", 0)?,
        center_of_mass_m: r.f64_array("center_of_mass_m", 0)?,
        hull_m: r.f64_arrays("hull_m", 0)?,
    })
}

impl Table for FieldInfo {
    const NAME: &'static str = "distance_fields";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch)
    }
}
