//! Why a URDF cannot be used.

/// Why a URDF cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The text is not XML in the form of a URDF.
    #[error("the text is not a URDF")]
    NotUrdf {
        /// What the parser says.
        source: urdf_rs::UrdfError,
    },
    /// There is no link at all.
    #[error("the URDF has no link")]
    NoLink,
    /// Two links or two joints have one name.
    #[error("two {what}s are called `{name}`")]
    Duplicate {
        /// `link` or `joint`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A joint hangs on, or moves, a link that does not exist.
    #[error("joint `{joint}` names the {role} link `{link}`, which does not exist")]
    UnknownLink {
        /// The joint.
        joint: String,
        /// `parent` or `child`.
        role: &'static str,
        /// The name that no link has.
        link: String,
        /// Links spelled nearly so.
        near: Vec<String>,
    },
    /// A link is the child of two joints.
    #[error("link `{link}` is the child of two joints, `{first}` and `{second}`")]
    TwoParents {
        /// The link.
        link: String,
        /// One joint.
        first: String,
        /// The other joint.
        second: String,
    },
    /// More than one link has no parent.
    #[error("links `{first}` and `{second}` both have no parent: the links are not one tree")]
    TwoRoots {
        /// One of them.
        first: String,
        /// The other.
        second: String,
    },
    /// Joints lead from a link back to itself.
    #[error("the joints form a loop through link `{link}`")]
    Loop {
        /// A link on the loop or hanging on it.
        link: String,
    },
    /// A joint of a kind that a hand does not have.
    #[error("joint `{joint}` is {kind}, expected revolute, continuous, prismatic or fixed")]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its kind.
        kind: &'static str,
    },
    /// A joint's limits are missing, both zero, infinite or in the wrong order.
    #[error("joint `{joint}` has no usable limits: lower {lower}, upper {upper}")]
    BadLimits {
        /// The joint.
        joint: String,
        /// Lower limit as read; 0 where it is missing.
        lower: f64,
        /// Upper limit as read; 0 where it is missing.
        upper: f64,
    },
    /// A joint's axis has no direction.
    #[error("the axis of joint `{joint}` is zero")]
    ZeroAxis {
        /// The joint.
        joint: String,
    },
    /// A joint mimics one that does not exist, cannot move, or mimics it in turn.
    #[error("joint `{joint}` mimics `{master}`, which is not an independent movable joint")]
    BadMimic {
        /// The joint.
        joint: String,
        /// The joint it names.
        master: String,
    },
    /// A number is NaN, infinite, or negative where it cannot be.
    #[error("{what} of `{name}` is not a usable number")]
    BadNumber {
        /// Which number.
        what: &'static str,
        /// The link or joint.
        name: String,
    },
    /// A joint that was asked for does not exist.
    #[error("robot `{robot}` has no joint `{joint}`")]
    MissingJoint {
        /// The robot's name.
        robot: String,
        /// The name asked for.
        joint: String,
        /// Joints spelled nearly so.
        near: Vec<String>,
    },
    /// A link that was asked for does not exist.
    #[error("robot `{robot}` has no link `{link}`")]
    MissingLink {
        /// The robot's name.
        robot: String,
        /// The name asked for.
        link: String,
        /// Links spelled nearly so.
        near: Vec<String>,
    },
}

impl RobotError {
    /// Says what to do next, if that is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::NotUrdf { source } => {
                let text = source.to_string();
                text.contains("duplicate field").then(|| {
                    "an element that may stand once, such as `<inertial>`, stands twice in a link \
                     or joint: remove one"
                        .to_owned()
                })
            }
            Self::NoLink => Some("give the URDF's text after xacro has expanded it".to_owned()),
            Self::UnknownLink { near, .. }
            | Self::MissingJoint { near, .. }
            | Self::MissingLink { near, .. } => did_you_mean(near),
            Self::BadLimits { joint, .. } => Some(format!(
                "give joint `{joint}` a `<limit lower=… upper=…>` in radians, or make its type \
                 `continuous`"
            )),
            Self::UnsupportedJoint { .. } => Some(
                "describe the hand alone: its root moves freely without a joint that says so"
                    .to_owned(),
            ),
            Self::Duplicate { .. }
            | Self::TwoParents { .. }
            | Self::TwoRoots { .. }
            | Self::Loop { .. }
            | Self::ZeroAxis { .. }
            | Self::BadMimic { .. }
            | Self::BadNumber { .. } => None,
        }
    }
}

/// Phrases a question about near names; none if there are none.
fn did_you_mean(near: &[String]) -> Option<String> {
    let names: Vec<String> = near.iter().map(|name| format!("`{name}`")).collect();
    let (last, others) = names.split_last()?;
    Some(if others.is_empty() {
        format!("did you mean {last}?")
    } else {
        format!("did you mean {} or {last}?", others.join(", "))
    })
}

/// A joint position vector of the wrong length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{found} joint positions, expected {expected}")]
pub struct WrongDof {
    /// Number of the robot's joints.
    pub expected: usize,
    /// Number of positions given.
    pub found: usize,
}
