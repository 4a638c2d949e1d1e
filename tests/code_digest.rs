//! What changes the code of a stage and what does not: in a small workspace made for the test, and in
//! this one.

mod reruns;
mod small;
mod whole;

use std::{collections::BTreeMap, fs, path::Path};

use code_digest::Workspace;

/// The digests of what the program in `folder` links: each a part of a stage's code or its report's.
fn digests(folder: &Path) -> code_digest::Result<BTreeMap<String, String>> {
    let codes = Workspace::of(folder)?.linked(folder)?;
    let parts = codes.into_iter().flat_map(|code| {
        let parts = code.parts.into_iter();
        parts.map(move |part| (format!("{} {}", code.name, part.name), part.digest))
    });
    Ok(parts.collect())
}

/// The names of the codes whose digests differ.
fn changed(before: &BTreeMap<String, String>, after: &BTreeMap<String, String>) -> Vec<String> {
    assert!(before.keys().eq(after.keys()));
    let changed = before
        .iter()
        .filter(|(part, digest)| after[*part] != **digest);
    changed.map(|(part, _)| part.clone()).collect()
}

#[expect(
    clippy::disallowed_methods,
    reason = "a test's file may well be half a file"
)]
fn put(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// Appends to a file.
fn append(folder: &Path, name: &str, more: &str) {
    let old = fs::read_to_string(folder.join(name)).unwrap_or_default();
    put(folder, name, &format!("{old}{more}"));
}
