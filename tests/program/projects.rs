//! The program works wherever it is installed: a new project is complete.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use tempfile::TempDir;

use crate::program::bench::{SMALL, put, small_recipe, stderr, stdout};

fn pipeline(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// A new project with a small sample, in a folder that has nothing else.
fn project() -> TempDir {
    let folder = TempDir::new().unwrap();
    let made = pipeline(folder.path(), &["new", "my_lab"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let text = stderr(&made);
    assert!(text.contains("`cd my_lab`"), "{text}");
    assert_eq!(names(folder.path()), ["my_lab"]);
    folder
}

#[test]
fn the_whole_job_runs_in_a_new_project() {
    let folder = project();
    let lab = folder.path().join("my_lab");
    assert_eq!(
        names(&lab),
        [".gitignore", "README.md", "data", "pipelines"]
    );
    let readme = fs::read_to_string(lab.join("README.md")).unwrap();
    assert!(readme.starts_with("# my_lab\n"), "{readme}");
    put(&lab.join("data/sample/recipe.toml"), &small_recipe());
    let mut arguments = vec!["run", "pipelines/cgf.toml"];
    for value in SMALL {
        arguments.extend(["--set", value]);
    }
    let ran = pipeline(&lab, &arguments);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert!(lab.join("data/lake/tables").is_dir());
    let asked = pipeline(&lab, &["query", "select distinct object from rollouts"]);
    assert_eq!(asked.status.code(), Some(0), "{}", stderr(&asked));
    assert!(stdout(&asked).lines().count() > 2, "{}", stdout(&asked));
    assert_eq!(names(folder.path()), ["my_lab"]);
}

#[test]
fn new_project_contains_every_file_its_pipelines_name() {
    let folder = project();
    let lab = folder.path().join("my_lab");
    put(&lab.join("data/sample/recipe.toml"), &small_recipe());
    let of = |folder: &str| {
        let files = names(&lab.join(folder)).into_iter();
        let files: Vec<String> = files.map(|name| format!("{folder}/{name}")).collect();
        files
    };
    let files = [of("pipelines"), of("pipelines/studies")].concat();
    let is_pipeline = |path: &&String| Path::new(path).extension() == Some("toml".as_ref());
    for path in files.iter().filter(is_pipeline) {
        let ready = pipeline(&lab, &["doctor", path]);
        let text = stderr(&ready);
        // Studies with several values have no single one to check.
        let is_study = text.contains("variants here");
        let known = ready.status.code() == Some(0) || text.contains("unknown stage `dispatch`");
        assert!(known || is_study, "{path}: {text}");
        let planned = pipeline(&lab, &["plan", path]);
        assert_eq!(
            planned.status.code(),
            Some(0),
            "{path}: {}",
            stderr(&planned)
        );
    }
}

#[test]
fn a_folder_that_is_not_empty_is_left_alone_and_a_name_is_checked() {
    let folder = TempDir::new().unwrap();
    fs::create_dir(folder.path().join("full")).unwrap();
    for name in ["a", "b", "c", "d", "e"] {
        put(&folder.path().join("full").join(name), name);
    }
    put(&folder.path().join("file"), "");
    for (name, says) in [
        (
            "full",
            &[
                "`full` is not empty: it has `a`, `b`, `c` and 2 more",
                "hint: ",
            ][..],
        ),
        (
            "file",
            &[
                "cannot make a project in `file`",
                "hint: choose another name",
            ],
        ),
        (
            "a b",
            &[
                "`a b` is not a name for a project",
                "hint: use ASCII letters",
            ],
        ),
        (
            "labs/my_lab",
            &["hint: go to the folder", "`pipeline new my_lab`"],
        ),
        ("..", &["`..` is not a name for a project"]),
    ] {
        let refused = pipeline(folder.path(), &["new", name]);
        let text = stderr(&refused);
        assert_eq!(refused.status.code(), Some(2), "{name}: {text}");
        for part in says {
            assert!(text.contains(part), "no `{part}` in:\n{text}");
        }
    }
    assert_eq!(names(folder.path()), ["file", "full"]);
    assert_eq!(
        names(&folder.path().join("full")),
        ["a", "b", "c", "d", "e"]
    );
    fs::create_dir(folder.path().join("empty")).unwrap();
    let made = pipeline(folder.path(), &["new", "empty"]);
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
}

#[test]
fn the_program_knows_no_folder_of_its_sources() {
    let program = fs::read(env!("CARGO_BIN_EXE_pipeline")).unwrap();
    let named = concat!(env!("CARGO_MANIFEST_DIR"), "/data");
    let is_there = |folder: &str| {
        program
            .windows(folder.len())
            .any(|part| part == folder.as_bytes())
    };
    assert!(!is_there(named));
    assert!(!is_there(concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines")));
}
