//! A hand prepared for the solver: the moving bodies and the unknowns that move them.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};
use robot::{JointKind, Link, RobotModel};
use spatial::Pose;

use crate::{SolverError, layout::Layout, posture::Posture, vectors::have_places};

/// Motion of the root link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Root {
    /// Not at all.
    Fixed,
    /// Freely, turned by the exponential map at the present orientation: none is special.
    Free,
    /// Freely, turned by angles about x, the new y and the new z, as dex-retargeting's dummy joints
    /// do: near a quarter turn about y one direction is lost.
    Angles,
}

/// A robot hand prepared for the solver.
///
/// Links that are fixed to one another are one body. A body's frame has the joint's axis along z,
/// so that a joint turns two columns of its parent's orientation.
#[derive(Debug, Clone)]
pub struct CompiledHand {
    pub(crate) root: Root,
    /// The bodies, parents first. Body 0 is the root and has no joint.
    pub(crate) bodies: Vec<Body>,
    /// The points attached to bodies, as they were given.
    pub(crate) points: Vec<BodyPoint>,
    /// The points at the ends of each vector: where it begins, where it ends.
    pub(crate) vectors: Vec<[usize; 2]>,
    /// Places of the second derivatives by pairs of unknowns, `(unknown, unknown)`; empty without vectors.
    pub(crate) places: Vec<usize>,
    /// The place of each of the model's links.
    pub(crate) links: Vec<BodyLink>,
    /// Layout of the unknowns in the normal equations.
    pub(crate) layout: Layout,
    /// Limits in the order of the joints' unknowns.
    pub(crate) lower: Vec<f64>,
    pub(crate) upper: Vec<f64>,
}

/// A body that moves relative to its parent.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    pub(crate) parent: usize,
    /// Pose in the parent where its position is 0.
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
    pub(crate) is_prismatic: bool,
    /// The model's joint.
    pub(crate) joint: usize,
    /// Its own position is `multiplier * q + offset`.
    pub(crate) multiplier: f64,
    pub(crate) offset: f64,
}

/// A point fixed to a body, in the body's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyPoint {
    pub(crate) body: usize,
    pub(crate) offset: Vector3<f64>,
}

/// A link fixed to a body, by its pose in the body's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyLink {
    pub(crate) body: usize,
    pub(crate) rotation: Matrix3<f64>,
    pub(crate) translation: Vector3<f64>,
}

impl CompiledHand {
    /// Prepares a robot, with points given by their link and place in the link's frame (m). The
    /// points are named by their index from then on.
    ///
    /// # Errors
    ///
    /// Fails if a link does not exist, or if more joints depend on one another than the solver was
    /// made for.
    pub fn new(
        model: &RobotModel,
        root: Root,
        points: &[(usize, Point3<f64>)],
    ) -> Result<Self, SolverError> {
        Self::with_vectors(model, root, points, &[])
    }

    /// Prepares a robot as [`CompiledHand::new`] does, with vectors from one point to another, which are named by
    /// their index, too.
    ///
    /// # Errors
    ///
    /// Fails as that does, and if a vector's point does not exist.
    pub fn with_vectors(
        model: &RobotModel,
        root: Root,
        points: &[(usize, Point3<f64>)],
        vectors: &[[usize; 2]],
    ) -> Result<Self, SolverError> {
        let (bodies, links) = bodies(model);
        let points = points
            .iter()
            .map(|&(link, point_in_link)| {
                let &(body, body_from_link) =
                    links.get(link).ok_or(SolverError::NoLink { link })?;
                Ok(BodyPoint {
                    body,
                    offset: (body_from_link * point_in_link).coords,
                })
            })
            .collect::<Result<Vec<_>, SolverError>>()?;
        let found = points.len();
        if let Some(&point) = vectors.iter().flatten().find(|&&point| point >= found) {
            return Err(SolverError::NoPoint { point, found });
        }
        let mut layout = Layout::new(root, &bodies, &points, model.dof())?;
        if !have_places(&layout, &bodies, &points, vectors) {
            layout = Layout::coupled(root, &bodies, model.dof())?;
        }
        let limit = |pick: fn(&robot::Joint) -> f64| {
            let joints = layout.joints.iter();
            joints.map(|&j| pick(&model.joints()[j])).collect()
        };
        let links = links.iter().map(|&(body, body_from_link)| BodyLink {
            body,
            rotation: body_from_link.rotation.to_rotation_matrix().into_inner(),
            translation: body_from_link.translation.vector,
        });
        Ok(Self {
            root,
            points,
            vectors: vectors.to_vec(),
            places: if vectors.is_empty() {
                Vec::new()
            } else {
                layout.places()
            },
            links: links.collect(),
            lower: limit(|joint| joint.lower),
            upper: limit(|joint| joint.upper),
            layout,
            bodies,
        })
    }

