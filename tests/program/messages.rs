//! Errors in values name the key, the expected and the found value, and the location.

use std::{fs, path::Path, process::Command};

use dataflow::Pipeline;
use tempfile::TempDir;

use crate::program::bench::{put, stderr, stdout};

/// Runs the program in a folder, and returns exit code and messages.
fn said(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    (output.status.code().unwrap(), stderr(&output))
}

fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Pipeline files that have a stage of every kind between them.
const FILES: [(&str, &str); 3] = [
    (
        "pipelines/cgf.toml",
        include_str!("../../pipelines/cgf.toml"),
    ),
    (
        "pipelines/baseline.toml",
        include_str!("../../pipelines/baseline.toml"),
    ),
    (
        "pipelines/replay.toml",
        include_str!("../../pipelines/replay.toml"),
    ),
];

/// An option of a stage.
struct StageOption {
    file: &'static str,
    kind: String,
    stage: String,
    key: String,
    /// A value of another type.
    wrong: &'static str,
}

/// The options of every stage by the JSON schema of its kind.
fn options() -> Vec<StageOption> {
    let mut options: Vec<StageOption> = Vec::new();
    for (file, text) in FILES {
        let read = Pipeline::parse(file.as_ref(), text, &pipeline::kinds(), None, &[]).unwrap();
        for stage in &read.stages {
            let (name, kind) = (stage.kind.name, &stage.kind);
            for option in kind.options() {
                let known = |known: &StageOption| known.kind == name && known.key == option.key;
                if options.iter().any(known) {
                    continue;
                }
                options.push(StageOption {
                    file,
                    kind: name.to_owned(),
                    stage: stage.name.to_string(),
                    key: option.key,
                    wrong: if option.value == "boolean" {
                        "3"
                    } else {
                        "true"
                    },
                });
            }
        }
    }
    options
}

#[test]
fn every_option_of_every_stage_names_its_key_and_what_it_must_be() {
    let options = options();
    assert!(options.len() > 150, "{}", options.len());
    // Words that only a programmer knows.
    let code = [
        "usize", "u32", "u64", "i64", "f64", "struct ", "enum ", "variant", "sequence", "map,",
    ];
    for option in &options {
        let (stage, key) = (&option.stage, &option.key);
        let set = format!("{stage}.{key}={}", option.wrong);
        let overrides = [set.parse().unwrap()];
        let text = fs::read_to_string(repository().join(option.file)).unwrap();
        let path = Path::new(option.file);
        let parsed = Pipeline::parse(path, &text, &pipeline::kinds(), None, &overrides);
        let Err(err) = parsed else {
            panic!("{set} is taken");
        };
        let begins = format!("`{key}` in stage `{stage}` must be ");
        let mut problems = err.problems.iter();
        let problem = problems.find(|problem| problem.message.starts_with(&begins));
        let problem = problem.unwrap_or_else(|| panic!("{set}: {err}"));
        let message = &problem.message;
        assert!(message.contains(", found "), "{set}: {message}");
        assert!(!message.contains("something else"), "{set}: {message}");
        assert!(
            !code.iter().any(|word| message.contains(word)),
            "{set}: {message}"
        );
        let place = problem.location.as_ref().unwrap().to_string();
        let carets = "^".repeat(option.wrong.len());
        assert!(place.contains(&format!("--set {set}\n")), "{place}");
        assert!(place.ends_with(&format!(" {carets}")), "{place}");
    }
}

