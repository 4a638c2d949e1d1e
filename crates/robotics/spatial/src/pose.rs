//! Rigid transforms that know which two frames they join.

use std::{
    fmt,
    marker::PhantomData,
    ops::{Deref, Mul},
};

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::rotation::{InvalidRotation, quaternion_xyzw, xyzw};

/// The rigid transform that takes coordinates in `From` to coordinates in `To`, in meters.
///
/// Name values `to_from_from`: `object_from_palm` is the pose of the palm in the object frame.
/// Poses, points and vectors are multiplied with it; it dereferences to its numbers.
pub struct Pose<To, From> {
    isometry: Isometry3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Pose<To, From> {
    /// Asserts that `isometry` takes coordinates in `From` to coordinates in `To`.
    pub fn new(isometry: Isometry3<f64>) -> Self {
        Self {
            isometry,
            frames: PhantomData,
        }
    }

    /// Builds the pose of a frame whose origin is at `position` in `To`, in meters.
    pub fn from_parts(
        position: impl Into<Translation3<f64>>,
        rotation: UnitQuaternion<f64>,
    ) -> Self {
        Self::new(Isometry3::from_parts(position.into(), rotation))
    }

    /// Returns the transform between two frames that coincide.
    pub fn identity() -> Self {
        Self::new(Isometry3::identity())
    }

    /// Returns the pose of `To` in `From`.
    pub fn inverse(&self) -> Pose<From, To> {
        Pose::new(self.isometry.inverse())
    }

    /// Returns `self.inverse() * to_from_c`: the pose of `C` in `From`.
    pub fn inv_mul<C>(&self, to_from_c: &Pose<To, C>) -> Pose<From, C> {
        Pose::new(self.isometry.inv_mul(&to_from_c.isometry))
    }

    /// Returns the same transform under other frame names.
    pub fn reinterpret<To2, From2>(&self) -> Pose<To2, From2> {
        Pose::new(self.isometry)
    }

    /// Returns the pose moved by an offset along the axes of `To`, in meters.
    #[must_use]
    pub fn translated(&self, offset_in_to: &Vector3<f64>) -> Self {
        Self::new(Translation3::from(*offset_in_to) * self.isometry)
    }

    /// Returns the pose as stored: position `xyz` in meters, then quaternion `xyzw` with `w ≥ 0`.
    pub fn to_array(&self) -> [f64; 7] {
        let t = &self.isometry.translation.vector;
        let [x, y, z, w] = xyzw(&self.isometry.rotation);
        [t.x, t.y, t.z, x, y, z, w]
    }

    /// Reads a pose as stored by [`Pose::to_array`].
    ///
    /// # Errors
    ///
    /// Fails if a number is not finite or the quaternion is not of unit length within 1e-3.
    pub fn from_array(numbers: [f64; 7]) -> Result<Self, InvalidPose> {
        let [px, py, pz, x, y, z, w] = numbers;
        if !(px.is_finite() && py.is_finite() && pz.is_finite()) {
            return Err(InvalidPose::Position([px, py, pz]));
        }
        let rotation = quaternion_xyzw([x, y, z, w])?;
        Ok(Self::from_parts([px, py, pz], rotation))
    }
}

/// Why seven numbers are not a pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InvalidPose {
    /// A coordinate is NaN or infinite.
    #[error("position {0:?} is not finite")]
    Position([f64; 3]),
    /// The last four numbers are not a rotation.
    #[error(transparent)]
    Rotation(#[from] InvalidRotation),
}

impl<A, B, C> Mul<Pose<B, C>> for Pose<A, B> {
    type Output = Pose<A, C>;

    fn mul(self, b_from_c: Pose<B, C>) -> Pose<A, C> {
        Pose::new(self.isometry * b_from_c.isometry)
    }
}

impl<To, From> Mul<Point3<f64>> for Pose<To, From> {
    type Output = Point3<f64>;

    fn mul(self, point_in_from: Point3<f64>) -> Point3<f64> {
        self.isometry * point_in_from
    }
}

impl<To, From> Mul<Vector3<f64>> for Pose<To, From> {
    type Output = Vector3<f64>;

    fn mul(self, vector_in_from: Vector3<f64>) -> Vector3<f64> {
        self.isometry * vector_in_from
    }
}

impl<To, From> Deref for Pose<To, From> {
    type Target = Isometry3<f64>;

    fn deref(&self) -> &Isometry3<f64> {
        &self.isometry
    }
}

impl<To, From> Clone for Pose<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<To, From> Copy for Pose<To, From> {}

impl<To, From> PartialEq for Pose<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.isometry == other.isometry
    }
}

impl<To, From> fmt::Debug for Pose<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Pose").field(&self.to_array()).finish()
    }
}
