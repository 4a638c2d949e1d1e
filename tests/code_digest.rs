//! Digests of a small workspace made for the test: what changes them and what does not.

use std::{collections::BTreeMap, fs, path::Path};

use tempfile::TempDir;

/// A stage that uses a library of the workspace and a locked dependency, beside an unrelated crate.
fn workspace() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        (
            "Cargo.toml",
            "[workspace]\nmembers = [\"*\"]\n[workspace.dependencies]\n\
             library = { path = \"library\" }\nother = { path = \"other\" }\nphysics = \"1\"\n",
        ),
        (
            "Cargo.lock",
            "[[package]]\nname = \"physics\"\nversion = \"1.0.0\"\nchecksum = \"aa\"\n\
             dependencies = [\"math\"]\n\n[[package]]\nname = \"math\"\nversion = \"2.0.0\"\n\
             checksum = \"bb\"\n\n[[package]]\nname = \"terminal\"\nversion = \"3.0.0\"\nchecksum = \"cc\"\n",
        ),
        (
            "stage/Cargo.toml",
            "[package]\nname = \"stage\"\n[dependencies]\nlibrary.workspace = true\n\
             [dev-dependencies]\nother.workspace = true\n",
        ),
        ("stage/src/lib.rs", "//! A stage.\n"),
        (
            "library/Cargo.toml",
            "[package]\nname = \"library\"\n[dependencies]\nphysics.workspace = true\n",
        ),
        ("library/src/lib.rs", "//! A library.\n"),
        ("library/src/deep/inner.rs", "//! Deeper.\n"),
        ("library/tests/test.rs", "//! A test.\n"),
        ("other/Cargo.toml", "[package]\nname = \"other\"\n"),
        ("other/src/lib.rs", "//! Unrelated.\n"),
        ("README.md", "Words.\n"),
    ];
    for (name, text) in files {
        put(folder.path(), name, text);
    }
    folder
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

fn digests(folder: &Path) -> BTreeMap<String, String> {
    let parts = code_digest::parts(&folder.join("stage")).unwrap();
    parts
        .into_iter()
        .map(|part| (part.name, part.digest))
        .collect()
}

/// Appends to a file and returns the names of the parts whose digests changed.
fn changed_by(name: &str, more: &str) -> Vec<String> {
    let folder = workspace();
    let before = digests(folder.path());
    let old = fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    put(folder.path(), name, &format!("{old}{more}"));
    let after = digests(folder.path());
    assert_eq!(
        before.keys().collect::<Vec<_>>(),
        ["dependencies", "library", "stage"]
    );
    before
        .keys()
        .filter(|name| before[*name] != after[*name])
        .cloned()
        .collect()
}

#[test]
fn a_source_changes_its_own_crate_alone() {
    assert_eq!(changed_by("stage/src/lib.rs", "fn f() {}\n"), ["stage"]);
    assert_eq!(changed_by("library/src/lib.rs", "fn f() {}\n"), ["library"]);
    assert_eq!(
        changed_by("library/src/deep/inner.rs", "fn f() {}\n"),
        ["library"]
    );
    assert_eq!(changed_by("library/src/new.rs", "fn f() {}\n"), ["library"]);
}

#[test]
fn what_does_not_compute_changes_nothing() {
    assert!(changed_by("README.md", "More words.\n").is_empty());
    assert!(changed_by("other/src/lib.rs", "fn f() {}\n").is_empty());
    assert!(changed_by("library/tests/test.rs", "fn f() {}\n").is_empty());
}

#[test]
fn a_locked_version_counts_only_where_it_computes() {
    let folder = workspace();
    let before = digests(folder.path());
    let lock = fs::read_to_string(folder.path().join("Cargo.lock")).unwrap();
    put(folder.path(), "Cargo.lock", &lock.replace("3.0.0", "3.0.1"));
    assert_eq!(digests(folder.path()), before);
    put(folder.path(), "Cargo.lock", &lock.replace("2.0.0", "2.0.1"));
    let after = digests(folder.path());
    assert_ne!(after["dependencies"], before["dependencies"]);
    assert_eq!(
        (&after["stage"], &after["library"]),
        (&before["stage"], &before["library"])
    );
}
