//! What is to be followed.

use crate::LANDMARKS;

/// What is to be followed, with what.
#[derive(Debug, Clone, PartialEq)]
pub struct Objective {
    /// Its type.
    pub kind: ObjectiveKind,
    /// Distance up to which the loss is a parabola, in meters.
    pub huber_delta_m: f64,
    /// Factor of the squared motion of all coordinates, in m/rad² (1/m where they are meters).
    pub normal_delta: f64,
}

/// The three types of objectives.
#[derive(Debug, Clone, PartialEq)]
pub enum ObjectiveKind {
    /// Origins of links follow landmarks.
    Position {
        /// Each link, and the landmark that it follows.
        links: Vec<(String, usize)>,
    },
    /// Vectors between origins of links follow those between landmarks.
    Vector {
        /// The vectors.
        vectors: Vec<LinkVector>,
        /// Size of the robot hand relative to the person's.
        scale: f64,
    },
    /// Vectors between fingertips, then from the wrist to each; a pinch is closed.
    DexPilot {
        /// The vectors: first those from each later finger to each earlier one, then those from the wrist.
        vectors: Vec<LinkVector>,
        /// Number of fingers, the thumb's first.
        fingers: usize,
        /// Size of the robot hand relative to the person's.
        scale: f64,
        /// Distance of two of the person's fingertips below which they pinch, in meters.
        project_distance_m: f64,
        /// Distance above which they no longer do, in meters.
        escape_distance_m: f64,
    },
}

/// A vector between origins of links that follows one between landmarks.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkVector {
    /// The links: where it begins, where it ends.
    pub links: [String; 2],
    /// The landmarks: where that which it follows begins, where it ends.
    pub landmarks: [usize; 2],
}

impl Objective {
    /// Returns the number of points or vectors that are followed.
    pub fn reference_count(&self) -> usize {
        match &self.kind {
            ObjectiveKind::Position { links } => links.len(),
            ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
                vectors.len()
            }
        }
    }

    /// Writes what landmarks (m) say is to be followed: points, or vectors at the person's size.
    pub fn references(&self, landmarks_m: &[[f64; 3]; LANDMARKS], references: &mut Vec<[f64; 3]>) {
        references.clear();
        match &self.kind {
            ObjectiveKind::Position { links } => {
                references.extend(links.iter().map(|&(_, landmark)| landmarks_m[landmark]));
            }
            ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
                references.extend(vectors.iter().map(|vector| {
                    let [from, to] = vector.landmarks.map(|landmark| landmarks_m[landmark]);
                    std::array::from_fn(|axis| to[axis] - from[axis])
                }));
            }
        }
    }

    /// Returns the landmark at the end of each point or vector that is followed.
    pub fn end_landmarks(&self) -> Vec<usize> {
        match &self.kind {
            ObjectiveKind::Position { links } => {
                links.iter().map(|&(_, landmark)| landmark).collect()
            }
            ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
                vectors.iter().map(|vector| vector.landmarks[1]).collect()
            }
        }
    }
}
