//! A small workspace: which edit changes which part of which code.

use std::{fs, path::Path, process::Command};

use tempfile::TempDir;

use super::{append, changed, digests, put};

/// A program with a stage that uses a library of the workspace, which uses a locked dependency; its
/// reports use another library. A generator links the stage.
pub(crate) fn workspace() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let package = |name: &str, more: &str| {
        format!("[package]\nname = \"{name}\"\nedition = \"2024\"\n{more}")
    };
    let stage = "[package.metadata.code]\nreports = [\"src/report.rs\"]\n\
                 [dependencies]\nlibrary.workspace = true\ncharts.workspace = true\n\
                 [dev-dependencies]\nother.workspace = true\n";
    let library = "[dependencies]\nphysics.workspace = true\n";
    let program = "[dependencies]\nstage-count.workspace = true\ngenerator.workspace = true\n";
    for (name, text) in [
        (
            "Cargo.toml",
            "[workspace]\nresolver = \"3\"\nmembers = [\"*\"]\nexclude = [\"target\"]\n\
             [workspace.dependencies]\n\
             library = { path = \"library\" }\nother = { path = \"other\" }\n\
             charts = { path = \"charts\" }\ngenerator = { path = \"generator\" }\n\
             stage-count = { path = \"stage\" }\nphysics = \"1\"\n",
        ),
        (
            "Cargo.lock",
            "[[package]]\nname = \"physics\"\nversion = \"1.0.0\"\nchecksum = \"aa\"\n\
             dependencies = [\"math\"]\n\n[[package]]\nname = \"math\"\nversion = \"2.0.0\"\n\
             checksum = \"bb\"\n\n[[package]]\nname = \"terminal\"\nversion = \"3.0.0\"\nchecksum = \"cc\"\n",
        ),
        ("program/Cargo.toml", &package("program", program)),
        ("stage/Cargo.toml", &package("stage-count", stage)),
        (
            "stage/src/lib.rs",
            "//! A stage.\nmod core;\npub mod report;\n#[cfg(test)]\nmod fixture;\n",
        ),
        (
            "stage/src/core.rs",
            "use library::f;\nfn count() -> u8 { 7 }\n",
        ),
        (
            "stage/src/report.rs",
            "mod chart;\npub struct Report;\nimpl Report {}\n",
        ),
        (
            "stage/src/report/chart.rs",
            "fn draw() { charts::draw() }\n",
        ),
        (
            "stage/src/fixture.rs",
            "pub(crate) fn three() -> u8 { 3 }\n",
        ),
        ("stage/words.txt", "Words.\n"),
        ("library/Cargo.toml", &package("library", library)),
        ("library/src/lib.rs", "//! A library.\npub fn f() {}\n"),
        ("library/src/deep/inner.rs", "//! Deeper.\n"),
        ("library/tests/test.rs", "//! A test.\n"),
        ("charts/Cargo.toml", &package("charts", "")),
        ("charts/src/lib.rs", "pub fn draw() {}\n"),
        ("generator/Cargo.toml", &package("generator", "")),
        ("generator/src/lib.rs", ""),
        ("other/Cargo.toml", &package("other", "")),
        ("other/src/lib.rs", ""),
        ("README.md", "Words.\n"),
    ] {
        put(folder.path(), name, text);
    }
    folder
}

const ITEM: &str = "fn g() {}\n";
const TEST: &str = "\n/// A test.\n#[cfg(test)]\nmod tests {\n    #[test]\n    fn it() {}\n}\n";

/// Appends to a file and returns the parts whose digests changed.
fn changed_by(name: &str, more: &str) -> Vec<String> {
    let folder = workspace();
    let program = folder.path().join("program");
    let before = digests(&program).unwrap();
    append(folder.path(), name, more);
    changed(&before, &digests(&program).unwrap())
}

#[test]
fn an_item_changes_its_own_crate_alone_and_a_report_only_reports() {
    let of_library = ["report-count library", "stage-count library"];
    for (name, expected) in [
        ("library/src/lib.rs", &of_library[..]),
        ("library/src/deep/inner.rs", &of_library),
        ("library/src/new.rs", &of_library),
        (
            "stage/src/core.rs",
            &["report-count stage-count", "stage-count stage-count"],
        ),
        ("stage/src/report.rs", &["report-count report-count"]),
        ("stage/src/report/chart.rs", &["report-count report-count"]),
        ("charts/src/lib.rs", &["report-count charts"]),
        ("generator/src/lib.rs", &["generator generator"]),
        ("stage/src/fixture.rs", &[]),
        ("library/tests/test.rs", &[]),
        ("other/src/lib.rs", &[]),
        ("README.md", &[]),
    ] {
        assert_eq!(changed_by(name, ITEM), expected, "{name}");
        if name.contains("/src/") && !name.contains("new") {
            assert_eq!(changed_by(name, TEST), [] as [&str; 0], "{name}");
        }
    }
}

