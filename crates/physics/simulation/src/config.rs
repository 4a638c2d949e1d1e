//! The physical scene and the grasp protocol.

mod drives;

use options::{above, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use self::drives::{ControllerKind, DriveConfig, PalmComplianceConfig, PalmDriveConfig};
use crate::{
    protocols::ProtocolName,
    settings::{
        MAX_DURATION_S, MAX_LINKS, MAX_SETTING, MAX_STEP_S, MAX_STEPS_PER_CONTROL, MAX_SUBSTEPS,
        MIN_STEP_S, SINGLE_PRECISION,
    },
    shortcuts::Shortcuts,
};

/// The physical scene: object, table, hand and time steps.
#[options(also = Self::combined_faults)]
#[derive(PartialEq)]
#[schemars(inline)]
pub struct SceneConfig {
    /// Friction coefficient of every surface (hand, object, table): that of rubber fingertips on
    /// most things.
    #[option(default = 1.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub friction: f64,
    /// Friction coefficient of the table's surface, if it is not that of the others: a contact has the mean of
    /// its two surfaces.
    #[option(default, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub table_friction: Option<f64>,
    /// Mass of the object in kilograms, in place of its true mass; inertias change in proportion.
    #[option(
        default, range = above(0.0, MAX_SETTING),
        why = "an object without mass cannot be simulated"
    )]
    pub object_mass_kg: Option<f64>,
    /// Density of the object's convex parts, in kilograms per cubic meter, which gives its mass in place of its
    /// true mass.
    #[option(
        default, range = above(0.0, MAX_SETTING),
        why = "an object without mass cannot be simulated"
    )]
    pub object_density_kg_per_m3: Option<f64>,
    /// Support of the object: the `table`, or `nothing`, without gravity.
    #[option(default)]
    pub support: Support,
    /// Factor on the object's mass and inertia.
    #[option(
        default = 1.0, range = above(0.0, MAX_SETTING),
        why = "physics needs a positive mass and stiffness"
    )]
    pub mass_scale: f64,
    /// Factor on the masses and inertias of the hand's links, known to its controller.
    #[option(
        default = 1.0, range = above(0.0, MAX_SETTING),
        why = "physics needs a positive mass and stiffness"
    )]
    pub hand_mass_scale: f64,
    /// Displacement of the object from its estimated pose: none.
    #[option(default, table)]
    pub object_offset: Offset,
    /// Physics time step in seconds: half of it costs twice as much, and drives are implicit.
    #[option(
        default = 0.004, range = MIN_STEP_S..=MAX_STEP_S,
        why = "shorter steps vanish in 32-bit rounding, longer ones miss contacts"
    )]
    pub time_step_s: f64,
    /// Solver substeps in one physics step, between which contacts keep their normals (1): with 2, a
    /// step costs a quarter more.
    #[option(default = 1, range = 1..=MAX_SUBSTEPS, why = "more have no effect")]
    pub substeps: u32,
    /// Physics steps in one control step: with the default step, 50 commands a second.
    #[option(
        default = 5, range = 1..=MAX_STEPS_PER_CONTROL,
        why = "controllers take commands more often"
    )]
    pub steps_per_control: u32,
    /// Distance in meters below which contacts are computed: yields a third as many constraint rows
    /// as the engine's default.
    #[option(default = 0.002, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub prediction_m: f64,
    /// Relative motion of two touching shapes, in meters, up to which their contact points and normals
    /// are kept instead of computed again (0): the engine's default, 50 mm, accepts grasps that slip, and
    /// with 1 mm held cans turn back and forth.
    #[option(default = 0.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub contact_recycle_m: f64,
    /// Whether different fingers touch each other (false; always by `full_contact`); links of one finger never do.
    #[option(default)]
    pub fingers_touch: bool,
    /// Whether fingers touch the palm (false; always by `full_contact`), except for their links next to it and those
    /// that overlap it with all joints at zero.
    #[option(default)]
    pub fingers_touch_palm: bool,
    /// Timeout in seconds for the object to come to rest on the table: it falls half a millimeter.
    #[option(
        default = 1.0, range = 0.0..=MAX_DURATION_S,
        why = "an object that moves for longer will not come to rest"
    )]
    pub settle_s: f64,
    /// Drives of the finger joints.
    #[option(table)]
    pub drive: DriveConfig,
    /// Drives of the palm's six coordinates (none): without them it follows its path exactly.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[option(default, table)]
    pub palm_drive: Option<PalmDriveConfig>,
    /// Compliance of the arm that holds the palm (none): without it contact does not push the palm back. Conflicts
    /// with `palm_drive`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[option(default, table)]
    pub palm_compliance: Option<PalmComplianceConfig>,
    /// Simulation steps omitted because they cannot change the verdict.
    #[option(default, table)]
    pub shortcuts: Shortcuts,
}

