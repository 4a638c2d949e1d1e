//! What lies at the option `path`.

use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    bop::CAMERAS,
    error::{COMPRESSED, Fault, ViewsError},
    npy, ply,
};

/// The file that makes a folder a recording of rosbag2.
const BAG: &str = "metadata.yaml";
/// Folders that are searched near `path`.
const MAX_SEARCHED: usize = 200;

/// A layout that is read.
pub(crate) enum Layout {
    /// A folder in BOP layout.
    Scene,
    /// A file of points.
    Cloud,
    /// A recording of ROS 2, which is this file.
    Recording(PathBuf),
}

/// Returns the layout of what is at the option `path`.
///
/// # Errors
///
/// Fails if it has none that is read.
pub(crate) fn of(path: &Path) -> Result<Layout, ViewsError> {
    if let Some(layout) = known(path) {
        return Ok(layout);
    }
    let path = path.to_owned();
    if !path.exists() {
        return Err(ViewsError::Nothing { path });
    }
    let is_bag = path.join(BAG).exists();
    let parts = files_of(&path, "mcap");
    if is_bag && parts.len() > 1 {
        let folder = path;
        return Err(ViewsError::SeveralRecordings { folder, parts });
    }
    let own = [path.clone()];
    let inside = if is_bag { files(&path) } else { Vec::new() };
    for file in own.iter().chain(&inside) {
        let extension = extension(file);
        let form = match extension.as_str() {
            "bag" if file.is_file() => "one of ROS 1",
            "db3" => "in SQLite format",
            "zstd" | "zst" => COMPRESSED,
            _ => continue,
        };
        let folder = file.parent().filter(|folder| folder.join(BAG).exists());
        return Err(ViewsError::OtherRecording {
            recording: folder.unwrap_or(file).to_owned(),
            file: file.clone(),
            form,
        });
    }
    let near = near(&path);
    Err(ViewsError::Neither { path, near })
}

/// Returns the layout of what is at a path, if it is one that is read.
fn known(path: &Path) -> Option<Layout> {
    if path.join(CAMERAS).exists() {
        return Some(Layout::Scene);
    }
    if path.is_file() {
        if is_recording(path) {
            return Some(Layout::Recording(path.to_owned()));
        }
        return cloud_format(path).map(|_| Layout::Cloud);
    }
    match files_of(path, "mcap").as_slice() {
        [file] if path.join(BAG).exists() => Some(Layout::Recording(file.clone())),
        _ => None,
    }
}

/// Says whether a file is named as a recording of ROS 2.
pub(crate) fn is_recording(path: &Path) -> bool {
    extension(path) == "mcap"
}

/// Reads the points of a cloud's bytes.
type ReadPoints = fn(&[u8]) -> Result<Vec<[f64; 3]>, Fault>;

/// Returns how the points of a cloud are read, by its extension.
pub(crate) fn cloud_format(path: &Path) -> Option<ReadPoints> {
    match extension(path).as_str() {
        "ply" => Some(ply::points),
        "npy" => Some(npy::points),
        _ => None,
    }
}

/// Returns the extension of a path in lower case, empty without one.
fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

/// Lists the files of a folder in the order of their names; none of anything else.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    files.retain(|path| path.is_file());
    files.sort();
    files
}

fn files_of(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut files = files(folder);
    files.retain(|file| extension(file) == ending);
    files
}

/// Looks for a scene up to two folders above a path, or for what is read up to two below it.
fn near(path: &Path) -> Option<PathBuf> {
    let mut above = path.ancestors().skip(1).take(2);
    if let Some(scene) = above.find(|above| above.join(CAMERAS).exists()) {
        return Some(scene.to_owned());
    }
    let mut level = vec![path.to_owned()];
    for _ in 0..2 {
        let folders = level.iter().take(MAX_SEARCHED);
        let entries = folders.flat_map(fs::read_dir).flatten().flatten();
        level = entries.map(|entry| entry.path()).collect();
        level.sort();
        let mut found = level.iter();
        if let Some(found) = found.find(|path| known(path).is_some()) {
            return Some(found.clone());
        }
    }
    None
}
