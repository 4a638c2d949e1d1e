//! Protocols by name: this project's, and grasp trials of other projects, as far as this engine can reproduce them.
//!
//! Each replaces the options that it states; the rest, e.g. the time step, is the scene's own.
//! `protocols.md` beside the crate's README lists the differences that remain.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::{
    Approach, ControllerKind, KnockedUntil, ObjectMass, Protocol, PullConfig, SceneConfig,
    StrictConfig, Support, Trial,
};

/// Torque of a drive that has no limit, in newton meters.
const NO_TORQUE_LIMIT_NM: f64 = 1e3;
/// Deepest that a palm, which does not yield, may be commanded below the table, in meters.
const PALM_IN_TABLE_M: f64 = 0.01;
/// Duration of the squeeze of `DexGraspBench`, in seconds.
const DEXGRASPBENCH_SQUEEZE_S: f64 = 0.4;
/// Deepest that a hand of `DexGraspBench` may start in the object, in meters.
const DEXGRASPBENCH_START_M: f64 = 0.01;
/// Greatest friction of `full_contact`, before sampled errors.
pub(crate) const FULL_CONTACT_FRICTION: f64 = 0.8;

/// The name of a protocol.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum ProtocolName {
    /// This project's lenient one: as the options say, by default without contact between fingers and with a palm that
    /// never yields.
    #[default]
    TableLift,
    /// The released simulation of Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand from
    /// Human Demonstrations*, RA-L 2023 (`scripts/sim.py`).
    Paper,
    /// Pulls in six directions, of `DexGraspBench` (J. Chen et al., *`BODex`: Scalable and Efficient Robotic
    /// Dexterous Grasp Synthesis Using Bilevel Optimization*, ICRA 2025).
    DexgraspbenchForceClosure,
    /// The lift from a table of the same.
    DexgraspbenchTabletop,
    /// Lift and shakes (T. Lum et al., *Get a Grip: Multi-Finger Grasp Evaluation at Scale Enables Robust
    /// Sim-to-Real Transfer*, `CoRL` 2024).
    GetAGrip,
    /// Pulls in six directions, one after the other (Z. Wei et al., *D(R,O) Grasp: A Unified Representation of Robot
    /// and Object Interaction for Cross-Embodiment Dexterous Grasping*, ICRA 2025).
    Dro,
    /// The simulated pick of A. Li et al., *`FRoGGeR`: Fast Robust Grasp Generation via the Min-Weight Metric*,
    /// IROS 2023.
    Frogger,
    /// This project's `table_lift` with every contact: fingers touch each other and the palm, contact pushes the palm off
    /// its path, a displaced object counts up to the lift, and friction is at most 0.8, before sampled errors.
    FullContact,
}

impl ProtocolName {
    /// Every protocol.
    pub const ALL: [Self; 8] = [
        Self::TableLift,
        Self::Paper,
        Self::DexgraspbenchForceClosure,
        Self::DexgraspbenchTabletop,
        Self::GetAGrip,
        Self::Dro,
        Self::Frogger,
        Self::FullContact,
    ];

