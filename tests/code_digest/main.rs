//! Digests of a small workspace made for the test: what changes them and what does not.

mod apart;

use std::{collections::BTreeMap, fs, path::Path, process::Command};

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
    append(folder.path(), name, more);
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

/// A workspace that builds: a program whose code part is what it prints, a library that it uses, and a
/// crate that it does not.
fn buildable() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let code_digest = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/code_digest");
    let stage = format!(
        "[package]\nname = \"stage\"\nedition = \"2024\"\n[dependencies]\n\
         library = {{ path = \"../library\" }}\n[build-dependencies]\n\
         code_digest = {{ path = {:?} }}\n",
        code_digest.display()
    );
    let package = |name: &str| format!("[package]\nname = \"{name}\"\nedition = \"2024\"\n");
    for (name, text) in [
        (
            "Cargo.toml",
            "[workspace]\nmembers = [\"stage\", \"library\", \"other\"]\nresolver = \"3\"\n",
        ),
        ("README.md", "Words.\n"),
        ("stage/Cargo.toml", &stage),
        (
            "stage/build.rs",
            "fn main() {\n    code_digest::emit();\n}\n",
        ),
        (
            "stage/src/main.rs",
            "fn main() {\n    print!(\"{}\", env!(\"PIPELINE_CODE\"));\n}\n",
        ),
        ("library/Cargo.toml", &package("library")),
        ("library/src/lib.rs", "//! A library.\n"),
        ("other/Cargo.toml", &package("other")),
        ("other/src/lib.rs", "//! Unrelated.\n"),
    ] {
        put(folder.path(), name, text);
    }
    folder
}

/// Builds a program of the workspace and returns what it prints.
fn output_of(folder: &Path, program: &str) -> String {
    let ran = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--offline", "--package", program])
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .env_remove("PIPELINE_CODE")
        .output()
        .unwrap();
    let complaint = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{complaint}");
    String::from_utf8(ran.stdout).unwrap()
}

/// Builds the workspace and returns the digests that its program carries, by part.
fn built(folder: &Path) -> BTreeMap<String, String> {
    let parts = output_of(folder, "stage");
    let parts = parts.split(';').map(|part| part.split_once('=').unwrap());
    parts
        .map(|(name, digest)| (name.to_owned(), digest.to_owned()))
        .collect()
}

/// Appends to a file.
fn append(folder: &Path, name: &str, more: &str) {
    let old = fs::read_to_string(folder.join(name)).unwrap_or_default();
    put(folder, name, &format!("{old}{more}"));
}

#[test]
fn a_rebuilt_program_carries_the_digests_of_what_was_edited_and_no_others() {
    let folder = buildable();
    let mut before = built(folder.path());
    for (name, more, changed) in [
        ("README.md", "More words.\n", None),
        ("other/src/lib.rs", "//! Still unrelated.\n", None),
        ("library/src/lib.rs", "//! Another line.\n", Some("library")),
        ("stage/src/main.rs", "// Another line.\n", Some("stage")),
        ("library/src/new.rs", "//! A new file.\n", Some("library")),
    ] {
        append(folder.path(), name, more);
        let after = built(folder.path());
        let differing: Vec<&str> = before
            .iter()
            .filter(|(part, digest)| after.get(*part) != Some(*digest))
            .map(|(part, _)| part.as_str())
            .collect();
        assert_eq!(differing, changed.into_iter().collect::<Vec<_>>(), "{name}");
        before = after;
    }
}

#[test]
fn a_line_of_screen_changes_screen_and_no_stage_before_it() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let parts = |stage: &str| -> Vec<String> {
        let parts = code_digest::parts(&root.join("stages").join(stage)).unwrap();
        parts.into_iter().map(|part| part.name).collect()
    };
    assert!(parts("screen").contains(&"stage-screen".to_owned()));
    for stage in ["ingest", "retarget", "train", "sample", "dispatch"] {
        let of_stage = parts(stage);
        let others = of_stage
            .iter()
            .filter(|part| part.starts_with("stage-") && **part != format!("stage-{stage}"));
        assert_eq!(others.count(), 0, "{stage} depends on {of_stage:?}");
        assert!(of_stage.contains(&"dependencies".to_owned()));
    }
    let computes = |stage: &str, library: &str| parts(stage).contains(&library.to_owned());
    assert!(computes("train", "cgf") && !computes("train", "simulation"));
    assert!(computes("screen", "simulation") && !computes("screen", "cgf"));
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
fn documentation_and_tests_are_in_no_code_digest() {
    assert!(changed_by("README.md", "More words.\n").is_empty());
    assert!(changed_by("other/src/lib.rs", "fn f() {}\n").is_empty());
    assert!(changed_by("library/tests/test.rs", "fn f() {}\n").is_empty());
}

#[test]
fn a_crate_that_lists_its_sources_counts_by_them_alone() {
    let decides = "[package.metadata.code]\ndecides = [\"src/deep/inner.rs\"]\n";
    let changed = |name: &str| {
        let folder = workspace();
        let manifest = folder.path().join("library/Cargo.toml");
        let old = fs::read_to_string(&manifest).unwrap();
        put(
            folder.path(),
            "library/Cargo.toml",
            &format!("{old}{decides}"),
        );
        let before = digests(folder.path());
        put(folder.path(), name, "//! Edited.\n");
        digests(folder.path()) != before
    };
    assert!(changed("library/src/deep/inner.rs"));
    assert!(!changed("library/src/lib.rs"));
    assert!(!changed("library/src/new.rs"));
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