impl SceneConfig {
    /// Returns the duration of one control step in seconds.
    pub fn control_step_s(&self) -> f64 {
        self.time_step_s * f64::from(self.steps_per_control)
    }

    /// Whether fingers touch each other and the palm, so that a depth of theirs counts.
    pub(crate) fn is_finger_depth_defined(&self) -> bool {
        self.fingers_touch && self.fingers_touch_palm
    }

    /// Returns the object's mass, before [`SceneConfig::mass_scale`].
    pub fn object_mass(&self) -> ObjectMass {
        match (self.object_mass_kg, self.object_density_kg_per_m3) {
            (Some(mass_kg), _) => ObjectMass::Kilograms(mass_kg),
            (None, Some(density)) => ObjectMass::Density(density),
            (None, None) => ObjectMass::Measured,
        }
    }

    /// Returns the number of control steps in which a finger's command arrives, e.g. 2 with 30 ms and 20 ms.
    pub fn delay_control_steps(&self) -> usize {
        self.delay_steps().div_ceil(self.steps_per_control as usize)
    }

    /// Returns the delay of the fingers in physics steps.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a checked scene has a delay of 0 to 0.2 s, and steps of at least a microsecond"
    )]
    pub(crate) fn delay_steps(&self) -> usize {
        (self.drive.delay_s / self.time_step_s).round() as usize
    }
}

/// Mass of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ObjectMass {
    /// Its true mass.
    Measured,
    /// This mass in kilograms.
    Kilograms(f64),
    /// This density of its convex parts, in kilograms per cubic meter.
    Density(f64),
}

/// Support of an object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Support {
    /// The table, with gravity.
    #[default]
    Table,
    /// Nothing: it floats where it would lie, without gravity and table.
    Nothing,
}

/// A planar displacement on the table.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct Offset {
    /// Displacement along the table's x axis in meters.
    #[option(default, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub x_m: f64,
    /// Displacement along the table's y axis in meters.
    #[option(default, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub y_m: f64,
    /// Rotation about the vertical through the object's origin in radians.
    #[option(default, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub yaw_rad: f64,
}

/// Behavior of the fingers while the palm follows its path.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Approach {
    /// Palm and fingers follow the motion, a function of time, over the whole reach.
    #[default]
    Follow,
    /// A script in place of the motion's fingers: the palm follows its path before the closing with
    /// the fingers at their final positions, opened by `open_rad`; then it waits, and they close. Of
    /// the motion only the palm's path and the grasp are tried.
    Open,
    /// A script in place of the whole reach: the palm is at the motion's end from the start, and the fingers
    /// close from there, opened by `open_rad`. Of the motion only the grasp is tried.
    AtGrasp,
}

impl Approach {
    /// Every approach.
    pub const ALL: [Self; 3] = [Self::Follow, Self::Open, Self::AtGrasp];

    /// Returns the word for it in a pipeline file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Follow => "follow",
            Self::Open => "open",
            Self::AtGrasp => "at_grasp",
        }
    }
}

