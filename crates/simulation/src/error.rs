//! Why a scene cannot be simulated.

/// Why a scene cannot be simulated at all; a motion that fails is a verdict, not an error.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// The object cannot fall: its mass is zero, negative or not a number.
    #[error("object has a mass of {mass_kg} kg, expected more than 0")]
    Massless {
        /// The mass found.
        mass_kg: f64,
    },
    /// The object's inertia belongs to no body.
    #[error("object has no physical inertia: principal moments {moments:?} kg m²")]
    ObjectInertia {
        /// The principal moments found.
        moments: [f64; 3],
    },
    /// A convex part has no volume.
    #[error("convex part {part} of the object has {points} points and no volume")]
    FlatPart {
        /// Number of the part, from 0.
        part: usize,
        /// Number of its points.
        points: usize,
    },
    /// The object has no shape.
    #[error("object has no convex parts")]
    NoParts,
    /// A moving link of the hand has no mass or no inertia.
    #[error("link `{link}` of the hand has no inertia in its URDF")]
    NoInertia {
        /// The link's name.
        link: String,
    },
    /// The hand has nothing to touch with.
    #[error("the hand has no collision shapes in its URDF")]
    NoCollisions,
    /// A joint is named that the hand does not have.
    #[error("the hand has no joint `{name}`")]
    UnknownJoint {
        /// The name asked for.
        name: String,
        /// The names that it has.
        known: Vec<String>,
    },
    /// A motion does not fit the hand, or its numbers are not numbers.
    #[error("motion cannot be followed: {0}")]
    Motion(String),
    /// A setting makes no sense.
    #[error("`{key}` is {value}, expected {expected}")]
    Setting {
        /// The setting's name.
        key: &'static str,
        /// The value found.
        value: f64,
        /// What is accepted.
        expected: &'static str,
    },
    /// The object alone on the table went out of bounds.
    #[error("object does not come to rest on the table: it left it or its numbers overflowed")]
    Unsettled,
}

impl SimulationError {
    /// Returns what to do about it, where that is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Massless { .. } => Some("give the object its true mass in kilograms".to_owned()),
            Self::ObjectInertia { .. } | Self::FlatPart { .. } | Self::NoParts => Some(
                "check that the object's mesh is closed and wound outward, then ingest it again"
                    .to_owned(),
            ),
            Self::NoInertia { link } => Some(format!(
                "add `<inertial>` with mass and inertia to `<link name=\"{link}\">`"
            )),
            Self::NoCollisions => {
                Some("add `<collision>` with primitive shapes to the links".to_owned())
            }
            Self::UnknownJoint { known, .. } => {
                Some(format!("its joints are {}", known.join(", ")))
            }
            Self::Motion(_) | Self::Setting { .. } | Self::Unsettled => None,
        }
    }
}
