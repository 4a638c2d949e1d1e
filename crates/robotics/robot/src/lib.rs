//! Robots from their URDF: joints, kinematics and its derivatives, inverse kinematics of arms,
//! dynamics, collision shapes and their distances, fingers, and warnings about the description.
//!
//! ```
//! let urdf = r#"<robot name="finger">
//!   <link name="palm"/>
//!   <link name="finger"/>
//!   <joint name="knuckle" type="revolute">
//!     <origin xyz="0 0 0.05"/>
//!     <parent link="palm"/> <child link="finger"/>
//!     <axis xyz="0 1 0"/>
//!     <limit lower="0" upper="1.6" effort="0.7" velocity="7"/>
//!   </joint>
//! </robot>"#;
//! let model = robot::RobotModel::from_urdf(urdf)?;
//! let palm_from_links = model.forward_kinematics::<spatial::Palm>(&[1.2])?;
//! let finger = model.require_link("finger")?;
//! assert_eq!(palm_from_links[finger].translation.z, 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Links are ordered parents first, and link 0 is the root: a hand's palm or an arm's base, as the caller's
//! type parameter says. A [`Link`], a [`Shape`] or a [`Mesh`] is a frame of a [`spatial::Pose`], too: its own.
//! Joints are the independent movable ones, in the order in which a depth-first walk meets them:
//! address them by name. Joints that mimic others move with them and have no position of their own.
//! Lengths are in meters, angles in radians, masses in kilograms.
//! A root that moves freely has a pose and a twist ([`FreeRootState`]) and never angles; [`DynamicsModel`] computes
//! with or without it. Kinematics and dynamics agree with Pinocchio (`tests/golden`).
//! `urdf-rs` parses. By hand are one pass before it, since it has no limits against hostile texts, tells no
//! line of the file and refuses common slips such as a second `<inertial>`; checks after it of what it leaves
//! open, such as the tree, limits and mimic joints; and [`plain_urdf`], which keeps what no parser returns.
//! This crate opens no file: callers read the meshes that a URDF names and pass their convex parts
//! to [`RobotModel::with_mesh_shapes`]; until then a link whose collision geometry is a mesh has no
//! shape.

mod chain;
mod checks;
mod convex;
mod description;
mod distance;
mod dynamics;
mod dynamics_model;
mod error;
mod extent;
mod findings;
mod fingers;
mod forward;
mod free_root;
mod hand_collision;
mod hand_layout;
mod jacobian;
mod joint_order;
mod model;
mod near_names;
mod penetration;
mod self_collision;
mod shape_pairs;
pub mod spheres;
mod surface;
mod urdf;

pub use chain::{Chain, ChainRates, KinematicState};
pub use convex::ConvexBody;
pub use description::{canonical_model, canonical_urdf, plain_urdf};
pub use distance::{DistanceBounds, distance_bounds};
pub use dynamics::{Efforts, JointMotion};
pub use dynamics_model::DynamicsModel;
pub use error::{MimicFault, RobotError, WrongDof};
pub use findings::{Finding, Part, Severity};
pub use fingers::Finger;
pub use free_root::{FreeRootState, pose_from_twist};
pub use hand_collision::{Clearance, Depth, HandCollision, HandSphere, LinkDepth, Surroundings};
pub use hand_layout::HandLayout;
pub use joint_order::{JointMismatch, JointOrder};
pub use model::{Collision, Inertial, Joint, JointKind, Link, Mesh, RobotModel, Shape};
pub use near_names::near_names;
pub use self_collision::{SelfCollision, SelfGap, SelfGaps};
pub use shape_pairs::{HandShape, Kinship, ShapePair};
pub use surface::{SurfacePoint, surface_points};
pub use urdf::MAX_BYTES as MAX_URDF_BYTES;
