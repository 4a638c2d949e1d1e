//! Why a motion cannot be written, or a file not be read.

/// Why a motion cannot be written, or a file not be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GlbError {
    /// There is nothing to show.
    #[error("the motion has no moment")]
    Empty,
    /// A moment is not after the one before it.
    #[error("moment {idx} at {time_s} s is not after the one before it")]
    Order {
        /// Its place, from 0.
        idx: usize,
        /// Its time.
        time_s: f64,
    },
    /// A moment has more or fewer joint positions than the robot has joints.
    #[error("moment {idx} has {found} joint positions, and the robot has {expected} joints")]
    Joints {
        /// Its place, from 0.
        idx: usize,
        /// Its joint positions.
        found: usize,
        /// The robot's joints.
        expected: usize,
    },
    /// A number is NaN or infinite.
    #[error("moment {idx} has a number that is not finite")]
    NotFinite {
        /// Its place, from 0.
        idx: usize,
    },
    /// A triangle of the object names a vertex that there is not.
    #[error("triangle {triangle} of the object names vertex {vertex} of {vertices_n}")]
    Vertex {
        /// The triangle, from 0.
        triangle: usize,
        /// The vertex, from 0.
        vertex: u32,
        /// The number of vertices.
        vertices_n: usize,
    },
    /// A file is larger than its format can say.
    #[error("the file would be larger than 4 GiB")]
    TooLarge,
    /// Bytes are not a file that this crate writes.
    #[error("the bytes are not a glTF animation as written here: {0}")]
    Malformed(String),
}
