//! Bad input ends in an error that says what, where and what to do.

use std::{
    fs,
    process::{Command, Output},
};

use crate::program::bench::{Bench, labels, put, stderr, stdout};

/// Runs on a pipeline file with one text replaced, and returns exit code and messages.
fn with_edited_file(from: &str, to: &str) -> (i32, String) {
    let file = include_str!("../../pipelines/cgf.toml");
    assert!(file.contains(from), "{from}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.toml");
    put(&path, &file.replacen(from, to, 1));
    let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["plan", path.to_str().unwrap(), "--lake"])
        .arg(folder.path().join("lake"))
        .output()
        .unwrap();
    (output.status.code().unwrap(), stderr(&output))
}

fn assert_says(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
}

#[test]
fn an_unknown_key_is_shown_with_line_caret_and_near_name() {
    let (code, text) = with_edited_file("kl_weight =", "kl_wieght =");
    assert_eq!(code, 2);
    let says = [
        "error: unknown key `kl_wieght` in stage `train`",
        "edited.toml:",
        "kl_wieght = 2e-3\n",
        "^^^^^^^^^",
        "hint: did you mean `kl_weight`?",
        "pipeline stages train",
    ];
    assert_says(&text, &says);
}

#[test]
fn a_misspelt_kind_and_a_misspelt_stage_get_the_near_name() {
    let (code, text) = with_edited_file("kind = \"retarget\"", "kind = \"retraget\"");
    assert_eq!(code, 2);
    assert_says(
        &text,
        &["unknown kind `retraget`", "did you mean `retarget`?"],
    );

    let (code, text) = with_edited_file("\"ingest.demonstrations\"", "\"ingset.demonstrations\"");
    assert_eq!(code, 2);
    assert_says(
        &text,
        &[
            "unknown stage `ingset`",
            "did you mean `ingest.demonstrations`?",
            "edited.toml:",
        ],
    );

    let (code, text) = with_edited_file("\"ingest.demonstrations\"", "\"ingest.objects\"");
    assert_eq!(code, 2);
    assert_says(&text, &["wants `demonstrations`", "wired to `objects`"]);
}

#[test]
fn unused_profile_is_checked_as_well() {
    const NEXT: &str = "# One page of everything above.";
    let check = |profile: &str, says: &[&str]| {
        let (code, text) = with_edited_file(NEXT, &format!("{profile}\n\n{NEXT}"));
        assert_eq!(code, 2, "{text}");
        assert_says(&text, says);
        assert_eq!(text.matches("error: ").count(), 1, "{text}");
    };
    check(
        "[profiles.many.trian]\nobjects = []",
        &[
            "profile `many` changes an unknown stage `trian`",
            "did you mean `train`?",
            "many.trian",
        ],
    );
    check(
        "[profiles.many.sample]\nper_objects = 10000",
        &[
            "unknown key `per_objects` in stage `sample`",
            "| per_objects = 10000",
        ],
    );
    check(
        "[profiles.many.sample]\nper_object = \"many\"",
        &["stage `sample`", "| per_object = \"many\""],
    );
    check(
        "[profiles.many.sample]\nper_object = 4_000_000_000",
        &["`per_object` is 4000000000", "| per_object = 4_000_000_000"],
    );
    check(
        "[profiles.many]\ningest = 3",
        &["what a profile changes in stage `ingest` is not a table"],
    );
    check("[profiles]\nbest = 3", &["profile `best` is not a table"]);
    check(
        "[profiles.many.shared]\ngrip = 3",
        &["no stage takes the shared value `grip`", "| grip = 3"],
    );
}

#[test]
fn every_error_of_a_file_is_reported_at_once() {
    let (code, text) = with_edited_file("seed = 7", "seed = -1\nsede = 3");
    assert_eq!(code, 2);
    assert_says(
        &text,
        &[
            "`seed` must be a whole number",
            "unknown key `sede`",
            "did you mean `seed`?",
        ],
    );
}

#[test]
fn a_missing_dataset_says_where_it_was_looked_for() {
    let bench = Bench::on("no/such/folder".into());
    let ran = bench.run(&[]);
    assert_eq!(ran.status.code(), Some(1));
    assert_says(
        &stderr(&ran),
        &["stage `ingest` failed", "no/such/folder", "hint: "],
    );
}

#[test]
fn an_unknown_override_is_a_wrong_command_line() {
    let bench = Bench::new();
    for (set, says) in [
        ("trian.epochs=3", "did you mean `train`?"),
        ("train.training.epoch=3", "did you mean `epochs`?"),
        ("train", "is not of the form `stage.key=value`"),
    ] {
        let ran = bench.run(&["--set", set]);
        assert_eq!(ran.status.code(), Some(2), "{set}");
        assert_says(&stderr(&ran), &[says]);
    }
    let ran = bench.run(&["--until", "scren"]);
    assert_eq!(ran.status.code(), Some(2));
    assert_says(
        &stderr(&ran),
        &["no stage `scren`", "did you mean `screen`?"],
    );
}

#[test]
fn a_hand_without_the_named_link_is_refused_with_its_name() {
    let bench = Bench::new();
    let urdf = include_str!("../../data/robots/allegro_right.urdf")
        .replace("link_3.0_tip", "link_3.0_end");
    let path = bench.root().parent().unwrap().join("renamed.urdf");
    put(&path, &urdf);
    let file = include_str!("../../data/hands/allegro_right.toml");
    let file = file.replace("../robots/allegro_right.urdf", "renamed.urdf");
    put(&path.with_extension("toml"), &file);
    let hand = format!("retarget.hand={}", path.with_extension("toml").display());
    let ran = bench.run(&["--until", "retarget", "--set", &hand]);
    assert_eq!(ran.status.code(), Some(1));
    assert_says(
        &stderr(&ran),
        &[
            "stage `retarget` failed",
            "link_3.0_tip",
            "renamed.urdf",
            "hint: ",
        ],
    );
}

