//! Why recordings could not be made.

use std::{io, path::PathBuf};

/// Why recordings could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DemonstratorError {
    /// The recipe is not TOML of the expected shape.
    #[error("the recipe cannot be read")]
    Recipe(#[source] Box<toml_edit::de::Error>),
    /// A number in the recipe makes no sense.
    #[error("`{option}` in the recipe {problem}")]
    Option {
        /// The option's key.
        option: &'static str,
        /// Description of the fault.
        problem: &'static str,
    },
    /// A file or folder could not be read or written.
    #[error("cannot {action} `{}`", path.display())]
    File {
        /// Operation that failed.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// No good grasp of an object was found.
    #[error("no grasp of `{object}` found for recording {recording}")]
    NoGrasp {
        /// The object's name.
        object: &'static str,
        /// Index of the recording, from zero.
        recording: usize,
    },
}

impl DemonstratorError {
    /// Returns a suggested fix, where one is known.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Recipe(_) | Self::Option { .. } => Some(
                "correct it in the folder's `recipe.toml`, or restore the committed recipe with \
                 `git restore data/sample/recipe.toml`"
                    .to_owned(),
            ),
            Self::File { .. } => Some("check the folder's permissions and free space".to_owned()),
            Self::NoGrasp { .. } => {
                Some("raise `grasp_tries` or change `seed` in `recipe.toml`".to_owned())
            }
        }
    }
}
