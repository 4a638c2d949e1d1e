//! Why a pose could not be found.

use geometry::GeometryError;

/// Why a pose could not be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegistrationError {
    /// The mesh cannot be measured.
    #[error(transparent)]
    Mesh(#[from] GeometryError),
    /// The mesh has no surface.
    #[error("the object's mesh has no surface")]
    NoSurface,
    /// No orientation is known in which the object rests.
    #[error("no resting orientation of the object is known")]
    NoRest,
    /// The best pose explains too little of what is seen, or puts too much of the object where a camera saw free space.
    #[error(
        "no pose fits: the best has {explained:.0} % of the seen points on the surface, at least {least:.0} % are needed, \
         and {free:.0} % of the surface in free space, at most {most:.0} % are allowed"
    )]
    PoorFit {
        /// Share of the seen points that lie on the surface, in percent.
        explained: f64,
        /// The least share.
        least: f64,
        /// Share of the surface in free space, in percent.
        free: f64,
        /// The greatest share.
        most: f64,
    },
    /// Two poses between which the surface differs fit alike.
    #[error(
        "two poses fit alike: their residuals are {best_mm:.2} mm and {other_mm:.2} mm, and their surfaces are \
         {apart_mm:.1} mm apart"
    )]
    Ambiguous {
        /// Residual of the best pose, in millimeters.
        best_mm: f64,
        /// Residual of the other one, in millimeters.
        other_mm: f64,
        /// Root mean square distance between the two surfaces, in millimeters.
        apart_mm: f64,
    },
}
