//! How plausible and different the motions of one object are.

use dataflow::{Artifact, Context, Inputs, Labels, Made, Outcome, Scope, Summary, Unit};
use diversity::{Diversity, Motion};
use lake::{ReadInputs, WriteArtifact};
use robot::{JointOrder, WrongDof};
use schemas::{
    candidates::{self, Candidates, Step},
    sampling::Sampled,
    trajectories::Trajectory,
};
use stage_sample::{
    CANDIDATES, SampleConfig, SampleError, TRAJECTORIES,
    inputs::{FIELDS, ROBOT, hand_file, hand_meshes, order, read_field, read_hand},
    room::{Gauge, Room},
};

use crate::{
    SampleReportError, charts,
    measure::{Measure, Shown},
};

/// Depth in the object, in meters, up to which a motion counts as clear of it before the grasp.
const CLEAR_M: f64 = 0.005;

/// One unit per object that has candidates.
pub(crate) fn units(config: &SampleConfig, scope: &Scope) -> Result<Vec<Unit>, SampleReportError> {
    let meshes = hand_meshes(config)?;
    let fields = scope.partitions(FIELDS);
    let trajectories = scope.partitions(TRAJECTORIES);
    let units = scope.partitions(CANDIDATES).iter().map(|candidates| {
        let object = candidates.key.as_str();
        // An object without a field is planned without, and skipped.
        let field = fields.iter().find(|field| field.key == object);
        let shown = trajectories
            .iter()
            .filter(|trajectory| trajectory.label("object") == Some(object));
        let unit = Unit::new(object)
            .reading(CANDIDATES, [object])
            .only_files(CANDIDATES, [lake::table::FILE])
            .reading(FIELDS, field.map(|field| field.key.as_str()))
            .reading(
                TRAJECTORIES,
                shown.map(|trajectory| trajectory.key.as_str()),
            )
            .only_files(TRAJECTORIES, [lake::table::FILE])
            .with_file_of_form(hand_file(config), ROBOT);
        meshes.iter().cloned().fold(unit, Unit::with_file)
    });
    Ok(units.collect())
}

/// What is said of an object's report.
pub(crate) fn labels(object: &str) -> Labels {
    Labels::from([("object".to_owned(), object.to_owned())])
}

/// Measures the motions of one object.
pub(crate) fn make(inputs: &Inputs, cx: &Context) -> Result<Outcome, SampleReportError> {
    let drawn: Candidates = inputs.one()?;
    let Some(field) = inputs.artifacts(FIELDS).first() else {
        return Ok(Outcome::Skipped {
            reason: "it is not among the objects with a surface".to_owned(),
        });
    };
    let field = read_field(field)?;
    let (_, hand) = read_hand(&inputs.source(0, "URDF of a hand")?.path)?;
    let shown = inputs
        .artifacts(TRAJECTORIES)
        .iter()
        .map(|artifact| read_shown(artifact, &drawn.joints))
        .collect::<Result<Vec<_>, _>>()?;
    let shown: Vec<Shown> = shown.into_iter().flatten().collect();
    let measure = Measure {
        gauge: Gauge {
            room: &Room::new(&hand)?,
            field: &field,
            order: &order(&hand, &drawn.joints, "set of candidates")?,
        },
        shown: &shown,
    };
    let motions: Vec<Motion> = drawn.candidates.iter().map(Motion::from).collect();
    let diversity = Diversity::of(&motions);
    let sampled = measure.all(&drawn.candidates, &diversity)?;
    cx.write(&sampled)?;
    charts::Charts {
        joints: &drawn.joints,
        sampled: &sampled,
        drawn: &diversity,
        shown: &charts::of_shown(&shown, &motions),
    }
    .put(cx)?;
    Ok(Outcome::Made(Made {
        labels: labels(&drawn.object),
        metrics: metrics(&sampled, &diversity)
            .map(|(name, value)| (name.to_owned(), value))
            .into(),
    }))
}

fn metrics(sampled: &[Sampled], diversity: &Diversity) -> [(&'static str, f64); 10] {
    let count = |is_one: fn(&Sampled) -> bool| sampled.iter().filter(|s| is_one(s)).count() as f64;
    let (at_grasp, over_time) = (diversity.at_grasp, diversity.over_time);
    [
        ("candidates_n", sampled.len() as f64),
        ("within_limits_n", count(Sampled::within_limits)),
        ("clear_n", count(|s| s.approach_depth_m <= CLEAR_M)),
        ("grasp_spread_m", at_grasp.palm_m),
        ("grasp_spread_rad", at_grasp.palm_rad),
        ("grasp_q_spread_rad", at_grasp.q_rad),
        ("motion_spread_m", over_time.palm_m),
        ("motion_spread_rad", over_time.palm_rad),
        ("motion_q_spread_rad", over_time.q_rad),
        ("collapsed_n", f64::from(u8::from(diversity.is_collapsed()))),
    ]
}

/// Says what became of all objects' candidates; spreads are means over the objects.
pub(crate) fn describe(summary: &Summary) -> String {
    let candidates = summary.total("candidates_n");
    let percent = |metric| 100.0 * summary.total(metric) / candidates.max(1.0);
    let mean = |metric| summary.total(metric) / (summary.n_made as f64).max(1.0);
    let line = format!(
        "{:.0} % within limits, {:.0} % clear; spread {:.0} mm, {:.0}°",
        percent("within_limits_n"),
        percent("clear_n"),
        1e3 * mean("grasp_spread_m"),
        mean("grasp_spread_rad").to_degrees(),
    );
    match summary.total("collapsed_n") {
        0.0 => line,
        collapsed => format!("COLLAPSED for {collapsed} objects, all motions one; {line}"),
    }
}

/// Reads a demonstration with its joints in this order; `None` if it has no step.
fn read_shown(artifact: &Artifact, joints: &[String]) -> Result<Option<Shown>, SampleReportError> {
    let shown: Trajectory = lake::table::read(artifact)?;
    let order =
        JointOrder::new(&shown.joints, joints).map_err(|source| SampleError::AnotherHand {
            what: format!("trajectory `{}`", artifact.key),
            source,
        })?;
    let steps = shown.steps.iter().map(|step| {
        Ok(Step {
            time_s: step.time_s,
            object_from_palm: step.object_from_palm,
            q_rad: order.apply(&step.q_rad)?,
            rates: candidates::Rates::still(joints.len()),
        })
    });
    let mut approach: Vec<Step> = steps.collect::<Result<_, WrongDof>>()?;
    Ok(approach.pop().map(|grasp| Shown {
        sequence: shown.sequence.clone(),
        rest: shown.rest,
        approach,
        grasp,
    }))
}
