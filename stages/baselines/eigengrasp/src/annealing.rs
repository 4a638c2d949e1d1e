//! `GraspIt`'s simulated annealing: temperature, jumps and acceptance.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// The constants of `GraspIt`'s default schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Schedule {
    /// Temperature at step 0.
    pub(crate) initial: f64,
    /// Cooling rate: `c` of [`Schedule::temperature`].
    pub(crate) cooling: f64,
    /// Dimensions: `d` of [`Schedule::temperature`].
    pub(crate) dimensions: f64,
    /// Number of the first step.
    pub(crate) first_step: usize,
    /// Factor on a difference of energies before it is compared with the temperature.
    pub(crate) energy_factor: f64,
}

/// `GraspIt`'s default schedule.
pub(crate) const DEFAULT: Schedule = Schedule {
    initial: 1e6,
    cooling: 7.0,
    dimensions: 8.0,
    first_step: 30_000,
    energy_factor: 1e-6,
};

impl Schedule {
    /// Returns the temperature after so many steps: `T₀ exp(−c k^(1/d))` (Ingber, "Very fast simulated re-annealing",
    /// 1989).
    pub(crate) fn temperature(&self, steps: usize) -> f64 {
        let k = (self.first_step + steps) as f64;
        self.initial * (-self.cooling * k.powf(1.0 / self.dimensions)).exp()
    }

    /// Returns the probability with which a state replaces another: 1 if it is better.
    pub(crate) fn acceptance(&self, temperature: f64, energy: f64, new_energy: f64) -> f64 {
        if new_energy <= energy {
            return 1.0;
        }
        ((energy - new_energy) * self.energy_factor / temperature).exp()
    }
}

/// Returns a jump as a share of the longest one, of either sign, from a uniform number in `[0, 1)`:
/// `± T ((1 + 1/T)^|2u − 1| − 1)`.
pub(crate) fn jump(temperature: f64, uniform: f64) -> f64 {
    let way = 2.0 * uniform - 1.0;
    let size = temperature * ((1.0 + 1.0 / temperature).powf(way.abs()) - 1.0);
    size.copysign(way)
}

/// Decides with this probability.
pub(crate) fn happens(probability: f64, rng: &mut ChaCha8Rng) -> bool {
    rng.random::<f64>() < probability
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    /// With 30,000 steps behind it: 30000^(1/8) = 3.6277, so that T = 1e6 exp(-25.394).
    #[test]
    fn the_temperature_falls_as_published() {
        let check = |steps: usize, expected: f64| {
            let found = DEFAULT.temperature(steps);
            assert!((found / expected - 1.0).abs() < 1e-3, "{steps}: {found}");
        };
        let at = |k: f64| 1e6 * (-7.0 * k.sqrt().sqrt().sqrt()).exp();
        check(0, at(30_000.0));
        check(70_000, at(100_000.0));
        assert!((DEFAULT.temperature(0).ln() - (1e6_f64.ln() - 25.394)).abs() < 1e-2);
    }

    #[test]
    fn jumps_reach_from_none_to_the_longest_and_shrink_with_the_temperature() {
        for temperature in [1e-7, 1e-3, 1.0, 1e3] {
            assert!((jump(temperature, 1.0) - 1.0).abs() < 1e-6, "{temperature}");
            assert!((jump(temperature, 0.0) + 1.0).abs() < 1e-6);
            assert!(jump(temperature, 0.5).abs() < 1e-12);
            assert!((jump(temperature, 0.25) + jump(temperature, 0.75)).abs() < 1e-9);
        }
        // T ((1 + 1/T)^(1/2) - 1) by hand: 1e-4 (sqrt(10001) - 1) = 0.0099005.
        assert!((jump(1e-4, 0.75) - 0.009_900_5).abs() < 1e-7);
        // A hot one is linear.
        assert!((jump(1e6, 0.75) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn better_states_are_always_accepted_and_worse_ones_as_often_as_boltzmann_says() {
        let temperature = 1e-5;
        assert_eq!(DEFAULT.acceptance(temperature, 10.0, 9.0), 1.0);
        assert_eq!(DEFAULT.acceptance(temperature, 10.0, 10.0), 1.0);
        // exp(-10 · 1e-6 / 1e-5) = exp(-1).
        let worse = DEFAULT.acceptance(temperature, 10.0, 20.0);
        assert!((worse - (-1.0_f64).exp()).abs() < 1e-12);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let n = 20_000;
        let accepted = (0..n).filter(|_| happens(worse, &mut rng)).count();
        assert!(
            (accepted as f64 / f64::from(n) - worse).abs() < 0.01,
            "{accepted}"
        );
        assert!((0..100).all(|_| happens(1.0, &mut rng)));
    }
}
