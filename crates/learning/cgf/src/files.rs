//! The two files of a trained network: its weights, and JSON that describes it.

use std::{
    fs::{self, File},
    io::Write,
    path::Path,
};

use serde::Serialize;

use crate::{CgfError, weights::Weights};

/// Writes both files.
pub(crate) fn save(
    weights: &Weights,
    weights_path: &Path,
    description: &impl Serialize,
    description_path: &Path,
) -> Result<(), CgfError> {
    write(weights_path, &weights.to_bytes()?)?;
    let mut json = serde_json::to_vec_pretty(description)?;
    json.push(b'\n');
    write(description_path, &json)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), CgfError> {
    File::create(path)
        .and_then(|mut file| file.write_all(bytes))
        .map_err(|source| CgfError::Io {
            action: "write",
            path: path.to_owned(),
            source,
        })
}

/// Reads one of them.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, CgfError> {
    fs::read(path).map_err(|source| CgfError::Io {
        action: "read",
        path: path.to_owned(),
        source,
    })
}
