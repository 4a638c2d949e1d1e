//! Where the table is, and how the grasped object lies on it.

use geometry::TriMesh;
use nalgebra::{Unit, Vector3};
use spatial::{Object, Pose, Rest, World};

use crate::{
    error::Unusable,
    recording::{Ground, Recording, Tag},
};

/// Returns how the grasped object lies on the table.
///
/// # Errors
///
/// Fails if nothing says where the table is.
pub(crate) fn rest(
    recording: &Recording,
    world_from_object: &Pose<World, Object>,
    shapes: &[schemas::objects::Object],
) -> Result<Rest, Unusable> {
    match &recording.ground {
        Ground::Tag(world_from_tag) => Ok(on_tag(world_from_tag, world_from_object)),
        Ground::Standing(_) => {
            let _ = shapes;
            Err(Unusable::NoTable)
        }
    }
}

/// Returns how an object lies on the table whose surface is the tag's plane.
pub(crate) fn on_tag(
    world_from_tag: &Pose<World, Tag>,
    world_from_object: &Pose<World, Object>,
) -> Rest {
    let tag_from_object = &world_from_tag.inverse() * world_from_object;
    let up_in_object = tag_from_object.inverse().direction(&Vector3::z());
    Rest {
        up_in_object: Unit::new_normalize(up_in_object),
        height_m: tag_from_object.isometry().translation.z,
    }
}

/// Returns the height of a mesh's lowest point above the table, in meters; `None` without vertices.
pub(crate) fn lowest_m(mesh: &TriMesh, rest: &Rest) -> Option<f64> {
    let heights = mesh
        .vertices_m
        .iter()
        .map(|vertex| rest.up_in_object.dot(&vertex.coords) + rest.height_m);
    heights.reduce(f64::min)
}
