//! Slopes and curvatures of all terms on a body, about one point of space.

use nalgebra::{Matrix3, Vector3};

/// The first two derivatives of the cost by small motions of a body, about the root's origin.
///
/// A motion is a velocity `v` of the body at the root's origin and a turn `w`, so that a point at
/// `r` moves by `v + w × r`. Bodies' moments add up along the tree like composite rigid bodies'
/// inertias (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, §6.2).
/// The second derivative by two joints, one above the other, is the product of the upper one's
/// motion with [`Moments::curvature`] of the lower one's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moments {
    /// By `v` twice.
    linear: Matrix3<f64>,
    /// By `v` and `w`.
    mixed: Matrix3<f64>,
    /// By `w` twice, with the change of `w × r` itself: not symmetric, the left one is above.
    angular: Matrix3<f64>,
    /// By `v`.
    pub(crate) force: Vector3<f64>,
    /// By `w`.
    pub(crate) moment: Vector3<f64>,
}

/// A body's motion, its linear velocity at the root's origin and its angular one; or what resists it, a
/// force and its moment about that origin. Both are along the object's axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SpatialVector {
    pub(crate) linear: Vector3<f64>,
    pub(crate) angular: Vector3<f64>,
}

/// Which form of the Hessian is computed: whether second derivatives of points by joints count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HessianForm {
    /// They do: the exact second derivative, which may not be positive definite.
    Exact,
    /// They do not (Gauss-Newton), and losses count by parabolas above them.
    Convex,
}

impl Moments {
    /// Of nothing.
    pub(crate) const ZERO: Self = Self {
        linear: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        mixed: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        angular: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        force: Vector3::new(0.0, 0.0, 0.0),
        moment: Vector3::new(0.0, 0.0, 0.0),
    };

    /// Adds a term at a point `r` with this slope and these curvatures along the axes.
    #[inline]
    pub(crate) fn add_point(
        &mut self,
        r: &Vector3<f64>,
        slope: &Vector3<f64>,
        curvature: &Vector3<f64>,
        form: HessianForm,
    ) {
        let (x, y, z) = (r.x, r.y, r.z);
        let (a, b, c) = (curvature.x, curvature.y, curvature.z);
        self.linear[(0, 0)] += a;
        self.linear[(1, 1)] += b;
        self.linear[(2, 2)] += c;
        let (ay, az) = (a * y, a * z);
        let (bx, bz) = (b * x, b * z);
        let (cx, cy) = (c * x, c * y);
        self.mixed[(0, 1)] += az;
        self.mixed[(0, 2)] -= ay;
        self.mixed[(1, 0)] -= bz;
        self.mixed[(1, 2)] += bx;
        self.mixed[(2, 0)] += cy;
        self.mixed[(2, 1)] -= cx;
        let (xy, xz, yz) = (cx * y, bx * z, ay * z);
        self.angular[(0, 0)] += bz * z + cy * y;
        self.angular[(1, 1)] += az * z + cx * x;
        self.angular[(2, 2)] += ay * y + bx * x;
        self.angular[(0, 1)] -= xy;
        self.angular[(1, 0)] -= xy;
        self.angular[(0, 2)] -= xz;
        self.angular[(2, 0)] -= xz;
        self.angular[(1, 2)] -= yz;
        self.angular[(2, 1)] -= yz;
        self.add_slope(r, slope, form);
    }

    /// Adds a term at a point `r` with this slope, and with this curvature along its direction.
    pub(crate) fn add_line(
        &mut self,
        r: &Vector3<f64>,
        direction: &Vector3<f64>,
        slope: f64,
        curvature: f64,
        form: HessianForm,
    ) {
        let arm = r.cross(direction);
        self.linear += direction * direction.transpose() * curvature;
        self.mixed += direction * arm.transpose() * curvature;
        self.angular += arm * arm.transpose() * curvature;
        self.add_slope(r, &(direction * slope), form);
    }

    #[inline]
    fn add_slope(&mut self, r: &Vector3<f64>, slope: &Vector3<f64>, form: HessianForm) {
        self.force += slope;
        self.moment += r.cross(slope);
        if form == HessianForm::Exact {
            // u · (w × r)' = (u above) · (r slopeᵀ − (r · slope)) w.
            let dot = r.dot(slope);
            self.angular += r * slope.transpose();
            self.angular[(0, 0)] -= dot;
            self.angular[(1, 1)] -= dot;
            self.angular[(2, 2)] -= dot;
        }
    }

    /// Adds another body's.
    #[inline]
    pub(crate) fn add(&mut self, other: &Self) {
        self.linear += other.linear;
        self.mixed += other.mixed;
        self.angular += other.angular;
        self.force += other.force;
        self.moment += other.moment;
    }

    /// Returns the slope along a motion.
    #[inline]
    pub(crate) fn slope(&self, motion: &SpatialVector) -> f64 {
        self.force.dot(&motion.linear) + self.moment.dot(&motion.angular)
    }

    /// Returns the change of force and moment with a motion, as motions above it see it.
    #[inline]
    pub(crate) fn curvature(&self, motion: &SpatialVector, form: HessianForm) -> SpatialVector {
        let linear = self.linear * motion.linear + self.mixed * motion.angular;
        let mut angular = self.mixed.tr_mul(&motion.linear) + self.angular * motion.angular;
        if form == HessianForm::Exact {
            angular += motion.linear.cross(&self.force);
        }
        SpatialVector { linear, angular }
    }

    /// Returns the second derivative by the root's velocity and turn in place, `(6, 6)` in blocks:
    /// linear, mixed and angular, the last one made symmetric.
    pub(crate) fn root(&self) -> (&Matrix3<f64>, &Matrix3<f64>, Matrix3<f64>) {
        let angular = (self.angular + self.angular.transpose()) * 0.5;
        (&self.linear, &self.mixed, angular)
    }

    /// Returns the angular block as it is.
    pub(crate) fn angular(&self) -> &Matrix3<f64> {
        &self.angular
    }
}

impl SpatialVector {
    /// None.
    pub(crate) const ZERO: Self = Self {
        linear: Vector3::new(0.0, 0.0, 0.0),
        angular: Vector3::new(0.0, 0.0, 0.0),
    };

    /// Adds a force at a point.
    #[inline]
    pub(crate) fn add_force(&mut self, r: &Vector3<f64>, force: &Vector3<f64>) {
        self.linear += force;
        self.angular += r.cross(force);
    }

    /// Adds another one.
    #[inline]
    pub(crate) fn add(&mut self, other: &Self) {
        self.linear += other.linear;
        self.angular += other.angular;
    }

    /// Returns the power of a motion against this force and moment.
    #[inline]
    pub(crate) fn dot(&self, other: &Self) -> f64 {
        self.linear.dot(&other.linear) + self.angular.dot(&other.angular)
    }
}