#[test]
fn an_included_file_counts_by_its_bytes() {
    let folder = workspace();
    let program = folder.path().join("program");
    append(
        folder.path(),
        "stage/src/core.rs",
        "const WORDS: &str = include_str!(\"../words.txt\");\n",
    );
    let before = digests(&program).unwrap();
    append(folder.path(), "stage/words.txt", "// More.\n");
    let after = digests(&program).unwrap();
    assert_eq!(
        changed(&before, &after),
        ["report-count stage-count", "stage-count stage-count"]
    );
    // A name that a macro makes cannot be followed.
    let made = "const W: &str = include_str!(concat!(\"../\", \"words.txt\"));\n";
    append(folder.path(), "stage/src/core.rs", made);
    let refused = digests(&program).unwrap_err();
    assert!(refused.contains("core.rs` includes a file"), "{refused}");
}

#[test]
fn what_could_let_a_report_change_a_result_is_refused() {
    let refused = |name: &str, more: &str| {
        let folder = workspace();
        append(folder.path(), name, more);
        digests(&folder.path().join("program")).unwrap_err()
    };
    for used in [
        "use crate::report::Report;",
        "use crate::{library, report};",
        "fn h() { super::report::Report; }",
        "pub use crate::report as shown;",
    ] {
        let refused = refused("stage/src/core.rs", used);
        assert!(refused.contains("core.rs` uses `report`"), "{refused}");
    }
    for (given, fault) in [
        (
            "impl std::fmt::Display for crate::Count {}",
            "implements for types of other modules",
        ),
        (
            "impl crate::Count { pub fn shown(&self) {} }",
            "implements for types of other modules",
        ),
        ("macro_rules! shown { () => {} }", "has a macro"),
    ] {
        let refused = refused("stage/src/report/chart.rs", given);
        assert!(refused.contains(fault), "{refused}");
    }
}

#[test]
fn a_crate_that_lists_its_sources_counts_by_them_alone() {
    let changed = |name: &str| {
        let folder = workspace();
        let program = folder.path().join("program");
        let decides = "[package.metadata.code]\ndecides = [\"src/deep/inner.rs\"]\n";
        append(folder.path(), "library/Cargo.toml", decides);
        let before = digests(&program).unwrap();
        append(folder.path(), name, ITEM);
        digests(&program).unwrap() != before
    };
    assert!(changed("library/src/deep/inner.rs"));
    assert!(!changed("library/src/lib.rs"));
    assert!(!changed("library/src/new.rs"));
}

#[test]
fn a_manifest_counts_by_what_it_builds() {
    let nothing: [&str; 0] = [];
    assert_eq!(changed_by("library/Cargo.toml", "# A comment.\n"), nothing);
    assert_eq!(changed_by("Cargo.toml", "# A comment.\n"), nothing);
    assert_eq!(
        changed_by("library/Cargo.toml", "[features]\nfast = []\n"),
        ["report-count library", "stage-count library"]
    );
    let slower = "[profile.release]\nopt-level = 0\n";
    assert!(changed_by("Cargo.toml", slower).contains(&"stage-count dependencies".to_owned()));
}

#[test]
fn a_locked_version_counts_only_where_it_computes() {
    let changed_by = |old: &str, new: &str| {
        let folder = workspace();
        let program = folder.path().join("program");
        let before = digests(&program).unwrap();
        let lock = fs::read_to_string(folder.path().join("Cargo.lock")).unwrap();
        put(folder.path(), "Cargo.lock", &lock.replace(old, new));
        changed(&before, &digests(&program).unwrap())
    };
    assert_eq!(changed_by("3.0.0", "3.0.1"), [] as [&str; 0]);
    assert_eq!(
        changed_by("2.0.0", "2.0.1"),
        ["report-count dependencies", "stage-count dependencies"]
    );
}

/// Builds a program of the workspace, which prints its code, and returns that.
fn built(folder: &Path) -> String {
    let ran = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "--offline", "--package", "program"])
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", folder.join("target"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{said}");
    String::from_utf8(ran.stdout).unwrap()
}

#[test]
fn a_rebuilt_program_carries_the_digests_of_what_was_edited_and_no_others() {
    let folder = workspace();
    let digest = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/engine/code_digest");
    let build = format!("[build-dependencies]\ncode_digest = {{ path = {digest:?} }}\n");
    append(folder.path(), "program/Cargo.toml", &build);
    let main = "fn main() {\n    print!(\"{}\", env!(\"PIPELINE_CODE_stage-count\"));\n}\n";
    put(folder.path(), "program/src/main.rs", main);
    put(
        folder.path(),
        "program/build.rs",
        "fn main() {\n    code_digest::emit();\n}\n",
    );
    // What is locked is this workspace's here, so that nothing is fetched.
    put(
        folder.path(),
        "library/Cargo.toml",
        "[package]\nname = \"library\"\nedition = \"2024\"\n",
    );
    fs::remove_file(folder.path().join("Cargo.lock")).unwrap();
    let mut before = built(folder.path());
    for (name, more, changes) in [
        ("README.md", "More words.\n", false),
        ("library/src/lib.rs", "// Another line.\n", false),
        ("stage/src/report.rs", "pub fn shown() {}\n", false),
        ("library/src/lib.rs", "pub fn g() {}\n", true),
        ("stage/src/core.rs", ITEM, true),
    ] {
        append(folder.path(), name, more);
        let after = built(folder.path());
        assert_eq!(after != before, changes, "{name}");
        before = after;
    }
}
