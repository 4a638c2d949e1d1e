//! Random attempts to grasp an object.

use std::sync::Arc;

use geometry::DistanceField;
use posture::Environment;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use schemas::objects::Object;
use spatial::RestingPose;

use crate::{RestChoice, RestDistribution};

/// Random attempts to grasp one object, each with random numbers and a resting pose of its own.
pub struct Attempts {
    field: Arc<DistanceField>,
    rests: RestDistribution,
    seed: u64,
}

impl Attempts {
    /// Takes an object, the distances from it and the seed of all attempts.
    pub fn new(object: &Object, field: DistanceField, rests: RestChoice, seed: u64) -> Self {
        Self {
            field: Arc::new(field),
            rests: RestDistribution::of(object, rests),
            seed,
        }
    }

    /// Returns the random numbers of a stream; that of an attempt is its number.
    pub fn random(&self, stream: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(stream);
        rng
    }

    /// Returns the object in a resting pose, on its table.
    pub fn environment(&self, rest: RestingPose) -> Environment {
        Environment::new(Arc::clone(&self.field), rest)
    }

    /// Makes attempts in parallel; returns each result, by number, with its processor time in seconds.
    ///
    /// # Errors
    ///
    /// Fails as an attempt does.
    pub fn results<T: Send, E: Send>(
        &self,
        count: usize,
        attempt: impl Fn(usize, &Environment, &mut ChaCha8Rng) -> Result<T, E> + Sync,
    ) -> Result<Vec<(T, f64)>, E> {
        let numbers = (0..count).into_par_iter();
        let results = numbers.map(|number| {
            let (made, cpu_s) = cpu_time::measured(|| {
                let mut rng = self.random(number as u64);
                let environment = self.environment(self.rests.at(rng.random()));
                attempt(number, &environment, &mut rng)
            });
            Ok((made?, cpu_s))
        });
        results.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn an_attempt_has_the_random_numbers_of_its_number_alone() {
        let attempts = |seed: u64| {
            let (object, field) = (fixture::BOX.object(), fixture::BOX.field());
            let attempts = Attempts::new(&object, field, RestChoice::Seen, seed);
            move |count: usize| -> Vec<u64> {
                let drawn = attempts.results(count, |_, _, rng| Ok::<u64, ()>(rng.random()));
                drawn.unwrap().into_iter().map(|(drawn, _)| drawn).collect()
            }
        };
        let [few, many] = [2, 5].map(attempts(3));
        assert_eq!(few, many[..2]);
        assert_ne!(few[0], few[1]);
        assert_ne!(attempts(4)(2), few);
    }
}
