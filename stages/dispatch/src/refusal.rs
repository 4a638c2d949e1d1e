//! Why a motion is not sent.

/// Why a motion is not sent; nothing of it has moved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    /// There is nothing to move between.
    #[error("not sent: {found} steps, expected at least 2")]
    Steps { found: usize },
    /// A number is missing, NaN or infinite.
    #[error("not sent: step {step} has a number that is missing or not finite")]
    Number { step: usize },
    /// Times do not increase.
    #[error("not sent: step {step} is at {time_s} s, not after {last_s} s")]
    Times {
        step: usize,
        time_s: f64,
        last_s: f64,
    },
    /// No rotation vector is that of the turn.
    #[error("not sent: the palm's turn before step {step} cannot be followed")]
    Turn { step: usize },
    /// The steps are those of another hand.
    #[error("not sent: its joints are not those of the hand: `{joint}`")]
    Joints { joint: String },
    /// A joint's position.
    #[error(
        "not sent: joint `{joint}` would be at {q:.4} after {time_s:.3} s, outside {lower:.4} to {upper:.4}"
    )]
    Limit {
        joint: String,
        q: f64,
        time_s: f64,
        lower: f64,
        upper: f64,
    },
    /// The hand's shapes and the table.
    #[error("not sent: link `{link}` would be {depth_m:.4} m below the table after {time_s:.3} s")]
    Table {
        link: String,
        depth_m: f64,
        time_s: f64,
    },
    /// The limits ask for too much time.
    #[error(
        "not sent: within its limits the motion takes {slower:.2} times as long, more than `limits.most_times_slower` = {most}"
    )]
    Slow { slower: f64, most: f64 },
}
