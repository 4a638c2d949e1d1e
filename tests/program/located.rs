//! Faults of a pipeline file stand where they are: with file, line and caret, in few words, whatever the file looks
//! like.

use std::process::Command;

use tempfile::TempDir;

use crate::program::bench::{put, stderr, stdout};

/// Runs `plan` on the last of these files, and returns the exit code and what is said.
fn planned(files: &[(&str, &str)], more: &[&str]) -> (i32, String) {
    let folder = TempDir::new().unwrap();
    for (name, text) in files {
        put(&folder.path().join(name), text);
    }
    let (last, _) = files.last().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(folder.path())
        .args(["plan", last, "--lake", "lake"])
        .args(more)
        .output()
        .unwrap();
    let said = format!("{}{}", stdout(&output), stderr(&output));
    (output.status.code().unwrap(), said)
}

#[track_caller]
fn refused(files: &[(&str, &str)], more: &[&str], parts: &[&str]) -> String {
    let (code, said) = planned(files, more);
    assert_eq!(code, 2, "{said}");
    for part in parts {
        assert!(said.contains(part), "no `{part}` in:\n{said}");
    }
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// A program stage that reads what another one makes.
fn program(name: &str, reads: &str) -> String {
    format!(
        "[stages.{name}]\nkind = \"program\"\ncommand = [\"true\"]\nmakes = \"{name}\"\n\
         columns.x = {{ type = \"number\" }}\ninputs.it = \"{reads}.{reads}\"\n"
    )
}

#[test]
fn a_circle_names_its_stages_with_their_lines() {
    let file = |stages: &[(&str, &str)]| -> String {
        let stages = stages.iter().map(|(name, reads)| program(name, reads));
        format!("seed = 7\n{}", stages.collect::<String>())
    };
    // What only follows from a circle is not part of it.
    let three = file(&[("a", "b"), ("after", "c"), ("b", "c"), ("c", "a")]);
    let said = refused(
        &[("p.toml", &three)],
        &[],
        &[
            "stages read each other in a circle: `a` reads `b.b` (line 7), `b` reads `c.c` (line 19), \
             `c` reads `a.a` (line 25)",
            "--> p.toml:7:13",
            "^^^^^",
            "hint: wire one of these inputs",
        ],
    );
    assert!(!said.contains("`after`"), "{said}");
    let alone = file(&[("a", "a")]);
    refused(
        &[("p.toml", &alone)],
        &[],
        &["a stage reads what it makes itself: `a` reads `a.a` (line 7)"],
    );
    let two = file(&[("a", "b"), ("b", "a"), ("c", "d"), ("d", "c")]);
    refused(
        &[("p.toml", &two)],
        &[],
        &[
            "`a` reads `b.b` (line 7)",
            "`c` reads `d.d` (line 19), `d` reads `c.c` (line 25)",
        ],
    );
    // In an extended file, and on the command line.
    let base = file(&[("a", "b"), ("b", "a")]);
    refused(
        &[
            ("base.toml", &base),
            ("p.toml", "extends = \"base.toml\"\n"),
        ],
        &[],
        &["--> base.toml:7:13", "(line 13)"],
    );
    refused(
        &[
            ("base.toml", &base),
            (
                "p.toml",
                "extends = \"base.toml\"\n[stages.b.inputs]\nit = \"a.a\"\n",
            ),
        ],
        &[],
        &["--> base.toml:7:13", "`b` reads `a.a` (p.toml:3)"],
    );
    let chain = file(&[("a", "a"), ("b", "a")]).replacen("inputs.it = \"a.a\"\n", "", 1);
    refused(
        &[("p.toml", &chain)],
        &["--set", "a.inputs.it=b.b"],
        &[
            "`a` reads `b.b` (`--set`), `b` reads `a.a` (p.toml:12)",
            "--> the command line",
        ],
    );
}

/// A file with one stage and these tables of sweeps.
fn swept(tables: &str) -> String {
    format!(
        "seed = 7\n[stages.a]\nkind = \"program\"\ncommand = [\"true\"]\nmakes = \"rows\"\n\
         columns.x = {{ type = \"number\" }}\n{tables}"
    )
}

#[test]
fn a_typo_in_a_sweep_is_shown_in_the_file() {
    let cases: [(&str, &[&str]); 11] = [
        // A stage, a key, a key below it.
        (
            "[[sweep]]\n\"b.timeout_s\" = [1, 2]\n",
            &[
                "unknown stage `b`",
                "p.toml:8:2",
                "| \"b.timeout_s\" = [1, 2]",
            ],
        ),
        (
            "[[sweep]]\n\"a.timeuot_s\" = [1, 2]\n",
            &["unknown key `timeuot_s`", "p.toml:8:4", "timeout_s`?"],
        ),
        (
            "[[sweep]]\n\"a.columns.x.kind\" = [\"text\", \"number\"]\n",
            &["unknown key `kind`", "p.toml:8:14"],
        ),
        (
            "[[sweep]]\nseeed = [1, 2]\n",
            &["unknown key `seeed`", "p.toml:8:1"],
        ),
        // A value, the second one.
        (
            "[[sweep]]\n\"a.timeout_s\" = [1, \"two\"]\n",
            &["found the text \"two\"", "p.toml:8:21"],
        ),
        (
            "[[sweep]]\n\"a.timeout_s\" = [\n    1,\n    -1,\n]\n",
            &["`timeout_s` is -1.0", "p.toml:10:5"],
        ),
        // The form of the tables.
        (
            "[sweep]\n\"a.timeout_s\" = [1, 2]\n",
            &["`sweep` must be an array of tables", "p.toml:7:2"],
        ),
        (
            "[[swep]]\n\"a.timeout_s\" = [1, 2]\n",
            &["unknown key `swep`", "p.toml:7:3", "did you mean `sweep`?"],
        ),
        (
            "[[sweep]]\na.timeout_s = [1, 2]\n",
            &[
                "`a.timeout_s` has dots",
                "write `\"a.timeout_s\"`",
                "p.toml:8:3",
            ],
        ),
        (
            "[[sweep]]\n\"a.timeout_s\" = 1\n",
            &["has no list of values", "p.toml:8:17"],
        ),
        (
            "[[sweep]]\n\"a.timeout_s\" = [1, 2]\n\"a.memory_mb\" = [100]\n",
            &[
                "has 1 values, and the key before it in its table 2",
                "p.toml:9:17",
            ],
        ),
    ];
    for (tables, parts) in cases {
        let said = refused(&[("p.toml", &swept(tables))], &[], parts);
        assert!(said.contains('^'), "{said}");
        assert!(!said.contains("--set"), "{said}");
        // In a file that another one extends.
        let parts: Vec<String> = parts
            .iter()
            .map(|part| part.replace("p.toml", "base.toml"))
            .collect();
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        let files = [
            ("base.toml", swept(tables)),
            ("p.toml", "extends = \"base.toml\"\n".to_owned()),
        ];
        let files = files.each_ref().map(|(name, text)| (*name, text.as_str()));
        refused(&files, &[], &parts);
    }
}

#[test]
fn a_long_line_gives_a_short_error() {
    let long = "x".repeat(50_000);
    let many = "true, ".repeat(20_000);
    let cases = [
        swept(&format!("timeout_s = \"{long}\"\n")),
        swept(&format!("{long} = 1\n")),
        swept(&format!(
            "options = {{ a = [{many}], }}\nread.{long} = \"some\"\n"
        )),
        swept(&format!("options = {{ a = [{many}], b = 1979-05-27 }}\n")),
        swept(&format!("options = {{ a = [{many}], b = }}\n")),
        swept(&format!("inputs.it = \"{long}.{long}\"\n")),
        swept("").replace("\"program\"", &format!("\"{long}\"")),
        swept("").replace("[stages.a]", &format!("[stages.{long}]")),
        swept(&format!("[[sweep]]\n\"a.{long}\" = [1, 2]\n")),
        swept(&format!("files.model = \"{long}\"\n")),
    ];
    for text in cases {
        let start: String = text.chars().take(120).collect();
        let (code, said) = planned(&[("p.toml", &text)], &[]);
        assert_eq!(code, 2, "{start}");
        assert!(said.contains("--> p.toml:"), "{start}");
        assert!(
            said.chars().count() < 3000,
            "{start}: {} characters",
            said.chars().count()
        );
        for line in said.lines().filter(|line| line.contains(" | ")) {
            assert!(line.chars().count() <= 100, "{line}");
        }
    }
    let argument = format!("a.timeout_s={long}");
    let (code, said) = planned(&[("p.toml", &swept(""))], &["--set", &argument]);
    assert_eq!(code, 2, "{said}");
    assert!(
        said.chars().count() < 3000,
        "{} characters",
        said.chars().count()
    );
}
