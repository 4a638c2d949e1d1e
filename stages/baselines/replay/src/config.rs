//! Options of `kind = "replay"`.

use options::options;

/// Options of `kind = "replay"`.
#[options]
pub struct ReplayConfig {
    /// Objects whose trajectories are offered, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
}
