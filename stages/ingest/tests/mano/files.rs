//! The made-up models of `make.py`.

use std::{
    fs::File,
    io::{BufReader, Read},
    path::Path,
};

use npyz::zip::ZipArchive;

/// Returns the bytes of a made-up model.
pub(crate) fn made_up(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mano/models.zip");
    let mut archive = ZipArchive::new(BufReader::new(File::open(path).unwrap())).unwrap();
    let mut bytes = Vec::new();
    let mut file = archive.by_name(name).unwrap();
    file.read_to_end(&mut bytes).unwrap();
    bytes
}
