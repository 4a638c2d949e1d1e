//! Bounds of the settings of a scene and a protocol.

use options::{OptionFault, OptionFaults, Options};

use crate::config::{Approach, Protocol, SceneConfig, Support, Trial};

/// Longest of the times that a protocol is made of, in seconds.
pub(crate) const MAX_DURATION_S: f64 = 3600.0;
/// Shortest physics time step, in seconds: the numbers of physics have 32 bits.
pub(crate) const MIN_STEP_S: f64 = 1e-6;
/// Longest physics time step, in seconds.
pub(crate) const MAX_STEP_S: f64 = 0.1;
/// Most solver substeps in one physics step.
pub(crate) const MAX_SUBSTEPS: u32 = 100;
/// Maximum number of physics steps in one control step.
pub(crate) const MAX_STEPS_PER_CONTROL: u32 = 10_000;
/// Maximum number of control steps of a motion, of which each is held in memory: 500 times those of a usual one.
const MAX_CONTROL_STEPS: f64 = 100_000.0;
/// Maximum number of physics steps of a motion or of an object that comes to rest.
const MAX_STEPS: f64 = 10_000_000.0;
/// Maximum number of links of a hand.
pub(crate) const MAX_LINKS: u32 = 5000;
/// Longest delay of a finger's commands, in seconds.
pub(crate) const MAX_DELAY_S: f64 = 0.2;
/// Greatest number of any other setting.
pub(crate) const MAX_SETTING: f64 = 1e6;
/// Reason for the bound [`MAX_SETTING`].
pub(crate) const SINGLE_PRECISION: &str = "physics computes with 32 bits";

impl SceneConfig {
    pub(crate) fn combined_faults(&self, faults: &mut OptionFaults) {
        if self.object_mass_kg.is_some() && self.object_density_kg_per_m3.is_some() {
            let problem = "conflicts with `object_density_kg_per_m3`: set one of them";
            faults.note("object_mass_kg", problem);
        }
        if self.palm_drive.is_some() && self.palm_compliance.is_some() {
            let problem = "conflicts with `palm_compliance`: set one of them";
            faults.note("palm_drive", problem);
        }
        let step_s = self.time_step_s;
        let settling = self.settle_s / step_s;
        if faults.is_empty() && settling > MAX_STEPS {
            faults.note(
                "settle_s",
                format!(
                    "is {:?}, with `time_step_s` = {step_s:?} that makes {settling:.0} steps, and may \
                     make {MAX_STEPS}: they take hours",
                    self.settle_s
                ),
            );
        }
    }
}

impl Protocol {
    /// Returns the setting for which a robot cell cannot execute the protocol, if there is one.
    pub fn cell_fault(&self) -> Option<OptionFault> {
        let fault = |key, problem: &str| Some(OptionFault::new(key, problem));
        if !self.name.is_table_lift() {
            fault(
                "protocol.name",
                "is that of a published protocol: a cell executes `table_lift`",
            )
        } else if self.approach == Approach::AtGrasp {
            fault(
                "protocol.approach",
                "is `at_grasp`: a cell's hand has to reach the object",
            )
        } else if self.trial != Trial::Lift {
            fault(
                "protocol.trial",
                "is not `lift`: a cell lifts what it grasps, and pulls at nothing",
            )
        } else {
            None
        }
    }

    /// Returns the faults of the protocol's settings in a scene, each with its bounds and their
    /// reason.
    pub fn faults_in(&self, scene: &SceneConfig) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let in_range = self.faults();
        if self.trial == Trial::Lift
            && scene.support == Support::Nothing
            && self.name.is_table_lift()
        {
            let problem =
                "is `lift`, from no table and without weight: the scene's `support` is `nothing`";
            faults.note("trial", problem);
        }
        if in_range.is_empty() && faults.is_empty() && scene.faults().is_empty() {
            self.check_steps(scene, &mut faults);
        }
        [in_range, faults.found()].concat()
    }

    /// Notes the longest of the times if a motion would have more steps than can be held.
    fn check_steps(&self, scene: &SceneConfig, faults: &mut OptionFaults) {
        let trial = match self.trial {
            Trial::Lift => [("lift_s", self.lift_s), ("hold_s", self.hold_s)],
            Trial::SixDirections => [("pull.pull_s", 6.0 * self.pull.pull_s), ("lift_s", 0.0)],
        };
        let [first, second] = trial;
        let times = [
            ("reach_s", self.reach_s),
            ("squeeze_s", self.squeeze_s),
            ("pause_s", self.pause_s),
            first,
            second,
        ];
        let whole_s: f64 = times.iter().map(|(_, seconds)| seconds).sum();
        let longest = times.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        let key = longest.map_or("reach_s", |(key, _)| key);
        for (what, step_s, most, why) in [
            (
                "control steps",
                scene.control_step_s(),
                MAX_CONTROL_STEPS,
                "each is held in memory",
            ),
            (
                "physics steps",
                scene.time_step_s,
                MAX_STEPS,
                "they take hours",
            ),
        ] {
            let steps = whole_s / step_s;
            if steps > most {
                let problem = format!(
                    "is part of {whole_s:?} s, which are {steps:.0} {what} of {step_s:?} s, and may be \
                     {most}: {why}"
                );
                faults.note(key, problem);
                return;
            }
        }
    }
}
