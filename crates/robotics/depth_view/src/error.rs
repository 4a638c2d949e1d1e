//! Why an image cannot be used.

/// Why an image cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// Too few pixels lie on one plane.
    #[error(
        "no table is seen: the largest plane has {share:.0} % of the pixels, at least {least:.0} % are needed"
    )]
    NoTable {
        /// The largest plane's share of the pixels with a depth, in percent.
        share: f64,
        /// The least share.
        least: f64,
    },
    /// An image has fewer depths than its table or its object needs.
    #[error("{found} pixels have a depth, at least {least} are needed")]
    FewDepths {
        /// Number of pixels with a depth.
        found: usize,
        /// The least number.
        least: usize,
    },
    /// Nothing stands on the table.
    #[error("no object of at least {least} pixels stands on the table")]
    NoObject {
        /// The least number of pixels.
        least: usize,
    },
    /// The largest thing on the table is cut off by the image's border.
    #[error("the object reaches the border of the image: a part of it is out of view")]
    OutOfView,
}
