//! What a scene is made of and what is done in it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::shortcuts::Shortcuts;

/// The physical scene: object, table, hand and how time is cut.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct SceneConfig {
    /// Friction coefficient of every contact (hand, object, table).
    pub friction: f64,
    /// Factor on the object's true mass and inertia.
    pub mass_scale: f64,
    /// Factor on the masses and inertias of the hand's links, of which its controller knows.
    pub hand_mass_scale: f64,
    /// Where the object really lies, relative to where the motion believes it to lie.
    pub object_offset: Offset,
    /// Physics time step in seconds.
    pub time_step_s: f64,
    /// Physics steps in one control step.
    pub steps_per_control: u32,
    /// Distance in meters below which contacts are computed.
    pub prediction_m: f64,
    /// Longest time in seconds that the object gets to come to rest on the table.
    pub settle_s: f64,
    /// Drives of the finger joints.
    pub drive: DriveConfig,
    /// What is not simulated because it cannot change the verdict.
    #[serde(default)]
    pub shortcuts: Shortcuts,
}

impl SceneConfig {
    /// Returns the duration of one control step in seconds.
    pub fn control_step_s(&self) -> f64 {
        self.time_step_s * f64::from(self.steps_per_control)
    }
}

/// A planar displacement on the table.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Offset {
    /// Displacement along the table's x axis in meters.
    pub x_m: f64,
    /// Displacement along the table's y axis in meters.
    pub y_m: f64,
    /// Rotation about the vertical through the object's origin in radians.
    pub yaw_rad: f64,
}

/// The drive of each finger joint: a torque that a [`ControllerKind`] asks for, clamped.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DriveConfig {
    /// What torque is asked for: that of `pd`, or of `pd_feedforward`.
    pub controller: ControllerKind,
    /// Stiffness in newton meters per radian.
    pub stiffness: f64,
    /// Damping in newton meter seconds per radian.
    pub damping: f64,
    /// Largest torque in newton meters.
    pub torque_limit: f64,
    /// Inertia of the rotor as felt at the joint, in kilogram square meters.
    pub armature: f64,
    /// Stiffness of the mechanical end stops in newton meters per radian.
    pub stop_stiffness: f64,
}

/// What torque a finger's drive asks for, at a joint at `q` that shall be at `q_d`.
///
/// Both are integrated implicitly and clamped to the torque limit as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum ControllerKind {
    /// A spring to the command and a brake: `stiffness (q_d − q) − damping q̇`, the command held over
    /// each control step.
    Pd,
    /// The torque of the motion itself, and a spring and a damper to it:
    /// `ID(q̈_d, q, q̇) + stiffness (q_d − q) + damping (q̇_d − q̇)` with the hand's inverse dynamics
    /// ID, armature included (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand
    /// from Human Demonstrations*, 2023, section III). `q_d` is followed between control steps too.
    PdFeedforward,
}

/// How the fingers behave while the palm follows its path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Approach {
    /// Palm and fingers follow the motion over the whole reach.
    Follow,
    /// The palm follows its path before the closing with the fingers at their final positions,
    /// opened by `open_rad`; then it waits, and they close.
    Open,
}

/// What is done with a motion, and what counts as success.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Protocol {
    /// What the fingers do during the reach: `follow` the motion, or stay `open` until the closing.
    pub approach: Approach,
    /// Duration of the reach, to which a motion is stretched, in seconds.
    pub reach_s: f64,
    /// Last part of the reach, as a fraction of it, in which the fingers close.
    pub close_fraction: f64,
    /// Names of the joints that open and squeeze; positive positions flex.
    pub flexion_joints: Vec<String>,
    /// How far these joints are opened during the reach, in radians.
    pub open_rad: f64,
    /// How far beyond their final positions these joints are commanded to squeeze, in radians.
    pub squeeze_rad: f64,
    /// Duration of the ramp to the squeeze in seconds.
    pub squeeze_s: f64,
    /// Pause between squeeze and lift in seconds.
    pub pause_s: f64,
    /// Height of the lift in meters.
    pub lift_m: f64,
    /// Duration of the lift in seconds.
    pub lift_s: f64,
    /// How long the lifted object must be held, in seconds.
    pub hold_s: f64,
    /// Rise of the object in meters above which it counts as lifted, after the lift and ever since.
    pub lifted_m: f64,
    /// Hand links that must touch the object at the end.
    pub min_links: u32,
    /// Largest speed of the object in the hand over the last half second, in meters per second.
    pub max_slip_m_per_s: f64,
    /// Displacement of the object before the squeeze that counts as knocked over, in meters.
    pub knocked_m: f64,
    /// Rotation of the object before the squeeze that counts as knocked over, in radians.
    pub knocked_rad: f64,
    /// How far outside its limits a joint position may be asked for, in radians.
    pub limit_tolerance_rad: f64,
    /// How far below the table the hand may be asked to reach, in meters.
    pub table_tolerance_m: f64,
    /// How far inside the object the hand may be asked to reach before the closing, in meters.
    pub early_tolerance_m: f64,
    /// What is done to the object once it is squeezed: `lift` (the default) or `six_directions`.
    #[serde(default)]
    pub trial: Trial,
    /// The pulls of `six_directions`.
    #[serde(default)]
    pub pull: PullConfig,
}

/// What is done to the object once it is squeezed.
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct PullConfig {
    /// Force over the object's mass, in newtons per kilogram (10).
    pub force_n_per_kg: f64,
    /// Duration of each pull in seconds (2).
    pub pull_s: f64,
    /// Displacement in the hand, since the first pull, that counts as lost, in meters (0.05).
    pub max_displacement_m: f64,
    /// Rotation in the hand, since the first pull, that counts as lost, in radians (15 degrees).
    pub max_rotation_rad: f64,
}

impl Default for PullConfig {
    /// `DexGraspBench`'s.
    fn default() -> Self {
        Self {
            force_n_per_kg: 10.0,
            pull_s: 2.0,
            max_displacement_m: 0.05,
            max_rotation_rad: 15.0_f64.to_radians(),
        }
    }
}
