//! Trials of motions under drawn errors.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use simulation::{SceneConfig, SceneRandomization, SimulationError, Verdict};

use crate::screening::{Screening, ScreeningOptions};

/// The trials of one motion under drawn errors.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MotionTrials {
    /// The verdict of each trial, in their order.
    pub verdicts: Vec<Verdict>,
    /// Control steps simulated in all trials.
    pub control_steps_n: i64,
}

impl Screening<'_> {
    /// Tries motions of these indices a number of times; returns the trials of each, in their order. The errors of a
    /// trial are drawn once for all motions, so that their shares of success can be compared. `progress` is told the
    /// share that is done.
    ///
    /// # Errors
    ///
    /// Fails if the hand, the object or a drawn scene cannot be simulated.
    ///
    /// # Panics
    ///
    /// Panics if there is no motion of an index.
    pub fn trials(
        &self,
        motions: &[usize],
        trials_n: usize,
        errors: &SceneRandomization,
        progress: impl Fn(f64),
    ) -> Result<Vec<MotionTrials>, SimulationError> {
        let mut tried = vec![MotionTrials::default(); motions.len()];
        for trial in 0..trials_n {
            let drawn = drawn_scene(&self.options, errors, trial);
            let scenes = self.scenes(&drawn, motions)?;
            let verdicts = self.verdicts(&scenes, motions)?;
            for (tried, (verdict, control_steps_n)) in tried.iter_mut().zip(verdicts) {
                tried.verdicts.push(verdict);
                tried.control_steps_n += i64::from(control_steps_n);
            }
            progress((trial + 1) as f64 / trials_n as f64);
        }
        Ok(tried)
    }
}

/// Returns the scene of one trial of an object.
fn drawn_scene(
    options: &ScreeningOptions<'_>,
    errors: &SceneRandomization,
    trial: usize,
) -> SceneConfig {
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    // The first ones draw the pose noise of motions.
    rng.set_stream(u64::MAX - trial as u64);
    errors.sample(options.scene, &mut rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn each_trial_of_each_seed_has_its_own_errors() {
        let (scene, protocol) = (fixture::scene(), fixture::protocol());
        let errors = SceneRandomization::default();
        let drawn = |seed: u64, trial: usize| {
            let options = ScreeningOptions {
                seed,
                ..fixture::options(&scene, &protocol)
            };
            drawn_scene(&options, &errors, trial)
        };
        assert_eq!(drawn(7, 0), drawn(7, 0));
        assert_ne!(drawn(7, 0), drawn(7, 1));
        assert_ne!(drawn(7, 0), drawn(8, 0));
        assert_ne!(drawn(7, 0), scene);
    }
}
