//! Velocities and accelerations at a step of a motion.

use nalgebra::UnitQuaternion;
use robot::{JointOrder, WrongDof};
use spatial::Twist;

/// The known rates of a hand at a step.
pub trait Rates: Clone {
    /// Returns the rates of the joints, if known.
    fn joints(&self) -> Option<&JointRates>;

    /// Whether every number is finite, and there is one for each of `dof` joints.
    fn is_whole(&self, dof: usize) -> bool;

    /// Returns the same rates with the joints in another order.
    ///
    /// # Errors
    ///
    /// Fails if there is not one number for each joint.
    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof>;

    /// Returns the rates of the hand rotated in its frame.
    #[must_use]
    fn rotated(&self, by: &UnitQuaternion<f64>) -> Self;
}

/// Velocities and accelerations of joints, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRates {
    /// Velocities in rad/s (m/s if prismatic).
    pub velocity: Vec<f64>,
    /// Accelerations in rad/s² (m/s²).
    pub acceleration: Vec<f64>,
}

/// Velocities and accelerations of a palm and joints, in the motion's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct HandRates<F> {
    /// Velocity of the palm.
    pub palm_velocity: Twist<F>,
    /// Acceleration of the palm.
    pub palm_acceleration: Twist<F>,
    /// Rates of the joints.
    pub joints: JointRates,
}

impl JointRates {
    /// Returns zero rates for `dof` joints.
    pub fn zero(dof: usize) -> Self {
        Self {
            velocity: vec![0.0; dof],
            acceleration: vec![0.0; dof],
        }
    }
}

impl<F> HandRates<F> {
    /// Returns zero rates for a palm and `dof` joints.
    pub fn zero(dof: usize) -> Self {
        Self {
            palm_velocity: Twist::zero(),
            palm_acceleration: Twist::zero(),
            joints: JointRates::zero(dof),
        }
    }
}

impl Rates for () {
    fn joints(&self) -> Option<&JointRates> {
        None
    }

    fn is_whole(&self, _dof: usize) -> bool {
        true
    }

    fn reordered(&self, _order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(())
    }

    fn rotated(&self, _by: &UnitQuaternion<f64>) -> Self {}
}

impl Rates for JointRates {
    fn joints(&self) -> Option<&JointRates> {
        Some(self)
    }

    fn is_whole(&self, dof: usize) -> bool {
        [&self.velocity, &self.acceleration]
            .into_iter()
            .all(|rates| rates.len() == dof && rates.iter().all(|rate| rate.is_finite()))
    }

    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(Self {
            velocity: order.apply(&self.velocity)?,
            acceleration: order.apply(&self.acceleration)?,
        })
    }

    fn rotated(&self, _by: &UnitQuaternion<f64>) -> Self {
        self.clone()
    }
}

impl<F: Clone> Rates for HandRates<F> {
    fn joints(&self) -> Option<&JointRates> {
        Some(&self.joints)
    }

    fn is_whole(&self, dof: usize) -> bool {
        let palm = [&self.palm_velocity, &self.palm_acceleration];
        palm.into_iter().all(Twist::is_finite) && self.joints.is_whole(dof)
    }

    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(Self {
            joints: self.joints.reordered(order)?,
            ..self.clone()
        })
    }

    fn rotated(&self, by: &UnitQuaternion<f64>) -> Self {
        Self {
            palm_velocity: self.palm_velocity.rotated(by),
            palm_acceleration: self.palm_acceleration.rotated(by),
            joints: self.joints.clone(),
        }
    }
}
