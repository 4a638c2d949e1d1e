//! Options of `kind = "interpolate"`.

use options::options;

/// Options of `kind = "interpolate"`.
#[options]
pub struct InterpolateConfig {
    /// Objects whose motions are replaced, by name; empty: all
    #[option(default)]
    pub objects: Vec<String>,
}
