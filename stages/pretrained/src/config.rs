//! Options of `kind = "pretrained"`.

use std::path::PathBuf;

use options::options;
use schemas::checkpoint;

/// Options of `kind = "pretrained"`.
#[options]
pub struct PretrainedConfig {
    /// Folder with the function's `last.safetensors` and `last.json`, as the artifact `checkpoint` of a lake has them
    #[option(path)]
    pub checkpoint: PathBuf,
}

impl PretrainedConfig {
    /// The two files that are read: name and path.
    pub(crate) fn files(&self) -> [(&'static str, PathBuf); 2] {
        let files = checkpoint::LAST;
        [files.weights, files.description].map(|name| (name, self.checkpoint.join(name)))
    }
}
