//! How fast a hand moves at a step of a motion.

use robot::{JointOrder, WrongDof};
use spatial::Twist;

/// What is known of how fast a hand moves at a step.
pub trait Rates: Clone {
    /// Returns how fast the joints move, if that is known.
    fn joints(&self) -> Option<&JointRates>;

    /// Whether every number is finite, and there is one for each of `dof` joints.
    fn is_whole(&self, dof: usize) -> bool;

    /// Returns the same rates with the joints in another order.
    ///
    /// # Errors
    ///
    /// Fails if there is not one number for each joint.
    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof>;
}

/// How fast joints move, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRates {
    /// Velocities in rad/s (m/s if prismatic).
    pub velocity: Vec<f64>,
    /// Accelerations in rad/s² (m/s²).
    pub acceleration: Vec<f64>,
}

/// How fast a palm and joints move.
#[derive(Debug, Clone, PartialEq)]
pub struct HandRates {
    /// Of the palm, along the axes of the motion's frame.
    pub palm_velocity: Twist,
    /// How fast that changes.
    pub palm_acceleration: Twist,
    /// Of the joints.
    pub joints: JointRates,
}

impl JointRates {
    /// Returns the rates of joints that do not move.
    pub fn still(dof: usize) -> Self {
        Self {
            velocity: vec![0.0; dof],
            acceleration: vec![0.0; dof],
        }
    }
}

impl HandRates {
    /// Returns the rates of a hand of `dof` joints that does not move.
    pub fn still(dof: usize) -> Self {
        Self {
            palm_velocity: Twist::zero(),
            palm_acceleration: Twist::zero(),
            joints: JointRates::still(dof),
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
}

impl Rates for HandRates {
    fn joints(&self) -> Option<&JointRates> {
        Some(&self.joints)
    }

    fn is_whole(&self, dof: usize) -> bool {
        let palm = [self.palm_velocity, self.palm_acceleration];
        palm.iter().all(Twist::is_finite) && self.joints.is_whole(dof)
    }

    fn reordered(&self, order: &JointOrder) -> Result<Self, WrongDof> {
        Ok(Self {
            joints: self.joints.reordered(order)?,
            ..self.clone()
        })
    }
}
