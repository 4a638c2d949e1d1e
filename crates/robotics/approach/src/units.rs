//! Inputs of a grasp generator for an object.

use dataflow::{Partition, Scope, Unit};
use schemas::{Table, distance_fields::FieldInfo, objects::Object, trajectories::Trajectory};

/// Returns a unit for each object: it reads the object, its distances, if there are any, and of every demonstration
/// these files.
pub fn units<'a>(
    scope: &'a Scope,
    objects: Vec<&'a Partition>,
    files: &'a [&'a str],
) -> impl Iterator<Item = Unit> + 'a {
    let trajectories = scope.partitions(Trajectory::NAME).iter();
    let trajectories = trajectories.map(|trajectory| trajectory.key.as_str());
    objects.into_iter().map(move |object| {
        let object = object.key.as_str();
        Unit::new(object)
            .with_label("object", object)
            .reading(Object::NAME, [object])
            .reading_own(FieldInfo::NAME, scope)
            .reading(Trajectory::NAME, trajectories.clone())
            .only_files(Trajectory::NAME, files.iter().copied())
    })
}