    /// Returns the word for it in a pipeline file.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::TableLift => "table_lift",
            Self::Paper => "paper",
            Self::DexgraspbenchForceClosure => "dexgraspbench_force_closure",
            Self::DexgraspbenchTabletop => "dexgraspbench_tabletop",
            Self::GetAGrip => "get_a_grip",
            Self::Dro => "dro",
            Self::Frogger => "frogger",
            Self::FullContact => "full_contact",
        }
    }

    /// Returns what a published protocol has beyond the options.
    fn published(self) -> Option<PublishedProtocol> {
        let plain = PublishedProtocol::PLAIN;
        let none = Criteria::NONE;
        let limit = |max_m: f64, max_deg: f64, always: bool| {
            Some(DisplacementLimit {
                max_m,
                max_rad: max_deg.to_radians(),
                always,
            })
        };
        Some(match self {
            Self::TableLift | Self::FullContact => return None,
            Self::Paper => PublishedProtocol {
                constant_speed_lift: true,
                criteria: Criteria {
                    lifted_m: Some(0.04),
                    ..none
                },
                ..plain
            },
            Self::DexgraspbenchForceClosure => PublishedProtocol {
                restart_each_pull: true,
                displacement_from_start: true,
                criteria: Criteria {
                    start_tolerance_m: Some(DEXGRASPBENCH_START_M),
                    max_rotation_rad: Some(15.0_f64.to_radians()),
                    ..none
                },
                ..plain
            },
            Self::DexgraspbenchTabletop => PublishedProtocol {
                constant_speed_lift: true,
                displacement: limit(0.05, 15.0, false),
                criteria: Criteria {
                    start_tolerance_m: Some(DEXGRASPBENCH_START_M),
                    table_tolerance_m: Some(0.01),
                    ..none
                },
                ..plain
            },
            Self::GetAGrip => PublishedProtocol {
                constant_speed_lift: true,
                shakes: Some(Shakes {
                    amplitude_m: 0.03,
                    period_s: 1.14,
                }),
                displacement: limit(0.1, 45.0, false),
                ..plain
            },
            Self::Dro => PublishedProtocol {
                open_share: 0.25,
                squeeze_share: 0.15,
                ..plain
            },
            Self::Frogger => PublishedProtocol {
                constant_speed_lift: true,
                displacement: limit(0.075, 30.0, true),
                ..plain
            },
        })
    }

    /// Whether it is the lenient one, by the options alone.
    pub fn is_table_lift(&self) -> bool {
        *self == Self::TableLift
    }

    /// Whether it is one of this project's, whose motions a cell executes.
    pub fn is_own(self) -> bool {
        matches!(self, Self::TableLift | Self::FullContact)
    }
}

/// What a published protocol has beyond the options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PublishedProtocol {
    /// Opening of the flexing joints before the closing, besides `open_rad`, as a share of the distance to their
    /// lower limits.
    pub(crate) open_share: f64,
    /// Their squeeze, besides `squeeze_rad`, as a share of the distance to their upper limits.
    pub(crate) squeeze_share: f64,
    /// Whether the palm rises at constant speed, instead of smoothly.
    pub(crate) constant_speed_lift: bool,
    /// Shakes of the lifted object.
    pub(crate) shakes: Option<Shakes>,
    /// Largest displacement of the lifted object from its initial pose carried along with the palm.
    pub(crate) displacement: Option<DisplacementLimit>,
    /// Whether every pull begins where the first one began.
    pub(crate) restart_each_pull: bool,
    /// Whether displacements under pulls count from before the closing, and not from the first pull.
    pub(crate) displacement_from_start: bool,
    /// By what it judges instead of the options.
    criteria: Criteria,
}

impl PublishedProtocol {
    /// Judges nothing, and does nothing that the options do not say.
    const PLAIN: Self = Self {
        open_share: 0.0,
        squeeze_share: 0.0,
        constant_speed_lift: false,
        shakes: None,
        displacement: None,
        restart_each_pull: false,
        displacement_from_start: false,
        criteria: Criteria::NONE,
    };
}

/// Limits by which a motion is judged; none where the protocol has none. Units are those of the options of these names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Criteria {
    pub(crate) knocked_m: Option<f64>,
    pub(crate) knocked_rad: Option<f64>,
    pub(crate) limit_tolerance_rad: Option<f64>,
    pub(crate) table_tolerance_m: Option<f64>,
    pub(crate) early_tolerance_m: Option<f64>,
    pub(crate) start_tolerance_m: Option<f64>,
    pub(crate) lifted_m: Option<f64>,
    pub(crate) max_slip_m_per_s: Option<f64>,
    pub(crate) max_spin_rad_per_s: Option<f64>,
    pub(crate) max_rotation_rad: Option<f64>,
}

