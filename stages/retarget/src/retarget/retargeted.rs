//! One demonstration's trajectory.

use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Max, Mean, Outcome, Sum};
use geometry::DistanceField;
use lake::{LakeError, ReadArtifact, ReadInputs, WriteArtifact};
use nalgebra::Point3;
use posture::{Environment, HandTable};
use retargeting::{LandmarkStep, Retargeted, RetargetingError, retarget, settled};
use schemas::{
    Table,
    demonstrations::{self, Demonstration},
    distance_fields::{self, FieldInfo},
    objects::Object,
    trajectories::{Tracking, Trajectory, TrajectoryRates},
};

use super::{
    LoadedHand,
    fields::read_mesh,
    library::{self, Shown},
    load_hand,
};
use crate::{RetargetConfig, RetargetError, recording};

/// Greatest coordinate of a landmark in the object frame, in meters.
const MAX_DISTANCE_M: f64 = 1000.0;

dataflow::metrics! {
    /// Metrics of a trajectory.
    pub struct TrajectoryMetrics {
        /// Number of steps.
        steps_n: Sum,
        /// Mean distance of the robot's points from their landmarks, in meters.
        keypoint_error_m: Mean,
        /// Distance of the fingertips from their landmarks at the grasp, in meters.
        fingertip_error_m: Mean,
        /// Depth of the hand in the object at the grasp, in meters.
        penetration_m: Mean,
        /// Largest depth of the hand in the table, in meters.
        table_penetration_m: Max,
        /// Distance of the fingertips from the surface at the grasp, in meters.
        tip_gap_m: Mean,
        /// Number of steps that were searched afresh and found a better minimum.
        restarts_n: Sum,
        /// Number of postures that were tried.
        iterations_n: Sum,
    }
}

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
    let shown = demonstration.steps.iter().map(|step| LandmarkStep {
        time_s: step.time_s,
        keypoints_m: step.keypoints_m,
    });
    let shown: Vec<LandmarkStep> = shown.collect();
    let shown = Shown {
        hand: &hand,
        table: &table,
        environment: &environment,
        config: &config.retargeting,
        steps: &shown,
    };
    let retargeted = match &config.dex_retargeting {
        Some(_) => {
            let path = &inputs.source(library::FILE)?.path;
            library::retarget(&library::problem(path, &hand, &urdf)?, path, &shown)?
        }
        None => by_stage(&shown)?,
    };
    let retargeted = match retargeted {
        Ok(Some(retargeted)) => retargeted,
        Ok(None) => return Ok(Outcome::skipped("it has no step")),
        Err(reason) => return Ok(Outcome::skipped(reason)),
    };
    if retargeted.grasp_keypoint_error_m > config.max_keypoint_error_m {
        return Ok(Outcome::skipped(format!(
            "the hand stays {:.0} mm from the landmarks at the grasp, more than \
             `max_keypoint_error_m`",
            1000.0 * retargeted.grasp_keypoint_error_m
        )));
    }
    let counts = [retargeted.restarts_n, retargeted.iterations_n];
    let trajectory = trajectory(demonstration, &table, &environment, retargeted)?;
    cx.write(&trajectory)?;
    recording::record(&urdf, &hand.model, &mesh, &trajectory, cx.folder())?;
    let metrics = TrajectoryMetrics::of(&trajectory.tracking, counts);
    Ok(Outcome::Made(metrics))
}

/// Returns the trajectory of a demonstration.
fn trajectory(
    demonstration: Demonstration,
    table: &HandTable,
    environment: &Environment,
    retargeted: Retargeted,
) -> Result<Trajectory, BoxedDiagnostic> {
    let of_tips = |is_tip: bool| {
        let points = table.points.iter();
        points
            .filter(|point| point.weight > 0.0)
            .filter(|point| !is_tip || point.tip_radius_m.is_some())
            .map(|point| point.keypoint.clone())
            .collect()
    };
    let rates = |idx: usize| {
        let rates = &retargeted.motion.steps()[idx].rates;
        TrajectoryRates {
            palm_velocity: rates.palm_velocity,
            joints: rates.joints.clone(),
        }
    };
    let motion = retargeted.motion.with_rates(rates);
    Ok(Trajectory {
        sequence: demonstration.sequence,
        object: demonstration.object,
        keypoints: of_tips(false),
        tips: of_tips(true),
        rest: environment.rest(),
        motion: motion.map_err(BoxedDiagnostic::without_hint)?,
        tracking: retargeted.tracking.into_iter().map(columns).collect(),
    })
}

/// Retargets a demonstration by the stage's own objective; `None` of no step, a reason if its times make no motion.
fn by_stage(shown: &Shown<'_>) -> Result<Result<Option<Retargeted>, String>, RetargetError> {
    match retarget(shown.hand, shown.environment, shown.config, shown.steps) {
        Ok(retargeted) => Ok(Ok(retargeted)),
        Err(RetargetingError::Motion(err)) => Ok(Err(err.to_string())),
        Err(err) => Err(err.into()),
    }
}

/// Returns a step's tracking as columns of the table.
fn columns(step: retargeting::Tracking) -> Tracking {
    Tracking {
        keypoint_errors_m: step.keypoint_errors_m,
        tip_errors_m: step.tip_errors_m,
        contact_gaps_m: step.contact_gaps_m,
        limit_margin_rad: step.limit_margin_rad,
        penetration_m: step.penetration_m,
        table_penetration_m: step.table_penetration_m,
    }
}

impl TrajectoryMetrics {
    /// Returns the metrics of a motion whose last step is the grasp, after so many restarts and iterations.
    fn of(tracking: &[Tracking], [restarts_n, iterations_n]: [usize; 2]) -> Self {
        let keypoint_errors: f64 = tracking.iter().map(Tracking::keypoint_error_m).sum();
        let still = Tracking::default();
        let grasp = tracking.last().unwrap_or(&still);
        let gaps = grasp.contact_gaps_m.iter().map(|gap| gap.abs());
        let contacts_n = grasp.contact_gaps_m.len().max(1) as f64;
        let table_depths_m = tracking.iter().map(|step| step.table_penetration_m);
        Self {
            steps_n: tracking.len() as f64,
            keypoint_error_m: keypoint_errors / tracking.len().max(1) as f64,
            fingertip_error_m: grasp.fingertip_error_m(),
            penetration_m: grasp.penetration_m,
            table_penetration_m: table_depths_m.fold(0.0, f64::max),
            tip_gap_m: gaps.sum::<f64>() / contacts_n,
            restarts_n: restarts_n as f64,
            iterations_n: iterations_n as f64,
        }
    }
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

/// Reads an object's distances, and puts it down as it lay, but for errors of the recording.
fn read_scene(field: &Artifact, demonstration: &Demonstration) -> Result<Environment, LakeError> {
    let info: FieldInfo = lake::table::read(field)?;
    let grid = field.parsed(distance_fields::FIELD, DistanceField::from_bytes)?;
    let hull: Vec<Point3<f64>> = info.hull_m.iter().map(|&at| Point3::from(at)).collect();
    let center_of_mass = Point3::from(info.center_of_mass_m);
    let rest = settled(&hull, &center_of_mass, &demonstration.rest);
    Ok(Environment::new(grid, rest))
}
