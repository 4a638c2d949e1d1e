//! READMEs say what the program does: every `$` line prints the output below it, and the table of
//! stages is that of the program.
//!
//! A line `…` stands for any lines. Times depend on the machine and may be any. Training rounds
//! differently on other processors: whole numbers may differ by a tenth, other figures by half.

use std::{fs, path::Path, process::Command};

use crate::program::{
    bench::{stderr, stdout},
    page,
    tables::readme::Readme,
};

/// A command of a README with its output.
#[derive(Debug)]
struct Shown {
    /// File and number of its line.
    place: String,
    command: String,
    printed: Vec<String>,
}

/// The commands in the `console` blocks of a README.
fn shown(readme: &Readme) -> Vec<Shown> {
    let name = readme.name();
    let mut commands: Vec<Shown> = Vec::new();
    let mut is_console = false;
    for (idx, line) in readme.lines.iter().enumerate() {
        if let Some(language) = line.strip_prefix("```") {
            is_console = language == "console";
        } else if !is_console {
            assert!(!line.starts_with("$ "), "{}:{}", name.display(), idx + 1);
        } else if let Some(command) = line.strip_prefix("$ ") {
            commands.push(Shown {
                place: format!("{}:{}", name.display(), idx + 1),
                command: command.to_owned(),
                printed: Vec::new(),
            });
        } else {
            commands.last_mut().unwrap().printed.push(line.to_owned());
        }
    }
    commands
}

/// The arguments of a command line of words, and of texts in double quotes.
fn arguments(command: &str) -> Vec<String> {
    let mut arguments = Vec::new();
    for (idx, part) in command.split('"').enumerate() {
        if idx % 2 == 1 {
            arguments.push(part.to_owned());
        } else {
            arguments.extend(part.split_whitespace().map(str::to_owned));
        }
    }
    arguments
}

/// A piece of a line: two lines are the same if they have the same pieces.
#[derive(Debug, Clone, Copy)]
enum Piece<'a> {
    Text(&'a str),
    Count(f64),
    Figure(f64),
}

impl PartialEq for Piece<'_> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Piece::Text(a), Piece::Text(b)) => a == b,
            (Piece::Figure(a), Piece::Figure(b)) => (a - b).abs() <= 0.5 * a.max(*b),
            (Piece::Count(a) | Piece::Figure(a), Piece::Count(b) | Piece::Figure(b)) => {
                (a - b).abs() <= 0.1 * a.max(*b)
            }
            _ => false,
        }
    }
}

/// The pieces of a line. How far apart they stand does not count.
fn pieces(line: &str) -> Vec<Piece<'_>> {
    let mut pieces = Vec::new();
    for mut word in line.split_whitespace() {
        while !word.is_empty() {
            let is_number = word.starts_with(|c: char| c.is_ascii_digit());
            let end =
                word.find(|c: char| (c.is_ascii_digit() || (is_number && c == '.')) != is_number);
            let (piece, rest) = word.split_at(end.unwrap_or(word.len()));
            pieces.push(match piece.parse() {
                Ok(figure) if is_number && piece.contains('.') => Piece::Figure(figure),
                Ok(count) if is_number => Piece::Count(count),
                _ => Piece::Text(piece),
            });
            word = rest;
        }
    }
    // Less than a minute, or more, depends on the machine too.
    let mut told = Vec::new();
    let mut left = pieces.as_slice();
    loop {
        left = match left {
            [
                Piece::Count(_),
                Piece::Text("min"),
                Piece::Count(_),
                Piece::Text("s"),
                rest @ ..,
            ]
            | [Piece::Figure(_), Piece::Text("s"), rest @ ..] => {
                told.push(Piece::Text("TIME"));
                rest
            }
            [piece, rest @ ..] => {
                told.push(*piece);
                rest
            }
            [] => return told,
        };
    }
}

/// Whether lines are as expected.
fn is_same(expected: &[String], printed: &[&str]) -> bool {
    match expected {
        [] => printed.is_empty(),
        [any, rest @ ..] if any.trim() == "…" => {
            (0..=printed.len()).any(|n_left_out| is_same(rest, &printed[n_left_out..]))
        }
        [line, rest @ ..] => printed
            .split_first()
            .is_some_and(|(first, others)| pieces(line) == pieces(first) && is_same(rest, others)),
    }
}

