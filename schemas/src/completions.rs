//! `completions`: how an object's shape was estimated from views, one partition and one row per object; the shape itself
//! is in `objects`.

use spatial::{Object, Pose, World};

use crate::{columns::columns, table::table};

columns! {
    /// The estimate of one object's shape.
    #[derive(Debug, Clone, PartialEq)]
    pub struct CompletedObject {
        world_from_object: Pose<World, Object> ["m, 1"]
            => "pose of the estimated object's frame in the world of its views: xyz, xyzw",
        views_n: i64 => "number of views",
        seen_m: Vec<[f64; 3]> ["m"] => "points of the surface that a view shows, object frame",
        seen_normals: Vec<[f64; 3]> ["1"] => "outward unit normal at each of them",
        unseen_m: Vec<f64> ["m"]
            => "distance of each of the object's points from the nearest that a view shows, in their order",
        symmetric: bool => "whether a symmetry completed it",
        free_share: f64 ["1"]
            => "share of the completed hull in which a view shows free space, which was carved out of it",
    }
}

table! {"completions", 1, per "object", row: CompletedObject, beside "objects"}
