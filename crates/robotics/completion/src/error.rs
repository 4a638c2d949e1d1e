//! Why a shape could not be completed.

use depth_view::ViewError;
use geometry::GeometryError;

/// Why a shape could not be completed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CompletionError {
    /// There is no view.
    #[error("no view")]
    NoView,
    /// The table is not seen.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The views show too little of the object.
    #[error("{found} points of the object are seen, at least {least} are needed")]
    FewPoints {
        /// Number of points.
        found: usize,
        /// The least number.
        least: usize,
    },
    /// The seen points lie in one plane.
    #[error("the object's points span no volume")]
    Flat(#[from] GeometryError),
}

impl CompletionError {
    /// Returns why an object is not estimated, with what to do.
    pub fn reason(&self) -> String {
        match self {
            Self::View(_) => format!("{self}; give `table`, or show more of it"),
            _ => self.to_string(),
        }
    }
}
