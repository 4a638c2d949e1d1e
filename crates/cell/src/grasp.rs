//! Timing and success criteria of a goal, as they are sent.
//!
//! These types are the wire's own: an option of the simulation does not reach a cell unless it is added here.

use options::OptionFault;
use serde::{Deserialize, Serialize};
use simulation::{Protocol, ProtocolName, PullConfig, StrictConfig};

/// Timing of a goal's phases, and the criteria of its success.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grasp {
    /// Behavior of the fingers during the reach.
    pub approach: Approach,
    /// Duration of the reach, in seconds.
    pub reach_s: f64,
    /// Last part of the reach in which the fingers close, as a fraction of it.
    pub close_fraction: f64,
    /// Names of the joints that close.
    pub flexion_joints: Vec<String>,
    /// Angle by which they open for the reach, in radians; it is included in the rows.
    pub open_rad: f64,
    /// Angle by which they press, in radians; it is included in the rows.
    pub squeeze_rad: f64,
    /// Duration of the ramp to the squeeze, in seconds.
    pub squeeze_s: f64,
    /// Pause between squeeze and lift, in seconds.
    pub pause_s: f64,
    /// Rise of the palm, in meters.
    pub lift_m: f64,
    /// Duration of the lift, in seconds.
    pub lift_s: f64,
    /// Time for which the object must be held, in seconds.
    pub hold_s: f64,
    /// Least rise of the object, in meters.
    pub lifted_m: f64,
    /// Fewest links that touch the object at the end.
    pub min_links: u32,
    /// Largest speed of the object in the hand, in meters per second.
    pub max_slip_m_per_s: f64,
    /// Largest displacement of the object before the grasp, in meters.
    pub knocked_m: f64,
    /// Largest rotation of the object before the grasp, in radians.
    pub knocked_rad: f64,
    /// Largest excess of a commanded joint position over its limits, in radians.
    pub limit_tolerance_rad: f64,
    /// Largest commanded depth of the hand below the table, in meters.
    pub table_tolerance_m: f64,
    /// Largest commanded depth of the hand inside the object before the closing, in meters.
    pub early_tolerance_m: f64,
    /// Further criteria.
    #[serde(default)]
    pub strict: Strict,
    /// The only trial: a lift.
    #[serde(default)]
    pub trial: Trial,
    /// Without a meaning for a lift. Version 4 sent it: with it a motion keeps the id under which cells and
    /// dispatchers remember it.
    #[serde(default)]
    pub pull: Pull,
}

/// Behavior of the fingers during the reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Approach {
    /// They go together with the palm.
    Follow,
    /// The palm goes all the way before they close.
    Open,
}

/// Trial of the grasped object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trial {
    /// The palm rises and holds.
    #[default]
    Lift,
}

/// Criteria that many cells cannot judge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Strict {
    /// Fewest fingers that touch the object at the end, the palm counting as one.
    pub min_fingers: u32,
    /// Largest angular speed of the object in the hand, in radians per second.
    pub max_spin_rad_per_s: f64,
    /// Largest commanded depth of the palm below the table, in meters.
    pub palm_table_tolerance_m: f64,
    /// Largest depth of the hand inside the object at the start, in meters.
    pub start_tolerance_m: f64,
    /// Largest net force on the hand, in newtons; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_palm_force_n: Option<f64>,
    /// Largest net torque on the hand, in newton meters; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_palm_torque_nm: Option<f64>,
    /// Until when a displaced object counts as knocked over.
    pub knocked_until: KnockedUntil,
}

/// Until when a displaced object counts as knocked over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KnockedUntil {
    /// Before the squeeze.
    Squeeze,
    /// Before the lift.
    Lift,
}

/// Pulls of another trial than a lift.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[expect(
    clippy::struct_field_names,
    reason = "the names are those of version 4"
)]
pub struct Pull {
    force_n_per_kg: f64,
    pull_s: f64,
    max_displacement_m: f64,
    max_rotation_rad: f64,
}

impl Grasp {
    /// Returns the end of the hold, in seconds.
    pub fn end_s(&self) -> f64 {
        self.reach_s + self.squeeze_s + self.pause_s + self.lift_s + self.hold_s
    }

    /// Returns the duration of the palm's path, in seconds.
    pub(crate) fn path_s(&self) -> f64 {
        match self.approach {
            Approach::Follow => self.reach_s,
            Approach::Open => self.reach_s * (1.0 - self.close_fraction.clamp(0.0, 1.0)),
        }
    }

    /// Returns the protocol by which the simulation judges such a grasp.
    pub(crate) fn protocol(&self) -> Protocol {
        let Self {
            approach,
            flexion_joints,
            strict,
            pull,
            trial: Trial::Lift,
            ..
        } = self;
        Protocol {
            name: ProtocolName::TableLift,
            approach: match approach {
                Approach::Follow => simulation::Approach::Follow,
                Approach::Open => simulation::Approach::Open,
            },
            reach_s: self.reach_s,
            close_fraction: self.close_fraction,
            flexion_joints: flexion_joints.clone(),
            open_rad: self.open_rad,
            squeeze_rad: self.squeeze_rad,
            squeeze_s: self.squeeze_s,
            pause_s: self.pause_s,
            lift_m: self.lift_m,
            lift_s: self.lift_s,
            hold_s: self.hold_s,
            lifted_m: self.lifted_m,
            min_links: self.min_links,
            max_slip_m_per_s: self.max_slip_m_per_s,
            knocked_m: self.knocked_m,
            knocked_rad: self.knocked_rad,
            limit_tolerance_rad: self.limit_tolerance_rad,
            table_tolerance_m: self.table_tolerance_m,
            early_tolerance_m: self.early_tolerance_m,
            strict: StrictConfig {
                min_fingers: strict.min_fingers,
                max_spin_rad_per_s: strict.max_spin_rad_per_s,
                palm_table_tolerance_m: strict.palm_table_tolerance_m,
                start_tolerance_m: strict.start_tolerance_m,
                max_palm_force_n: strict.max_palm_force_n,
                max_palm_torque_nm: strict.max_palm_torque_nm,
                knocked_until: match strict.knocked_until {
                    KnockedUntil::Squeeze => simulation::KnockedUntil::Squeeze,
                    KnockedUntil::Lift => simulation::KnockedUntil::Lift,
                },
            },
            trial: simulation::Trial::Lift,
            pull: PullConfig {
                force_n_per_kg: pull.force_n_per_kg,
                pull_s: pull.pull_s,
                max_displacement_m: pull.max_displacement_m,
                max_rotation_rad: pull.max_rotation_rad,
            },
        }
    }
}

