//! Random numbers of the generator: normal ones, one stream per item, and low-passed noise.

use std::f64::consts::TAU;

use nalgebra::{Unit, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// Returns the random numbers of one item: they depend on nothing but the arguments.
pub(crate) fn stream(seed: u64, kind: &str, item: usize) -> ChaCha8Rng {
    let text = format!("{seed}/{kind}/{item}");
    ChaCha8Rng::from_seed(*blake3::hash(text.as_bytes()).as_bytes())
}

/// Draws a number of mean zero and standard deviation one.
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}

/// Draws three independent numbers of standard deviation one.
pub(crate) fn normal3(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(rng))
}

/// Draws a direction in space, all equally likely.
pub(crate) fn direction(rng: &mut ChaCha8Rng) -> Unit<Vector3<f64>> {
    Unit::new_normalize(normal3(rng))
}

/// Draws a number between two, all equally likely.
pub(crate) fn between(rng: &mut ChaCha8Rng, range: [f64; 2]) -> f64 {
    range[0] + (range[1] - range[0]) * rng.random::<f64>()
}

/// Noise of a tracker: white noise through a first-order low-pass, of a given standard deviation.
pub(crate) struct LowPass<const N: usize> {
    state: [f64; N],
    keep: f64,
}

impl<const N: usize> LowPass<N> {
    /// Starts in the steady state.
    pub(crate) fn new(cutoff_hz: f64, rate_hz: f64, rng: &mut ChaCha8Rng) -> Self {
        Self {
            state: std::array::from_fn(|_| normal(rng)),
            keep: (-TAU * cutoff_hz / rate_hz).exp(),
        }
    }

    /// Returns the next values, of standard deviation one.
    pub(crate) fn next(&mut self, rng: &mut ChaCha8Rng) -> [f64; N] {
        let fresh = (1.0 - self.keep * self.keep).sqrt();
        for value in &mut self.state {
            *value = self.keep * *value + fresh * normal(rng);
        }
        self.state
    }
}