/// Execution and success criteria of a motion.
#[options]
#[derive(PartialEq)]
#[schemars(inline)]
pub struct Protocol {
    /// Name of the protocol: `full_contact`, by the options below with contact between fingers, palm and arm;
    /// `table_lift`, the lenient one, by the options alone; or a published one, which replaces most of them and of the
    /// scene's.
    // Goals of cells that know no names stay as they are.
    #[serde(default, skip_serializing_if = "ProtocolName::is_table_lift")]
    #[schemars(extend("default" = "table_lift"))]
    pub name: ProtocolName,
    /// Behavior of the fingers during the reach: they `follow` the motion, as in the paper, or, by a
    /// script that is not the motion, stay `open` until the closing, so that they do not knock the
    /// object over; or the hand starts at the grasp (`at_grasp`).
    #[option(default)]
    pub approach: Approach,
    /// Duration of the reach, to which a motion is stretched, in seconds: that of a person from
    /// near the object; of the closing, if the hand starts at the grasp.
    #[option(default = 0.8, range = above(0.0, MAX_DURATION_S), why = "reaching takes seconds")]
    pub reach_s: f64,
    /// Last part of the reach, as a fraction of it, in which the fingers close: 0.2 s of 0.8 s.
    #[option(default = 0.25, range = 0.0..=1.0, why = "it is a share of the reach")]
    pub close_fraction: f64,
    /// Names of the joints that open and squeeze; positive positions flex; no default, for each
    /// hand has its own.
    pub flexion_joints: Vec<String>,
    /// Angle by which these joints are opened during the reach, in radians: some centimeters at the tips.
    #[option(default = 0.3, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub open_rad: f64,
    /// Angle beyond their final positions to which these joints are commanded to squeeze, in radians: with
    /// a stiffness of 20 Nm/rad more than the drive's torque.
    #[option(default = 0.15, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub squeeze_rad: f64,
    /// Duration of the ramp to the squeeze in seconds: slower than the fingers swing.
    #[option(default = 0.3, range = 0.0..=MAX_DURATION_S, why = "a grasp takes seconds")]
    pub squeeze_s: f64,
    /// Pause between squeeze and lift in seconds: motions settle.
    #[option(default = 0.3, range = 0.0..=MAX_DURATION_S, why = "a grasp takes seconds")]
    pub pause_s: f64,
    /// Height of the lift in meters: clears the table with every object of a hand's size.
    #[option(default = 0.15, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub lift_m: f64,
    /// Duration of the lift in seconds: brisk, so that weak grasps fail.
    #[option(default = 0.4, range = 0.0..=MAX_DURATION_S, why = "a grasp takes seconds")]
    pub lift_s: f64,
    /// Time for which the lifted object must be held, in seconds: reveals slow slip.
    #[option(default = 2.0, range = 0.0..=MAX_DURATION_S, why = "a grasp takes seconds")]
    pub hold_s: f64,
    /// Rise of the object in meters above which it counts as lifted, from the end of the lift on: a
    /// little more than half of the lift.
    #[option(default = 0.08, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub lifted_m: f64,
    /// Hand links that must touch the object at the end: with one it only balances.
    #[option(default = 2, range = 0..=MAX_LINKS, why = "no hand has more links")]
    pub min_links: u32,
    /// Largest speed of the object in the hand over the last half second, in meters per second: a
    /// faster one soon leaves the hand.
    #[option(default = 0.01, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub max_slip_m_per_s: f64,
    /// Displacement of the object before the squeeze that counts as knocked over, in meters: the
    /// fingers no longer close around it.
    #[option(default = 0.03, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub knocked_m: f64,
    /// Rotation of the object before the squeeze that counts as knocked over, in radians: 34°, past
    /// which most things fall.
    #[option(default = 0.6, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub knocked_rad: f64,
    /// Largest excess of a commanded joint position over its limits, in radians: the drive stops at
    /// the limit.
    #[option(default = 0.1, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub limit_tolerance_rad: f64,
    /// Largest commanded depth of the hand below the table, in meters: fingers yield by that much.
    #[option(default = 0.01, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub table_tolerance_m: f64,
    /// Largest commanded depth of the hand inside the object before the closing, in meters: the
    /// object yields by that much.
    #[option(default = 0.02, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub early_tolerance_m: f64,
    /// Conditions that many benchmarks leave out.
    #[option(default, table)]
    pub strict: StrictConfig,
    /// Trial of the squeezed object: `lift` (the default) or `six_directions`.
    #[option(default)]
    pub trial: Trial,
    /// The pulls of `six_directions`.
    #[option(default, table)]
    pub pull: PullConfig,
}

