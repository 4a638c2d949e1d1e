//! How often controllers are told something.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::OptionError;

/// Highest rate accepted, in 1/s: ten times that of the fastest controllers.
pub const MOST_HZ: f64 = 10_000.0;

/// How often controllers are told something. At these rates a goal of a hand of 16 joints that lasts
/// 2 s has 260 kB.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(inline)]
pub struct RatesConfig {
    /// What moves the palm (1/s): the rate of an xArm's controller.
    pub palm_hz: f64,
    /// The hand (1/s): the rate of the Allegro's controller.
    pub hand_hz: f64,
}

impl Default for RatesConfig {
    /// Returns those of an xArm and an Allegro.
    fn default() -> Self {
        Self {
            palm_hz: 250.0,
            hand_hz: 333.0,
        }
    }
}

impl RatesConfig {
    /// Checks what types cannot say.
    ///
    /// # Errors
    ///
    /// Fails with the first rate that is out of range.
    pub fn check(&self) -> Result<(), OptionError> {
        for (key, rate_hz) in [
            ("rates.palm_hz", self.palm_hz),
            ("rates.hand_hz", self.hand_hz),
        ] {
            if !(1.0..=MOST_HZ).contains(&rate_hz) {
                let problem = format!("{rate_hz} is not between 1 and {MOST_HZ} per second");
                return Err(OptionError::new(key, problem));
            }
        }
        Ok(())
    }
}
