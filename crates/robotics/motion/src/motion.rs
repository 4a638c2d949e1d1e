//! A hand over time, in one frame.

use std::sync::Arc;

use robot::JointOrder;
use spatial::{Palm, Pose};

use crate::{HandRates, MotionError, Rates};

/// A hand over time in frame `F`, whose steps know the rates `R`.
///
/// There is at least one step; times increase, every number is finite, and each step has one position per
/// joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion<F, R = HandRates<F>> {
    joints: Arc<[String]>,
    steps: Vec<Step<F, R>>,
}

/// A hand at one time of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Step<F, R = HandRates<F>> {
    /// Seconds, since the first step unless stated otherwise.
    pub time_s: f64,
    /// Pose of the palm in the motion's frame.
    pub frame_from_palm: Pose<F, Palm>,
    /// Joint positions in radians (meters if prismatic), in the order of the motion's joints.
    pub q_rad: Vec<f64>,
    /// Rates of change.
    pub rates: R,
}

impl<F, R: Rates> Motion<F, R> {
    /// Creates a motion from joint names and steps in time order.
    ///
    /// # Errors
    ///
    /// Fails if there is no step, if times do not increase, or if a step has a number that is not
    /// finite or does not have one number per joint.
    pub fn new(joints: &[impl AsRef<str>], steps: Vec<Step<F, R>>) -> Result<Self, MotionError> {
        let joints = joints.iter().map(|joint| joint.as_ref().to_owned());
        Self::of_joints(joints.collect(), steps)
    }

    /// Creates a motion with joint names that several motions share.
    ///
    /// # Errors
    ///
    /// As [`Motion::new`].
    pub fn of_joints(joints: Arc<[String]>, steps: Vec<Step<F, R>>) -> Result<Self, MotionError> {
        if steps.is_empty() {
            return Err(MotionError::Steps {
                found: 0,
                expected: 1,
            });
        }
        let mut last_s = f64::NEG_INFINITY;
        for (idx, step) in steps.iter().enumerate() {
            if !step.is_whole(joints.len()) {
                return Err(MotionError::Number { step: idx });
            }
            if step.time_s <= last_s {
                return Err(MotionError::Times {
                    step: idx,
                    time_s: step.time_s,
                    last_s,
                });
            }
            last_s = step.time_s;
        }
        Ok(Self { joints, steps })
    }

    /// Returns the names of the joints, in the order of the steps' numbers.
    pub fn joints(&self) -> &Arc<[String]> {
        &self.joints
    }

    /// Returns the steps in time order.
    pub fn steps(&self) -> &[Step<F, R>] {
        &self.steps
    }

    /// Returns the first step.
    pub fn first(&self) -> &Step<F, R> {
        &self.steps[0]
    }

    /// Returns the last step, the grasp.
    pub fn grasp(&self) -> &Step<F, R> {
        &self.steps[self.steps.len() - 1]
    }

    /// Returns the duration in seconds.
    pub fn duration_s(&self) -> f64 {
        self.grasp().time_s - self.first().time_s
    }

    /// Returns the same motion with its joints in the given order.
    ///
    /// # Errors
    ///
    /// Fails unless both are orders of the same joints.
    pub fn reordered(&self, joints: &[String]) -> Result<Self, MotionError> {
        let order = JointOrder::new(&self.joints, joints)?;
        let step = |step: &Step<F, R>| {
            Ok(Step {
                time_s: step.time_s,
                frame_from_palm: step.frame_from_palm,
                q_rad: order.apply(&step.q_rad)?,
                rates: step.rates.reordered(&order)?,
            })
        };
        let steps = self.steps.iter().map(step);
        Ok(Self {
            joints: joints.into(),
            steps: steps.collect::<Result<_, MotionError>>()?,
        })
    }

    /// Returns the same motion with the rates that `rates` returns for each step's index.
    ///
    /// # Errors
    ///
    /// Fails if a rate is not finite, or there is not one number per joint.
    pub fn with_rates<S: Rates>(
        &self,
        rates: impl Fn(usize) -> S,
    ) -> Result<Motion<F, S>, MotionError> {
        let step = |(idx, step): (usize, &Step<F, R>)| Step {
            time_s: step.time_s,
            frame_from_palm: step.frame_from_palm,
            q_rad: step.q_rad.clone(),
            rates: rates(idx),
        };
        let steps = self.steps.iter().enumerate().map(step);
        Motion::of_joints(Arc::clone(&self.joints), steps.collect())
    }

    /// Returns the motion moved in its frame, with its rates.
    #[must_use]
    pub fn moved(&self, by: &Pose<F, F>) -> Self {
        let step = |step: &Step<F, R>| Step {
            time_s: step.time_s,
            frame_from_palm: *by * step.frame_from_palm,
            q_rad: step.q_rad.clone(),
            rates: step.rates.rotated(&by.rotation),
        };
        Self {
            joints: Arc::clone(&self.joints),
            steps: self.steps.iter().map(step).collect(),
        }
    }
}

impl<F> Motion<F, ()> {
    /// Returns the motion in another frame.
    #[must_use]
    pub fn expressed_in<G>(&self, other_from_frame: &Pose<G, F>) -> Motion<G, ()> {
        let step = |step: &Step<F, ()>| Step {
            time_s: step.time_s,
            frame_from_palm: *other_from_frame * step.frame_from_palm,
            q_rad: step.q_rad.clone(),
            rates: (),
        };
        Motion {
            joints: Arc::clone(&self.joints),
            steps: self.steps.iter().map(step).collect(),
        }
    }
}

impl<F, R: Rates> Step<F, R> {
    /// Whether every number is finite, and there is one for each of `dof` joints.
    fn is_whole(&self, dof: usize) -> bool {
        let pose = self.frame_from_palm;
        let numbers = pose.translation.vector.iter();
        let numbers = numbers.chain(pose.rotation.coords.iter());
        self.q_rad.len() == dof
            && self.rates.is_whole(dof)
            && numbers
                .chain(&self.q_rad)
                .chain([&self.time_s])
                .all(|number| number.is_finite())
    }
}
