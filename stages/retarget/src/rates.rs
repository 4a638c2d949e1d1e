//! How fast a trajectory moves.

use nalgebra::{Isometry3, Vector3};
use schemas::trajectories::{Rates, Step};

/// Fills in the velocities and accelerations of steps from their positions.
///
/// At each step they are those of the parabola through it and its neighbors (at an end, through the
/// three steps there), which needs no equal spacing; two steps share one velocity.
pub(crate) fn fill_rates(steps: &mut [Step]) {
    let n = steps.len();
    let times: Vec<f64> = steps.iter().map(|step| step.time_s).collect();
    let rates: Vec<Rates> = (0..n)
        .map(|at| {
            let middle = at.clamp(1, n.saturating_sub(2).max(1));
            let window = middle - 1..(middle + 2).min(n);
            let weights = derivative_weights(times.get(window.clone()).unwrap_or(&[]), times[at]);
            let near = steps.get(window).unwrap_or(&[]);
            rates(
                near,
                &weights,
                steps.get(at).map(|step| step.object_from_palm.isometry()),
            )
        })
        .collect();
    for (step, mut rates) in steps.iter_mut().zip(rates) {
        if rates.q_velocity_rad_per_s.is_empty() {
            rates = Rates::still(step.q_rad.len());
        }
        step.rates = rates;
    }
}

/// Returns the rates at one of a few neighboring steps, whose palm is at `here`.
fn rates(near: &[Step], weights: &[[f64; 2]], here: Option<&Isometry3<f64>>) -> Rates {
    let dof = near.first().map_or(0, |step| step.q_rad.len());
    let mut rates = Rates::still(dof);
    let (mut velocity, mut spin) = (Vector3::zeros(), Vector3::zeros());
    for (step, [first, second]) in near.iter().zip(weights) {
        for (idx, q) in step.q_rad.iter().enumerate() {
            if let Some(rate) = rates.q_velocity_rad_per_s.get_mut(idx) {
                *rate += first * q;
            }
            if let Some(rate) = rates.q_acceleration_rad_per_s2.get_mut(idx) {
                *rate += second * q;
            }
        }
        let palm = step.object_from_palm.isometry();
        velocity += palm.translation.vector * *first;
        if let Some(here) = here {
            // Turns from here, small between neighbors, add like vectors.
            spin += (palm.rotation * here.rotation.inverse()).scaled_axis() * *first;
        }
    }
    rates.palm_velocity = [velocity.x, velocity.y, velocity.z, spin.x, spin.y, spin.z];
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
    use nalgebra::UnitQuaternion;
    use schemas::trajectories::Tracking;
    use spatial::Pose;

    use super::*;

    fn steps(times: &[f64]) -> Vec<Step> {
        times
            .iter()
            .map(|&t| Step {
                time_s: t,
                object_from_palm: Pose::new(Isometry3::from_parts(
                    Vector3::new(0.3 * t, 0.0, t * t).into(),
                    UnitQuaternion::new(Vector3::new(0.0, 0.2, 0.0))
                        * UnitQuaternion::new(Vector3::new(0.0, 0.0, 0.5 * t)),
                )),
                q_rad: vec![1.0 + 2.0 * t - 3.0 * t * t, 0.7],
                rates: Rates::still(2),
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
            let (t, rates) = (step.time_s, &step.rates);
            assert!((rates.q_velocity_rad_per_s[0] - (2.0 - 6.0 * t)).abs() < 1e-9);
            assert!((rates.q_acceleration_rad_per_s2[0] + 6.0).abs() < 1e-9);
            assert!(rates.q_velocity_rad_per_s[1].abs() < 1e-9);
            let expected = [0.3, 0.0, 2.0 * t, about.x, about.y, about.z];
            for (found, expected) in rates.palm_velocity.iter().zip(expected) {
                assert!((found - expected).abs() < 1e-3, "{rates:?}");
            }
        }
    }

    #[test]
    fn few_steps_have_the_rates_that_they_can() {
        let mut two = steps(&[0.0, 0.5]);
        fill_rates(&mut two);
        assert_eq!(two[0].rates, {
            let mut rates = two[1].rates.clone();
            rates.palm_velocity[3..].copy_from_slice(&two[0].rates.palm_velocity[3..]);
            rates
        });
        assert!((two[0].rates.q_velocity_rad_per_s[0] - 0.5).abs() < 1e-12);
        let mut one = steps(&[0.0]);
        fill_rates(&mut one);
        assert_eq!(one[0].rates, Rates::still(2));
    }
}
