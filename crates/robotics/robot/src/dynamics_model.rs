//! The moving bodies of a robot: links that are fixed to each other, taken together.

use nalgebra::{Matrix3, Matrix6, Translation3, Unit, UnitQuaternion, Vector3, Vector6};
use spatial::{Palm, Pose, Twist};

use crate::{Inertial, JointKind, Link, RobotModel, WrongDof};

/// A robot's moving bodies with their masses, made ready for dynamics.
///
/// Links that are fixed to each other are one body, in the frame of the first of them; body 0
/// holds the root link. Links without mass weigh nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct DynamicsModel {
    pub(crate) all: Vec<Body>,
    pub(crate) dof: usize,
    /// Inertia of the motor's rotor as felt at each moving joint, in kg m² (kg if prismatic).
    pub(crate) armature: f64,
}

/// A body and the joint that moves it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Body {
    /// The body it hangs on, an earlier one; the root's is itself.
    pub(crate) parent: usize,
    /// `None` for the root alone.
    pub(crate) joint: Option<BodyJoint>,
    pub(crate) inertia: SpatialInertia,
}

impl Body {
    fn without_mass(parent: usize, joint: Option<BodyJoint>) -> Self {
        Self {
            parent,
            joint,
            inertia: SpatialInertia::zero(),
        }
    }
}

/// Joint between a body and its parent, at position `multiplier * q + offset`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BodyJoint {
    /// Index of the independent joint whose position is `q`.
    pub(crate) number: usize,
    pub(crate) multiplier: f64,
    offset: f64,
    is_turning: bool,
    parent_from_joint: Pose<Link, Link>,
    axis: Unit<Vector3<f64>>,
}

impl BodyJoint {
    /// Returns the body's pose in its parent's frame.
    fn parent_from_body(&self, q: &[f64]) -> Pose<Link, Link> {
        let position = self.multiplier * q[self.number] + self.offset;
        Pose::new(if self.is_turning {
            *self.parent_from_joint * UnitQuaternion::from_axis_angle(&self.axis, position)
        } else {
            *self.parent_from_joint * Translation3::from(self.axis.into_inner() * position)
        })
    }

    /// Returns the body's motion relative to its parent per unit of its own position, in its frame.
    pub(crate) fn unit_motion(&self) -> SpatialMotion {
        let axis = self.axis.into_inner();
        if self.is_turning {
            SpatialMotion::new(Vector3::zeros(), axis)
        } else {
            SpatialMotion::new(axis, Vector3::zeros())
        }
    }
}

/// A velocity or acceleration of a body, at the origin of its frame and along its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpatialMotion {
    pub(crate) linear: Vector3<f64>,
    pub(crate) angular: Vector3<f64>,
}

impl SpatialMotion {
    pub(crate) fn new(linear: Vector3<f64>, angular: Vector3<f64>) -> Self {
        Self { linear, angular }
    }

    pub(crate) fn zero() -> Self {
        Self::new(Vector3::zeros(), Vector3::zeros())
    }

    pub(crate) fn from_twist(twist: &Twist<Palm>) -> Self {
        Self::new(twist.linear, twist.angular)
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self::new(self.linear + other.linear, self.angular + other.angular)
    }

    pub(crate) fn times(self, factor: f64) -> Self {
        Self::new(self.linear * factor, self.angular * factor)
    }

    /// Returns the power of a force along this motion.
    pub(crate) fn dot(&self, on_body: &SpatialForce) -> f64 {
        self.linear.dot(&on_body.force) + self.angular.dot(&on_body.torque)
    }

    /// Returns this motion of the parent as one of the body whose pose in it is given.
    pub(crate) fn in_child(&self, parent_from_body: &Pose<Link, Link>) -> Self {
        let at_body = self.linear + self.angular.cross(&parent_from_body.translation.vector);
        let body_from_parent = parent_from_body.rotation.inverse();
        Self::new(body_from_parent * at_body, body_from_parent * self.angular)
    }

    /// Returns the rate of another motion that moves along with this one
    /// (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, equation 2.31).
    pub(crate) fn cross_motion(&self, other: &Self) -> Self {
        Self::new(
            self.angular.cross(&other.linear) + self.linear.cross(&other.angular),
            self.angular.cross(&other.angular),
        )
    }

