//! An out-of-range number is refused when the pipeline file is read, before anything runs.

use std::{path::Path, sync::LazyLock};

use dataflow::{FileError, Kind, Override, Pipeline, Wiring};

use crate::program::bench::{Bench, pipeline_files, stderr};

const FILE: &str = include_str!("../../pipelines/cgf.toml");

/// The same with an arm.
const ARM: &str = include_str!("../../pipelines/arm.toml");

/// A program, which no shipped job has.
const PROGRAM: &str = "
[stages.program]
kind = 'program'
command = ['true']
makes = 'lengths'
columns.length_m = { type = 'number' }
";

/// Whole numbers that only name something, and take no memory or time.
const NAMES: [&str; 1] = ["dispatch.attempt"];

/// The file with a stage of every kind of which it has none, and so with every option.
fn whole() -> &'static str {
    static WHOLE: LazyLock<String> = LazyLock::new(|| {
        let kinds = pipeline::kinds();
        let read = Pipeline::parse(Path::new("pipelines/arm.toml"), ARM, &kinds, None, &[]);
        let stages = read.unwrap().stages;
        let makes = |kind: &Kind, artifact: &str| {
            let mut outputs = kind.outputs.iter();
            outputs.any(|output| output.artifact == artifact)
        };
        let maker = |artifact: &str| {
            let of_file = stages.iter().find(|stage| makes(&stage.kind, artifact));
            // A stage that is added below has the name of its kind.
            let added = || kinds.iter().find(|kind| makes(kind, artifact));
            let name = of_file.map(|stage| stage.name.to_string());
            name.unwrap_or_else(|| added().unwrap().name.to_owned())
        };
        let mut text = format!("{ARM}{PROGRAM}");
        let is_there = |kind: &Kind| stages.iter().any(|stage| stage.kind.name == kind.name);
        for kind in kinds
            .iter()
            .filter(|kind| kind.wiring == Wiring::Declared && !is_there(kind))
        {
            let name = kind.name;
            text += &format!("\n[stages.{name}]\nkind = '{name}'\n");
            for input in &kind.inputs {
                text += &format!("inputs.{input} = '{}.{input}'\n", maker(input));
            }
            let options = kind.options();
            for shared in ["hand", "protocol"] {
                let table = format!("{shared}.");
                if options
                    .iter()
                    .any(|it| it.key == shared || it.key.starts_with(&table))
                {
                    text += &format!("shared.{shared} = '{shared}'\n");
                }
            }
        }
        text
    });
    &WHOLE
}

/// Reads the pipeline, with every option, and with one value in place of its own.
fn read(set: &str) -> Result<Pipeline, FileError> {
    let given: Override = set.parse().unwrap();
    let path = Path::new("pipelines/arm.toml");
    Pipeline::parse(path, whole(), &pipeline::kinds(), None, &[given])
}

/// The options of these types of every stage of the pipeline.
fn options(kind_of: &str) -> Vec<String> {
    let mut found = Vec::new();
    for kind in pipeline::kinds() {
        for option in kind.options() {
            if option.value.split(" or ").any(|word| word == kind_of) {
                found.push(format!("{}.{}", kind.name, option.key));
            }
        }
    }
    found
}

