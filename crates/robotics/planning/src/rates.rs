//! Command rates of the controllers.

use options::options;

/// Highest rate accepted, in 1/s: ten times that of the fastest controllers.
pub const MAX_HZ: f64 = 10_000.0;

/// Command rates of the controllers. At these rates a goal of a hand of 16 joints that lasts 2 s
/// has 260 kB.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct CommandRatesConfig {
    /// Rate of the palm's or arm's controller (1/s): that of an xArm.
    #[option(
        default = 250.0, range = 1.0..=MAX_HZ,
        why = "no controller is faster, and a slower one jerks"
    )]
    pub palm_hz: f64,
    /// Rate of the hand's controller (1/s): that of the Allegro.
    #[option(
        default = 333.0, range = 1.0..=MAX_HZ,
        why = "no controller is faster, and a slower one jerks"
    )]
    pub hand_hz: f64,
}