    /// Returns the rate of a force that moves along with this motion (Featherstone 2008, 2.32).
    pub(crate) fn cross_force(&self, on_body: &SpatialForce) -> SpatialForce {
        SpatialForce::new(
            self.angular.cross(&on_body.force),
            self.angular.cross(&on_body.torque) + self.linear.cross(&on_body.force),
        )
    }
}

/// A force and torque on a body, or its momentum, at the origin of its frame and along its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpatialForce {
    pub(crate) force: Vector3<f64>,
    pub(crate) torque: Vector3<f64>,
}

impl SpatialForce {
    pub(crate) fn new(force: Vector3<f64>, torque: Vector3<f64>) -> Self {
        Self { force, torque }
    }

    pub(crate) fn zero() -> Self {
        Self::new(Vector3::zeros(), Vector3::zeros())
    }

    pub(crate) fn vector(&self) -> Vector6<f64> {
        let (f, n) = (self.force, self.torque);
        Vector6::new(f.x, f.y, f.z, n.x, n.y, n.z)
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self::new(self.force + other.force, self.torque + other.torque)
    }

    pub(crate) fn times(self, factor: f64) -> Self {
        Self::new(self.force * factor, self.torque * factor)
    }

    /// Returns this force on a body as one on the parent in which its pose is given.
    pub(crate) fn in_parent(&self, parent_from_body: &Pose<Link, Link>) -> Self {
        let force = parent_from_body.rotation * self.force;
        let torque = parent_from_body.rotation * self.torque;
        let arm = parent_from_body.translation.vector;
        Self::new(force, torque + arm.cross(&force))
    }
}

/// Mass, first moment of mass and inertia about the origin of a frame (Featherstone 2008, §2.13).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SpatialInertia {
    /// kg.
    pub(crate) mass: f64,
    /// Mass times center of mass, in kg m.
    pub(crate) moment: Vector3<f64>,
    /// About the origin, in kg m².
    pub(crate) inertia: Matrix3<f64>,
}

impl SpatialInertia {
    pub(crate) fn zero() -> Self {
        Self {
            mass: 0.0,
            moment: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        }
    }

    fn from_inertial(inertial: &Inertial) -> Self {
        let (mass, center) = (inertial.mass_kg, inertial.center_of_mass_m.coords);
        Self {
            mass,
            moment: center * mass,
            inertia: inertial.inertia_kg_m2 + parallel_axes(mass, &center),
        }
    }

    /// Returns whether there is mass, and inertia about every axis through its center.
    fn is_of_a_body(&self) -> bool {
        if self.mass <= 0.0 {
            return false;
        }
        let about_center = self.inertia - parallel_axes(self.mass, &(self.moment / self.mass));
        about_center.symmetric_eigenvalues().min() > 0.0
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.inertia += other.inertia;
    }

    /// Returns the same in the frame in which this one's pose is given.
    pub(crate) fn in_parent(&self, parent_from_this: &Pose<Link, Link>) -> Self {
        let rotation = parent_from_this.rotation.to_rotation_matrix();
        let r = rotation.matrix();
        let shift = parent_from_this.translation.vector;
        let moment = r * self.moment;
        let turned = r * self.inertia * r.transpose();
        // About the new origin: twice the mixed term of (c + s)², symmetric, and that of s².
        let mixed = Matrix3::identity() * (2.0 * moment.dot(&shift))
            - moment * shift.transpose()
            - shift * moment.transpose();
        Self {
            mass: self.mass,
            moment: moment + shift * self.mass,
            inertia: turned + mixed + parallel_axes(self.mass, &shift),
        }
    }

    /// Returns the momentum of this motion, or the force for this acceleration.
    pub(crate) fn times(&self, motion: &SpatialMotion) -> SpatialForce {
        SpatialForce::new(
            motion.linear * self.mass + motion.angular.cross(&self.moment),
            self.inertia * motion.angular + self.moment.cross(&motion.linear),
        )
    }

    /// Returns it as a matrix on motions, linear part first.
    pub(crate) fn matrix(&self) -> Matrix6<f64> {
        let moment = self.moment.cross_matrix();
        let mut matrix = Matrix6::zeros();
        matrix
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * self.mass));
        matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&-moment);
        matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&moment);
        // Turning tensors rounds: the matrix is symmetric to the last bit.
        let inertia = (self.inertia + self.inertia.transpose()) * 0.5;
        matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia);
        matrix
    }
}

