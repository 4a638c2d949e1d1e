//! Names for runs.

use std::collections::BTreeMap;

use crate::{
    LakeError,
    folder::{Lake, names_in},
    sealed,
};

impl Lake {
    /// Returns the runs that have names.
    ///
    /// # Errors
    ///
    /// Fails if a tag cannot be read.
    pub fn tags(&self) -> Result<BTreeMap<String, u64>, LakeError> {
        let folder = self.root().join("tags");
        let mut tags = BTreeMap::new();
        for name in names_in(&folder)? {
            if let Some(run) = sealed::read(&folder.join(&name))? {
                tags.insert(name.trim_end_matches(".json").to_owned(), run);
            }
        }
        Ok(tags)
    }
}
