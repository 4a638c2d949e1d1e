//! Rates of a motion from its positions alone.

use spatial::Twist;

use crate::{HandRates, Motion, MotionError, Rates, Step};

impl<F: Clone, R: Rates> Motion<F, R> {
    /// Returns the motion with the velocities and accelerations that follow from its positions.
    ///
    /// At each step velocities, and the joints' accelerations, are those of the parabola through it and its
    /// neighbors (at an end, through the three steps there), which needs no equal spacing; two steps share one
    /// velocity, one has none. The palm's acceleration is the difference of its neighbors' velocities (its own
    /// at an end) over the time between them.
    ///
    /// # Errors
    ///
    /// Fails if steps are so near in time that a rate is not finite.
    pub fn differentiated(&self) -> Result<Motion<F, HandRates<F>>, MotionError> {
        let steps = self.steps();
        let n = steps.len();
        let mut rates: Vec<HandRates<F>> = (0..n)
            .map(|at| {
                let middle = at.clamp(1, n.saturating_sub(2).max(1));
                velocities(&steps[middle - 1..(middle + 2).min(n)], &steps[at])
            })
            .collect();
        for at in 0..n {
            rates[at].palm_acceleration =
                palm_acceleration(steps, at, |idx| rates[idx].palm_velocity.to_array());
        }
        self.with_rates(|at| rates[at].clone())
    }
}

/// Returns how fast the palm's velocity, in m/s and rad/s, changes about a step: its difference between the neighbors
/// (the step itself at an end) over the time between them; 0 of a single step.
pub fn palm_acceleration<F, R>(
    steps: &[Step<F, R>],
    at: usize,
    velocity: impl Fn(usize) -> [f64; 6],
) -> Twist<F> {
    let (before, after) = (at.saturating_sub(1), (at + 1).min(steps.len() - 1));
    if before == after {
        return Twist::zero();
    }
    let between_s = steps[after].time_s - steps[before].time_s;
    let [next, last] = [after, before].map(velocity);
    Twist::from_array(std::array::from_fn(|k| (next[k] - last[k]) / between_s))
}

/// Returns the velocities, and the joints' accelerations, at one of a few neighboring steps.
fn velocities<F, R>(near: &[Step<F, R>], here: &Step<F, R>) -> HandRates<F> {
    let times: Vec<f64> = near.iter().map(|step| step.time_s).collect();
    let mut rates = HandRates::zero(here.q_rad.len());
    for (step, [first, second]) in near.iter().zip(derivative_weights(&times, here.time_s)) {
        for (idx, q) in step.q_rad.iter().enumerate() {
            rates.joints.velocity[idx] += first * q;
            rates.joints.acceleration[idx] += second * q;
        }
        let [palm, here] = [step, here].map(|step| &step.frame_from_palm);
        rates.palm_velocity.linear += palm.translation.vector * first;
        // Turns from here, small between neighbors, add like vectors.
        rates.palm_velocity.angular +=
            (palm.rotation * here.rotation.inverse()).scaled_axis() * first;
    }
    rates
}

/// Returns for each of two or three times the weights of its value in the first and the second
/// derivative at `at` of the polynomial through all.
fn derivative_weights(times: &[f64], at: f64) -> Vec<[f64; 2]> {
    match *times {
        [a, b] => vec![[-1.0 / (b - a), 0.0], [1.0 / (b - a), 0.0]],
        [a, b, c] => [(a, b, c), (b, a, c), (c, a, b)]
            .map(|(own, one, other)| {
                let scale = 1.0 / ((own - one) * (own - other));
                [scale * (2.0 * at - one - other), 2.0 * scale]
            })
            .to_vec(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use spatial::{Object, Pose};

    use super::*;

    /// Returns the steps at these times with their rates.
    fn with_rates(times: &[f64]) -> Vec<Step<Object>> {
        let step = |&t: &f64| Step {
            time_s: t,
            frame_from_palm: Pose::from_parts(
                [0.3 * t, 0.0, t * t],
                UnitQuaternion::new(Vector3::new(0.0, 0.2, 0.0))
                    * UnitQuaternion::new(Vector3::new(0.0, 0.0, 0.5 * t)),
            ),
            q_rad: vec![1.0 + 2.0 * t - 3.0 * t * t, 0.7],
            rates: (),
        };
        let motion = Motion::new(&["a", "b"], times.iter().map(step).collect()).unwrap();
        motion.differentiated().unwrap().steps().to_vec()
    }

    #[test]
    fn rates_of_a_parabola_are_exact() {
        let about = UnitQuaternion::new(Vector3::new(0.0, 0.2, 0.0)) * Vector3::z() * 0.5;
        for step in &with_rates(&[0.0, 0.1, 0.15, 0.3, 0.4]) {
            let (t, rates) = (step.time_s, &step.rates);
            assert!((rates.joints.velocity[0] - (2.0 - 6.0 * t)).abs() < 1e-9);
            assert!((rates.joints.acceleration[0] + 6.0).abs() < 1e-9);
            assert!(rates.joints.velocity[1].abs() < 1e-9);
            let expected = [0.3, 0.0, 2.0 * t, about.x, about.y, about.z];
            for (found, expected) in rates.palm_velocity.to_array().into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{rates:?}");
            }
        }
    }

    #[test]
    fn few_steps_have_the_rates_that_they_can() {
        let two = with_rates(&[0.0, 0.5]);
        let [first, last] = [0, 1].map(|idx: usize| two[idx].rates.clone());
        assert_eq!(first.joints, last.joints);
        let linear = [&first, &last].map(|rates| rates.palm_velocity.linear);
        assert_eq!(linear[0], linear[1]);
        assert!((first.joints.velocity[0] - 0.5).abs() < 1e-12);
        assert_eq!(with_rates(&[0.0])[0].rates, HandRates::zero(2));
    }
}