#[test]
fn a_truncated_recording_among_good_ones_is_skipped_and_counted() {
    let bench = Bench::with_own_sample();
    let image = labels(&bench.a_recording()).remove(20);
    let bytes = fs::read(&image).unwrap();
    fs::File::options()
        .write(true)
        .open(&image)
        .unwrap()
        .set_len(bytes.len() as u64 / 2)
        .unwrap();
    let ran = bench.run(&["--until", "retarget"]);
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    let name = image.file_name().unwrap().to_str().unwrap();
    assert_says(
        &stderr(&ran),
        &[
            name,
            "1 skipped",
            "pipeline inspect ingest.demonstrations --skipped --run 1",
        ],
    );
    let listed = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .args(["inspect", "ingest.demonstrations", "--skipped", "--lake"])
        .arg(bench.lake())
        .output()
        .unwrap();
    assert_says(
        &stdout(&listed),
        &["skipped", name, "filtered", "left hand"],
    );
    // The reason is kept: the same command again says the same, and reads nothing.
    let again = bench.run(&["--until", "retarget"]);
    assert_eq!(again.status.code(), Some(3));
}

/// Runs the command that a hint gives, on the bench's lake, and returns what it prints.
fn paste(bench: &Bench, ran: &Output) -> String {
    let text = stderr(ran);
    let command = text
        .split('`')
        .find(|quoted| quoted.starts_with("pipeline inspect ") && quoted.contains("--skipped"))
        .unwrap_or_else(|| panic!("no hint in:\n{text}"));
    let arguments: Vec<&str> = command.split(' ').skip(1).collect();
    stdout(&bench.ask(&arguments))
}

#[test]
fn a_hint_shows_what_its_own_run_left_out() {
    let bench = Bench::with_own_sample();
    let image = labels(&bench.a_recording()).remove(20);
    put(&image, "no archive");
    let name = image.file_name().unwrap().to_str().unwrap();
    let shows = |what: &str, ran: &Output, code: i32| {
        assert_eq!(ran.status.code(), Some(code), "{what}: {}", stderr(ran));
        let pasted = paste(&bench, ran);
        assert!(pasted.contains(name), "{what}: no `{name}` in:\n{pasted}");
    };
    let some = ["--until", "retarget"];
    shows("a first run", &bench.run(&some), 3);

    // Another pipeline makes the same artifact without that recording, and is the newest run.
    let file = bench.root().parent().unwrap().join("other.toml");
    put(&file, include_str!("../../pipelines/cgf.toml"));
    let subject = image.ancestors().nth(3).unwrap().file_name().unwrap();
    let other = fs::read_dir(bench.root())
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .find(|folder| folder != subject && folder.to_str().unwrap().contains("subject"))
        .unwrap();
    let another_run = || {
        let ran = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .arg("run")
            .arg(&file)
            .args(["--fresh", "ingest", "--until", "ingest", "--lake"])
            .arg(bench.lake())
            .arg("--set")
            .arg(format!("ingest.root={}", bench.root().display()))
            .arg("--set")
            .arg(format!("ingest.subjects=[{other:?}]"))
            .output()
            .unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        let newest = bench.ask(&["inspect", "ingest.demonstrations", "--skipped"]);
        assert!(!stdout(&newest).contains(name));
    };
    another_run();
    shows("one that finds all as it was", &bench.run(&some), 3);
    let no_partition = bench.ask(&["inspect", "ingest.objects", "???", "--run", "1"]);
    let hint = "list them with `pipeline inspect ingest.objects --run 1`";
    assert_says(&stderr(&no_partition), &[hint]);

    let strict = ["--set", "ingest.max_skipped_fraction=0"];
    shows("one that fails for it", &bench.run(&strict), 1);
    another_run();

    // Nothing is left to make, in the stage itself and in the next one.
    let object = ["--set", "ingest.max_skipped_fraction=1", "--set"];
    let off_the_table = [&object[..], &["ingest.max_table_error_m=1e-12"]].concat();
    shows("one with nothing left", &bench.run(&off_the_table), 1);
    another_run();

    // A stage that wants more than came to it: every object that there is is kept out.
    let unseen = |objects: &[&str]| {
        let ran = bench.run(&["--set", &format!("train.unseen_objects={objects:?}")]);
        assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
        ran
    };
    let named = stderr(&unseen(&["nothing"]));
    let (_, named) = named.split_once("there are: ").unwrap();
    let objects: Vec<&str> = named.lines().next().unwrap().split(", ").collect();
    let ran = unseen(&objects);
    let run = bench.runs().len();
    let hint = format!("`pipeline inspect retarget.trajectories --skipped --run {run}`");
    assert_says(&stderr(&ran), &["stage `train` failed", &hint]);
}

#[test]
fn an_empty_lake_says_how_to_fill_it() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [["query", "select 1"], ["inspect", "screen.rollouts"]] {
        let asked = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .args(arguments)
            .arg("--lake")
            .arg(folder.path())
            .output()
            .unwrap();
        assert_eq!(asked.status.code(), Some(2));
        assert_says(
            &stderr(&asked),
            &["hint: ", "pipeline run pipelines/cgf.toml"],
        );
    }
}