#[test]
fn a_value_of_a_wrong_type_is_shown_in_its_line() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("edited.toml");
    for (from, to, says) in [
        (
            "epochs = 150",
            "epochs = \"many\"",
            &[
                "`training.epochs` in stage `train` must be a whole number from 1 to 1000000, found the text \"many\"",
                "epochs = \"many\"",
                "^^^^^^",
            ][..],
        ),
        (
            "epochs = 150",
            "epochs = 1.5",
            &["must be a whole number from 1 to 1000000, found the number 1.5"],
        ),
        (
            "epochs = 150",
            "epochs = -1",
            &["from 1 to 1000000, found the number -1"],
        ),
        (
            "root = \"data/sample\"",
            "root = \"data/sample\"\nmirror = \"no\"",
            &["`mirror` in stage `ingest` must be `true` or `false`"],
        ),
        (
            "[stages.train.training]",
            "[stages.train.network]\npoint_widths = [64, \"wide\", 256]\n[stages.train.training]",
            &[
                "element 2 of `network.point_widths`",
                "found the text \"wide\"",
                "^^^^^^",
            ],
        ),
        (
            "root = \"data/sample\"",
            "root = \"data/sample\"\nsubjects = \"all\"",
            &["`subjects` in stage `ingest` must be a list of texts"],
        ),
        (
            "epochs = 150",
            "epochs = 150\nschedule = \"cosin\"",
            &[
                "must be \"halving\" or \"cosine\"",
                "found the text \"cosin\"",
                "did you mean `\"cosine\"`?",
            ],
        ),
        (
            "scene.friction = \"friction\" }\n\n[stages.dispatch]",
            "scene.friction = \"friction\" }\nscene.drive.controller = \"pid\"\n\n[stages.dispatch]",
            &[
                "scene.drive.controller` in stage `screen` must be \"pd\"",
                "found the text \"pid\"",
            ],
        ),
        (
            "hand = \"right\"\n",
            "",
            &["stage `ingest` lacks the key `hand`", "[stages.ingest]"],
        ),
        (
            "epochs = 150",
            "epoch = 150",
            &["unknown key `epoch`", "did you mean `epochs`?"],
        ),
        (
            "\n[stages.train.training]",
            "epochs = 3\n[stages.train.training]",
            &["unknown key `epochs`", "did you mean `training.epochs`?"],
        ),
        (
            "hand = \"right\"",
            "hand = \"right\"\nmax_skipped_fraction = 2",
            &[
                "`max_skipped_fraction` in stage `ingest` must be a number from 0 to 1, found the number 2",
            ],
        ),
    ] {
        let file = FILES[0].1;
        assert!(file.contains(from), "{from}");
        put(&path, &file.replacen(from, to, 1));
        let (code, text) = said(repository(), &["plan", path.to_str().unwrap()]);
        assert_eq!(code, 2, "{to}: {text}");
        for part in says.iter().chain(&["edited.toml:", "hint: "]) {
            let has_no_hint = *part == "hint: " && to.contains("max_skipped");
            assert!(
                has_no_hint || text.contains(part),
                "no `{part}` in:\n{text}"
            );
        }
        assert!(
            !text.contains("usize") && !text.contains("struct"),
            "{text}"
        );
    }
}

#[test]
fn all_wrong_values_of_a_file_are_reported_at_once() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("edited.toml");
    let file = FILES[0]
        .1
        .replacen("epochs = 150", "epochs = \"many\"\nbatch = true", 1)
        .replacen("hand = \"right\"", "hand = \"right\"\nmiror = false", 1);
    put(&path, &file);
    let (code, text) = said(repository(), &["plan", path.to_str().unwrap()]);
    assert_eq!(code, 2);
    assert_eq!(text.matches("error: ").count(), 3, "{text}");
}

#[test]
fn mistakes_in_values_given_beside_the_file_point_at_them() {
    for (set, points, says) in [
        (
            "train.training.epochs=many",
            "many",
            "must be a whole number",
        ),
        ("train.training.epoch=3", "epoch", "did you mean `epochs`?"),
        (
            "train.trainin.epochs=3",
            "trainin",
            "did you mean `training`?",
        ),
        ("trian.training.epochs=3", "trian", "did you mean `train`?"),
        ("train.training=3", "3", "must be a table"),
        ("train.hand.file=3", "3", "must be text"),
        ("train.kind=trian", "trian", "did you mean `train`?"),
        ("train.inputs=3", "3", "is not a table"),
        ("train.inputs.objects=3", "3", "must name `stage.artifact`"),
        (
            "train.inputs.objets=ingest.objects",
            "objets",
            "did you mean `objects`?",
        ),
        (
            "train.inputs.objects=ingset.objects",
            "ingset.objects",
            "did you mean `ingest.objects`?",
        ),
        (
            "train.inputs.objects=ingest.shapes",
            "ingest.shapes",
            "wants `objects`",
        ),
        (
            "train.inputs.objects=ingest.things",
            "ingest.things",
            "it makes: ",
        ),
        ("train.max_skipped_fraction=2", "2", "from 0 to 1"),
        ("retarget.wrist=fre", "fre", "did you mean `\"free\"`?"),
        ("seed=many", "many", "must be a whole number"),
        ("sed=3", "sed", "unknown key `sed`"),
    ] {
        let (code, text) = said(repository(), &["plan", "pipelines/cgf.toml", "--set", set]);
        assert_eq!(code, 2, "{set}: {text}");
        assert!(text.contains(says), "{set}: no `{says}` in:\n{text}");
        let line = format!("  | --set {set}\n");
        assert!(text.contains(&line), "{set}:\n{text}");
        assert!(!text.contains("cgf.toml:"), "{set}:\n{text}");
        let (_, after) = text.split_once(&line).unwrap();
        let carets = after.lines().next().unwrap();
        let start = carets.find('^').unwrap();
        let shown = line
            .get(start..start + carets.matches('^').count())
            .unwrap();
        assert_eq!(shown, points, "{set}:\n{text}");
    }
}