impl TryFrom<&Protocol> for Grasp {
    type Error = OptionFault;

    /// Fails if a cell cannot execute the protocol.
    fn try_from(protocol: &Protocol) -> Result<Self, OptionFault> {
        if let Some(fault) = protocol.cell_fault() {
            return Err(fault);
        }
        let Protocol { strict, pull, .. } = protocol;
        Ok(Self {
            approach: match protocol.approach {
                simulation::Approach::Follow => Approach::Follow,
                simulation::Approach::Open | simulation::Approach::AtGrasp => Approach::Open,
            },
            reach_s: protocol.reach_s,
            close_fraction: protocol.close_fraction,
            flexion_joints: protocol.flexion_joints.clone(),
            open_rad: protocol.open_rad,
            squeeze_rad: protocol.squeeze_rad,
            squeeze_s: protocol.squeeze_s,
            pause_s: protocol.pause_s,
            lift_m: protocol.lift_m,
            lift_s: protocol.lift_s,
            hold_s: protocol.hold_s,
            lifted_m: protocol.lifted_m,
            min_links: protocol.min_links,
            max_slip_m_per_s: protocol.max_slip_m_per_s,
            knocked_m: protocol.knocked_m,
            knocked_rad: protocol.knocked_rad,
            limit_tolerance_rad: protocol.limit_tolerance_rad,
            table_tolerance_m: protocol.table_tolerance_m,
            early_tolerance_m: protocol.early_tolerance_m,
            strict: Strict::from(*strict),
            trial: Trial::Lift,
            pull: Pull::from(*pull),
        })
    }
}

impl From<StrictConfig> for Strict {
    fn from(config: StrictConfig) -> Self {
        Self {
            min_fingers: config.min_fingers,
            max_spin_rad_per_s: config.max_spin_rad_per_s,
            palm_table_tolerance_m: config.palm_table_tolerance_m,
            start_tolerance_m: config.start_tolerance_m,
            max_palm_force_n: config.max_palm_force_n,
            max_palm_torque_nm: config.max_palm_torque_nm,
            knocked_until: match config.knocked_until {
                simulation::KnockedUntil::Squeeze => KnockedUntil::Squeeze,
                simulation::KnockedUntil::Lift => KnockedUntil::Lift,
            },
        }
    }
}

impl From<PullConfig> for Pull {
    fn from(config: PullConfig) -> Self {
        Self {
            force_n_per_kg: config.force_n_per_kg,
            pull_s: config.pull_s,
            max_displacement_m: config.max_displacement_m,
            max_rotation_rad: config.max_rotation_rad,
        }
    }
}

impl Default for Strict {
    fn default() -> Self {
        StrictConfig::default().into()
    }
}

impl Default for Pull {
    fn default() -> Self {
        PullConfig::default().into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ids are digests of these bytes: version 4 sent the simulation's own configuration.
    #[test]
    fn a_grasp_has_the_bytes_that_version_4_sent() {
        let text = include_str!("../examples/grasp.json");
        let shipped: Protocol = serde_json::from_str(text).unwrap();
        let strict = Protocol {
            approach: simulation::Approach::Follow,
            strict: StrictConfig {
                min_fingers: 3,
                max_palm_force_n: Some(50.0),
                max_palm_torque_nm: Some(10.0),
                knocked_until: simulation::KnockedUntil::Lift,
                ..StrictConfig::default()
            },
            pull: PullConfig {
                pull_s: 1.5,
                ..PullConfig::default()
            },
            ..shipped.clone()
        };
        for protocol in [shipped, strict] {
            let grasp = Grasp::try_from(&protocol).unwrap();
            let bytes = serde_json::to_string(&grasp).unwrap();
            assert_eq!(bytes, serde_json::to_string(&protocol).unwrap());
            assert_eq!(grasp.protocol(), protocol);
            assert_eq!(serde_json::from_str::<Grasp>(&bytes).unwrap(), grasp);
        }
    }

    #[test]
    fn what_no_cell_executes_is_no_grasp() {
        let text = include_str!("../examples/grasp.json");
        let shipped: Protocol = serde_json::from_str(text).unwrap();
        let grasp = serde_json::to_value(Grasp::try_from(&shipped).unwrap()).unwrap();
        for (field, value) in [("trial", "six_directions"), ("approach", "at_grasp")] {
            let mut other = grasp.clone();
            other[field] = value.into();
            assert!(serde_json::from_value::<Grasp>(other).is_err(), "{field}");
        }
        let six_directions = Protocol {
            trial: simulation::Trial::SixDirections,
            ..shipped
        };
        assert!(Grasp::try_from(&six_directions).is_err());
    }
}
