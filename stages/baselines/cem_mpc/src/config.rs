//! Options of `kind = "cem_mpc"`.

use std::path::PathBuf;

use dataflow::{OptionFault, OptionFaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::{Approach, ControllerKind, Protocol, SceneConfig};

/// Most samples of one iteration, and most iterations.
const MAX_DRAWS: usize = 100_000;
/// Most control steps that are looked ahead.
const MAX_HORIZON: usize = 1000;
/// Most motions of an object.
const MAX_PER_OBJECT: usize = 1_000_000;
/// Greatest weight, speed or distance.
const MAX_VALUE: f64 = 1e6;

/// Options of `kind = "cem_mpc"`.
///
/// An action's numbers are from −1 to 1, shares of the greatest speeds of palm and joints.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CemMpcConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[serde(skip_serializing)]
    pub hand: PathBuf,
    /// The hand's file, which marks the fingertips.
    #[serde(skip_serializing)]
    pub hand_table: PathBuf,
    /// Objects for which motions are made, by name; empty: all
    #[serde(default)]
    pub objects: Vec<String>,
    /// Number of motions of each object that are made (4), to the grasps of its first candidates: each simulates about
    /// a thousand control steps for each of its own, and takes some ten seconds. The other candidates get none.
    #[serde(default = "defaults::per_object")]
    pub per_object: usize,
    /// Sequences of actions sampled in one iteration (100): the paper's.
    #[serde(default = "defaults::population")]
    pub population: usize,
    /// Actions of a sequence, one per control step (5): the paper's.
    #[serde(default = "defaults::horizon")]
    pub horizon: usize,
    /// Best sequences, which make the next mean and deviation (10): the paper's.
    #[serde(default = "defaults::elites")]
    pub elites: usize,
    /// Iterations before an action is executed (2): the paper's.
    #[serde(default = "defaults::iterations")]
    pub iterations: usize,
    /// Standard deviation of the first samples, as a share of half the range of an action's number (0.2): wide enough
    /// for any direction.
    #[serde(default = "defaults::initial_sd")]
    pub initial_sd: f64,
    /// Least standard deviation, likewise (0.05): a search goes on.
    #[serde(default = "defaults::min_sd")]
    pub min_sd: f64,
    /// Share of the former mean and deviation in the next ones (0.1).
    #[serde(default = "defaults::smoothing")]
    pub smoothing: f64,
    /// Share of the shifted mean with which the next search starts (0.2): with all of it, joints that hardly matter go
    /// on for good in whatever direction they once took.
    #[serde(default = "defaults::memory")]
    pub memory: f64,
    /// Greatest speed of the palm's origin along each axis of the object, in m/s: that of a person's hand.
    #[serde(default = "defaults::max_speed_m_per_s")]
    pub max_speed_m_per_s: f64,
    /// Greatest angular speed of the palm about each axis, in rad/s: a quarter turn in a second.
    #[serde(default = "defaults::max_turn_rad_per_s")]
    pub max_turn_rad_per_s: f64,
    /// Greatest speed of a joint's command, in rad/s (m/s if prismatic): a little less than that of the hand's drives.
    #[serde(default = "defaults::max_joint_speed_rad_per_s")]
    pub max_joint_speed_rad_per_s: f64,
    /// Cost of a meter between the fingertips and the grasp's, as one vector, for each control step (1/m): that of the
    /// released code.
    #[serde(default = "defaults::tip_weight_per_m")]
    pub tip_weight_per_m: f64,
    /// Cost of a meter by which the object is moved, for each control step (1/m): that of the released code.
    #[serde(default = "defaults::object_weight_per_m")]
    pub object_weight_per_m: f64,
    /// Cost of a meter by which the commanded hand is below the table, for each control step (1/m): the palm would go
    /// through it, and the screen refuses that. The released code has no such cost.
    #[serde(default = "defaults::table_weight_per_m")]
    pub table_weight_per_m: f64,
    /// Mean distance of the fingertips from the grasp's at which control ends, in meters: the last command is held from
    /// then on.
    #[serde(default = "defaults::tip_tolerance_m")]
    pub tip_tolerance_m: f64,
    /// The physical scene, that of the screen.
    pub scene: SceneConfig,
    /// Protocol of a motion's execution, as in the screen: control ends after the control steps of `reach_s`, 40 by
    /// default.
    pub protocol: Protocol,
}

impl CemMpcConfig {
    /// Returns the options for which the protocol's name stands.
    pub(crate) fn resolved(&self) -> Self {
        let (scene, protocol) = self.protocol.resolved(&self.scene);
        Self {
            scene,
            protocol,
            ..self.clone()
        }
    }