impl Criteria {
    const NONE: Self = Self {
        knocked_m: None,
        knocked_rad: None,
        limit_tolerance_rad: None,
        table_tolerance_m: None,
        early_tolerance_m: None,
        start_tolerance_m: None,
        lifted_m: None,
        max_slip_m_per_s: None,
        max_spin_rad_per_s: None,
        max_rotation_rad: None,
    };

    /// Returns those that the options name.
    fn of_options(protocol: &Protocol) -> Self {
        Self {
            knocked_m: Some(protocol.knocked_m),
            knocked_rad: Some(protocol.knocked_rad),
            limit_tolerance_rad: Some(protocol.limit_tolerance_rad),
            table_tolerance_m: Some(protocol.table_tolerance_m),
            early_tolerance_m: Some(protocol.early_tolerance_m),
            start_tolerance_m: Some(protocol.strict.start_tolerance_m),
            lifted_m: Some(protocol.lifted_m),
            max_slip_m_per_s: Some(protocol.max_slip_m_per_s),
            max_spin_rad_per_s: Some(protocol.strict.max_spin_rad_per_s),
            max_rotation_rad: Some(protocol.pull.max_rotation_rad),
        }
    }
}

/// Whether a number is above its limit, if it has one.
pub(crate) fn exceeds(number: f64, limit: Option<f64>) -> bool {
    limit.is_some_and(|limit| number > limit)
}

/// Shakes of the palm along the table's axes, one after the other: there, back, as far to the other side, and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shakes {
    /// Distance to each side in meters.
    pub(crate) amplitude_m: f64,
    /// Duration of the shake along one axis in seconds.
    pub(crate) period_s: f64,
}

impl Shakes {
    /// Returns the palm's displacement along the axis after a fraction of a shake, in meters.
    pub(crate) fn at(&self, fraction: f64) -> f64 {
        let quarter = 4.0 * fraction;
        self.amplitude_m
            * match quarter {
                up if up <= 1.0 => up,
                down if down <= 3.0 => 2.0 - down,
                back => back - 4.0,
            }
    }
}

/// Largest displacement of a lifted object from its initial pose carried along with the palm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DisplacementLimit {
    /// Distance in meters.
    pub(crate) max_m: f64,
    /// Rotation in radians.
    pub(crate) max_rad: f64,
    /// Whether it holds from the squeeze on, and not only at the end.
    pub(crate) always: bool,
}

impl Protocol {
    /// Returns what the named protocol has beyond the options; this project's own have nothing.
    pub(crate) fn published(&self) -> PublishedProtocol {
        self.name.published().unwrap_or(PublishedProtocol::PLAIN)
    }

    /// Returns the limits by which it judges a motion.
    pub(crate) fn criteria(&self) -> Criteria {
        let published = self.name.published();
        published.map_or_else(|| Criteria::of_options(self), |it| it.criteria)
    }

    /// Whether the options have been replaced by what the name stands for: the criteria of published protocols are not
    /// among them.
    pub(crate) fn is_resolved(&self) -> bool {
        if self.name.is_own() {
            return self.name.is_table_lift() || self.strict.knocked_until == KnockedUntil::Lift;
        }
        let mut cleared = self.clone();
        cleared.clear_criteria();
        Criteria::of_options(self) == Criteria::of_options(&cleared)
    }

    /// Returns the scene and the protocol for which the name stands.
    pub fn resolved(&self, scene: &SceneConfig) -> (SceneConfig, Self) {
        let (mut scene, mut protocol) = (scene.clone(), self.clone());
        if !self.name.is_own() {
            scene.mass_scale = 1.0;
            scene.support = Support::Table;
        }
        match self.name {
            ProtocolName::TableLift => {}
            ProtocolName::Paper => paper(&mut scene, &mut protocol),
            ProtocolName::DexgraspbenchForceClosure => force_closure(&mut scene, &mut protocol),
            ProtocolName::DexgraspbenchTabletop => tabletop(&mut scene, &mut protocol),
            ProtocolName::GetAGrip => get_a_grip(&mut scene, &mut protocol),
            ProtocolName::Dro => dro(&mut scene, &mut protocol),
            ProtocolName::Frogger => frogger(&mut scene, &mut protocol),
            ProtocolName::FullContact => full_contact(&mut scene, &mut protocol),
        }
        (scene, protocol)
    }

