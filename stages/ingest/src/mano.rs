//! Hand landmarks from the parameters of the MANO hand model, by the user's own licensed file.
//!
//! A dataset gives per image 51 numbers of a hand: [`ShapedHand::keypoints`] says in which order.
//! What they mean is in the model file, `MANO_RIGHT.pkl` or `MANO_LEFT.pkl`, which may not be
//! passed on; nothing of it is stored here or in any artifact.
//!
//! `machine` runs the file's instructions in bounded memory, `pickle` holds what they make, `arrays`
//! takes arrays of numbers out of it, `model` checks that they are a hand model, and `skin` poses it.

mod arrays;
mod machine;
mod model;
mod pickle;
mod skin;

pub use model::ManoModel;
pub use skin::ShapedHand;

/// Why a hand model could not be read.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ManoError {
    /// The file is larger than any hand model.
    #[error("{found} bytes, more than the {limit} that a hand model can have")]
    TooLarge {
        /// Its size in bytes.
        found: usize,
        /// The largest accepted size in bytes.
        limit: usize,
    },
    /// The bytes are not a pickle, are damaged or end early.
    #[error("no pickle that can be read: {what} at byte {at}")]
    Pickle {
        /// The fault.
        what: &'static str,
        /// Where, from the file's start.
        at: usize,
    },
    /// A part of the model is not there.
    #[error("the hand model has no `{0}`")]
    Missing(&'static str),
    /// A part of the model is something else than an array of numbers.
    #[error("`{key}` of the hand model {what}")]
    Array {
        /// The part.
        key: &'static str,
        /// The fault, as the rest of a sentence.
        what: &'static str,
    },
    /// An array has other dimensions.
    #[error("`{key}` of the hand model has shape {found:?}, expected {expected:?}")]
    Shape {
        /// The part.
        key: &'static str,
        /// Dimensions found.
        found: Vec<usize>,
        /// Dimensions expected.
        expected: Vec<usize>,
    },
    /// The numbers are not those of a hand model of MANO's kind.
    #[error("not a MANO hand model: {0}")]
    NotMano(&'static str),
}