    /// Returns the hand with other limits of its joints, in the model's order; a joint whose limits are equal is held.
    ///
    /// # Errors
    ///
    /// Fails if there are not as many, or a lower one is above its upper one.
    pub fn with_limits(mut self, limits: &[(f64, f64)]) -> Result<Self, SolverError> {
        if limits.len() != self.dof() {
            return Err(SolverError::WrongLength {
                what: "joint limits",
                found: limits.len(),
                expected: self.dof(),
            });
        }
        for (slot, &joint) in self.layout.joints.iter().enumerate() {
            let (lower, upper) = limits[joint];
            if !(lower <= upper && lower < f64::INFINITY && upper > f64::NEG_INFINITY) {
                return Err(SolverError::BadNumber {
                    what: format!("a limit of joint {joint}"),
                });
            }
            (self.lower[slot], self.upper[slot]) = (lower, upper);
        }
        Ok(self)
    }

    /// Returns the number of unknowns: six of a root that moves, and one per joint.
    pub fn unknowns(&self) -> usize {
        self.layout.n
    }

    /// Returns the number of joints.
    pub fn dof(&self) -> usize {
        self.lower.len()
    }

    /// Returns the number of attached points.
    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// Returns a posture with every joint between its limits; a position that is not a number
    /// becomes the one nearest to 0.
    pub fn within_limits(&self, posture: &Posture) -> Posture {
        let mut inside = posture.clone();
        inside.q.resize(self.dof(), 0.0);
        for (slot, &joint) in self.layout.joints.iter().enumerate() {
            let q = inside.q[joint];
            let q = if q.is_finite() { q } else { 0.0 };
            inside.q[joint] = q.max(self.lower[slot]).min(self.upper[slot]);
        }
        inside
    }
}

/// A link's body, and its pose in it.
type LinkPlace = (usize, Pose<Body, Link>);

/// Returns the bodies of a robot, and each link's place.
fn bodies(model: &RobotModel) -> (Vec<Body>, Vec<LinkPlace>) {
    let mut bodies = vec![Body {
        parent: 0,
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
        is_prismatic: false,
        joint: usize::MAX,
        multiplier: 0.0,
        offset: 0.0,
    }];
    let mut links: Vec<LinkPlace> = Vec::with_capacity(model.links().len());
    for link in model.links() {
        let above = link.parent.and_then(|parent| links.get(parent)).copied();
        let (parent, body_from_parent) = above.unwrap_or((0, Pose::identity()));
        let body_from_joint = body_from_parent * link.parent_from_joint;
        let (Some(kind), Some(joint)) = (link.kind, link.joint) else {
            links.push((parent, body_from_joint));
            continue;
        };
        // Any turn that takes z to the axis does; about x where they are opposite.
        let z_to_axis = UnitQuaternion::rotation_between_axis(&Vector3::z_axis(), &link.axis)
            .unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
            });
        let parent_from_body = *body_from_joint * z_to_axis;
        links.push((
            bodies.len(),
            Pose::from_parts(Vector3::zeros(), z_to_axis.inverse()),
        ));
        bodies.push(Body {
            parent,
            rotation: parent_from_body.rotation.to_rotation_matrix().into_inner(),
            translation: parent_from_body.translation.vector,
            is_prismatic: kind == JointKind::Prismatic,
            joint,
            multiplier: link.multiplier,
            offset: link.offset,
        });
    }
    (bodies, links)
}
