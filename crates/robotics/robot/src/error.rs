//! Errors of reading a URDF.

/// Reason why a URDF cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RobotError {
    /// The bytes are not UTF-8.
    #[error("the URDF is not UTF-8 from byte {} on", source.valid_up_to())]
    NotText {
        /// The encoding that the bytes begin with or declare, as `iconv` names it.
        encoding: String,
        /// The position of the first invalid byte.
        source: std::str::Utf8Error,
    },
    /// The text is not XML.
    #[error("line {line} of the URDF is not XML")]
    NotXml {
        /// The line, from 1.
        line: usize,
        /// The parser's error.
        source: quick_xml::Error,
    },
    /// The repaired text is refused by `urdf-rs`.
    #[error("`urdf-rs` refuses the URDF")]
    Refused {
        /// The parser's error; its place is one in the repaired text.
        source: Box<urdf_rs::UrdfError>,
    },
    /// The text ends inside of an element.
    #[error("the URDF ends before `<{name}>` of line {line} is closed")]
    Unclosed {
        /// The line, from 1.
        line: usize,
        /// The element.
        name: String,
    },
    /// The text has a document type declaration.
    #[error("line {line} of the URDF is a document type declaration, which is never read")]
    DocumentType {
        /// The line, from 1.
        line: usize,
    },
    /// The text has not one root element `<robot>`.
    #[error(
        "the text is not one `<robot>`{}",
        found
            .as_ref()
            .map(|found| format!(": `<{found}>` stands there"))
            .unwrap_or_default()
    )]
    NoRobot {
        /// The element found instead of it or beside it, if there is one.
        found: Option<String>,
    },
    /// There are far more parts of a kind than a robot has.
    #[error("the URDF has more than {limit} {what}")]
    TooLarge {
        /// The kind of part.
        what: &'static str,
        /// The maximum number.
        limit: usize,
    },
    /// The text is a template from which `xacro` makes a URDF.
    #[error("`<{element}>` on line {line} is an instruction for xacro")]
    Xacro {
        /// The element.
        element: String,
        /// Its line, from 1.
        line: usize,
    },
    /// An attribute has an expression that `xacro` fills in.
    #[error("`{attribute}` of `<{element}>` on line {line} is `{text}`, which xacro fills in")]
    XacroValue {
        /// The element.
        element: String,
        /// The attribute.
        attribute: String,
        /// Its value.
        text: String,
        /// The element's line, from 1.
        line: usize,
    },
    /// An attribute that cannot be left out is not there.
    #[error("`<{element}>` on line {line} has no `{attribute}`")]
    MissingAttribute {
        /// The element.
        element: String,
        /// The attribute.
        attribute: &'static str,
        /// The element's line, from 1.
        line: usize,
    },
    /// A joint lacks its parent or its child.
    #[error("joint `{joint}` on line {line} has no `<{role} link=…>`")]
    Unlinked {
        /// The joint.
        joint: String,
        /// `parent` or `child`.
        role: &'static str,
        /// The joint's line, from 1.
        line: usize,
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
    #[error(
        "joint `{joint}` on line {line} is `{kind}`, expected revolute, continuous, prismatic or \
         fixed"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its kind.
        kind: String,
        /// Its line, from 1.
        line: usize,
    },
    /// A joint's limits are in the wrong order.
    #[error("the limits of joint `{joint}` are swapped: lower {lower}, upper {upper}")]
    BadLimits {
        /// The joint.
        joint: String,
        /// Lower limit as read.
        lower: f64,
        /// Upper limit as read.
        upper: f64,
    },
    /// A prismatic joint has no limits.
    #[error("prismatic joint `{joint}` on line {line} has no limits")]
    NoLimits {
        /// The joint.
        joint: String,
        /// Its line, from 1.
        line: usize,
    },
    /// A joint's axis has no direction.
    #[error("the axis of joint `{joint}` is zero")]
    ZeroAxis {
        /// The joint.
        joint: String,
    },
    /// A joint mimics one that it cannot follow.
    #[error("joint `{joint}` mimics `{master}`, which {fault}")]
    BadMimic {
        /// The joint.
        joint: String,
        /// The joint it names, itself or through others.
        master: String,
        /// The reason why that one cannot be followed.
        fault: MimicFault,
    },
    /// A link weighs less than nothing.
    #[error("link `{link}` has a mass of {mass_kg} kg")]
    NegativeMass {
        /// The link.
        link: String,
        /// Its mass.
        mass_kg: f64,
    },
    /// A number is none, not finite, larger than any in a robot, or negative where it cannot be.
    #[error("`{attribute}` of `<{element}>` on line {line} is `{text}`, not a usable number")]
    BadNumber {
        /// The element.
        element: String,
        /// Its attribute.
        attribute: &'static str,
        /// The attribute's value.
        text: String,
        /// The element's line, from 1.
        line: usize,
    },
    /// An attribute does not hold three numbers.
    #[error("`{attribute}` of `<{element}>` on line {line} is `{text}`, not three usable numbers")]
    BadTriple {
        /// The element.
        element: String,
        /// Its attribute.
        attribute: &'static str,
        /// The attribute's value.
        text: String,
        /// The element's line, from 1.
        line: usize,
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
    /// A joint of an arm moves with another.
    #[error("joint `{joint}` on the path from the root to link `{link}` follows another joint")]
    FollowsOnChain {
        /// The joint.
        joint: String,
        /// The link to which the arm goes.
        link: String,
    },
}

