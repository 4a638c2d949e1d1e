//! A motion as a continuous function of time: through every step with the step's rates.

use spatial::{PoseSegment, PoseState};

use crate::{HandRates, Motion, MotionError, Step, joints_between};

/// Fewest steps of a motion.
const MIN_STEPS: usize = 2;

/// A motion through its steps, with each step's positions, velocities and accelerations: between
/// two of them a [`PoseSegment`] of the palm and quintic polynomials of the joints.
#[derive(Debug, Clone)]
pub struct MotionSpline<F> {
    motion: Motion<F>,
    /// The palm's segment from each step to the next.
    segments: Vec<PoseSegment<F>>,
}

impl<F: Copy> MotionSpline<F> {
    /// Creates the spline through a motion's steps.
    ///
    /// # Errors
    ///
    /// Fails for fewer than two steps, or if the palm's turn between two steps has no rotation
    /// vector.
    pub fn through(motion: Motion<F>) -> Result<Self, MotionError> {
        let steps = motion.steps();
        if steps.len() < MIN_STEPS {
            return Err(MotionError::Steps {
                found: steps.len(),
                expected: MIN_STEPS,
            });
        }
        let pairs = steps.iter().zip(steps.iter().skip(1)).enumerate();
        let segments = pairs.map(|(idx, (from, to))| {
            let segment = PoseSegment::new(&from.palm(), &to.palm(), to.time_s - from.time_s);
            segment.ok_or(MotionError::Turn { step: idx + 1 })
        });
        let segments = segments.collect::<Result<_, _>>()?;
        Ok(Self { motion, segments })
    }

    /// Returns the duration in seconds.
    pub fn duration_s(&self) -> f64 {
        self.motion.duration_s()
    }

    /// Returns the hand `time_s` after the first step; before the first and after the last step,
    /// the hand of that step with its rates.
    pub fn at(&self, time_s: f64) -> Step<F> {
        let steps = self.motion.steps();
        let time_s = self.motion.first().time_s + time_s.clamp(0.0, self.duration_s());
        let after = steps.partition_point(|step| step.time_s <= time_s);
        // There are at least two steps, and a segment between every two.
        let after = after.clamp(1, steps.len() - 1);
        let (from, to) = (&steps[after - 1], &steps[after]);
        let since_s = time_s - from.time_s;
        let palm = self.segments[after - 1].at(since_s);
        let (q_rad, joints) = joints_between(
            (&from.q_rad, &from.rates.joints),
            (&to.q_rad, &to.rates.joints),
            to.time_s - from.time_s,
            since_s,
        );
        Step {
            time_s,
            frame_from_palm: palm.frame_from_palm,
            q_rad,
            rates: HandRates {
                palm_velocity: palm.velocity,
                palm_acceleration: palm.acceleration,
                joints,
            },
        }
    }

    /// Returns the hand at the last step.
    pub fn grasp(&self) -> Step<F> {
        self.at(self.duration_s())
    }
}

impl<F: Copy> Step<F> {
    /// Returns the palm's state.
    fn palm(&self) -> PoseState<F> {
        PoseState {
            frame_from_palm: self.frame_from_palm,
            velocity: self.rates.palm_velocity,
            acceleration: self.rates.palm_acceleration,
        }
    }
}
