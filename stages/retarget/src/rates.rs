//! How fast a trajectory moves.

use schemas::trajectories::{Rates, Step};
use spatial::{Object, Palm, Pose, Twist};

/// Fills in the velocities and accelerations of steps from their positions.
///
/// At each step they are those of the parabola through it and its neighbors (at an end, through the
/// three steps there), which needs no equal spacing; two steps share one velocity.
pub(crate) fn fill_rates(steps: &mut [Step]) {
    let n = steps.len();
    let times: Vec<f64> = steps.iter().map(|step| step.hand.time_s).collect();
    let rates: Vec<Rates> = (0..n)
        .map(|at| {
            let middle = at.clamp(1, n.saturating_sub(2).max(1));
            let window = middle - 1..(middle + 2).min(n);
            let weights = derivative_weights(times.get(window.clone()).unwrap_or(&[]), times[at]);
            let near = steps.get(window).unwrap_or(&[]);
            rates(
                near,
                &weights,
                steps.get(at).map(|step| &step.hand.frame_from_palm),
            )
        })
        .collect();
    for (step, mut rates) in steps.iter_mut().zip(rates) {
        if rates.joints.velocity.is_empty() {
            rates = Rates::still(step.hand.q_rad.len());
        }
        step.hand.rates = rates;
    }
}

/// Returns the rates at one of a few neighboring steps, whose palm is at `here`.
fn rates(near: &[Step], weights: &[[f64; 2]], here: Option<&Pose<Object, Palm>>) -> Rates {
    let dof = near.first().map_or(0, |step| step.hand.q_rad.len());
    let mut rates = Rates::still(dof);
    let mut palm_velocity = Twist::zero();
    for (step, [first, second]) in near.iter().zip(weights) {
        for (idx, q) in step.hand.q_rad.iter().enumerate() {
            if let Some(rate) = rates.joints.velocity.get_mut(idx) {
                *rate += first * q;
            }
            if let Some(rate) = rates.joints.acceleration.get_mut(idx) {
                *rate += second * q;
            }
        }
        let palm = &step.hand.frame_from_palm;
        palm_velocity.linear += palm.translation.vector * *first;
        if let Some(here) = here {
            // Turns from here, small between neighbors, add like vectors.
            palm_velocity.angular +=
                (palm.rotation * here.rotation.inverse()).scaled_axis() * *first;
        }
    }
    rates.palm_velocity = palm_velocity;
    rates
}

/// Returns for each of two or three times the weights of its value in the first and the second
/// derivative at `at` of the polynomial through all.
fn derivative_weights(times: &[f64], at: f64) -> Vec<[f64; 2]> {
    match *times {
        [a, b] if b > a => vec![[-1.0 / (b - a), 0.0], [1.0 / (b - a), 0.0]],
        [a, b, c] if b > a && c > b => [(a, b, c), (b, a, c), (c, a, b)]
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
    use schemas::trajectories::Tracking;
    use spatial::Pose;

    use super::*;

    fn steps(times: &[f64]) -> Vec<Step> {
        times
            .iter()
            .map(|&t| Step {
                hand: motion::Step {
                    time_s: t,
                    frame_from_palm: Pose::from_parts(
                        [0.3 * t, 0.0, t * t],
                        UnitQuaternion::new(Vector3::new(0.0, 0.2, 0.0))
                            * UnitQuaternion::new(Vector3::new(0.0, 0.0, 0.5 * t)),
                    ),
                    q_rad: vec![1.0 + 2.0 * t - 3.0 * t * t, 0.7],
                    rates: Rates::still(2),
                },
                tracking: Tracking::default(),
            })
            .collect()
    }

    #[test]
    fn rates_of_a_parabola_are_exact() {
        let mut steps = steps(&[0.0, 0.1, 0.15, 0.3, 0.4]);
        fill_rates(&mut steps);
        let about = UnitQuaternion::new(Vector3::new(0.0, 0.2, 0.0)) * Vector3::z() * 0.5;
        for step in &steps {
            let (t, rates) = (step.hand.time_s, &step.hand.rates);
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
        let mut two = steps(&[0.0, 0.5]);
        fill_rates(&mut two);
        let [first, last] = [0, 1].map(|idx: usize| two[idx].hand.rates.clone());
        assert_eq!(first.joints, last.joints);
        let linear = [&first, &last].map(|rates| rates.palm_velocity.linear);
        assert_eq!(linear[0], linear[1]);
        assert!((two[0].hand.rates.joints.velocity[0] - 0.5).abs() < 1e-12);
        let mut one = steps(&[0.0]);
        fill_rates(&mut one);
        assert_eq!(one[0].hand.rates, Rates::still(2));
    }
}