#[test]
fn every_count_has_bounds_and_says_why_they_are_there() {
    let counts = options("integer");
    assert!(counts.len() >= 25, "{counts:?}");
    let mut faults = Vec::new();
    for option in counts
        .iter()
        .filter(|option| !NAMES.contains(&option.as_str()))
    {
        for value in ["4294967295", "4000000000", "9223372036854775807"] {
            let Err(err) = read(&format!("{option}={value}")) else {
                faults.push(format!("{option} can be {value}"));
                continue;
            };
            // A value that overflows the option's type is reported as such.
            let key = option.split_once('.').unwrap().1;
            let said = err.to_string();
            if value != "9223372036854775807"
                && !(said.contains(&format!("`{key}` is {value}")) && said.contains(": "))
            {
                faults.push(format!("{option} = {value}: {said}"));
            }
        }
        for value in ["-1", "1.5", "nan"] {
            if read(&format!("{option}={value}")).is_ok() {
                faults.push(format!("{option} can be {value}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn non_finite_numbers_are_refused() {
    let numbers = options("number");
    assert!(numbers.len() >= 100, "{}", numbers.len());
    let mut faults = Vec::new();
    for option in &numbers {
        for value in ["nan", "inf", "-inf"] {
            if read(&format!("{option}={value}")).is_ok() {
                faults.push(format!("{option} can be {value}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn shipped_pipelines_are_within_bounds() {
    for path in pipeline_files() {
        let source = std::fs::read_to_string(&path).unwrap();
        let read = Pipeline::parse(&path, &source, &pipeline::kinds(), None, &[]);
        assert!(read.is_ok(), "{}: {:?}", path.display(), read.err());
    }
}

/// Plans with these values, and returns the error; nothing may be written.
fn refused(values: &[&str]) -> String {
    let bench = Bench::new();
    let sets = values.iter().flat_map(|value| ["--set", value]);
    let arguments: Vec<&str> = sets.collect();
    for command in ["plan", "run"] {
        let ended = bench.command(command, &arguments).output().unwrap();
        assert_eq!(
            ended.status.code(),
            Some(2),
            "{values:?}: {}",
            stderr(&ended)
        );
        assert!(!bench.lake().exists());
        if command == "run" {
            return stderr(&ended);
        }
    }
    unreachable!()
}

#[test]
fn out_of_bounds_value_names_key_bound_and_reason() {
    let check = |values: &[&str], says: &[&str]| {
        let said = refused(values);
        for part in says {
            assert!(said.contains(part), "no `{part}` in {said}");
        }
    };
    let hint = "hint: `pipeline stages sample` lists every option";
    check(
        &["sample.per_object=4000000000"],
        &[
            "error: stage `sample`: `per_object` is 4000000000, and must be from 1 to 1000000",
            hint,
        ],
    );
    // Two values that are each well, and are too many together.
    check(
        &["sample.per_object=1000000", "sample.steps=1000"],
        &["`per_object`", "1000000000 steps", "held in memory"],
    );
    check(
        &["train.training.batch=1000000", "train.network.points=65536"],
        &["`training.batch` is 1000000", "GB of at most"],
    );
    check(
        &["train.network.point_widths=[16384, 16384, 16384]"],
        &["`network.point_widths` is [16384, 16384, 16384]", "weights"],
    );
    check(
        &["train.network.decoder_widths=[4000000000]"],
        &[
            "`network.decoder_widths` is [4000000000]",
            "from 1 to 16384",
        ],
    );
    check(
        &["train.network.hand_widths=[]"],
        &["`network.hand_widths` is []"],
    );
    check(
        &[
            "screen.protocol.hold_s=3600",
            "screen.scene.time_step_s=1e-6",
        ],
        &["`protocol.hold_s`", "control steps"],
    );
    check(
        &["dispatch.protocol.reach_s=1e300"],
        &["`protocol.reach_s` is 1e300, and must be more than 0 and at most 3600"],
    );
    check(
        &["retarget.field_spacing_m=1e-12"],
        &["`field_spacing_m` is 1e-12, and must be from 0.0001 to 0.1"],
    );
    // Everything that is wrong is said at once.
    check(
        &[
            "ingest.points_n=0",
            "sample.draws=0",
            "dispatch.limits.max_slowdown=1e9",
        ],
        &["`points_n` is 0", "`draws` is 0", "`limits.max_slowdown`"],
    );
}

#[test]
fn a_value_of_the_file_is_shown_where_it_stands() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("much.toml");
    let file = FILE.replacen("per_object = 256", "per_object = 4_000_000_000", 1);
    crate::program::bench::put(&path, &file);
    let plan = std::process::Command::new(env!("CARGO_BIN_EXE_pipeline"))
        .arg("plan")
        .arg(&path)
        .arg("--lake")
        .arg(folder.path().join("lake"))
        .output()
        .unwrap();
    assert_eq!(plan.status.code(), Some(2));
    let said = stderr(&plan);
    assert!(said.contains("| per_object = 4_000_000_000"), "{said}");
    assert!(said.contains("^^^^^^^^^^^^^"), "{said}");
}