    /// Clears the options in whose place published protocols have [`Criteria`] of their own.
    fn clear_criteria(&mut self) {
        self.knocked_m = 0.0;
        self.knocked_rad = 0.0;
        self.limit_tolerance_rad = 0.0;
        self.table_tolerance_m = 0.0;
        self.early_tolerance_m = 0.0;
        self.max_slip_m_per_s = 0.0;
        self.lifted_m = 0.0;
        self.pull.max_rotation_rad = 0.0;
        self.min_links = 0;
        self.strict = StrictConfig {
            min_fingers: 0,
            max_spin_rad_per_s: 0.0,
            palm_table_tolerance_m: PALM_IN_TABLE_M,
            start_tolerance_m: 0.0,
            ..self.strict
        };
    }
}

/// Friction of hand and object and of the table, and the object's mass.
fn object(scene: &mut SceneConfig, [friction, table_friction]: [f64; 2], mass: ObjectMass) {
    scene.friction = friction;
    scene.table_friction = Some(table_friction);
    (scene.object_mass_kg, scene.object_density_kg_per_m3) = match mass {
        ObjectMass::Measured => (None, None),
        ObjectMass::Kilograms(mass_kg) => (Some(mass_kg), None),
        ObjectMass::Density(density) => (None, Some(density)),
    };
}

/// Springs of the fingers, in Nm/rad, Nms/rad and Nm.
fn drive(scene: &mut SceneConfig, [stiffness, damping, torque_limit]: [f64; 3]) {
    scene.drive.controller = ControllerKind::Pd;
    scene.drive.stiffness = stiffness;
    scene.drive.damping = damping;
    scene.drive.torque_limit = torque_limit;
}

/// Every contact that a real hand has, and the limits of the arm that carries it.
fn full_contact(scene: &mut SceneConfig, protocol: &mut Protocol) {
    scene.fingers_touch = true;
    scene.fingers_touch_palm = true;
    if scene.palm_drive.is_none() {
        scene.palm_compliance.get_or_insert_default();
    }
    protocol.strict.knocked_until = KnockedUntil::Lift;
}

/// 40 control steps of the motion and 15 of the lift by 15 cm; at the end, a contact and a rise of 4 cm.
fn paper(scene: &mut SceneConfig, protocol: &mut Protocol) {
    drive(scene, [200.0, 60.0, 10.0]);
    // Dynamic coefficients, as contacts there have their mean: hand 1 and object 3, object 3 and table 0.5.
    object(scene, [2.0, 1.5], ObjectMass::Density(1000.0));
    protocol.clear_criteria();
    protocol.approach = Approach::Follow;
    protocol.trial = Trial::Lift;
    protocol.reach_s = 0.8;
    (protocol.squeeze_rad, protocol.squeeze_s, protocol.pause_s) = (0.0, 0.0, 0.0);
    (protocol.lift_m, protocol.lift_s, protocol.hold_s) = (0.15, 0.3, 0.0);
    protocol.min_links = 1;
}

/// Sets the common settings of both protocols of `DexGraspBench`: 100 g, a pregrasp that is no deeper than 1 cm,
/// 0.4 s for the grasp and for the squeeze.
fn dexgraspbench(scene: &mut SceneConfig, protocol: &mut Protocol) {
    drive(scene, [5.0, 0.1, NO_TORQUE_LIMIT_NM]);
    object(scene, [0.6, 0.6], ObjectMass::Kilograms(0.1));
    protocol.clear_criteria();
    protocol.approach = Approach::AtGrasp;
    (protocol.reach_s, protocol.squeeze_s, protocol.pause_s) = (0.4, DEXGRASPBENCH_SQUEEZE_S, 0.0);
}

