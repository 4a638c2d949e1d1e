//! A robot hand as a tree of links.

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::{RobotError, near::near_names, urdf};

/// A robot hand: links in a tree, moved by joints.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotModel {
    pub(crate) name: String,
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
}

/// A rigid body of the hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Its name in the URDF.
    pub name: String,
    /// Name of the joint that it hangs on, fixed and mimic joints included; `None` for the root.
    pub joint_name: Option<String>,
    /// The link it hangs on; `None` for the root alone.
    pub parent: Option<usize>,
    /// The joint position that moves it relative to its parent; `None` if it is fixed to it.
    pub joint: Option<usize>,
    /// How it moves relative to its parent; `None` if it is fixed to it.
    pub kind: Option<JointKind>,
    /// Its own position is `multiplier * q + offset`, with `q` that of [`Link::joint`]: 1 and 0
    /// unless it mimics another joint.
    pub multiplier: f64,
    /// See [`Link::multiplier`]; radians, or meters where prismatic.
    pub offset: f64,
    /// Pose of the joint's frame in the parent's frame; the link's frame where its position is 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Direction about or along which it moves, in the joint's frame (and its own).
    pub axis: Unit<Vector3<f64>>,
    /// Mass properties; `None` if the URDF gives none.
    pub inertial: Option<Inertial>,
    /// Collision primitives.
    pub collisions: Vec<Collision>,
}

/// Mass properties of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Inertial {
    /// Mass in kilograms.
    pub mass_kg: f64,
    /// Center of mass in the link's frame, in meters.
    pub center_of_mass_m: Point3<f64>,
    /// Inertia about the center of mass along the link's axes, in kg m².
    pub inertia_kg_m2: Matrix3<f64>,
}

/// A collision primitive of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Collision {
    /// Pose of the shape's center in the link's frame.
    pub link_from_shape: Isometry3<f64>,
    /// The shape about its center.
    pub shape: Shape,
}

/// A primitive about its own center.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A box along the axes.
    Box {
        /// Half of each side, in meters.
        half_extents_m: Vector3<f64>,
    },
    /// A ball.
    Sphere {
        /// Radius in meters.
        radius_m: f64,
    },
    /// A cylinder along z.
    Cylinder {
        /// Radius in meters.
        radius_m: f64,
        /// Half of its length, in meters.
        half_length_m: f64,
    },
    /// A cylinder along z with a half ball on each end.
    Capsule {
        /// Radius in meters.
        radius_m: f64,
        /// Half of the cylinder's length without the ends, in meters.
        half_length_m: f64,
    },
}

/// An independent joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name in the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// The link it moves.
    pub link: usize,
    /// Least position, in radians (meters if prismatic); −∞ if continuous.
    pub lower: f64,
    /// Greatest position, in radians (meters if prismatic); ∞ if continuous.
    pub upper: f64,
    /// Largest torque in Nm (force in N if prismatic), as the URDF says: 0 means that it does not.
    pub effort: f64,
    /// Largest speed in rad/s (m/s if prismatic), as the URDF says.
    pub velocity: f64,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// About its axis, between limits.
    Revolute,
    /// About its axis, without limits.
    Continuous,
    /// Along its axis, between limits.
    Prismatic,
}

impl RobotModel {
    /// Reads a robot from the text of its URDF.
    ///
    /// # Errors
    ///
    /// Fails if the text is not a URDF, its links are not one tree, a number is not finite, or a
    /// joint lacks limits.
    pub fn from_urdf(xml: &str) -> Result<Self, RobotError> {
        urdf::parse(xml)
    }

    /// Returns the robot's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the links, parents before children; the first one is the root, the palm.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// Returns the independent movable joints, in the order of every joint position vector.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Returns the number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Returns the joints' names, in the order of every joint position vector.
    pub fn joint_names(&self) -> Vec<String> {
        self.joints.iter().map(|joint| joint.name.clone()).collect()
    }

    /// Returns the index of the link of this name.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link.name == name)
    }

    /// Returns the index of the joint of this name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Returns the index of the link of this name.
    ///
    /// # Errors
    ///
    /// Fails if there is no such link, naming those that are spelled nearly so.
    pub fn require_link(&self, name: &str) -> Result<usize, RobotError> {
        self.link(name).ok_or_else(|| RobotError::MissingLink {
            robot: self.name.clone(),
            link: name.to_owned(),
            near: near_names(name, self.links.iter().map(|link| link.name.as_str())),
        })
    }

    /// Returns the indices of the joints of these names, in their order.
    ///
    /// # Errors
    ///
    /// Fails at the first name that no joint has, naming those that are spelled nearly so.
    pub fn require_joints(&self, names: &[impl AsRef<str>]) -> Result<Vec<usize>, RobotError> {
        names
            .iter()
            .map(AsRef::as_ref)
            .map(|name| {
                self.joint(name).ok_or_else(|| RobotError::MissingJoint {
                    robot: self.name.clone(),
                    joint: name.to_owned(),
                    near: near_names(name, self.joints.iter().map(|joint| joint.name.as_str())),
                })
            })
            .collect()
    }

    /// Returns the joint positions halfway between the limits, 0 for continuous joints.
    pub fn mid_range(&self) -> Vec<f64> {
        self.joints
            .iter()
            .map(|joint| match joint.kind {
                JointKind::Continuous => 0.0,
                JointKind::Revolute | JointKind::Prismatic => 0.5 * (joint.lower + joint.upper),
            })
            .collect()
    }
}
