//! The drives of fingers and palm.

use options::{above, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::settings::{MAX_DELAY_S, MAX_SETTING, SINGLE_PRECISION};

/// Time in which the released simulation corrects the palm, in seconds.
const RELEASED_TIME_S: f64 = 0.03;

/// The drive of each finger joint: a torque that a [`ControllerKind`] asks for, clamped.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct DriveConfig {
    /// The torque law: `pd`, which knows only the command, `pd_velocity`, `pd_velocity_interpolated` or
    /// `pd_feedforward`.
    #[option(default)]
    pub controller: ControllerKind,
    /// Stiffness in newton meters per radian; no default, for each hand has its own.
    #[option(range = above(0.0, MAX_SETTING), why = "physics needs a positive mass and stiffness")]
    pub stiffness: f64,
    /// Damping in newton meter seconds per radian; no default, for each hand has its own.
    #[option(range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub damping: f64,
    /// Largest torque in newton meters; no default, for each hand has its own.
    #[option(range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub torque_limit: f64,
    /// Inertia of the rotor as felt at the joint, in kilogram square meters; no default, for each
    /// hand has its own.
    #[option(range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub armature: f64,
    /// Stiffness of the mechanical end stops in newton meters per radian: at the torque of small
    /// drives they give by a fraction of a degree.
    #[option(default = 200.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub stop_stiffness: f64,
    /// Delay until a finger's command takes effect, in seconds, rounded to whole physics steps (0).
    #[option(
        default, range = 0.0..=MAX_DELAY_S,
        why = "a hand with a longer delay cannot be controlled"
    )]
    pub delay_s: f64,
}

/// Torque law of a drive, at a joint at `q` with desired position `q_d`; a driven palm has the same.
///
/// All are integrated implicitly and clamped to the torque limit as a whole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum ControllerKind {
    /// A spring to the command and a damper: `stiffness (q_d − q) − damping q̇`, with the command
    /// held over each control step.
    #[default]
    Pd,
    /// A spring and a damper to the motion: `stiffness (q_d − q) + damping (q̇_d − q̇)`, with position and
    /// velocity held over each control step.
    PdVelocity,
    /// The same with `q_d` and `q̇_d` followed between control steps too.
    PdVelocityInterpolated,
    /// The torque of the motion itself, and a spring and a damper to it:
    /// `ID(q̈_d, q, q̇) + stiffness (q_d − q) + damping (q̇_d − q̇)` with the hand's inverse dynamics
    /// ID, armature included (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand
    /// from Human Demonstrations*, 2023, section III). `q_d` is followed between control steps too.
    PdFeedforward,
}

impl ControllerKind {
    /// Whether it knows more of a motion than the commanded positions.
    pub(crate) fn follows_motion(self) -> bool {
        self != Self::Pd
    }
}

/// Drives of the palm's coordinates, three along the axes of its start and three about them, with the torque law of the
/// fingers' drives ([`DriveConfig::controller`]): they carry the hand's mass and inertia to the commanded path, and end
/// with the reach, the squeeze and the pause; the lift is exact. Neither fingers nor object push the palm back.
///
/// The defaults are those of the released simulation of Ye et al., *Learning Continuous Grasping Function with a
/// Dexterous Hand from Human Demonstrations*, 2023 (`scripts/sim.py`): a velocity of (target − current)/0.03 s,
/// dampings of 200 Ns/m and 50 Nms/rad, and limits of 200 N and 50 Nm.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct PalmDriveConfig {
    /// Stiffness along an axis in newtons per meter (6,667).
    #[option(default = 200.0 / RELEASED_TIME_S, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub stiffness_n_per_m: f64,
    /// Damping along an axis in newton seconds per meter (200).
    #[option(default = 200.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub damping_ns_per_m: f64,
    /// Largest force along an axis in newtons (200).
    #[option(default = 200.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub force_limit_n: f64,
    /// Stiffness about an axis in newton meters per radian (1,667).
    #[option(default = 50.0 / RELEASED_TIME_S, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub stiffness_nm_per_rad: f64,
    /// Damping about an axis in newton meter seconds per radian (50).
    #[option(default = 50.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub damping_nms_per_rad: f64,
    /// Largest torque about an axis in newton meters (50).
    #[option(default = 50.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub torque_limit_nm: f64,
}

/// An arm that holds the palm on its path: contact with object and table pushes the palm off it, and springs and dampers
/// of limited force and torque pull it back, in the whole rollout. The palm's own acceleration costs none of them. The
/// motion ends as `overloaded` once the palm is too far off.
///
/// The limits are those of an `xArm` 6: its payload of 5 kg (UFACTORY, *xArm User Manual*, section 8), and half of the
/// 20 Nm of its last joint (`xarm6.urdf.xacro` of `xarm_ros`), which are 50 N at 20 cm from the palm.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct PalmComplianceConfig {
    /// Largest force of the arm in newtons (50): the weight of the payload.
    #[option(default = 50.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub force_limit_n: f64,
    /// Largest torque of the arm about the palm's origin in newton meters (10).
    #[option(default = 10.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub torque_limit_nm: f64,
    /// Stiffness in newtons per meter (20,000): the force limit displaces the palm by 2.5 mm.
    #[option(default = 20_000.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub stiffness_n_per_m: f64,
    /// Damping in newton seconds per meter (630): critical, without overshoot.
    #[option(default = 630.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub damping_ns_per_m: f64,
    /// Effective mass of arm and hand in kilograms (5): half of the arm's moving 7.8 kg, and the hand's 1.1 kg
    /// (ISO/TS 15066:2016, *Robots and robotic devices: Collaborative robots*, annex A).
    #[option(
        default = 5.0, range = above(0.0, MAX_SETTING),
        why = "physics needs a positive mass and stiffness"
    )]
    pub mass_kg: f64,
    /// Stiffness in newton meters per radian (2,000): the torque limit turns the palm by 0.3 degrees.
    #[option(default = 2000.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub stiffness_nm_per_rad: f64,
    /// Damping in newton meter seconds per radian (28): critical.
    #[option(default = 28.0, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub damping_nms_per_rad: f64,
    /// Effective moment of inertia about the palm's origin in kilogram square meters (0.1): the effective mass 14 cm
    /// from there.
    #[option(
        default = 0.1, range = above(0.0, MAX_SETTING),
        why = "physics needs a positive mass and stiffness"
    )]
    pub inertia_kg_m2: f64,
    /// Largest displacement of the palm from its path in meters (0.01).
    #[option(default = 0.01, range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub max_deviation_m: f64,
    /// Largest rotation of the palm from its path in radians (5 degrees).
    #[option(default = 5.0_f64.to_radians(), range = 0.0..=MAX_SETTING, why = SINGLE_PRECISION)]
    pub max_deviation_rad: f64,
}
