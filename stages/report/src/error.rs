//! Why a page could not be made.

use dataflow::Diagnostic;
use glb::GlbError;
use schemas::SchemaError;

/// Why a page could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// Facts of the pipeline cannot be written or read.
    #[error("facts of the pipeline are not as this program writes them")]
    Facts(#[from] serde_json::Error),
    /// A recording is not one of a hand and an object.
    #[error("recording `{name}` cannot be shown: {problem}")]
    Recording {
        /// Its file's name.
        name: String,
        /// The problem.
        problem: String,
    },
    /// A motion cannot be shown.
    #[error("motion `{name}` cannot be shown")]
    Motion {
        /// The motion.
        name: String,
        /// The cause.
        source: GlbError,
    },
    /// A recording is of a motion that its table does not have.
    #[error("recording `{name}` is of no row of its table")]
    Stray {
        /// Its file's name.
        name: String,
    },
    /// A view is no image.
    #[error("view `{name}` cannot be shown")]
    View {
        /// The view.
        name: String,
        /// The cause.
        source: SchemaError,
    },
    /// A file cannot be compressed.
    #[error("a motion or a picture cannot be compressed")]
    Compress(#[source] std::io::Error),
}

impl Diagnostic for ReportError {
    fn hint(&self) -> Option<String> {
        match self {
            Self::Recording { .. } | Self::Stray { .. } | Self::View { .. } => {
                Some("make it again with `pipeline run … --fresh`".to_owned())
            }
            Self::Facts(_) | Self::Motion { .. } | Self::Compress(_) => None,
        }
    }
}
