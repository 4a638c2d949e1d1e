//! READMEs say what the program does: every `$` line prints the output below it, and the tables of
//! stages are those of the program.
//!
//! A line `…` stands for any lines. Times depend on the machine and may be any. Training rounds
//! differently on other processors: whole numbers may differ by a tenth, other figures by half, and
//! percentages besides by ten points at most.

use std::{path::Path, process::Command};

use dataflow::{Kind, OutputInfo, Wiring};

use crate::program::{
    bench::{golden, stderr, stdout},
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
    /// A figure before `%`, which is of tenths; a whole one is a count.
    Percentage(f64),
}

impl PartialEq for Piece<'_> {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Piece::Text(a), Piece::Text(b)) => a == b,
            (Piece::Figure(a), Piece::Figure(b)) => (a - b).abs() <= 0.5 * a.max(*b),
            (Piece::Percentage(a), Piece::Percentage(b)) => {
                (a - b).abs() <= (0.5 * a.max(*b)).min(10.0)
            }
            (
                Piece::Count(a) | Piece::Figure(a) | Piece::Percentage(a),
                Piece::Count(b) | Piece::Figure(b) | Piece::Percentage(b),
            ) => (a - b).abs() <= 0.1 * a.max(*b),
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
            [
                Piece::Figure(percentage),
                unit @ Piece::Text(text),
                rest @ ..,
            ] if text.starts_with('%') => {
                told.extend([Piece::Percentage(*percentage), *unit]);
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
fn times_may_be_any_other_numbers_are_within_bounds_and_words_are_equal() {
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
            "done objects 15 of 15, candidates 46.0 %, executions 45 of 45 in 58.2 s",
            false,
        ),
        (
            "done objects 15 of 15, candidates 85 %, executions 45 of 45 in 58.2 s",
            true,
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
    for (expected, printed, is_expected) in [
        ("error 9.8 mm", "error 13.7 mm", true),
        ("error 9.8 mm", "error 24.0 mm", false),
        ("4 % collide", "7 % collide", false),
        ("4.0 % collide", "9.0 % collide", false),
    ] {
        let is_found = is_same(&[expected.to_owned()], &[printed]);
        assert_eq!(is_found, is_expected, "{printed}");
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

/// What a row says of a kind of stage, but for its sentence: its name, what it reads, makes and reports.
fn columns(kind: &Kind) -> String {
    let quoted = |names: &[&str]| {
        let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
        quoted.join(", ")
    };
    let is_report = |output: &&OutputInfo| {
        let mut parts = output.code.iter();
        parts.any(|(name, _)| name.starts_with("report-"))
    };
    let named = |is_wanted: &dyn Fn(&&OutputInfo) -> bool| -> Vec<&str> {
        let wanted = kind.outputs.iter().filter(is_wanted);
        wanted.map(|output| output.artifact).collect()
    };
    let [results, reports] = [named(&|output| !is_report(output)), named(&is_report)];
    let (reads, makes) = match kind.wiring {
        Wiring::Free => (vec!["any"], vec!["any"]),
        Wiring::Declared => (kind.all_inputs(), results),
    };
    let reads = if reads.is_empty() {
        "files".to_owned()
    } else {
        quoted(&reads)
    };
    let [makes, reports] = [makes, reports].map(|names| quoted(&names));
    let row = format!("| `{}` | {reads} | {makes} | {reports}", kind.name);
    row.trim_end().to_owned()
}

/// `PIPELINE_WRITE_GOLDEN=1` writes the tables, with the sentences that stand there; that of a new stage is the program's.
#[test]
fn the_golden_tables_of_stages_are_those_of_the_program() {
    let baselines = Path::new("stages/baselines");
    for folder in [Path::new("stages"), baselines] {
        let kinds = pipeline::kinds().into_iter();
        let kinds =
            kinds.filter(|kind| baselines.join(kind.name).is_dir() == (folder == baselines));
        let path = folder.join("README.md");
        let mut readme = Readme::read(path.clone()).unwrap();
        let is_row = |line: &String| line.starts_with("| `");
        let start = readme.lines.iter().position(is_row).unwrap();
        let n = readme.lines[start..]
            .iter()
            .take_while(|line| is_row(line))
            .count();
        let rows = readme.lines[start..start + n].to_vec();
        let of_kinds = kinds.map(|kind| {
            let name = format!("| `{}` |", kind.name);
            let row = rows.iter().find(|row| row.starts_with(&name));
            let sentence = row
                .and_then(|row| row.split('|').nth(5))
                .map_or(kind.about, str::trim);
            format!("{} | {sentence} |", columns(&kind))
        });
        readme.lines.splice(start..start + n, of_kinds);
        let text = readme.lines.join("\n") + "\n";
        assert_eq!(text, golden(&path, &text), "{}", path.display());
    }
}
