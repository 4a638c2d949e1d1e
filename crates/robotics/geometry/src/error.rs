//! Why a mesh could not be used.

use crate::{
    polygon::MAX_CONCAVE_CORNERS,
    size::{ThreeDigits, unit},
};

/// Why a mesh could not be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeometryError {
    /// A number in the text cannot be read or is not finite.
    #[error("line {line}: `{found}` is not a finite number")]
    NotANumber {
        /// The line, counted from one.
        line: usize,
        /// The text found.
        found: String,
    },
    /// A vertex line has fewer than three numbers.
    #[error("line {line}: a vertex needs three numbers, found {found}")]
    ShortVertex {
        /// The line, counted from one.
        line: usize,
        /// Number of numbers found.
        found: usize,
    },
    /// A face line has fewer than three corners.
    #[error("line {line}: a face needs three corners, found {found}")]
    ShortFace {
        /// The line, counted from one.
        line: usize,
        /// Number of corners found.
        found: usize,
    },
    /// A polygon has too many corners for one that is not convex.
    #[error(
        "line {line}: a face of {found} corners is not convex, at most {MAX_CONCAVE_CORNERS} are read"
    )]
    LargeFace {
        /// The line, counted from one.
        line: usize,
        /// Number of corners found.
        found: usize,
    },
    /// A face's corner is not an index.
    #[error("line {line}: `{found}` is not a vertex index")]
    NotAnIndex {
        /// The line, counted from one.
        line: usize,
        /// The text found.
        found: String,
    },
    /// A face names a vertex that does not exist before it in the file.
    #[error("line {line}: vertex {index} does not exist, the file has {vertices} up to here")]
    IndexOutOfRange {
        /// The line, counted from one.
        line: usize,
        /// The index as written.
        index: i64,
        /// Number of vertices before the line.
        vertices: usize,
    },
    /// A binary file is shorter than its beginning says.
    #[error("the file has {found} bytes, expected {expected}")]
    CutOff {
        /// Least number of bytes it should have.
        expected: usize,
        /// Number of bytes it has.
        found: usize,
    },
    /// A coordinate of a binary file is infinite or not a number.
    #[error("a coordinate is {found}")]
    NotFinite {
        /// The number.
        found: f64,
    },
    /// The file is a pointer of Git LFS.
    #[error("the file is a Git LFS pointer, not the mesh itself")]
    LfsPointer,
    /// The beginning of a PLY file cannot be read.
    #[error("line {line}: `{found}` is not understood in the header of a PLY file")]
    BadHeader {
        /// The line, counted from one.
        line: usize,
        /// The text found.
        found: String,
    },
    /// The lengths make no sense in meters.
    #[error(
        "it measures {} m, and its longest side must be {least_m} to {most_m} m{}",
        sides_m.map(|side| ThreeDigits(side).to_string()).join(" × "),
        factor.map_or("; meshes are in meters".to_owned(), |factor| {
            format!("; meshes are in meters, this one may be in {}: multiply its coordinates by {factor}", unit(factor))
        })
    )]
    Size {
        /// Its sides along the axes, in meters.
        sides_m: [f64; 3],
        /// Least length of the longest side, in meters.
        least_m: f64,
        /// Greatest length of the longest side, in meters.
        most_m: f64,
        /// The factor of a unit that would make it plausible.
        factor: Option<f64>,
    },
    /// There is no triangle with an area.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// The points have no hull with a volume: fewer than four, or all in a plane.
    #[error("{points} points have no convex hull with a volume")]
    NoHull {
        /// Number of points.
        points: usize,
    },
    /// The grid of a distance field would have too many nodes.
    #[error(
        "it measures {} m, too large for distances every {spacing_m} m; meshes are in meters, and \
         large objects need a coarser spacing",
        sides_m.map(|side| ThreeDigits(side).to_string()).join(" × ")
    )]
    LargeGrid {
        /// Its sides along the axes, in meters.
        sides_m: [f64; 3],
        /// Distance between neighboring nodes, in meters.
        spacing_m: f64,
    },
    /// A length of the grid of a distance field is not a positive number.
    #[error("spacing and margin of a distance field must be positive: {spacing_m} m, {margin_m} m")]
    BadGrid {
        /// Distance between neighboring nodes, in meters.
        spacing_m: f64,
        /// Room around the mesh's bounds, in meters.
        margin_m: f64,
    },
}

impl GeometryError {
    /// Returns what to do about it, where that is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::NotANumber { .. }
            | Self::ShortVertex { .. }
            | Self::ShortFace { .. }
            | Self::NotAnIndex { .. }
            | Self::IndexOutOfRange { .. }
            | Self::CutOff { .. }
            | Self::NotFinite { .. } => {
                Some("the file may be cut off: copy it from its source again".to_owned())
            }
            Self::LargeFace { .. } => Some("export the mesh as triangles".to_owned()),
            Self::LfsPointer => Some(
                "the repository was cloned without Git LFS: get the file with `git lfs pull`"
                    .to_owned(),
            ),
            Self::BadHeader { .. } => Some("export the mesh as binary PLY or as OBJ".to_owned()),
            Self::Size { factor, .. } => Some(match factor {
                Some(factor) => format!(
                    "lengths are in meters: is it in {}? Multiply its coordinates by {factor}",
                    unit(*factor)
                ),
                None => "lengths are in meters: export the mesh in meters".to_owned(),
            }),
            Self::NoTriangles => Some("export the mesh with its faces".to_owned()),
            Self::LargeGrid { .. } => Some(
                "the spacing must be about a hundredth of the object; is the mesh in meters?"
                    .to_owned(),
            ),
            Self::BadGrid { .. } | Self::NoHull { .. } => None,
        }
    }
}
