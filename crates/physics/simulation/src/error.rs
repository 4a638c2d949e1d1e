//! Why a scene cannot be simulated.

use options::OptionFault;

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
    /// Links of the hand move and have no mass or no inertia.
    #[error("moving links without inertia: {}", names(links))]
    NoInertia {
        /// The links' names.
        links: Vec<String>,
    },
    /// The hand has nothing to touch with.
    #[error("the hand has no collision shapes in its URDF")]
    NoCollisions,
    /// A link of the hand would touch nothing, because its mesh was not loaded.
    #[error("link `{link}` of the hand collides with `{file}`, whose mesh was not loaded")]
    MeshNotRead {
        /// The link's name.
        link: String,
        /// The mesh as the URDF names it.
        file: String,
    },
    /// A collision shape of the hand has no volume.
    #[error("link `{link}` of the hand has a collision shape without volume")]
    FlatLink {
        /// The link's name.
        link: String,
    },
    /// A joint is named that the hand does not have.
    #[error("`flexion_joints` names `{name}`, which is not an independent joint of the hand")]
    UnknownJoint {
        /// The name asked for.
        name: String,
        /// The names that it has.
        known: Vec<String>,
    },
    /// A motion does not fit the hand, or its numbers are not numbers.
    #[error("motion cannot be followed: {0}")]
    Motion(String),
    /// A setting is out of its bounds.
    #[error(transparent)]
    Setting(#[from] OptionFault),
    /// The object alone on the table went out of bounds.
    #[error("object does not come to rest: it left the table, or the simulation overflowed")]
    Unsettled,
}

/// Lists names, each in backticks.
fn names(links: &[String]) -> String {
    let names: Vec<String> = links.iter().map(|link| format!("`{link}`")).collect();
    names.join(", ")
}

impl SimulationError {
    /// Says whether the object is at fault, not the hand or a setting, with which every other object would fail too.
    pub fn is_of_object(&self) -> bool {
        matches!(
            self,
            Self::Massless { .. }
                | Self::ObjectInertia { .. }
                | Self::FlatPart { .. }
                | Self::NoParts
                | Self::Unsettled
        )
    }

    /// Returns what to do about it, where that is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Massless { .. } => Some("give the object its true mass in kilograms".to_owned()),
            Self::ObjectInertia { .. } | Self::FlatPart { .. } | Self::NoParts => Some(
                "check that the object's mesh is closed and wound outward, then ingest it again"
                    .to_owned(),
            ),
            Self::NoInertia { .. } => Some(
                "add `<inertial>` with mass and inertia to each of them, or to a link that is fixed \
                 to it; `pipeline doctor --robot URDF` lists what else is amiss"
                    .to_owned(),
            ),
            Self::NoCollisions => {
                Some("add `<collision>` with shapes or meshes to the links".to_owned())
            }
            Self::UnknownJoint { known, .. } => {
                Some(format!(
                    "its joints are {}; those that follow another are not named",
                    known.join(", ")
                ))
            }
            Self::MeshNotRead { .. } => Some(
                "read it with `robot_meshes::with_mesh_shapes` before the hand is simulated"
                    .to_owned(),
            ),
            Self::FlatLink { link } => Some(format!(
                "give `<link name=\"{link}\">` a thicker `<collision>`; lengths are in meters"
            )),
            Self::Motion(_) | Self::Setting(_) | Self::Unsettled => None,
        }
    }
}
