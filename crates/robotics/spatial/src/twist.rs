//! Linear and angular velocities of a frame.
//!
//! The moving frame is always a palm or the root of a robot, so that the type names only the frame of the
//! axes, which could be confused. A field that holds a twist says relative to what it moves.

use std::{
    marker::PhantomData,
    ops::{Add, Mul, Sub},
};

use nalgebra::{UnitQuaternion, Vector3};

use crate::Pose;

/// Velocity or acceleration of a moving frame, along the axes of `Frame`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist<Frame> {
    /// That of the moving frame's origin, in m/s or m/s².
    pub linear: Vector3<f64>,
    /// Angular velocity or acceleration, in rad/s or rad/s².
    pub angular: Vector3<f64>,
    frame: PhantomData<fn() -> Frame>,
}

impl<Frame> Twist<Frame> {
    /// Asserts that both vectors are along the axes of `Frame`.
    pub fn new(linear: Vector3<f64>, angular: Vector3<f64>) -> Self {
        Self {
            linear,
            angular,
            frame: PhantomData,
        }
    }

    /// Returns the twist of a frame at rest.
    pub fn zero() -> Self {
        Self::new(Vector3::zeros(), Vector3::zeros())
    }

    /// Takes six numbers: linear, then angular.
    pub fn from_array([x, y, z, a, b, c]: [f64; 6]) -> Self {
        Self::new(Vector3::new(x, y, z), Vector3::new(a, b, c))
    }

    /// Returns six numbers: linear, then angular.
    pub fn to_array(&self) -> [f64; 6] {
        let (v, w) = (self.linear, self.angular);
        [v.x, v.y, v.z, w.x, w.y, w.z]
    }

    /// Returns the twist along the axes of another frame, relative to which `Frame` rests.
    pub fn expressed_in<Other>(&self, other_from_frame: &Pose<Other, Frame>) -> Twist<Other> {
        Twist::new(
            *other_from_frame * self.linear,
            *other_from_frame * self.angular,
        )
    }

    /// Returns the twist rotated in its frame.
    #[must_use]
    pub fn rotated(&self, by: &UnitQuaternion<f64>) -> Self {
        Self::new(by * self.linear, by * self.angular)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.to_array().iter().all(|number| number.is_finite())
    }
}

impl<Frame> Add for Twist<Frame> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.linear + other.linear, self.angular + other.angular)
    }
}

impl<Frame> Sub for Twist<Frame> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.linear - other.linear, self.angular - other.angular)
    }
}

impl<Frame> Mul<f64> for Twist<Frame> {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::new(self.linear * factor, self.angular * factor)
    }
}
