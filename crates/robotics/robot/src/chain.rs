//! The joints from the root to one link: an arm, and how its end moves with them.

mod ik_solutions;
mod inverse_kinematics;

use nalgebra::{Cholesky, Const, Matrix6, Matrix6xX, Point3, Vector3, Vector6};
use spatial::{Base, Palm, Pose, Twist};

use crate::{Joint, Link, RobotError, RobotModel, WrongDof};

/// Rows of a twist.
const SIX: usize = 6;

/// The joints from a robot's root, its base, to one of its links, in that order; the link is the
/// chain's end: the palm of the hand that an arm carries.
///
/// Positions of its joints are in radians (meters if prismatic).
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// The links from the root to the end and the joints that move them, nothing else.
    links: RobotModel,
    /// Indices of those joints among the robot's.
    joints: Vec<usize>,
}

/// Kinematics of a chain at certain joint positions.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicState {
    /// Pose of the chain's end in the base's frame.
    pub base_from_palm: Pose<Base, Palm>,
    /// The geometric Jacobian, `(6, dof)`: velocity of the end's origin in meters, then its angular
    /// velocity in radians, per radian (or per meter), along the base's axes.
    pub jacobian: Matrix6xX<f64>,
}

/// Velocities and accelerations of a chain's joints.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainRates {
    /// First derivatives of the joint positions.
    pub velocity: Vec<f64>,
    /// Second derivatives.
    pub acceleration: Vec<f64>,
}

impl Chain {
    /// Returns the chain from a robot's root to the link of this name.
    ///
    /// # Errors
    ///
    /// Fails if there is no such link, and if a joint on the path to it follows another by `<mimic>`.
    pub fn to_link(robot: &RobotModel, name: &str) -> Result<Self, RobotError> {
        let mut path = Vec::new();
        let mut next = Some(robot.require_link(name)?);
        while let Some((idx, link)) = next.and_then(|idx| Some((idx, robot.links.get(idx)?))) {
            path.push((idx, link));
            next = link.parent;
        }
        let mut links = Vec::with_capacity(path.len());
        let mut joints = Vec::new();
        let mut moved: Vec<Joint> = Vec::new();
        for (place, (idx, link)) in path.into_iter().rev().enumerate() {
            let mut number = None;
            if let Some((joint, own)) = link.joint.and_then(|j| Some((j, robot.joints.get(j)?))) {
                if own.link != idx {
                    return Err(RobotError::FollowsOnChain {
                        joint: link.joint_name.clone().unwrap_or_default(),
                        link: name.to_owned(),
                    });
                }
                number = Some(moved.len());
                joints.push(joint);
                moved.push(Joint {
                    link: place,
                    ..own.clone()
                });
            }
            links.push(Link {
                parent: place.checked_sub(1),
                joint: number,
                inertial: None,
                collisions: Vec::new(),
                meshes: Vec::new(),
                ..link.clone()
            });
        }
        let links = RobotModel {
            name: robot.name.clone(),
            links,
            joints: moved,
            findings: Vec::new(),
            has_mesh_shapes: true,
        };
        Ok(Self { links, joints })
    }

    /// Returns the indices of the robot's joints on the chain, from the root to the end.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// Returns the number of its joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Returns the chain as a robot of its own: its links without masses and shapes, and its joints in
    /// the order of its positions.
    pub fn model(&self) -> &RobotModel {
        &self.links
    }

    /// Returns pose and Jacobian of the chain's end.
    ///
    /// # Errors
    ///
    /// Fails if `q` does not hold exactly one position per joint of the chain.
    pub fn state(&self, q: &[f64]) -> Result<KinematicState, WrongDof> {
        let poses = self.links.forward_kinematics::<Base>(q)?;
        // A chain has one link at least: its end.
        let end = poses.len() - 1;
        let base_from_palm = poses[end].reinterpret::<Base, Palm>();
        let origin = Point3::from(base_from_palm.translation.vector);
        Ok(KinematicState {
            base_from_palm,
            jacobian: self.links.geometric_jacobian(&poses, end, &origin),
        })
    }
}

impl KinematicState {
    /// Returns the twist of the end at these joint velocities.
    ///
    /// # Panics
    ///
    /// Panics if there is not one velocity per joint.
    pub fn twist(&self, velocity: &[f64]) -> Twist<Base> {
        assert_eq!(velocity.len(), self.jacobian.ncols(), "joint velocities");
        let mut twist = Vector6::zeros();
        for (column, &velocity) in self.jacobian.column_iter().zip(velocity) {
            twist.axpy(velocity, &column, 1.0);
        }
        Twist::from_array(twist.into())
    }

