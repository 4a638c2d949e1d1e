//! Plans a way around object and table to the grasp of each motion, by [`rrt_connect`]: the paper's planning baseline.
//!
//! One unit per object: each of its candidates becomes another one with the same ends, times and table. Where no way is
//! found the motion leads to the node that is nearest to the grasp: it is judged, and fails, like any other. Nothing
//! is simulated: `screen` judges every generator alike. The metrics count collision checks, each one configuration of
//! the hand against object and table.

mod config;
mod rrt;

pub use config::RrtConfig;
pub use rrt::{Rrt, RrtMetrics};
