//! One demonstration's trajectory.

use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Outcome};
use geometry::DistanceField;
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact};
use posture::{Environment, HandTable};
use schemas::{
    Table,
    demonstrations::{self, Demonstration},
    distance_fields::{self, FieldInfo},
    objects::Object,
    trajectories,
};

use super::{LoadedHand, fields::read_mesh, load_hand};
use crate::{
    RetargetConfig, RetargetError, recording,
    settle::put_down,
    track::{TrajectoryMetrics, track},
};

/// Greatest coordinate of a landmark in the object frame, in meters.
const MAX_DISTANCE_M: f64 = 1000.0;

/// Makes the trajectory of one demonstration.
pub(super) fn make(
    config: &RetargetConfig,
    inputs: &Inputs,
    cx: &Context,
) -> Result<Outcome<TrajectoryMetrics>, BoxedDiagnostic> {
    let urdf = inputs.source("hand")?;
    let table = inputs.source("hand_table")?;
    let LoadedHand { urdf, hand, table } = load_hand(&urdf.path, &table.path)?;
    let demonstration: Demonstration = inputs.one()?;
    if let Some(reason) = unusable(&demonstration, &table) {
        return Ok(Outcome::skipped(reason));
    }
    let (Some(object), Some(field)) = (
        inputs.artifacts(Object::NAME).first(),
        inputs.artifacts(FieldInfo::NAME).first(),
    ) else {
        return Ok(Outcome::skipped(format!(
            "object `{}` has no distance field",
            demonstration.object
        )));
    };
    let mesh = match read_mesh(object)? {
        Ok(mesh) => mesh,
        Err(reason) => return Ok(Outcome::skipped(reason)),
    };
    let environment = read_scene(field, &demonstration)?;
    let tracked = match track(&hand, &environment, config, &demonstration) {
        Ok(Some(tracked)) => tracked,
        Ok(None) => return Ok(Outcome::skipped("it has no step")),
        Err(RetargetError::Motion(err)) => return Ok(Outcome::skipped(err.to_string())),
        Err(err) => return Err(err.into()),
    };
    if tracked.grasp_keypoint_error_m > config.max_keypoint_error_m {
        return Ok(Outcome::skipped(format!(
            "the hand stays {:.0} mm from the landmarks at the grasp, more than \
             `max_keypoint_error_m`",
            1000.0 * tracked.grasp_keypoint_error_m
        )));
    }
    let metrics = tracked.metrics();
    let of_tips = |is_tip: bool| {
        let points = table.points.iter();
        points
            .filter(|point| point.weight > 0.0)
            .filter(|point| !is_tip || point.tip_radius_m.is_some())
            .map(|point| point.keypoint.clone())
            .collect()
    };
    let trajectory = trajectories::Trajectory {
        sequence: demonstration.sequence,
        object: demonstration.object,
        keypoints: of_tips(false),
        tips: of_tips(true),
        rest: environment.rest(),
        motion: tracked.motion,
        tracking: tracked.tracking,
    };
    cx.write(&trajectory)?;
    recording::record(&urdf, &hand.model, &mesh, &trajectory, cx.folder())?;
    Ok(Outcome::Made(metrics))
}

/// Returns why a demonstration cannot be retargeted to this hand, if it cannot.
pub(super) fn unusable(demonstration: &Demonstration, table: &HandTable) -> Option<String> {
    if demonstration.hand != table.side {
        return Some(format!(
            "a {} hand's reach, but the hand's file says that the robot's is a {} hand",
            demonstration.hand.as_str(),
            table.side.as_str()
        ));
    }
    let is_sound = |step: &demonstrations::Step| {
        let mut coordinates = step.keypoints_m.as_flattened().iter();
        coordinates.all(|x| x.abs() <= MAX_DISTANCE_M) && step.time_s.is_finite()
    };
    let broken = demonstration
        .steps
        .iter()
        .position(|step| !is_sound(step))?;
    Some(format!(
        "step {broken} has a time that is not finite, or a landmark that is not within \
         {MAX_DISTANCE_M} m"
    ))
}

fn read_scene(field: &Artifact, demonstration: &Demonstration) -> Result<Environment, LakeError> {
    let info = lake::table::read(field)?;
    let grid = field.parsed(distance_fields::FIELD, DistanceField::from_bytes)?;
    Ok(put_down(grid, &info, &demonstration.rest))
}
