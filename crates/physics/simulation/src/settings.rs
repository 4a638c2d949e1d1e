//! Bounds of the settings of a scene and a protocol.

use crate::config::{Approach, Protocol, PullConfig, SceneConfig, StrictConfig, Support, Trial};

/// Longest of the times that a protocol is made of, in seconds.
const MAX_DURATION_S: f64 = 3600.0;
/// Shortest physics time step, in seconds: the numbers of physics have 32 bits.
const MIN_STEP_S: f64 = 1e-6;
/// Longest physics time step, in seconds.
const MAX_STEP_S: f64 = 0.1;
/// Most solver substeps in one physics step.
const MAX_SUBSTEPS: u32 = 100;
/// Maximum number of physics steps in one control step.
const MAX_STEPS_PER_CONTROL: u32 = 10_000;
/// Maximum number of control steps of a motion, of which each is held in memory: 500 times those of a usual one.
const MAX_CONTROL_STEPS: f64 = 100_000.0;
/// Maximum number of physics steps of a motion or of an object that comes to rest.
const MAX_STEPS: f64 = 10_000_000.0;
/// Maximum number of links of a hand.
const MAX_LINKS: u32 = 5000;
/// Longest delay of a finger's commands, in seconds.
pub(crate) const MAX_DELAY_S: f64 = 0.2;
/// Greatest number of any other setting.
const MAX_SETTING: f64 = 1e6;
/// Reason for the bound [`MAX_SETTING`].
const SINGLE_PRECISION: &str = "physics computes with 32 bits";

/// Problem with one setting.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` {problem}")]
pub struct SettingFault {
    /// Dotted name of the setting, e.g. `drive.stiffness`.
    pub key: &'static str,
    /// The problem, to be read after the name.
    pub problem: String,
}

impl SettingFault {
    /// Returns the fault of the setting of this name.
    pub fn new(key: &'static str, problem: impl Into<String>) -> Self {
        let problem = problem.into();
        Self { key, problem }
    }
}

impl From<SettingFault> for (&'static str, String) {
    fn from(fault: SettingFault) -> Self {
        (fault.key, fault.problem)
    }
}

impl SceneConfig {
    /// Returns the faults of the scene's settings, each with its bounds and their reason.
    pub fn faults(&self) -> Vec<SettingFault> {
        let mut faults = Faults::default();
        for (key, number) in [
            ("mass_scale", self.mass_scale),
            ("hand_mass_scale", self.hand_mass_scale),
            ("drive.stiffness", self.drive.stiffness),
        ] {
            faults.above(key, number, "physics needs a positive mass and stiffness");
        }
        for (key, number) in [
            ("friction", self.friction),
            ("table_friction", self.table_friction.unwrap_or_default()),
            ("prediction_m", self.prediction_m),
            ("contact_recycle_m", self.contact_recycle_m),
            ("drive.damping", self.drive.damping),
            ("drive.torque_limit", self.drive.torque_limit),
            ("drive.armature", self.drive.armature),
            ("drive.stop_stiffness", self.drive.stop_stiffness),
        ] {
            faults.unsigned(key, number);
        }
        if let Some(palm) = &self.palm_drive {
            for (key, number) in [
                ("palm_drive.stiffness_n_per_m", palm.stiffness_n_per_m),
                ("palm_drive.damping_ns_per_m", palm.damping_ns_per_m),
                ("palm_drive.force_limit_n", palm.force_limit_n),
                ("palm_drive.stiffness_nm_per_rad", palm.stiffness_nm_per_rad),
                ("palm_drive.damping_nms_per_rad", palm.damping_nms_per_rad),
                ("palm_drive.torque_limit_nm", palm.torque_limit_nm),
            ] {
                faults.unsigned(key, number);
            }
        }
        for (key, number) in [
            ("object_mass_kg", self.object_mass_kg),
            ("object_density_kg_per_m3", self.object_density_kg_per_m3),
        ] {
            if let Some(number) = number {
                faults.above(key, number, "an object without mass cannot be simulated");
            }
        }
        if self.object_mass_kg.is_some() && self.object_density_kg_per_m3.is_some() {
            let problem = "conflicts with `object_density_kg_per_m3`: set one of them";
            faults.note("object_mass_kg", problem.to_owned());
        }
        for (key, number) in [
            ("object_offset.x_m", self.object_offset.x_m),
            ("object_offset.y_m", self.object_offset.y_m),
            ("object_offset.yaw_rad", self.object_offset.yaw_rad),
        ] {
            faults.signed(key, number);
        }
        let why = "a hand with a longer delay cannot be controlled";
        faults.within("drive.delay_s", self.drive.delay_s, 0.0, MAX_DELAY_S, why);
        let why = "shorter steps vanish in 32-bit rounding, longer ones miss contacts";
        let step_s = self.time_step_s;
        faults.within("time_step_s", step_s, MIN_STEP_S, MAX_STEP_S, why);
        if !(1..=MAX_SUBSTEPS).contains(&self.substeps) {
            let problem = format!(
                "is {}, and must be from 1 to {MAX_SUBSTEPS}: more have no effect",
                self.substeps
            );
            faults.note("substeps", problem);
        }
        let per_control = self.steps_per_control;
        if !(1..=MAX_STEPS_PER_CONTROL).contains(&per_control) {
            let problem = format!(
                "is {per_control}, and must be from 1 to {MAX_STEPS_PER_CONTROL}: controllers take \
                 commands more often"
            );
            faults.note("steps_per_control", problem);
        }
        let why = "an object that moves for longer will not come to rest";
        faults.within("settle_s", self.settle_s, 0.0, MAX_DURATION_S, why);
        let settling = self.settle_s / step_s;
        if faults.0.is_empty() && settling > MAX_STEPS {
            faults.note(
                "settle_s",
                format!(
                    "is {:?}, with `time_step_s` = {step_s:?} that makes {settling:.0} steps, and may \
                     make {MAX_STEPS}: they take hours",
                    self.settle_s
                ),
            );
        }
        faults.0
    }
}

