//! Plans a way around object and table to the grasp of each motion, by RRT-Connect: the paper's planning baseline.
//!
//! A motion's first step is where the hand starts, its last step the grasp. Between them two trees grow in the space of
//! the palm's pose and the joints' positions until they meet (Kuffner and LaValle, *RRT-Connect: An Efficient Approach
//! to Single-Query Path Planning*, 2000). The grasp touches the object and is in no free space, so the second tree
//! grows from a pregrasp, from which the hand closes on a straight line.
//!
//! One unit per object: each of its candidates becomes another one with the same ends, times and table. Where no way is
//! found the motion leads to the node that is nearest to the grasp: it is judged, and fails, like any other. Nothing
//! is simulated: `screen` judges every generator alike. What a plan costs is its collision checks, each one
//! configuration of the hand against object and table; the metrics count them.

mod collision;
mod config;
mod configuration;
mod connect;
mod error;
mod path;
mod plan;
mod pregrasp;
mod stage;
mod tree;

pub use config::RrtConfig;
pub use error::RrtError;
pub use stage::{Rrt, RrtMetrics};
