//! Looking at what is shown without believing it.

use std::{collections::HashSet, path::Path};

use crate::{
    LakeError,
    atomic::io_error,
    blobs::digest_file,
    folder::{Lake, names_in},
    newest::{self, Newest},
    stamp::Stamp,
    verify::files_below,
};

impl Lake {
    /// Makes sure that every file below a folder of tables holds the bytes that a unit or a run made.
    /// Only files whose stamps are not known to be those of whole ones are read.
    ///
    /// # Errors
    ///
    /// Fails with [`LakeError::Damaged`] for the first file that does not.
    pub fn check_shown(&self, folder: &Path) -> Result<(), LakeError> {
        if !self.blobs().root().is_dir() {
            return Ok(());
        }
        let whole = self.whole_stamps()?;
        for path in files_below(folder)? {
            let stamp = Stamp::read(&path).map_err(io_error("read", &path))?;
            if whole.contains(&stamp) {
                continue;
            }
            let digest = digest_file(&path).map_err(io_error("read", &path))?;
            if !self.blobs().path(&digest).exists() {
                return Err(LakeError::Damaged { path });
            }
        }
        Ok(())
    }

    /// The stamps of files that were whole when a run last looked at them.
    fn whole_stamps(&self) -> Result<HashSet<Stamp>, LakeError> {
        let mut stamps = HashSet::new();
        for name in names_in(&self.root().join(newest::FOLDER))? {
            let path = newest::path(self.root(), newest::pipeline_of(&name));
            let newest = Newest::read(&path)?;
            stamps.extend(newest.stamps.iter().map(|(_, stamp)| *stamp));
            let shown = newest.all_shown().values().flat_map(|shown| shown.values());
            stamps.extend(shown.map(|file| file.stamp));
        }
        Ok(stamps)
    }
}
