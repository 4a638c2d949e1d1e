//! Pose of the table, and resting orientation of the grasped object on it.

use geometry::{StablePose, StillObject, TablePlane, TriMesh};
use nalgebra::{Point3, Unit, Vector3};
use schemas::objects;
use spatial::{Object, Pose, RestingPose, World};

use crate::{
    departure,
    error::RecordingError,
    recording::{Recording, TableSource, Tag},
};

/// Resting orientation of the grasped object on the table, and its source.
pub(crate) struct TablePose {
    /// The resting orientation.
    pub(crate) rest: RestingPose,
    /// The table's plane, if estimated from still objects.
    pub(crate) plane: Option<TablePlane>,
}

/// Returns the resting orientation of the grasped object on the table.
///
/// # Errors
///
/// Fails if the table's pose is unknown, or fewer than `min_objects_n` still objects agree on it.
pub(crate) fn lying(
    recording: &Recording,
    world_from_object: &Pose<World, Object>,
    shapes: &[objects::Object],
    min_objects_n: usize,
) -> Result<TablePose, RecordingError> {
    match &recording.ground {
        TableSource::Tag(world_from_tag) => Ok(TablePose {
            rest: on_tag(world_from_tag, world_from_object),
            plane: None,
        }),
        TableSource::StillObject { others, above } => {
            let others = others.iter().filter_map(|other| {
                Some((other.object.as_str(), departure::middle(&other.poses)?))
            });
            let scene: Vec<_> = [(recording.object.as_str(), *world_from_object)]
                .into_iter()
                .chain(others)
                .filter_map(|(name, pose)| {
                    Some((pose, Shape::of(shapes.iter().find(|s| s.name == name)?)))
                })
                .collect();
            let standing: Vec<StillObject<'_>> = scene
                .iter()
                .map(|(world_from_object, shape)| StillObject {
                    world_from_object: *world_from_object,
                    rests: &shape.rests,
                    vertices_m: &shape.vertices_m,
                })
                .collect();
            let origin = world_from_object.translation.vector;
            let toward = above.map(|above| above.coords - origin);
            let plane = geometry::table_plane(&standing, toward).ok_or(RecordingError::NoTable)?;
            if plane.agreeing_n < min_objects_n {
                return Err(RecordingError::FewOnTable {
                    found: plane.agreeing_n,
                    min: min_objects_n,
                });
            }
            Ok(TablePose {
                rest: on_plane(&plane, world_from_object),
                plane: Some(plane),
            })
        }
    }
}

/// Stable orientations and vertices of a shape.
struct Shape {
    rests: Vec<StablePose>,
    vertices_m: Vec<Point3<f64>>,
}

impl Shape {
    fn of(shape: &objects::Object) -> Self {
        let rests = shape.rests.iter().map(|rest| StablePose {
            rest: rest.rest,
            probability: rest.probability,
        });
        Self {
            rests: rests.collect(),
            vertices_m: shape.vertices_m.iter().map(|&v| v.into()).collect(),
        }
    }
}

/// Returns the resting orientation of an object on a plane.
fn on_plane(plane: &TablePlane, world_from_object: &Pose<World, Object>) -> RestingPose {
    let up_in_object = world_from_object.inverse() * *plane.up;
    let origin = world_from_object.translation.vector;
    RestingPose {
        up_in_object: Unit::new_normalize(up_in_object),
        height_m: plane.up.dot(&origin) - plane.height_m,
    }
}

/// Returns the resting orientation of an object on the tag's plane.
pub(crate) fn on_tag(
    world_from_tag: &Pose<World, Tag>,
    world_from_object: &Pose<World, Object>,
) -> RestingPose {
    let tag_from_object = world_from_tag.inverse() * *world_from_object;
    let up_in_object = tag_from_object.inverse() * Vector3::z();
    RestingPose {
        up_in_object: Unit::new_normalize(up_in_object),
        height_m: tag_from_object.translation.z,
    }
}

/// Returns the height of a mesh's lowest point above the table, in meters; `None` without vertices.
pub(crate) fn lowest_m(mesh: &TriMesh, rest: &RestingPose) -> Option<f64> {
    let heights = mesh
        .vertices_m
        .iter()
        .map(|vertex| rest.up_in_object.dot(&vertex.coords) + rest.height_m);
    heights.reduce(f64::min)
}
