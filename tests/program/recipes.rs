//! The recipes of `schemas/python.md`, as they are printed there, and the program that `pipeline stages program`
//! prints.

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::program::{
    bench::{Bench, copy_folder, stderr, stdout},
    cell_lab::Lab,
    python::python,
};

const PAGE: &str = include_str!("../../schemas/python.md");
/// The lake and the endpoint in it.
const LAKE: &str = "data/lake";
const ENDPOINT: &str = "tcp/127.0.0.1:7447";
/// Greatest difference of a number decoded in numpy.
const DECODED: f64 = 1e-4;

/// The recipe below a heading.
fn recipe(heading: &str) -> &'static str {
    let (_, below) = PAGE.split_once(&format!("\n## {heading}\n")).unwrap();
    let (_, program) = below.split_once("```python\n").unwrap();
    program.split_once("```").unwrap().0
}

/// Runs a recipe on a lab's lake, and returns what it prints.
fn run(python: &str, heading: &str, lab: &Lab) -> String {
    let lake = lab.bench.lake().display().to_string();
    let program = recipe(heading)
        .replace(LAKE, &lake)
        .replace(ENDPOINT, &lab.endpoint);
    let built = Path::new(env!("CARGO_BIN_EXE_pipeline")).parent().unwrap();
    let paths = env::var_os("PATH").unwrap_or_default();
    let paths = [built.to_owned()]
        .into_iter()
        .chain(env::split_paths(&paths));
    let ran = Command::new(python)
        .args(["-c", &program])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env("PATH", env::join_paths(paths).unwrap())
        .output()
        .unwrap();
    assert!(
        ran.status.success(),
        "{heading}: {}{}",
        stdout(&ran),
        stderr(&ran)
    );
    stdout(&ran)
}

/// The tables of a lake, by the names of their folders.
fn tables(lake: &Path) -> Vec<String> {
    let folders = fs::read_dir(lake.join("tables")).unwrap();
    folders
        .map(|folder| folder.unwrap().file_name().into_string().unwrap())
        .collect()
}

#[test]
fn every_recipe_does_what_its_page_says() {
    let lab = Lab::new();
    let every = tables(&lab.bench.lake());
    assert!(every.len() > 15, "{every:?}");
    for (heading, modules) in [
        ("Every table, with polars", &["polars"][..]),
        ("Every table, with DuckDB", &["duckdb"]),
        ("Every table, with pandas", &["pandas", "pyarrow"]),
    ] {
        let Some(python) = python(modules) else {
            continue;
        };
        let said = run(&python, heading, &lab);
        for table in &every {
            let line = said
                .lines()
                .find(|line| line.starts_with(&format!("{table} ")));
            let line = line.unwrap_or_else(|| panic!("{heading}: no `{table}` in\n{said}"));
            let rows: u64 = line.split(' ').nth(1).unwrap().parse().unwrap();
            assert!(rows > 0, "{heading}: {line}");
        }
        assert!(said.contains("screen"), "{heading}: {said}");
    }
    tables_of_other_pipelines_are_kept_apart(&lab);
    if let Some(python) = python(&["safetensors", "numpy", "pyarrow"]) {
        let said = run(&python, "The grasping function, in numpy", &lab);
        let words: Vec<&str> = said.split_whitespace().collect();
        let (motions, worst): (u32, f64) = (words[0].parse().unwrap(), words[4].parse().unwrap());
        println!("{said}");
        assert!(motions >= 16 && worst < DECODED, "{said}");
    }
    if let Some(python) = python(&[]) {
        let said = run(&python, "`pipeline` itself", &lab);
        assert!(said.contains("screen rollouts {'"), "{said}");
        assert!(
            said.contains("'rate': ") && said.contains("finished"),
            "{said}"
        );
    }
    if let Some(python) = python(&["zenoh"]) {
        let cell = lab.cell(&[]);
        let said = run(&python, "A cell, over zenoh", &lab);
        drop(cell);
        assert!(
            said.contains("results ") && said.contains("cgf/cell/simulated/state {"),
            "{said}"
        );
    }
}