    /// Returns the number of control steps of a motion, at least one.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a checked protocol has a bounded number of control steps"
    )]
    pub(crate) fn steps_n(&self) -> usize {
        let steps = self.protocol.reach_s / self.scene.control_step_s();
        (steps.round() as usize).max(1)
    }

    /// Returns the faults of the options beyond their types.
    pub(crate) fn faults(&self) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let why = "each takes some ten seconds";
        faults.within("per_object", self.per_object, 1..=MAX_PER_OBJECT, why);
        let why = "each is simulated for each control step";
        faults.within("population", self.population, 2..=MAX_DRAWS, why);
        faults.within("iterations", self.iterations, 1..=MAX_DRAWS, why);
        let why = "each is simulated for every sample";
        faults.within("horizon", self.horizon, 1..=MAX_HORIZON, why);
        let why = "they are some of the `population`";
        faults.within("elites", self.elites, 1..=self.population.max(1), why);
        let why = "it is a share of half the range of an action's number";
        faults.above("initial_sd", self.initial_sd, 0.0, 10.0, why);
        faults.within("min_sd", self.min_sd, 0.0..=10.0, why);
        let why = "with 1 nothing would be learned from the samples";
        faults.within("smoothing", self.smoothing, 0.0..=0.99, why);
        let why = "it is a share of the plan that is left";
        faults.within("memory", self.memory, 0.0..=1.0, why);
        for (key, number) in [
            ("max_speed_m_per_s", self.max_speed_m_per_s),
            ("max_turn_rad_per_s", self.max_turn_rad_per_s),
            ("max_joint_speed_rad_per_s", self.max_joint_speed_rad_per_s),
            ("tip_weight_per_m", self.tip_weight_per_m),
            ("object_weight_per_m", self.object_weight_per_m),
            ("table_weight_per_m", self.table_weight_per_m),
            ("tip_tolerance_m", self.tip_tolerance_m),
        ] {
            let why = "physics computes with 32 bits";
            faults.within(key, number, 0.0..=MAX_VALUE, why);
        }
        let resolved = self.resolved();
        let Self {
            scene, protocol, ..
        } = &resolved;
        faults.of_table("scene", scene.faults());
        faults.of_table("protocol", protocol.faults(scene));
        if protocol.approach != Approach::Follow {
            let problem = "must be `follow`: with a scripted approach the screen executes other \
                           fingers than those that were commanded";
            faults.note("protocol.approach", problem);
        }
        if scene.drive.controller != ControllerKind::Pd {
            let problem =
                "must be `pd`: the next command, to which another one looks ahead, is not known";
            faults.note("scene.drive.controller", problem);
        }
        if scene.drive.delay_s > 0.0 {
            faults.note(
                "scene.drive.delay_s",
                "must be 0: commands take effect at once",
            );
        }
        faults.found()
    }
}

/// Values of options that a pipeline file leaves out; the options say why.
#[rustfmt::skip]
mod defaults {
    pub(super) fn per_object() -> usize { 4 }
    pub(super) fn population() -> usize { 100 }
    pub(super) fn horizon() -> usize { 5 }
    pub(super) fn elites() -> usize { 10 }
    pub(super) fn iterations() -> usize { 2 }
    pub(super) fn initial_sd() -> f64 { 0.2 }
    pub(super) fn min_sd() -> f64 { 0.05 }
    pub(super) fn smoothing() -> f64 { 0.1 }
    pub(super) fn memory() -> f64 { 0.2 }
    pub(super) fn max_speed_m_per_s() -> f64 { 1.0 }
    pub(super) fn max_turn_rad_per_s() -> f64 { 1.57 }
    pub(super) fn max_joint_speed_rad_per_s() -> f64 { 5.0 }
    pub(super) fn table_weight_per_m() -> f64 { 10.0 }
    pub(super) fn tip_weight_per_m() -> f64 { 0.1 }
    pub(super) fn object_weight_per_m() -> f64 { 2.0 }
    pub(super) fn tip_tolerance_m() -> f64 { 0.01 }
}

/// Options with their defaults, for the Allegro.
#[cfg(test)]
pub(crate) fn fixture() -> CemMpcConfig {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data");
    let options = serde_json::json!({
        "hand": format!("{data}/robots/allegro_right.urdf"),
        "hand_table": format!("{data}/hands/allegro_right.toml"),
        "scene": {"drive": {
            "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
        }},
        "protocol": {"flexion_joints": ["joint_1.0"]},
    });
    serde_json::from_value(options).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_executed_as_it_was_commanded_is_refused() {
        assert_eq!(fixture().faults(), []);
        assert_eq!(fixture().steps_n(), 40);
        let mut config = fixture();
        config.elites = 101;
        config.protocol.approach = Approach::Open;
        config.scene.drive.controller = ControllerKind::PdFeedforward;
        config.scene.drive.delay_s = 0.02;
        let faults = config.faults();
        let keys: Vec<&str> = faults.iter().map(|fault| fault.key.as_str()).collect();
        let expected = [
            "elites",
            "protocol.approach",
            "scene.drive.controller",
            "scene.drive.delay_s",
        ];
        assert_eq!(keys, expected);
    }
}
