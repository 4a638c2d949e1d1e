//! What the screen says of a rollout.

use simulation::{Rollout, Verdict};
use stage_screen::ScreenConfig;

/// Returns the verdict with the limit of depth.
pub(crate) fn screened(screen: &ScreenConfig, rollout: &Rollout) -> Verdict {
    match rollout.verdict {
        Verdict::Held if rollout.penetration_m > screen.max_penetration_m => Verdict::TooDeep,
        verdict => verdict,
    }
}