/// Pulls of 1 N for 2 s in six directions, each from the same state: at most 5 cm and 15 degrees from where it lay
/// before the closing.
fn force_closure(scene: &mut SceneConfig, protocol: &mut Protocol) {
    dexgraspbench(scene, protocol);
    scene.support = Support::Nothing;
    protocol.trial = Trial::SixDirections;
    protocol.pull = PullConfig {
        force_n_per_kg: 10.0,
        pull_s: 2.0,
        max_displacement_m: 0.05,
        ..protocol.pull
    };
}

/// A lift by 10 cm in 0.4 s: at its end at most 5 cm and 15 degrees from 10 cm above where it lay.
fn tabletop(scene: &mut SceneConfig, protocol: &mut Protocol) {
    dexgraspbench(scene, protocol);
    protocol.trial = Trial::Lift;
    (protocol.lift_m, protocol.lift_s, protocol.hold_s) = (0.1, 0.4, 0.0);
}

/// A lift by 20 cm, and shakes of 3 cm: three links in contact, at most 10 cm and 45 degrees off.
fn get_a_grip(scene: &mut SceneConfig, protocol: &mut Protocol) {
    drive(scene, [50.0, 1.0, 15.0]);
    object(scene, [0.9, 1.0], ObjectMass::Density(500.0));
    protocol.clear_criteria();
    protocol.approach = Approach::AtGrasp;
    protocol.trial = Trial::Lift;
    // The fingertips close by 5 cm: a quarter of a radian in each joint of a finger of 10 cm.
    protocol.squeeze_rad = 0.25;
    (protocol.reach_s, protocol.squeeze_s, protocol.pause_s) = (0.17, 0.25, 0.0);
    (protocol.lift_m, protocol.lift_s, protocol.hold_s) = (0.2, 1.14, 0.0);
    protocol.min_links = 3;
}

/// Fingers that close for 1 s from 25 % open to 15 % closed, and pulls of 0.5 N/kg for 1 s each: at most 2 cm from
/// where it was before the first one.
fn dro(scene: &mut SceneConfig, protocol: &mut Protocol) {
    drive(scene, [1000.0, 200.0, 15.0]);
    object(scene, [3.0, 3.0], ObjectMass::Density(500.0));
    scene.support = Support::Nothing;
    protocol.clear_criteria();
    protocol.approach = Approach::AtGrasp;
    protocol.trial = Trial::SixDirections;
    (protocol.open_rad, protocol.squeeze_rad) = (0.0, 0.0);
    let control_s = scene.control_step_s();
    (protocol.reach_s, protocol.squeeze_s) = (control_s, 0.0);
    protocol.pause_s = (1.0 - control_s).max(0.0);
    protocol.pull = PullConfig {
        force_n_per_kg: 0.5,
        pull_s: 1.0,
        max_displacement_m: 0.02,
        ..protocol.pull
    };
}

/// A squeeze of 0.2 s, a lift by 10 cm in 1 s and a hold of 1.5 s: at most 7.5 cm and 30 degrees off.
fn frogger(scene: &mut SceneConfig, protocol: &mut Protocol) {
    scene.drive.torque_limit = 0.7;
    object(scene, [0.7, 0.7], ObjectMass::Density(150.0));
    protocol.clear_criteria();
    protocol.approach = Approach::AtGrasp;
    protocol.trial = Trial::Lift;
    protocol.open_rad = 0.0;
    protocol.reach_s = scene.control_step_s();
    (protocol.squeeze_s, protocol.pause_s) = (0.2, 0.0);
    (protocol.lift_m, protocol.lift_s, protocol.hold_s) = (0.1, 1.0, 1.5);
}
