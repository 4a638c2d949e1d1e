//! A robot: links in a tree, moved by joints.

use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Translation3, Unit, Vector3};
use spatial::Pose;

use crate::{ConvexBody, Finding, RobotError, near_names::near_names, urdf};

/// A robot: links in a tree, moved by joints.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotModel {
    pub(crate) name: String,
    pub(crate) links: Vec<Link>,
    pub(crate) joints: Vec<Joint>,
    /// Assumptions and omissions made while reading.
    pub(crate) findings: Vec<Finding>,
    /// Whether its links have the shapes of the meshes that they collide with.
    pub(crate) has_mesh_shapes: bool,
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
    /// Kind of its motion relative to its parent; `None` if it is fixed to it.
    pub kind: Option<JointKind>,
    /// Its own position is `multiplier * q + offset`, with `q` that of [`Link::joint`]: 1 and 0
    /// unless it mimics another joint.
    pub multiplier: f64,
    /// See [`Link::multiplier`]; radians, or meters where prismatic.
    pub offset: f64,
    /// Pose of the joint's frame in the parent's frame; the link's frame where its position is 0.
    pub parent_from_joint: Pose<Self, Self>,
    /// Direction about or along which it moves, in the joint's frame (and its own).
    pub axis: Unit<Vector3<f64>>,
    /// Mass properties; `None` if the URDF gives none, or no mass.
    pub inertial: Option<Inertial>,
    /// Its collision shapes: primitives, and convex bodies where
    /// [`RobotModel::with_mesh_shapes`] made them of its meshes.
    pub collisions: Vec<Collision>,
    /// Meshes that it names.
    pub meshes: Vec<Mesh>,
}

/// A mesh that a link names.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// The file as the URDF names it, e.g. `package://hand/meshes/palm.stl`.
    pub file: String,
    /// Whether it is a collision mesh rather than a visual one.
    pub is_collision: bool,
    /// Pose of the mesh's frame in the link's frame.
    pub link_from_mesh: Pose<Link, Self>,
    /// Factors on the file's numbers along its axes, by which they are meters.
    pub scale: Vector3<f64>,
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

/// A shape that a link collides with.
#[derive(Debug, Clone, PartialEq)]
pub struct Collision {
    /// Pose of the shape's center in the link's frame.
    pub link_from_shape: Pose<Link, Shape>,
    /// The shape about its center.
    pub shape: Shape,
}

/// A convex shape about its own center.
#[derive(Debug, Clone, PartialEq)]
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
    /// A body, or part of a mesh: its center is the middle of the box about it.
    Convex(Arc<ConvexBody>),
}

/// An independent joint.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Its name in the URDF.
    pub name: String,
    /// Kind of its motion.
    pub kind: JointKind,
    /// The link it moves.
    pub link: usize,
    /// Least position, in radians (meters if prismatic); −∞ if continuous. Joints that follow this
    /// one are inside their own limits, too, as long as it is inside these.
    pub lower: f64,
    /// Greatest position, in radians (meters if prismatic); ∞ if continuous. Equal to
    /// [`Joint::lower`] where the joint is locked.
    pub upper: f64,
    /// Largest torque in Nm (force in N if prismatic), as the URDF says: 0 means that it does not.
    pub effort: f64,
    /// Largest speed in rad/s (m/s if prismatic), as the URDF says.
    pub velocity: f64,
}

impl Joint {
    /// Returns the position halfway between the limits, 0 if it is continuous.
    pub fn middle(&self) -> f64 {
        match self.kind {
            JointKind::Continuous => 0.0,
            JointKind::Revolute | JointKind::Prismatic => 0.5 * (self.lower + self.upper),
        }
    }

    /// Returns the position within the limits that is nearest to a position.
    pub fn clamp(&self, q: f64) -> f64 {
        q.max(self.lower).min(self.upper)
    }

    /// Returns the position within the limits that is nearest to 0.
    pub fn nearest_zero(&self) -> f64 {
        self.clamp(0.0)
    }
}

/// Kind of a joint's motion.
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
    /// What can be understood in one way only is read, whatever the order of links and joints:
    /// links without mass or shape weigh and touch nothing, the first of several `<inertial>`
    /// elements counts, a revolute joint without limits turns without end, one whose limits are
    /// equal is locked, and meshes are named but not opened: see [`RobotModel::with_mesh_shapes`].
    /// [`RobotModel::findings`] lists the assumptions.
    ///
    /// # Errors
    ///
    /// Fails if the text is not XML or not a URDF, has a document type declaration, still needs
    /// xacro, or is too large; if its links are not one tree; if a number is none, not finite or
    /// beyond 10⁹; and if a joint's limits are swapped, missing where it is prismatic, or it mimics
    /// a joint that cannot be followed.
    pub fn from_urdf(xml: &str) -> Result<Self, RobotError> {
        urdf::parse(xml)
    }

    /// Reads a robot as [`RobotModel::from_urdf`] does, with every joint independent: what its URDF says of joints that
    /// mimic others is passed over.
    ///
    /// # Errors
    ///
    /// Fails as that does.
    pub fn from_urdf_without_mimics(xml: &str) -> Result<Self, RobotError> {
        urdf::read_robot(xml, urdf::Mimics::Independent)
    }

    /// Reads a robot from the bytes of its URDF, as [`RobotModel::from_urdf`].
    ///
    /// # Errors
    ///
    /// Fails as that does, and if the bytes are not UTF-8.
    pub fn from_urdf_bytes(bytes: &[u8]) -> Result<Self, RobotError> {
        let xml = std::str::from_utf8(bytes).map_err(|source| RobotError::NotText {
            encoding: urdf::encoding(bytes),
            source,
        })?;
        urdf::parse(xml)
    }

    /// Gives each link the shapes of the meshes that it collides with; `parts` returns, for the name
    /// of a link and a mesh of its, convex bodies in meters in the mesh's frame, [`Mesh::scale`]
    /// applied.
    ///
    /// # Errors
    ///
    /// Fails as `parts` does.
    pub fn with_mesh_shapes<E>(
        mut self,
        mut parts: impl FnMut(&str, &Mesh) -> Result<Vec<ConvexBody>, E>,
    ) -> Result<Self, E> {
        if self.has_mesh_shapes {
            return Ok(self);
        }
        for link in &mut self.links {
            for mesh in link.meshes.iter().filter(|mesh| mesh.is_collision) {
                for body in parts(&link.name, mesh)? {
                    let middle = body.middle_m();
                    link.collisions.push(Collision {
                        link_from_shape: Pose::new(
                            *mesh.link_from_mesh * Translation3::from(middle),
                        ),
                        shape: Shape::Convex(Arc::new(body.moved(&-middle))),
                    });
                }
            }
        }
        self.has_mesh_shapes = true;
        Ok(self)
    }

    /// Returns the first link that collides with a mesh of which it has no shape yet, and the mesh:
    /// such a link would touch nothing.
    pub fn without_mesh_shape(&self) -> Option<(&Link, &Mesh)> {
        if self.has_mesh_shapes {
            return None;
        }
        self.links.iter().find_map(|link| {
            let mesh = link.meshes.iter().find(|mesh| mesh.is_collision)?;
            Some((link, mesh))
        })
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

    /// Returns the assumptions and omissions made while reading the URDF, in its order.
    pub fn findings(&self) -> &[Finding] {
        &self.findings
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
        self.joints.iter().map(Joint::middle).collect()
    }
}
