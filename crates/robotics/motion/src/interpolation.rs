//! Interpolation between the steps of a motion.

use spatial::{Pose, quintic};

use crate::{JointRates, Motion, Rates, Step};

impl<F, R: Rates> Motion<F, R> {
    /// Returns the hand at a time: between two steps, positions linear and the rotation on the
    /// shortest arc; before the first step and after the last, that of the step.
    pub fn at(&self, time_s: f64) -> Step<F, ()> {
        let [from, to] = self.around(time_s);
        let part = match to.time_s - from.time_s {
            length_s if length_s > 0.0 => (time_s - from.time_s) / length_s,
            _ => 1.0,
        };
        from.blend(to, part.clamp(0.0, 1.0), time_s)
    }

    /// Returns the hand after a fraction in 0..=1 of the duration, as [`Motion::at`] does; at 0 it
    /// equals the first step's bit for bit.
    pub fn at_fraction(&self, fraction: f64) -> Step<F, ()> {
        let first = self.first();
        let time_s = first.time_s + self.duration_s() * fraction.clamp(0.0, 1.0);
        if time_s <= first.time_s {
            return first.blend(first, 1.0, time_s);
        }
        self.at(time_s)
    }

    /// Returns the joints' positions and rates at a time, on the quintic polynomials through the
    /// steps around it; `None` if their rates are not known.
    pub fn joints_at(&self, time_s: f64) -> Option<(Vec<f64>, JointRates)> {
        let [from, to] = self.around(time_s);
        Some(joints_between(
            (&from.q_rad, from.rates.joints()?),
            (&to.q_rad, to.rates.joints()?),
            to.time_s - from.time_s,
            time_s - from.time_s,
        ))
    }

    /// Returns the steps around a time, the earlier one first; the same step twice if there is only
    /// one.
    fn around(&self, time_s: f64) -> [&Step<F, R>; 2] {
        let steps = self.steps();
        let last = steps.len() - 1;
        let after = steps.partition_point(|step| step.time_s < time_s);
        let after = after.clamp(1.min(last), last);
        [&steps[after.saturating_sub(1)], &steps[after]]
    }
}

impl<F, R> Step<F, R> {
    /// Returns the interpolation to another step at a fraction `share`.
    fn blend(&self, to: &Self, share: f64, time_s: f64) -> Step<F, ()> {
        let [a, b] = [self, to].map(|step| &step.frame_from_palm);
        // Rotations equal within rounding have no arc, and either end serves.
        let rotation = a.rotation.try_slerp(&b.rotation, share, 1e-9);
        let translation = a.translation.vector.lerp(&b.translation.vector, share);
        let joints = self.q_rad.iter().zip(&to.q_rad);
        Step {
            time_s,
            frame_from_palm: Pose::from_parts(translation, rotation.unwrap_or(b.rotation)),
            q_rad: joints.map(|(a, b)| a + (b - a) * share).collect(),
            rates: (),
        }
    }
}

/// Returns the joints' positions and rates `time_s` after the first of two ends that are
/// `duration_s` apart, on the quintic polynomial that matches both ends' positions, velocities and
/// accelerations.
pub fn joints_between(
    from: (&[f64], &JointRates),
    to: (&[f64], &JointRates),
    duration_s: f64,
    time_s: f64,
) -> (Vec<f64>, JointRates) {
    let dof = from.0.len();
    let mut q = Vec::with_capacity(dof);
    let mut rates = JointRates {
        velocity: Vec::with_capacity(dof),
        acceleration: Vec::with_capacity(dof),
    };
    for (from, to) in ends(from.0, from.1).zip(ends(to.0, to.1)) {
        let [position, velocity, acceleration] = quintic(from, to, duration_s, time_s);
        q.push(position);
        rates.velocity.push(velocity);
        rates.acceleration.push(acceleration);
    }
    (q, rates)
}

/// Position, velocity and acceleration of each joint.
pub(crate) fn ends(q: &[f64], rates: &JointRates) -> impl Iterator<Item = [f64; 3]> {
    let rates = rates.velocity.iter().zip(&rates.acceleration);
    q.iter().zip(rates).map(|(&q, (&v, &a))| [q, v, a])
}
