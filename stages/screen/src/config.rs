//! Options of `kind = "screen"`.

use std::path::PathBuf;

use options::{OptionFaults, Options, options};
use screening::{PoseError, ScreeningOptions};
use simulation::{Protocol, SceneConfig, SceneRandomization};

/// Most rollouts of an object that are recorded: a recording has about 1 MB.
const MAX_RECORDED: usize = 10_000;
/// Largest pose noise, as a share of an object's extent.
const MAX_POSE_NOISE: f64 = 1000.0;

/// Most trials of a motion under sampled errors.
const MAX_TRIALS: usize = 100_000;
/// Most motions of an object that are tried under errors.
const MAX_TRIED: usize = 1_000_000;

/// Greatest bound of the hand's depth in an object, in meters.
const MAX_PENETRATION_M: f64 = 1.0;

/// Options of `kind = "screen"`.
#[options(also = Self::combined_faults)]
pub struct ScreenConfig {
    /// File of the robot hand, or its URDF alone; the root link is the palm.
    #[option(path)]
    pub hand: PathBuf,
    /// Number of accepted rollouts per object recorded for a viewer: a recording has about 1 MB.
    #[option(default = 2, range = 0..=MAX_RECORDED, why = "each recording takes about 1 MB")]
    pub recorded_per_object: usize,
    /// Number of failed rollouts per object recorded likewise, the first of each reason before a second
    /// of any; a motion refused on geometry alone, or whose simulation diverged, has none.
    #[option(default = 1, range = 0..=MAX_RECORDED, why = "each recording takes about 1 MB")]
    pub recorded_failures_per_object: usize,
    /// Noise on the object's position, for a study: each motion is executed as if the object were
    /// shifted by normally distributed lengths, with a standard deviation along each axis of this
    /// share of the object's extent (0); paper: 0 to 0.1
    #[option(default, range = 0.0..=MAX_POSE_NOISE, why = "it is a share of the object's extent")]
    pub pose_noise: f64,
    /// Error of the object's estimated pose, for a study: each motion is executed as if the object lay so far off on
    /// the table (none).
    #[option(default, table)]
    pub pose_error: PoseError,
    /// Deepest that the hand may be in an object that it holds, in meters; deeper is `too_deep`: soft
    /// fingertips yield by that much.
    #[option(
        default = 0.005, range = 0.0..=MAX_PENETRATION_M,
        why = "no object of a hand's size is deeper"
    )]
    pub max_penetration_m: f64,
    /// Deepest that fingers may be in each other and in the palm at any time of a motion that holds its object,
    /// in meters, where they touch both; deeper is `too_deep`: soft contacts of the simulation yield by that much.
    #[option(
        default = 0.002, range = 0.0..=MAX_PENETRATION_M,
        why = "no finger is thicker"
    )]
    pub max_finger_penetration_m: f64,
    /// Trials of accepted motions under sampled errors.
    #[option(default, table)]
    pub robustness: RobustnessConfig,
    /// Number of motions per object, accepted or not, that are tried with the object off its estimated pose by errors
    /// of several sizes (0, 8 in `cgf.toml`), evenly among the candidates.
    #[option(default = 0, range = 0..=MAX_TRIED, why = "each is simulated once for each size")]
    pub pose_errors_per_object: usize,
    /// The physical scene.
    #[option(table)]
    pub scene: SceneConfig,
    /// Execution of a motion and its conditions of success.
    pub protocol: Protocol,
}

/// Trials of accepted motions under sampled errors.
#[options]
#[derive(Copy, PartialEq)]
#[schemars(inline)]
pub struct RobustnessConfig {
    /// Number of trials of each motion (16), 0 for none: its share of them is uncertain by an eighth.
    #[option(
        default = 16, range = 0..=MAX_TRIALS,
        why = "each simulates every tried motion once more"
    )]
    pub trials: usize,
    /// Number of accepted motions per object that are tried, the first ones (16): each costs as much as
    /// `trials` candidates.
    #[option(
        default = 16, range = 0..=MAX_TRIED,
        why = "each is simulated `robustness.trials` times"
    )]
    pub per_object: usize,
    /// Bounds of the sampled errors.
    #[option(default)]
    pub errors: SceneRandomization,
}

impl ScreenConfig {
    /// Returns the conditions under which motions are screened, of [resolved](Self::resolved) options.
    pub fn screening(&self, seed: u64) -> ScreeningOptions<'_> {
        ScreeningOptions {
            scene: &self.scene,
            protocol: &self.protocol,
            max_penetration_m: self.max_penetration_m,
            max_finger_penetration_m: self.max_finger_penetration_m,
            pose_noise: self.pose_noise,
            pose_error: self.pose_error,
            seed,
        }
    }

    /// Returns the options for which the protocol's name stands: a published one judges no depth.
    #[must_use]
    pub fn resolved(&self) -> Self {
        let (scene, protocol) = self.protocol.resolved(&self.scene);
        let of_own = |most_m: f64| {
            if self.protocol.name.is_own() {
                most_m
            } else {
                f64::INFINITY
            }
        };
        Self {
            max_penetration_m: of_own(self.max_penetration_m),
            max_finger_penetration_m: of_own(self.max_finger_penetration_m),
            scene,
            protocol,
            ..self.clone()
        }
    }

    fn combined_faults(&self, faults: &mut OptionFaults) {
        let errors = &self.robustness.errors;
        faults.of_table("robustness.errors", errors.faults_in(&self.scene));
        let Self {
            scene, protocol, ..
        } = self.resolved();
        faults.of_table("protocol", protocol.faults_in(&scene));
        if !self.protocol.name.is_own() {
            faults.of_table("protocol", self.protocol.faults_in(&self.scene));
            faults.of_table("scene", scene.faults());
        }
    }
}