/// Returns the inertia of a point mass about the origin.
fn parallel_axes(mass: f64, center: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * center.norm_squared() - center * center.transpose()) * mass
}

impl RobotModel {
    /// Returns the first link of each moving body that has no inertia about some axis, so that no
    /// force is needed to turn it. The root's body is left out.
    pub fn bodies_without_inertia(&self) -> Vec<usize> {
        let movable = (0..self.links().len()).filter(|&idx| self.links()[idx].kind.is_some());
        let bodies = DynamicsModel::new(self).all.into_iter().skip(1);
        movable
            .zip(bodies)
            .filter(|(_, body)| !body.inertia.is_of_a_body())
            .map(|(link, _)| link)
            .collect()
    }
}

impl DynamicsModel {
    /// Gathers a robot's links into its moving bodies.
    pub fn new(model: &RobotModel) -> Self {
        let links = model.links();
        let mut bodies: Vec<Body> = Vec::new();
        // For each link: its body, and its pose in that body.
        let mut places: Vec<(usize, Pose<Link, Link>)> = Vec::with_capacity(links.len());
        for link in links {
            let (parent, body_from_parent) = match link.parent {
                Some(parent) => places[parent],
                None => (0, Pose::identity()),
            };
            let parent_from_joint = body_from_parent * link.parent_from_joint;
            let place = if let (Some(kind), Some(number)) = (link.kind, link.joint) {
                let joint = BodyJoint {
                    number,
                    multiplier: link.multiplier,
                    offset: link.offset,
                    is_turning: kind != JointKind::Prismatic,
                    parent_from_joint,
                    axis: link.axis,
                };
                bodies.push(Body::without_mass(parent, Some(joint)));
                (bodies.len() - 1, Pose::identity())
            } else {
                if bodies.is_empty() {
                    bodies.push(Body::without_mass(0, None));
                }
                (parent, parent_from_joint)
            };
            if let Some(inertial) = &link.inertial {
                let (body, body_from_link) = &place;
                let inertia = SpatialInertia::from_inertial(inertial).in_parent(body_from_link);
                bodies[*body].inertia.add(&inertia);
            }
            places.push(place);
        }
        Self {
            all: bodies,
            dof: model.dof(),
            armature: 0.0,
        }
    }

    /// Gives every joint, those that mimic others too, a motor whose rotor is felt there as this
    /// inertia, in kg m² (kg if prismatic); its gyroscopic effect is not part of the model
    /// (Featherstone, *Rigid Body Dynamics Algorithms*, 2008, §9.6).
    #[must_use]
    pub fn with_armature(self, armature: f64) -> Self {
        Self { armature, ..self }
    }

    /// Makes every mass, and so every inertia, this many times as great.
    #[must_use]
    pub fn with_mass_scale(mut self, scale: f64) -> Self {
        for body in &mut self.all {
            let inertia = &mut body.inertia;
            inertia.mass *= scale;
            inertia.moment *= scale;
            inertia.inertia *= scale;
        }
        self
    }

    /// Returns the mass of all bodies in kilograms.
    pub fn mass_kg(&self) -> f64 {
        self.all.iter().map(|body| body.inertia.mass).sum()
    }

    /// Returns the mass of the root's body in kilograms.
    pub(crate) fn root_mass_kg(&self) -> f64 {
        self.all.first().map_or(0.0, |root| root.inertia.mass)
    }

    /// Returns the pose of each body in its parent's frame; the identity for the root.
    pub(crate) fn parent_from_bodies(&self, q: &[f64]) -> Result<Vec<Pose<Link, Link>>, WrongDof> {
        self.check(q)?;
        let pose = |body: &Body| match &body.joint {
            Some(joint) => joint.parent_from_body(q),
            None => Pose::identity(),
        };
        Ok(self.all.iter().map(pose).collect())
    }

    /// Checks that there is one number per independent joint.
    pub(crate) fn check(&self, numbers: &[f64]) -> Result<(), WrongDof> {
        if numbers.len() == self.dof {
            Ok(())
        } else {
            Err(WrongDof {
                expected: self.dof,
                found: numbers.len(),
            })
        }
    }
}
