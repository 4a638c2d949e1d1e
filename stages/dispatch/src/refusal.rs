//! Why a motion is not sent.

use planning::Infeasible;

/// Why a motion is not sent; nothing of it has moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    /// The robot cannot make it.
    #[error("not sent: {0}")]
    Infeasible(#[from] Infeasible),
    /// The cell takes no message that long.
    #[error("not sent: its goal has {bytes} bytes, more than the {most} that the cell takes")]
    Long { bytes: usize, most: usize },
}