#[test]
fn a_missing_file_gets_the_near_name_and_the_folder_it_was_looked_for_in() {
    let here = format!("the path is taken relative to `{}`", repository().display());
    let near = "did you mean `data/robots/allegro_right.urdf`?";
    let rigt = "data/robots/allegro_rigt.urdf";
    let set = |key: &str, path: &str| format!("{key}={path}");
    for (arguments, code, says) in [
        (
            vec!["plan".to_owned(), "pipelines/cfg.toml".to_owned()],
            2,
            "did you mean `pipelines/cgf.toml`?",
        ),
        (
            vec!["plan".to_owned(), "pipeline/cgf.toml".to_owned()],
            2,
            "did you mean `pipelines/cgf.toml`?",
        ),
        (
            vec!["graph".to_owned(), "pipelines/cgf".to_owned()],
            2,
            "did you mean `pipelines/cgf.toml`?",
        ),
        (
            vec!["doctor".to_owned(), "--robot".to_owned(), rigt.to_owned()],
            1,
            near,
        ),
        (
            vec!["cell".to_owned(), "--hand".to_owned(), rigt.to_owned()],
            2,
            near,
        ),
        (
            vec![
                "doctor".to_owned(),
                "--set".to_owned(),
                set("sample.hand", rigt),
            ],
            1,
            near,
        ),
        (
            vec![
                "doctor".to_owned(),
                "--set".to_owned(),
                set("ingest.root", "data/sampel"),
            ],
            1,
            "did you mean `data/sample`?",
        ),
        (
            vec![
                "doctor".to_owned(),
                "--set".to_owned(),
                set("retarget.hand", "data/hand/allegro_right.toml"),
            ],
            2,
            "did you mean `data/hands/allegro_right.toml`?",
        ),
    ] {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let (found, text) = said(repository(), &arguments);
        assert_eq!(found, code, "{arguments:?}: {text}");
        assert!(
            text.contains(says),
            "{arguments:?}: no `{says}` in:\n{text}"
        );
        assert!(
            text.contains(&here),
            "{arguments:?}: no `{here}` in:\n{text}"
        );
        assert!(!text.contains("os error"), "{text}");
    }
    let empty = TempDir::new().unwrap();
    let (code, text) = said(empty.path(), &["run", "pipelines/cgf.toml"]);
    assert_eq!(code, 2);
    assert!(
        text.contains("`pipeline new NAME` makes a project"),
        "{text}"
    );
    let (code, text) = said(empty.path(), &["runs"]);
    assert_eq!(code, 2);
    assert!(
        text.contains("`pipeline new NAME` makes a project"),
        "{text}"
    );
}

#[test]
fn system_errors_are_explained_with_the_path() {
    let folder = TempDir::new().unwrap();
    put(&folder.path().join("file"), "");
    for (arguments, says) in [
        (
            ["plan", "/proc/self"],
            "cannot read the pipeline file `/proc/self`: it is a folder",
        ),
        (
            ["plan", "file/cgf.toml"],
            "a part of the path is a file, not a folder",
        ),
        (
            ["plan", "none.toml"],
            "`none.toml`: there is no such file or folder",
        ),
        (
            ["new", "file"],
            "`file`: a part of the path is a file, not a folder",
        ),
    ] {
        let (code, text) = said(folder.path(), &arguments);
        assert_eq!(code, 2, "{text}");
        assert!(text.contains(says), "no `{says}` in:\n{text}");
        assert!(!text.contains("os error"), "{text}");
    }
    // A lake below a file cannot be written.
    let lake = folder.path().join("file/lake");
    let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(repository())
        .args(["doctor", "--lake"])
        .arg(&lake)
        .output()
        .unwrap();
    let text = stdout(&output);
    assert!(
        text.contains("cannot be written: a part of the path is a file"),
        "{text}"
    );
    assert!(!text.contains("os error"), "{text}");
}

#[test]
fn a_cell_that_is_not_there_is_said_not_to_answer() {
    // The port is free again as soon as the listener is dropped.
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let endpoint = format!("tcp/{}", free.local_addr().unwrap());
    drop(free);
    let set = format!("dispatch.cell={endpoint}");
    let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(repository())
        .args(["doctor", "--set", &set])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    let says = format!("nothing answers at `{endpoint}`");
    assert!(stdout(&output).contains(&says), "{}", stdout(&output));
    let (code, text) = said(repository(), &["cell", "--connect", &endpoint]);
    assert_eq!(code, 1, "{text}");
    assert!(text.contains(&says), "{text}");
}
