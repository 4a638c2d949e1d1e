//! The replicated files, which are irreplaceable, and the checks of their bytes.

use std::path::{Path, PathBuf};

use crate::{LakeError, lake::Lake, records, register, repeated_runs, replicas, tags};

/// Checks the bytes of a file, or of its replica, at a path.
pub(crate) type Check = fn(&Lake, &Path, &[u8]) -> Result<(), LakeError>;

/// Lists the files that exist, or whose replicas do, each with its check.
pub(crate) fn all(lake: &Lake) -> Result<Vec<(PathBuf, Check)>, LakeError> {
    let folder = &lake.folder;
    let kinds: [(PathBuf, Check); 4] = [
        (folder.runs(), |lake, path, bytes| {
            lake.register.parse(path, bytes).map(drop)
        }),
        (folder.manifests(), |_, path, bytes| {
            register::check_manifest(path, bytes)
        }),
        (folder.recipes(), |_, path, bytes| {
            records::parse_recipe(path, bytes).map(drop)
        }),
        (folder.tags(), |_, path, bytes| {
            tags::parse(path, bytes).map(drop)
        }),
    ];
    let mut all: Vec<(PathBuf, Check)> = Vec::new();
    let repeated = folder.repeated_run();
    if repeated.exists() || folder.copy_of(&repeated).exists() {
        all.push((repeated, |_, path, bytes| {
            repeated_runs::parse(path, bytes).map(drop)
        }));
    }
    for (kind, check) in kinds {
        let names = replicas::names(folder, &kind)?.into_iter();
        all.extend(names.map(|name| (kind.join(name), check)));
    }
    Ok(all)
}
