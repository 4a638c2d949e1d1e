//! Rejection of motions on geometry alone.

use motion::HandState;
use nalgebra::Vector3;
use rapier3d::{parry::query, prelude::SharedShape};
use robot::{Link, RobotModel, Shape};
use schemas::rollouts::Verdict;
use spatial::{Object, Palm, Pose, Table};

use crate::{
    config::{Protocol, Support},
    error::SimulationError,
    hand::LinkShape,
    script::{Phase, Script},
    units::{engine_pose, meters},
};

/// Returns why a script is rejected on geometry alone, if it is.
///
/// Checked are, in this order, over the whole reach: joint limits and the hand below the table, of
/// the requested motion; then the hand inside the object at the start and deep inside it before it
/// closes, as it is commanded. Fingers that are opened further than requested may press on the table: they yield.
///
/// # Errors
///
/// Fails if the script has not one position per joint of the hand.
pub(crate) fn reject(
    script: &Script,
    protocol: &Protocol,
    model: &RobotModel,
    shapes: &[LinkShape],
    hulls: &[SharedShape],
    support: Support,
    table_from_object: &Pose<Table, Object>,
) -> Result<Option<Verdict>, SimulationError> {
    let criteria = protocol.criteria();
    let tolerance = criteria.limit_tolerance_rad.unwrap_or(f64::INFINITY);
    let outside = |pose: &HandState<Object>| {
        pose.q_rad
            .iter()
            .zip(model.joints())
            .any(|(&position, joint)| {
                position < joint.lower - tolerance || position > joint.upper + tolerance
            })
    };
    if script.requested.iter().any(outside) {
        return Ok(Some(Verdict::Limit));
    }
    let below = |shape: &LinkShape, object_from_shape: &Pose<Object, Shape>| {
        let table_from_shape = *table_from_object * *object_from_shape;
        let tolerance_m = match shape.of_hand.finger {
            None => protocol.strict.palm_table_tolerance_m,
            Some(_) => criteria.table_tolerance_m.unwrap_or(f64::INFINITY),
        };
        let is_above = shape.shape.lowest_m(&table_from_shape, &Vector3::z()) >= -tolerance_m;
        support == Support::Table && !is_above
    };
    for pose in &script.requested {
        if any_shape(model, shapes, pose, below)? {
            return Ok(Some(Verdict::Table));
        }
    }
    let deeper = |tolerance_m: Option<f64>| {
        move |shape: &LinkShape, object_from_shape: &Pose<Object, Shape>| {
            tolerance_m.is_some_and(|most_m| depth_m(shape, object_from_shape, hulls) > most_m)
        }
    };
    let start_m = criteria.start_tolerance_m;
    if any_shape(model, shapes, &script.start.hand, deeper(start_m))? {
        return Ok(Some(Verdict::EarlyContact));
    }
    let commands = script.commands.iter();
    for command in commands.take_while(|command| command.phase == Phase::Reach) {
        if any_shape(
            model,
            shapes,
            &command.hand,
            deeper(criteria.early_tolerance_m),
        )? {
            return Ok(Some(Verdict::EarlyContact));
        }
    }
    Ok(None)
}

/// Whether a condition holds for any shape of the hand; it gets the shape's pose in the object's
/// frame.
fn any_shape(
    model: &RobotModel,
    shapes: &[LinkShape],
    pose: &HandState<Object>,
    condition: impl Fn(&LinkShape, &Pose<Object, Shape>) -> bool,
) -> Result<bool, SimulationError> {
    let palm_from_links: Vec<Pose<Palm, Link>> = model
        .forward_kinematics(&pose.q_rad)
        .map_err(|err| SimulationError::Motion(err.to_string()))?;
    Ok(shapes.iter().any(|shape| {
        let palm_from_link = palm_from_links[shape.of_hand.link];
        let object_from_shape = pose.frame_from_palm * palm_from_link * shape.link_from_shape;
        condition(shape, &object_from_shape)
    }))
}

/// Returns how deep a shape is inside the deepest of the convex parts, in meters.
fn depth_m(
    shape: &LinkShape,
    object_from_shape: &Pose<Object, Shape>,
    hulls: &[SharedShape],
) -> f64 {
    let object_from_engine = engine_pose(object_from_shape) * shape.shape_from_engine;
    let sphere = shape.engine.compute_bounding_sphere(&object_from_engine);
    hulls
        .iter()
        .filter(|hull| {
            let around = hull.compute_local_bounding_sphere();
            around.center.distance(sphere.center) < around.radius + sphere.radius
        })
        .filter_map(|hull| {
            let at = rapier3d::math::Pose::IDENTITY;
            query::contact(
                &at,
                hull.0.as_ref(),
                &object_from_engine,
                shape.engine.0.as_ref(),
                0.0,
            )
            .ok()?
        })
        .map(|contact| -meters(contact.dist))
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_without_joint_positions_is_not_clear() {
        let model = RobotModel::from_urdf(
            r#"<robot name="h"><link name="palm"/><link name="tip"/>
              <joint name="j" type="continuous"><parent link="palm"/><child link="tip"/></joint>
            </robot>"#,
        )
        .unwrap();
        for (q, is_known) in [(vec![0.1], true), (vec![], false), (vec![0.1; 2], false)] {
            let pose = HandState {
                frame_from_palm: Pose::identity(),
                q_rad: q,
            };
            let found = any_shape(&model, &[], &pose, |_, _| true);
            assert_eq!(found.is_ok(), is_known, "{found:?}");
        }
    }
}