impl Protocol {
    /// Returns the setting for which a robot cell cannot execute the protocol, if there is one.
    pub fn cell_fault(&self) -> Option<SettingFault> {
        let fault = |key, problem: &str| Some(SettingFault::new(key, problem));
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
    pub fn faults(&self, scene: &SceneConfig) -> Vec<SettingFault> {
        let mut faults = Faults::default();
        faults.above_to(
            "reach_s",
            self.reach_s,
            MAX_DURATION_S,
            "reaching takes seconds",
        );
        for (key, seconds) in [
            ("squeeze_s", self.squeeze_s),
            ("pause_s", self.pause_s),
            ("lift_s", self.lift_s),
            ("hold_s", self.hold_s),
            ("pull.pull_s", self.pull.pull_s),
        ] {
            faults.within(key, seconds, 0.0, MAX_DURATION_S, "a grasp takes seconds");
        }
        let closing = self.close_fraction;
        faults.within(
            "close_fraction",
            closing,
            0.0,
            1.0,
            "it is a share of the reach",
        );
        let PullConfig {
            force_n_per_kg,
            max_displacement_m,
            max_rotation_rad,
            ..
        } = self.pull;
        let StrictConfig {
            min_fingers,
            max_spin_rad_per_s,
            palm_table_tolerance_m,
            start_tolerance_m,
            max_palm_force_n,
            max_palm_torque_nm,
            ..
        } = self.strict;
        for (key, most) in [
            ("strict.max_palm_force_n", max_palm_force_n),
            ("strict.max_palm_torque_nm", max_palm_torque_nm),
        ] {
            if let Some(most) = most {
                faults.above(key, most, "every grasp loads the palm");
            }
        }
        for (key, number) in [
            ("open_rad", self.open_rad),
            ("squeeze_rad", self.squeeze_rad),
            ("lift_m", self.lift_m),
            ("lifted_m", self.lifted_m),
            ("max_slip_m_per_s", self.max_slip_m_per_s),
            ("knocked_m", self.knocked_m),
            ("knocked_rad", self.knocked_rad),
            ("limit_tolerance_rad", self.limit_tolerance_rad),
            ("table_tolerance_m", self.table_tolerance_m),
            ("early_tolerance_m", self.early_tolerance_m),
            ("strict.max_spin_rad_per_s", max_spin_rad_per_s),
            ("strict.palm_table_tolerance_m", palm_table_tolerance_m),
            ("strict.start_tolerance_m", start_tolerance_m),
            ("pull.force_n_per_kg", force_n_per_kg),
            ("pull.max_displacement_m", max_displacement_m),
            ("pull.max_rotation_rad", max_rotation_rad),
        ] {
            faults.signed(key, number);
        }
        for (key, number) in [
            ("min_links", self.min_links),
            ("strict.min_fingers", min_fingers),
        ] {
            if number > MAX_LINKS {
                let problem = format!(
                    "is {number}, and must be from 0 to {MAX_LINKS}: no hand has more links"
                );
                faults.note(key, problem);
            }
        }
        if self.trial == Trial::Lift
            && scene.support == Support::Nothing
            && self.name.is_table_lift()
        {
            let problem =
                "is `lift`, from no table and without weight: the scene's `support` is `nothing`";
            faults.note("trial", problem.to_owned());
        }
        if faults.0.is_empty() && scene.faults().is_empty() {
            self.check_steps(scene, &mut faults);
        }
        faults.0
    }

    /// Notes the longest of the times if a motion would have more steps than can be held.
    fn check_steps(&self, scene: &SceneConfig, faults: &mut Faults) {
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

/// Faults found so far.
#[derive(Default)]
pub(crate) struct Faults(pub(crate) Vec<SettingFault>);

impl Faults {
    pub(crate) fn note(&mut self, key: &'static str, problem: String) {
        self.0.push(SettingFault { key, problem });
    }

    pub(crate) fn within(
        &mut self,
        key: &'static str,
        number: f64,
        least: f64,
        most: f64,
        why: &str,
    ) {
        if !(least..=most).contains(&number) {
            let problem = format!("is {number:?}, and must be from {least} to {most}: {why}");
            self.note(key, problem);
        }
    }

    /// Notes a setting that is negative, or more than physics computes with.
    fn unsigned(&mut self, key: &'static str, number: f64) {
        self.within(key, number, 0.0, MAX_SETTING, SINGLE_PRECISION);
    }

    /// Notes a setting that is larger, with either sign, than physics computes with.
    fn signed(&mut self, key: &'static str, number: f64) {
        self.within(key, number, -MAX_SETTING, MAX_SETTING, SINGLE_PRECISION);
    }

    fn above(&mut self, key: &'static str, number: f64, why: &str) {
        self.above_to(key, number, MAX_SETTING, why);
    }

    fn above_to(&mut self, key: &'static str, number: f64, most: f64, why: &str) {
        if !(number > 0.0 && number <= most) {
            let problem =
                format!("is {number:?}, and must be more than 0 and at most {most}: {why}");
            self.note(key, problem);
        }
    }
}
