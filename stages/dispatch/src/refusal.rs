//! Why a motion is not sent.

use cell::Rejection;
use options::OptionFault;
use planning::Infeasible;

/// Why a motion is not sent; nothing has moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    /// The motion is infeasible.
    #[error("not sent: {0}")]
    Infeasible(#[from] Infeasible),
    /// No cell executes the protocol.
    #[error("not sent: {0}")]
    Protocol(OptionFault),
    /// The motion is beyond the cell's own limits.
    #[error("not sent, beyond the cell's own limits: {}", .0.reason)]
    Limits(Rejection),
    /// The goal exceeds the cell's maximum message length.
    #[error("not sent: its goal has {bytes} bytes, more than the {most} that the cell takes")]
    Long { bytes: usize, most: usize },
}
