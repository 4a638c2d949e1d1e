//! Plausibility and diversity of one object's motions.

use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, OptionsUsed, Outcome, Output, Scope, Sum, Summary, Unit,
};
use diversity::{ComparedMotion, Diversity};
use geometry::DistanceField;
use hand_files::HandFiles;
use lake::{ReadArtifact, WriteArtifact};
use motion::MotionError;
use robot::RobotModel;
use sampling::{CollisionModel, PenetrationProbe};
use schemas::{
    Table,
    candidates::Candidates,
    distance_fields::{self, FieldInfo},
    sampling::{SampleMeasures, Sampling},
    trajectories::Trajectory,
};

use super::{charts, measure::Measure};
use crate::{Sample, SampleConfig, SampleError, inputs::joint_order};

/// Depth in the object, in meters, up to which a motion counts as clear of it before the grasp.
const CLEAR_M: f64 = 0.005;

dataflow::metrics! {
    /// Metrics of the motions of an object.
    pub struct SamplingMetrics {
        /// Number of candidates.
        candidates_n: Sum,
        /// Number of those drawn within the joint limits.
        within_limits_n: Sum,
        /// Number of those clear of the object before the grasp.
        clear_n: Sum,
        /// Spread of the palm at the grasp, in meters.
        grasp_spread_m: Mean,
        /// Spread of the palm at the grasp, in radians.
        grasp_spread_rad: Mean,
        /// Spread of the joints at the grasp, in radians (meters if prismatic).
        grasp_q_spread_rad: Mean,
        /// Spread of the palm over the motion, in meters.
        motion_spread_m: Mean,
        /// Spread of the palm over the motion, in radians.
        motion_spread_rad: Mean,
        /// Spread of the joints over the motion, in radians (meters if prismatic).
        motion_q_spread_rad: Mean,
        /// Number of objects all of whose motions are one.
        collapsed_n: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions, its distances, its demonstrations and the hand.
    pub struct SamplingInputs {
        /// The motions.
        each drawn: Candidates [lake::table::FILE];
        /// The distances from the object.
        own field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes),
            or "object has no distance field";
        /// The object's demonstrations.
        labeled shown: Trajectory [lake::table::FILE], by "object";
    }
    files {
        /// The hand.
        hand: RobotModel = hand_files::model;
    }
}

/// The report `sampling`: how plausible and different an object's motions are.
pub struct SamplingReport;

impl Output for SamplingReport {
    type Stage = Sample;
    type Metrics = SamplingMetrics;
    type Inputs<'a> = SamplingInputs;

    const ARTIFACT: &'static str = Sampling::NAME;
    const SCHEMA: &'static str = Sampling::VERSION;
    const PARTITION: &'static str = Sampling::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<SamplingMetrics>> = Some(line);

    /// One unit per object that has candidates.
    fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = SamplingInputs::units(scope, &[])?;
        Ok(HandFiles::without_table(&config.hand)?.added_to_each(units))
    }

    /// Measures the motions of one object.
    fn make(
        _config: &SampleConfig,
        inputs: SamplingInputs,
        cx: &Context,
    ) -> Result<Outcome<SamplingMetrics>, BoxedDiagnostic> {
        let SamplingInputs {
            drawn,
            field,
            shown,
            hand,
        } = inputs;
        let shown = shown
            .into_iter()
            .map(|shown| reordered(shown, &drawn.joints));
        let shown = shown.collect::<Result<Vec<_>, _>>()?;
        let measure = Measure {
            probe: PenetrationProbe {
                collision_model: &CollisionModel::new(&hand).map_err(SampleError::from)?,
                field: &field,
                order: &joint_order(&hand, &drawn.joints, "set of candidates")?,
            },
            shown: &shown,
        };
        let motions: Vec<ComparedMotion> =
            drawn.candidates.iter().map(ComparedMotion::from).collect();
        let diversity = Diversity::of(&motions);
        let sampled = measure
            .all(&drawn.candidates, &diversity)
            .map_err(SampleError::from)?;
        cx.write(&sampled)?;
        charts::Charts {
            joints: &drawn.joints,
            sampled: &sampled,
            drawn: &diversity,
            shown: &charts::of_shown(&shown, &motions),
        }
        .put(cx)?;
        Ok(Outcome::Made(SamplingMetrics::of(&sampled, &diversity)))
    }
}

impl SamplingMetrics {
    fn of(sampled: &[SampleMeasures], diversity: &Diversity) -> Self {
        let count = |is_one: fn(&SampleMeasures) -> bool| {
            sampled.iter().filter(|s| is_one(s)).count() as f64
        };
        let (at_grasp, over_time) = (diversity.at_grasp, diversity.over_time);
        Self {
            candidates_n: sampled.len() as f64,
            within_limits_n: count(SampleMeasures::within_limits),
            clear_n: count(|s| s.approach_depth_m <= CLEAR_M),
            grasp_spread_m: at_grasp.palm_m,
            grasp_spread_rad: at_grasp.palm_rad,
            grasp_q_spread_rad: at_grasp.q_rad,
            motion_spread_m: over_time.palm_m,
            motion_spread_rad: over_time.palm_rad,
            motion_q_spread_rad: over_time.q_rad,
            collapsed_n: f64::from(u8::from(diversity.is_collapsed())),
        }
    }
}

/// Says what became of all objects' candidates.
fn line(summary: &Summary<SamplingMetrics>) -> String {
    let all = &summary.metrics;
    let percent = |n: f64| 100.0 * n / all.candidates_n.max(1.0);
    let line = format!(
        "{:.0} % within limits, {:.0} % collision-free; palm spread {:.0} mm, {:.0}°",
        percent(all.within_limits_n),
        percent(all.clear_n),
        1e3 * all.grasp_spread_m,
        all.grasp_spread_rad.to_degrees(),
    );
    match all.collapsed_n {
        0.0 => line,
        collapsed => format!("COLLAPSED for {collapsed} objects, all motions one; {line}"),
    }
}

/// Returns a demonstration with its joints in this order.
fn reordered(shown: Trajectory, joints: &[String]) -> Result<Trajectory, SampleError> {
    let motion = shown.motion.reordered(joints).map_err(|err| match err {
        MotionError::Joints(source) => SampleError::HandMismatch {
            what: format!("trajectory `{}`", shown.sequence),
            source,
        },
        other => other.into(),
    })?;
    Ok(Trajectory { motion, ..shown })
}