/// Reason why a joint cannot be followed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum MimicFault {
    /// It does not exist.
    Unknown {
        /// Joints spelled nearly so.
        near: Vec<String>,
    },
    /// It cannot move.
    Fixed,
    /// It follows the joint in turn.
    Loop,
    /// Multipliers along the way make its position infinite.
    NotFinite,
}

impl std::fmt::Display for MimicFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Unknown { .. } => "does not exist",
            Self::Fixed => "is fixed",
            Self::Loop => "follows it in turn",
            Self::NotFinite => "overflows",
        })
    }
}

impl RobotError {
    /// Returns the advice for the user, if there is any.
    pub fn hint(&self) -> Option<String> {
        let hint = match self {
            Self::UnknownLink { near, .. }
            | Self::MissingJoint { near, .. }
            | Self::MissingLink { near, .. }
            | Self::BadMimic {
                fault: MimicFault::Unknown { near },
                ..
            } => return did_you_mean(near),
            Self::Xacro { .. } | Self::XacroValue { .. } => EXPAND,
            Self::NotText { encoding, .. } => {
                return Some(format!(
                    "convert it, e.g. `iconv -f {encoding} -t UTF-8 robot.urdf`, and declare UTF-8 in its first line; \
                     or give the URDF itself instead of a mesh or an archive"
                ));
            }
            Self::NoLink | Self::NoRobot { .. } => {
                "give a URDF: `<robot name=…>` with its links and joints; SDF and MJCF are not read"
            }
            Self::Refused { .. } => "remove control characters from its names and file names",
            Self::DocumentType { .. } => "remove `<!DOCTYPE …>` and write out what it declares",
            Self::TooLarge { .. } => "give one robot alone, with its meshes in files of their own",
            Self::BadLimits {
                joint,
                lower,
                upper,
            } => {
                return Some(format!(
                    "give joint `{joint}` `<limit lower=\"{upper}\" upper=\"{lower}\" …/>`, if that \
                     is what is meant"
                ));
            }
            Self::NoLimits { joint, .. } => {
                return Some(format!(
                    "give joint `{joint}` a `<limit lower=… upper=…/>` in meters"
                ));
            }
            Self::UnsupportedJoint { .. } => {
                "describe the robot alone: its root moves freely without a joint that says so"
            }
            Self::TwoRoots { first, second } => {
                return Some(format!(
                    "connect them by a joint, or remove the one that is not part of the robot: a \
                     joint whose child is `{first}` or `{second}` is missing"
                ));
            }
            Self::ZeroAxis { joint } => {
                return Some(format!(
                    "give joint `{joint}` an `<axis xyz=…/>` that is not zero"
                ));
            }
            Self::TwoParents { .. } | Self::Loop { .. } => {
                "a URDF is a tree: open a closed linkage, and let a joint follow another with \
                 `<mimic>`"
            }
            Self::FollowsOnChain { .. } => {
                "name the link that the arm carries; its own joints must move one by one"
            }
            Self::BadMimic { .. } => "let it follow a joint that moves and follows none itself",
            Self::Duplicate { .. }
            | Self::NotXml { .. }
            | Self::Unclosed { .. }
            | Self::MissingAttribute { .. }
            | Self::Unlinked { .. }
            | Self::NegativeMass { .. }
            | Self::BadTriple { .. }
            | Self::BadNumber { .. } => return None,
        };
        Some(hint.to_owned())
    }
}

/// Advice for a file that xacro has not expanded.
const EXPAND: &str = "expand it first: `xacro robot.urdf.xacro > robot.urdf`";

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
