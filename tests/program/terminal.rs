//! Output fits a terminal of 80 columns, and is colored only where color is supported.

use std::process::{Command, Output};

use crate::program::{
    bench::{Bench, stderr, stdout},
    commands::{finished, subcommands},
};

const WIDTH: usize = 80;
/// Columns of the lines of a run, which are cut on a narrower terminal.
const RUN_WIDTH: usize = 100;

/// Lines of a screen.
const HEIGHT: usize = 24;

fn pipeline(arguments: &[&str], environment: &[(&str, &str)]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env_remove("COLUMNS")
        .env_remove("NO_COLOR")
        .env_remove("CLICOLOR_FORCE")
        .envs(environment.iter().copied())
        .args(arguments)
        .output()
        .unwrap()
}

fn assert_fits(text: &str, what: &str) {
    for line in text.lines() {
        let n = line.chars().count();
        assert!(n <= WIDTH, "{what}: {n} characters in\n{line}");
    }
}

#[test]
fn the_short_help_of_every_command_is_one_screen() {
    let narrow = [("COLUMNS", "80")];
    let mut commands: Vec<Vec<String>> = vec![vec!["-h".to_owned()]];
    commands.extend(
        subcommands()
            .into_iter()
            .map(|command| vec![command, "-h".to_owned()]),
    );
    assert!(commands.len() > 15);
    for arguments in commands {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let help = stdout(&pipeline(&arguments, &narrow));
        assert_fits(&help, &format!("{arguments:?}"));
        let n = help.lines().count();
        assert!(
            (5..=HEIGHT).contains(&n),
            "{arguments:?}: {n} lines\n{help}"
        );
        // The long help says what the short one leaves out.
        let long: Vec<&str> = arguments
            .iter()
            .map(|&word| if word == "-h" { "--help" } else { word })
            .collect();
        assert!(stdout(&pipeline(&long, &narrow)).lines().count() >= n);
    }
    // It works, though the list leaves it out.
    let help = pipeline(&["help", "run"], &narrow);
    assert!(stdout(&help).contains("--until"), "{}", stdout(&help));
}

#[test]
fn the_stages_of_the_main_job_have_lines_that_fit() {
    let bench = Bench::new();
    let ran = bench.run_well(&[]);
    let text = stderr(&ran);
    assert!(text.lines().count() > 16, "{text}");
    let is_about_stages = |line: &&str| !line.starts_with("report") && !line.starts_with("next");
    for line in text.lines().filter(is_about_stages) {
        let n = line.chars().count();
        assert!(n <= RUN_WIDTH, "{n} characters in\n{line}");
    }
    let again = stderr(&bench.run_well(&[]));
    let done = again.lines().find(|line| line.starts_with("done")).unwrap();
    assert!(done.contains("nothing to run"), "{done}");
}

#[test]
fn plans_and_stages_fit_a_narrow_terminal() {
    let narrow = |command: &mut Command| {
        let output = command.env("COLUMNS", "80").output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stdout(&output)
    };
    let change = ["--set", "retarget.smoothness_weight=0.3"];
    for arguments in [&[][..], &change] {
        let plan = narrow(&mut finished().command("plan", arguments));
        assert!(plan.lines().count() > 3, "{plan}");
        assert_fits(&plan, "plan");
    }
    let change = narrow(&mut finished().command("plan", &change));
    assert!(
        change.contains("units: `smoothness_weight` changed"),
        "{change}"
    );
    let overview = stdout(&pipeline(&["stages"], &[("COLUMNS", "80")]));
    assert_fits(&overview, "stages");
    let kinds = overview
        .lines()
        .take_while(|line| !line.is_empty())
        .filter(|line| !line.starts_with(' '))
        .filter_map(|line| line.split_whitespace().next());
    let mut n = 0;
    for kind in kinds {
        let options = stdout(&pipeline(&["stages", kind], &[("COLUMNS", "80")]));
        assert_fits(&options, kind);
        // Wrapped, not cut: every word is still there.
        let wide = stdout(&pipeline(&["stages", kind], &[]));
        assert!(
            !options.contains('…') || wide.contains('…'),
            "{kind}: {options}"
        );
        n += 1;
    }
    assert!(n >= 8, "{overview}");
}

#[test]
fn colors_are_shown_where_they_are_asked_for_and_nowhere_else() {
    let wrong: &[&str] = &[
        "plan",
        "pipelines/cgf.toml",
        "--set",
        "train.training.epochs=many",
    ];
    for arguments in [
        wrong,
        &["doctor"],
        &["query", "selct 1"],
        &["run", "-h"],
        &["--nothing"],
    ] {
        let is_colored = |environment: &[(&str, &str)]| {
            let output = pipeline(arguments, environment);
            (stdout(&output) + &stderr(&output)).contains('\u{1b}')
        };
        assert!(!is_colored(&[]), "{arguments:?}");
        assert!(!is_colored(&[("NO_COLOR", "1")]), "{arguments:?}");
        assert!(is_colored(&[("CLICOLOR_FORCE", "1")]), "{arguments:?}");
        let both = [("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")];
        assert!(!is_colored(&both), "{arguments:?}");
    }
    let colored = stderr(&pipeline(wrong, &[("CLICOLOR_FORCE", "1")]));
    for word in ["error:", "hint:", "^^^^"] {
        assert!(
            colored.contains(&format!("m{word}\u{1b}[0m")),
            "{word}: {colored:?}"
        );
    }
    // Data is for programs, whatever is asked for.
    let data = pipeline(
        &["query", "select 1 as one", "--format", "csv"],
        &[("CLICOLOR_FORCE", "1")],
    );
    assert!(!stdout(&data).contains('\u{1b}'));
}
