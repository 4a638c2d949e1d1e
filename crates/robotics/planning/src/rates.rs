//! Command rates of the controllers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use simulation::SettingFault;

/// Highest rate accepted, in 1/s: ten times that of the fastest controllers.
pub const MAX_HZ: f64 = 10_000.0;

/// Command rates of the controllers. At these rates a goal of a hand of 16 joints that lasts 2 s
/// has 260 kB.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct CommandRatesConfig {
    /// Rate of the palm's or arm's controller (1/s): that of an xArm.
    pub palm_hz: f64,
    /// Rate of the hand's controller (1/s): that of the Allegro.
    pub hand_hz: f64,
}

impl Default for CommandRatesConfig {
    /// Returns the rates of an xArm and an Allegro.
    fn default() -> Self {
        Self {
            palm_hz: 250.0,
            hand_hz: 333.0,
        }
    }
}

impl CommandRatesConfig {
    /// Checks the rates beyond their types.
    ///
    /// # Errors
    ///
    /// Fails with the first rate that is out of range.
    pub fn check(&self) -> Result<(), SettingFault> {
        for (key, rate_hz) in [
            ("rates.palm_hz", self.palm_hz),
            ("rates.hand_hz", self.hand_hz),
        ] {
            if !(1.0..=MAX_HZ).contains(&rate_hz) {
                let problem = format!("{rate_hz} is not between 1 and {MAX_HZ} per second");
                return Err(SettingFault::new(key, problem));
            }
        }
        Ok(())
    }
}