    /// Returns the rate of the end's twist while the joints move at constant velocities,
    /// `J′ q′`, in m/s² and rad/s².
    ///
    /// A joint that turns carries along all that is beyond it, so that joint j changes the column
    /// of a later joint i by `ωⱼ × (vᵢ, ωᵢ)`, and that of an earlier one by `(ωᵢ × vⱼ, 0)` (Bruyninckx
    /// and De Schutter, *Symbolic Differentiation of the Velocity Mapping for a Serial Kinematic
    /// Chain*, 1996).
    ///
    /// # Panics
    ///
    /// Panics if there is not one velocity per joint.
    pub fn bias_acceleration(&self, velocity: &[f64]) -> Twist<Base> {
        assert_eq!(velocity.len(), self.jacobian.ncols(), "joint velocities");
        let mut bias_acceleration = Twist::zero();
        let mut spin: Vector3<f64> = Vector3::zeros();
        for (column, &velocity) in self.jacobian.column_iter().zip(velocity) {
            let linear = column.fixed_rows::<3>(0) * velocity;
            let angular = column.fixed_rows::<3>(3) * velocity;
            let before = spin;
            spin += angular;
            bias_acceleration.linear += (before + spin).cross(&linear);
            bias_acceleration.angular += before.cross(&angular);
        }
        bias_acceleration
    }

    /// Returns the joint velocities and accelerations with which the end has a twist and a rate of
    /// it: `J q′ = twist` and `J q″ = rate − J′ q′`, the least ones where more than six joints leave
    /// a choice; `None` where the chain is singular.
    pub fn rates(&self, twist: &Twist<Base>, rate: &Twist<Base>) -> Option<ChainRates> {
        let square = self.square(0.0)?;
        let velocity = self.least(&square, twist);
        let acceleration = self.least(&square, &(*rate - self.bias_acceleration(&velocity)));
        let all = velocity.iter().chain(&acceleration);
        all.copied().all(f64::is_finite).then_some(ChainRates {
            velocity,
            acceleration,
        })
    }

    /// Returns the smallest singular value of the Jacobian, meters and radians taken as they are: the
    /// least speed of the end that joints can make together at 1 rad/s, in the direction in which they
    /// make it worst; 0 where a direction is lost (Lynch and Park, *Modern Robotics*, 2017, §5.3–5.4).
    pub fn min_singular_value(&self) -> f64 {
        if self.jacobian.ncols() < SIX {
            return 0.0;
        }
        self.jacobian.clone().singular_values().min()
    }

    /// Whether [`KinematicState::min_singular_value`] is at least this; far from a singularity it costs
    /// a tenth of that.
    pub fn is_regular(&self, least: f64) -> bool {
        // The sum of σ⁻² is at least that of the least σ.
        let surely = self
            .square(0.0)
            .is_some_and(|square| square.inverse().trace() * least * least <= 1.0);
        surely || self.min_singular_value() >= least
    }

    /// Decomposes `J Jᵀ + damping`; `None` if that is singular.
    fn square(&self, damping: f64) -> Option<Cholesky<f64, Const<SIX>>> {
        let mut square: Matrix6<f64> = Matrix6::identity() * damping;
        for column in self.jacobian.column_iter() {
            square.ger(1.0, &column, &column, 1.0);
        }
        square.cholesky()
    }

    /// Returns the least joint velocities with this twist, `Jᵀ (J Jᵀ)⁻¹ twist`, refined once by the
    /// residual from rounding.
    fn least(&self, square: &Cholesky<f64, Const<SIX>>, twist: &Twist<Base>) -> Vec<f64> {
        let solve =
            |twist: Twist<Base>| self.transposed(&square.solve(&Vector6::from(twist.to_array())));
        let mut velocity = solve(*twist);
        let more = solve(*twist - self.twist(&velocity));
        for (velocity, more) in velocity.iter_mut().zip(more) {
            *velocity += more;
        }
        velocity
    }

    /// Returns `Jᵀ wrench`.
    fn transposed(&self, wrench: &Vector6<f64>) -> Vec<f64> {
        let columns = self.jacobian.column_iter();
        columns.map(|column| column.dot(wrench)).collect()
    }
}