/// The rows of a table are those of one pipeline.
fn tables_of_other_pipelines_are_kept_apart(lab: &Lab) {
    let tables = lab.bench.lake().join("tables/objects");
    let rows = |said: &str| -> Option<String> {
        let mut lines = said.lines();
        lines
            .find(|line| line.starts_with("objects "))
            .map(str::to_owned)
    };
    let stage = tables.join("pipeline=cgf/stage=ingest");
    for (heading, module) in [
        ("Every table, with polars", "polars"),
        ("Every table, with pandas", "pandas"),
    ] {
        let Some(python) = python(&[module, "pyarrow"]) else {
            continue;
        };
        let before = rows(&run(&python, heading, lab));
        let other = tables.join("pipeline=other");
        copy_folder(&stage, &other.join("stage=ingest"));
        let with_other = rows(&run(&python, heading, lab));
        fs::remove_dir_all(other).unwrap();
        assert_eq!(with_other, before, "{heading}");
    }
}

#[test]
fn every_recipe_is_run() {
    let headings = PAGE.lines().filter(|line| line.starts_with("## "));
    assert_eq!(headings.count(), PAGE.matches("```python").count());
    assert_eq!(PAGE.matches("```python").count(), 6, "run new ones above");
    let dispatcher = "crates/cell/examples/python/dispatcher.py";
    assert!(PAGE.contains(dispatcher) && PathBuf::from(dispatcher).is_file());
}

/// The output of `pipeline stages program`: the stage and its program.
#[test]
fn the_printed_program_works_as_it_stands() {
    let Some(python) = python(&["pyarrow"]) else {
        return;
    };
    let bench = Bench::new();
    let printed = Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .args(["stages", "program"])
        .output()
        .unwrap();
    let printed = stdout(&printed);
    let (_, page) = printed.split_once("In the pipeline file:\n").unwrap();
    let block = |after: &str| -> String {
        let (_, rest) = page.split_once(after).unwrap();
        let lines = rest.lines().skip_while(|line| line.trim().is_empty());
        let lines = lines.take_while(|line| line.is_empty() || line.starts_with("    "));
        lines
            .map(|line| line.strip_prefix("    ").unwrap_or(line))
            .collect::<Vec<_>>()
            .join("\n")
    };
    let (stage, program) = (block(""), block("pip install pyarrow`:\n"));
    let n_lines = program
        .lines()
        .filter(|line| !line.trim().is_empty())
        .count();
    assert!(n_lines <= 20, "{n_lines} lines");
    let folder = tempfile::tempdir().unwrap();
    let script = folder.path().join("margin.py");
    fs::write(&script, program).unwrap();
    let stage = stage.replace("\"python3\"", &format!("{python:?}"));
    let stage = stage.replace("margin.py", &script.display().to_string());
    let file = folder.path().join("margin.toml");
    let root = env!("CARGO_MANIFEST_DIR");
    let text = format!("extends = \"{root}/pipelines/replay.toml\"\n\n{stage}\n");
    fs::write(&file, text).unwrap();
    bench.run_own(&file);
    let query = "select count(*) as n, sum(abs(margin_m - (lift_m - 0.08))) as off from margins \
                 join rollouts on margins.candidate_id = rollouts.candidate_id";
    let asked = bench.ask(&["query", query, "--format", "csv"]);
    let said = stdout(&asked);
    let row = said
        .lines()
        .nth(1)
        .unwrap_or_else(|| panic!("{}", stderr(&asked)));
    let (n, off) = row.split_once(',').unwrap();
    assert!(
        n.parse::<u32>().unwrap() > 10 && off.parse::<f64>().unwrap() < 1e-9,
        "{said}"
    );
}