impl Protocol {
    /// Returns the duration of the palm's path, in seconds: 0 where it is at its end from the start.
    pub fn path_s(&self) -> f64 {
        match self.approach {
            Approach::Follow => self.reach_s,
            Approach::Open => self.reach_s * (1.0 - self.close_fraction.clamp(0.0, 1.0)),
            Approach::AtGrasp => 0.0,
        }
    }
}

/// Conditions of a success that many benchmarks leave out.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct StrictConfig {
    /// Fingers that must touch the object at the end, the palm counting as one (2): links of a single
    /// finger only balance it.
    #[option(default = 2, range = 0..=MAX_LINKS, why = "no hand has more links")]
    pub min_fingers: u32,
    /// Largest angular speed of the object in the hand over the last half second, in radians per second
    /// (0.2): 5 cm from its origin that is the speed of a slip.
    #[option(default = 0.2, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub max_spin_rad_per_s: f64,
    /// Largest commanded depth of the palm below the table, in meters (0.002): unlike a finger, it does
    /// not yield.
    #[option(default = 0.002, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub palm_table_tolerance_m: f64,
    /// Largest depth of the hand inside the object where it starts, in meters (0.002): contact pushes
    /// the object away at once.
    #[option(default = 0.002, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub start_tolerance_m: f64,
    /// Largest net force of object and table on the hand for a tenth of a second, in newtons (none): an arm
    /// stops or yields at some multiple of its payload, the palm here only with the scene's `palm_compliance`.
    // Goals of cells that do not know it stay as they are.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[option(default, range = above(0.0, MAX_SETTING), why = "every grasp loads the palm")]
    pub max_palm_force_n: Option<f64>,
    /// Largest net torque of object and table on the hand about the palm's origin for a tenth of a second, in
    /// newton meters (none).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[option(default, range = above(0.0, MAX_SETTING), why = "every grasp loads the palm")]
    pub max_palm_torque_nm: Option<f64>,
    /// Until when a displaced object counts as knocked over (`squeeze`): a squeeze may pull it to the
    /// palm from farther away, and hold it well.
    #[option(default)]
    pub knocked_until: KnockedUntil,
}

/// Until when a displaced object counts as knocked over.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum KnockedUntil {
    /// Before the squeeze.
    #[default]
    Squeeze,
    /// Before the lift, during the squeeze too.
    Lift,
}

/// Trial of the squeezed object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Trial {
    /// The palm rises by `lift_m` and holds for `hold_s`.
    #[default]
    Lift,
    /// Gravity and the table vanish, and a force pulls the object along each axis of the table's frame,
    /// first one way and then the other, as in `DexGraspBench` (J. Chen et al., "`BODex`: Scalable and
    /// Efficient Robotic Dexterous Grasp Synthesis Using Bilevel Optimization", 2025): all six must hold.
    SixDirections,
}

/// The pulls of the trial `six_directions`, one after the other.
// The defaults are those of `DexGraspBench`.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct PullConfig {
    /// Force over the object's mass, in newtons per kilogram (10).
    #[option(default = 10.0, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub force_n_per_kg: f64,
    /// Duration of each pull in seconds (2).
    #[option(default = 2.0, range = 0.0..=MAX_DURATION_S, why = "a grasp takes seconds")]
    pub pull_s: f64,
    /// Displacement in the hand, since the first pull, that counts as lost, in meters (0.05).
    #[option(default = 0.05, range = -MAX_SETTING..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub max_displacement_m: f64,
    /// Rotation in the hand, since the first pull, that counts as lost, in radians (15 degrees).
    #[option(
        default = 15.0_f64.to_radians(), range = -MAX_SETTING..=MAX_SETTING,
        why = SINGLE_PRECISION
    )]
    pub max_rotation_rad: f64,
}