#[test]
fn every_command_of_a_readme_prints_what_stands_below_it() {
    let commands: Vec<Shown> = Readme::all().unwrap().iter().flat_map(shown).collect();
    assert!(commands.len() > 5, "{commands:#?}");
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[String], folder: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        let command = command.args(arguments).current_dir(folder);
        command.env_remove("COLUMNS").output().unwrap()
    };
    let made = run(&arguments("new lab"), folder.path());
    assert!(made.status.success(), "{}", stderr(&made));
    let lab = folder.path().join("lab");
    for Shown {
        place,
        command,
        printed,
    } in commands
    {
        let mut arguments = arguments(&command);
        assert_eq!(arguments.remove(0), "pipeline", "{place}");
        let output = run(&arguments, &lab);
        let text = stderr(&output) + &stdout(&output);
        let lines: Vec<&str> = text.lines().collect();
        assert!(
            is_same(&printed, &lines),
            "{place}: `{command}` does not print\n{}\nbut\n{text}",
            printed.join("\n")
        );
    }
    page::check(&lab);
}

#[test]
fn times_may_be_any_figures_within_half_counts_within_a_tenth_and_words_are_equal() {
    let expected = "done   objects 15 of 15, candidates 91.6 %, executions 45 of 45 in 1 min 03 s";
    for (printed, is_expected) in [
        (
            "done objects 15 of 15, candidates 88.4 %, executions 44 of 45 in 58.2 s",
            true,
        ),
        (
            "done objects 15 of 15, candidates 91.6 %, executions 30 of 45 in 58.2 s",
            false,
        ),
        (
            "done objects 15 of 15, candidates 12.4 %, executions 45 of 45 in 58.2 s",
            false,
        ),
        (
            "done objects 15 of 15, candidates 91.6 %, failures 45 of 45 in 58.2 s",
            false,
        ),
        (
            "done objects 15 of 15, candidates 91.6 %, executions 45 of 45 cached",
            false,
        ),
    ] {
        assert_eq!(
            is_same(&[expected.to_owned()], &[printed]),
            is_expected,
            "{printed}"
        );
    }
    let some = ["a".to_owned(), "…".to_owned(), "c".to_owned()];
    for (printed, is_expected) in [
        (&["a", "c"][..], true),
        (&["a", "b", "b", "c"], true),
        (&["a", "b"], false),
        (&["a", "c", "d"], false),
    ] {
        assert_eq!(is_same(&some, printed), is_expected, "{printed:?}");
    }
}

/// The words in backticks.
fn quoted(text: &str) -> Vec<String> {
    let words = text.split('`').skip(1).step_by(2);
    words.map(str::to_owned).collect()
}

#[test]
fn the_table_of_stages_is_that_of_the_program() {
    let listed = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .arg("stages")
        .output()
        .unwrap();
    let mut kinds: Vec<[Vec<String>; 3]> = Vec::new();
    let text = stdout(&listed);
    for line in text.lines().take_while(|line| !line.is_empty()) {
        let names = |list: &str| -> Vec<String> {
            list.split(", ")
                .map(|name| name.trim().to_owned())
                .collect()
        };
        match line.trim().split_once("  ") {
            Some(("reads", list)) => kinds.last_mut().unwrap()[1].extend(names(list)),
            Some(("makes", list)) => kinds.last_mut().unwrap()[2] = names(list),
            _ => {
                let kind = line.split_whitespace().next().unwrap().to_owned();
                kinds.push([vec![kind], Vec::new(), Vec::new()]);
            }
        }
    }
    let readme = ["stages/README.md", "stages/baselines/README.md"].map(|path| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
        fs::read_to_string(path).unwrap()
    });
    let rows = readme.iter().flat_map(|readme| readme.lines());
    let rows = rows.filter(|line| line.starts_with("| `"));
    let mut rows: Vec<[Vec<String>; 3]> = rows
        .map(|row| {
            let cells: Vec<&str> = row.split('|').collect();
            let [kind, reads, makes, reports] = [1, 2, 3, 4].map(|at| quoted(cells[at]));
            [kind, reads, [makes, reports].concat()]
        })
        .collect();
    rows.sort();
    kinds.sort();
    assert_eq!(rows, kinds);
}
