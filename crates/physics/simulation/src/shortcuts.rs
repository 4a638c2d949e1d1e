//! Parts of a rollout that are omitted because they cannot change the verdict.

use options::options;

/// Parts of a rollout that are omitted because they cannot change the verdict; all of them by
/// default.
///
/// `cargo bench --bench shortcuts` runs thousands of rollouts with all of them and with none, and
/// compares the verdicts. (Skipping the reach up to where the hand comes near the object is not
/// among them: the fingers then arrive slightly elsewhere, and grasps that hold by chance fail by
/// chance.) A rollout whose steps are recorded always runs to its end.
#[options]
#[derive(Copy, PartialEq, Eq)]
#[schemars(inline)]
pub struct Shortcuts {
    /// Motions refused on geometry alone are not simulated (true). Without it they are simulated
    /// and then refused.
    #[option(default = true)]
    pub refused: bool,
    /// A rollout ends as soon as the object lies or falls below the whole hand (true).
    #[option(default = true)]
    pub lost: bool,
    /// A rollout ends as soon as the object has rested in the hand for a while (true).
    #[option(default = true)]
    pub settled: bool,
}

impl Shortcuts {
    /// Everything is simulated.
    pub const NONE: Self = Self {
        refused: false,
        lost: false,
        settled: false,
    };
    /// All shortcuts.
    pub const ALL: Self = Self {
        refused: true,
        lost: true,
        settled: true,
    };
}
