//! Options of `kind = "cem_mpc"`.

use std::path::PathBuf;

use cem_mpc::{ControlOptions, CrossEntropy, Speeds};
use options::{OptionFaults, Options, above, options};
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
#[options(also = Self::combined_faults)]
pub struct CemMpcConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// The hand's file, which marks the fingertips.
    #[option(path)]
    pub hand_table: PathBuf,
    /// Objects for which motions are made, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
    /// Number of motions of each object that are made (4), to the grasps of its first candidates: each simulates about
    /// a thousand control steps for each of its own, and takes some ten seconds. The other candidates get none.
    #[option(default = 4, range = 1..=MAX_PER_OBJECT, why = "each takes some ten seconds")]
    pub per_object: usize,
    /// Sequences of actions sampled in one iteration (100): the paper's.
    #[option(default = 100, range = 2..=MAX_DRAWS, why = "each is simulated for each control step")]
    pub population: usize,
    /// Actions of a sequence, one per control step (5): the paper's.
    #[option(default = 5, range = 1..=MAX_HORIZON, why = "each is simulated for every sample")]
    pub horizon: usize,
    /// Best sequences, which make the next mean and deviation (10): the paper's.
    #[option(default = 10)]
    pub elites: usize,
    /// Iterations before an action is executed (2): the paper's.
    #[option(default = 2, range = 1..=MAX_DRAWS, why = "each is simulated for each control step")]
    pub iterations: usize,
    /// Standard deviation of the first samples, as a share of half the range of an action's number (0.2): wide enough
    /// for any direction.
    #[option(
        default = 0.2, range = above(0.0, 10.0),
        why = "it is a share of half the range of an action's number"
    )]
    pub initial_sd: f64,
    /// Least standard deviation, likewise (0.05): a search goes on.
    #[option(
        default = 0.05, range = 0.0..=10.0,
        why = "it is a share of half the range of an action's number"
    )]
    pub min_sd: f64,
    /// Share of the former mean and deviation in the next ones (0.1).
    #[option(
        default = 0.1, range = 0.0..=0.99,
        why = "with 1 nothing would be learned from the samples"
    )]
    pub smoothing: f64,
    /// Share of the shifted mean with which the next search starts (0.2): with all of it, joints that hardly matter go
    /// on for good in whatever direction they once took.
    #[option(default = 0.2, range = 0.0..=1.0, why = "it is a share of the plan that is left")]
    pub memory: f64,
    /// Greatest speed of the palm's origin along each axis of the object, in m/s: that of a person's hand.
    #[option(default = 1.0, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub max_speed_m_per_s: f64,
    /// Greatest angular speed of the palm about each axis, in rad/s: a quarter turn in a second.
    #[option(default = 1.57, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub max_turn_rad_per_s: f64,
    /// Greatest speed of a joint's command, in rad/s (m/s if prismatic): a little less than that of the hand's drives.
    #[option(default = 5.0, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub max_joint_speed_rad_per_s: f64,
    /// Cost of a meter between the fingertips and the grasp's, as one vector, for each control step (1/m): that of the
    /// released code.
    #[option(default = 0.1, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub tip_weight_per_m: f64,
    /// Cost of a meter by which the object is moved, for each control step (1/m): that of the released code.
    #[option(default = 2.0, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub object_weight_per_m: f64,
    /// Cost of a meter by which the commanded hand is below the table, for each control step (1/m): the palm would go
    /// through it, and the screen refuses that. The released code has no such cost.
    #[option(default = 10.0, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
    pub table_weight_per_m: f64,
    /// Mean distance of the fingertips from the grasp's at which control ends, in meters: the last command is held from
    /// then on.
    #[option(default = 0.01, range = 0.0..=MAX_VALUE, why = "physics computes with 32 bits")]
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

    /// Returns the parameters of control.
    pub(crate) fn control(&self) -> ControlOptions {
        ControlOptions {
            method: CrossEntropy {
                population: self.population,
                elites: self.elites,
                iterations: self.iterations,
                initial_sd: self.initial_sd,
                min_sd: self.min_sd,
                smoothing: self.smoothing,
            },
            horizon: self.horizon,
            memory: self.memory,
            speeds: Speeds {
                palm: self.max_speed_m_per_s,
                turn: self.max_turn_rad_per_s,
                joint: self.max_joint_speed_rad_per_s,
            },
            tip_weight_per_m: self.tip_weight_per_m,
            object_weight_per_m: self.object_weight_per_m,
            table_weight_per_m: self.table_weight_per_m,
            tip_tolerance_m: self.tip_tolerance_m,
            control_step_s: self.scene.control_step_s(),
            steps_n: self.steps_n(),
        }
    }

    /// Returns the number of control steps of a motion, at least one.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a checked protocol has a bounded number of control steps"
    )]
    fn steps_n(&self) -> usize {
        let steps = self.protocol.reach_s / self.scene.control_step_s();
        (steps.round() as usize).max(1)
    }

    fn combined_faults(&self, faults: &mut OptionFaults) {
        let why = "they are some of the `population`";
        faults.within("elites", self.elites, 1..=self.population.max(1), why);
        let resolved = self.resolved();
        let Self {
            scene, protocol, ..
        } = &resolved;
        faults.of_table("scene", scene.faults());
        faults.of_table("protocol", protocol.faults_in(scene));
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
    }
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
