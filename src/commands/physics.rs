//! Whether the simulated cell has the physics of the screen whose motions it executes, and a hand drives of its own.

use std::fs;

use dataflow::{Pipeline, StageEntry};
use robot::RobotModel;
use schemas::{Table, rollouts::Rollouts};
use serde_json::Value;
use simulation::{ProtocolName, SceneConfig};
use stage_dispatch::{Dispatch, SIMULATED};
use stage_screen::Screen;

/// Values of a scene on which it depends whether a grasp succeeds. Time steps are not among them: the cell's
/// differ on purpose.
const PHYSICS: [&str; 9] = [
    "friction",
    "table_friction",
    "object_mass_kg",
    "object_density_kg_per_m3",
    "mass_scale",
    "fingers_touch",
    "fingers_touch_palm",
    "palm_compliance",
    "drive",
];

/// A value in which a simulated cell differs from the screen, or a screen from the hand.
pub(crate) struct Difference {
    /// The stage of the cell, or the screen.
    pub(crate) stage: String,
    /// Both values, each with its key.
    pub(crate) text: String,
    /// A way to have the same value in both.
    pub(crate) hint: String,
}

/// Returns the values in which simulated cells differ from the screens of their motions.
pub(crate) fn differences(pipeline: &Pipeline) -> Vec<Difference> {
    let stages = pipeline.stages.iter();
    stages
        .filter_map(|dispatch| of_stage(pipeline, dispatch))
        .flatten()
        .collect()
}

/// Relative difference of torque limits that are meant to be the same.
const SAME: f64 = 0.01;

/// Returns the screens whose drives are not as strong as the hand's own description says: the limits may be those of
/// another hand.
pub(crate) fn foreign_drives(pipeline: &Pipeline) -> Vec<Difference> {
    pipeline.stages.iter().filter_map(foreign_drive).collect()
}

/// As [`foreign_drives`], of one stage; `None` too if the description cannot be read, which is told elsewhere, or
/// says nothing of its drives.
fn foreign_drive(stage: &StageEntry) -> Option<Difference> {
    // A published protocol has the drives of its paper.
    let options = stage.options::<Screen>();
    let options = options.filter(|options| options.protocol.name.is_own())?;
    let hand = RobotModel::from_urdf_bytes(&fs::read(&options.hand).ok()?).ok()?;
    let limit = options.scene.drive.torque_limit;
    let efforts = hand.finger_efforts_nm();
    let (least, most) = (*efforts.first()?, *efforts.last()?);
    let is_own = |effort: &f64| (effort - limit).abs() <= SAME * effort;
    if efforts.iter().any(is_own) {
        return None;
    }
    let own = if least < most {
        format!("{least} to {most} Nm")
    } else {
        format!("{most} Nm")
    };
    Some(Difference {
        stage: stage.name.to_string(),
        text: format!(
            "`{}` drives the fingers of `{}` with at most {limit} Nm, and its URDF says {own}: the drive may be \
             another hand's",
            stage.name,
            hand.name()
        ),
        hint: "give the hand its own torque limit, stiffness and damping, e.g. with \
               `drive = { torque_limit = … }` in its file"
            .to_owned(),
    })
}

/// As [`differences`], of one stage; `None` if it serves no simulated cell for a screen.
fn of_stage(pipeline: &Pipeline, dispatch: &StageEntry) -> Option<Vec<Difference>> {
    let options = dispatch.options::<Dispatch>()?;
    if options.cell != SIMULATED {
        return None;
    }
    let source = dispatch.inputs.get(Rollouts::NAME)?;
    let screen = pipeline.stages.iter().find(|it| it.name == source.stage)?;
    let screening = screen.options::<Screen>()?;
    let [judged, sent] = [&screening.protocol, &options.protocol].map(|it| it.name);
    if judged != sent && judged.is_own() {
        // The rest follows from the name.
        let [judged, sent] = [judged, sent].map(ProtocolName::as_str);
        return Some(vec![Difference {
            stage: dispatch.name.to_string(),
            text: format!(
                "`{}.protocol.name` is {judged}, `{}.protocol.name` is {sent}: the simulated cell executes motions in \
                 other physics than they were screened in",
                screen.name, dispatch.name
            ),
            hint: format!(
                "to execute in the physics of the screen, add `--set {}.protocol.name={judged}`",
                dispatch.name
            ),
        }]);
    }
    let screened = values(&screening.resolved().scene);
    let executed = values(&options.resolved().simulated.scene);
    let differing = PHYSICS
        .iter()
        .flat_map(|key| inner(key, &screened[*key], &executed[*key]));
    let difference = |(key, screened, executed): (String, Value, Value)| Difference {
        stage: dispatch.name.to_string(),
        text: format!(
            "`{}.scene.{key}` is {screened}, `{}.simulated.scene.{key}` is {executed}: the simulated cell \
             executes motions in other physics than they were screened in",
            screen.name, dispatch.name
        ),
        hint: match screened {
            Value::Null => format!(
                "to execute in the physics of the screen, leave out `{}.simulated.scene.{key}`",
                dispatch.name
            ),
            screened => format!(
                "to execute in the physics of the screen, add `--set {}.simulated.scene.{key}={screened}`",
                dispatch.name
            ),
        },
    };
    Some(differing.map(difference).collect())
}

/// The values of a scene by their keys.
fn values(scene: &SceneConfig) -> Value {
    serde_json::to_value(scene).unwrap_or_default()
}

/// Returns the values that differ; of tables those within, each by its key.
fn inner(key: &str, a: &Value, b: &Value) -> Vec<(String, Value, Value)> {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            let of = |name: &String| {
                let [a, b] = [a, b].map(|it| it.get(name).cloned().unwrap_or_default());
                inner(&format!("{key}.{name}"), &a, &b)
            };
            a.keys().flat_map(of).collect()
        }
        _ if a == b => Vec::new(),
        _ => vec![(key.to_owned(), a.clone(), b.clone())],
    }
}
