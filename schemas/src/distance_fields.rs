//! `distance_fields`: signed distances from an object's surface, one partition and one row per
//! object; the grid itself is the file [`FIELD`] beside the table.

use crate::{columns::columns, table::table};

/// Name of the artifact's file that holds the grid: signed distances in meters, negative inside, as
/// `geometry::DistanceField` writes them.
pub const FIELD: &str = "field.bin";

columns! {
    /// Metadata of the grid.
    #[derive(Debug, Clone, PartialEq)]
    pub struct FieldInfo {
        spacing_m: f64 ["m"] => "distance between neighboring nodes of the grid",
        margin_m: f64 ["m"] => "room around the mesh's bounds that it covers",
        center_of_mass_m: [f64; 3] ["m"] => "the solid's center of mass, object frame",
        hull_m: Vec<[f64; 3]> ["m"] => "vertices of its convex hull, object frame",
    }
}

table! {"distance_fields", 1, per "object", row: FieldInfo}
