//! Claims of `pipelines/baseline.toml`: beside each motion that is drawn the straight line between its ends, both
//! through the same physics, and one table that compares them.

use std::{collections::BTreeMap, fs, process::Command};

use dataflow::Pipeline;
use serde_json::Value;

use crate::program::bench::{Bench, stderr};

/// The pipeline file, from the root of the project.
const FILE: &str = "pipelines/baseline.toml";
const OBJECTS: [&str; 2] = ["003_cracker_box", "006_mustard_bottle"];
const PER_OBJECT: usize = 4;

/// Runs the file with little training and few motions of two objects.
fn compared() -> Bench {
    let bench = Bench::new();
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", FILE, "--lake"])
        .arg(bench.lake());
    for value in [
        &format!("ingest.root={}", bench.root().display()),
        &format!("sample.objects={OBJECTS:?}"),
        "train.held_out_share=0.0",
        "train.network.points=64",
        "train.training.epochs=20",
        &format!("sample.per_object={PER_OBJECT}"),
        "refine.draws=1",
    ] {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    bench
}

/// Asks the lake in SQL.
fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let answer = bench.ask(&["query", sql, "--format", "json"]);
    assert!(answer.status.success(), "{}", stderr(&answer));
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    rows.collect::<Result<_, _>>().unwrap()
}

fn text<'a>(row: &'a Value, column: &str) -> &'a str {
    row[column].as_str().unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap()
}

#[test]
fn motions_and_their_lines_are_judged_by_the_same_physics() {
    let bench = compared();
    let rows = ask(
        &bench,
        "select candidate_id, generator, object, time_s, object_from_palm, q_rad from candidates \
         where stage <> 'sample'",
    );
    let all = |generator: &str| -> BTreeMap<&str, &Value> {
        let rows = rows
            .iter()
            .filter(|row| text(row, "generator") == generator);
        rows.map(|row| (text(row, "candidate_id"), row)).collect()
    };
    let (drawn, lines) = (all("refine"), all("interpolate"));
    assert_eq!(drawn.len(), OBJECTS.len() * PER_OBJECT);
    assert_eq!(lines.len(), drawn.len());
    let mut bent_n = 0;
    for (name, motion) in &drawn {
        let line = lines[format!("{name}-line").as_str()];
        assert_eq!(line["object"], motion["object"]);
        assert_eq!(line["time_s"], motion["time_s"]);
        let steps_n = numbers(&line["time_s"]).len();
        let [of_line, of_motion] = [line, motion].map(|row| {
            let q_rad = numbers(&row["q_rad"]);
            let poses = row["object_from_palm"].as_array().unwrap();
            let poses: Vec<Vec<f64>> = poses.iter().map(numbers).collect();
            let dof = q_rad.len() / steps_n;
            let steps = q_rad.chunks_exact(dof).zip(poses);
            steps
                .map(|(q, pose)| [q, &pose].concat())
                .collect::<Vec<Vec<f64>>>()
        });
        let apart = |step: usize| {
            let both = of_line[step].iter().zip(&of_motion[step]);
            both.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(apart(0) < 1e-9 && apart(steps_n - 1) < 1e-9, "{name}");
        bent_n += usize::from(apart(steps_n / 2) > 1e-3);
    }
    assert!(bent_n > drawn.len() / 2, "{bent_n} of {}", drawn.len());

    let rollouts = ask(
        &bench,
        "select stage, generator, candidate_id from rollouts order by candidate_id",
    );
    assert_eq!(rollouts.len(), rows.len());
    for row in &rollouts {
        let (stage, candidates) = match text(row, "generator") {
            "refine" => ("screen", &drawn),
            _ => ("screen_line", &lines),
        };
        assert_eq!(text(row, "stage"), stage);
        assert!(candidates.contains_key(text(row, "candidate_id")));
    }

    // One table compares them.
    let success = ask(
        &bench,
        "select object, generator, sum(candidates_n) as candidates_n, sum(draws_n) as draws_n, \
         sum(case when candidates_n > 0 and (rate < rate_low or rate > rate_high) then 1 else 0 end) \
         as outside_n from success group by object, generator order by object, generator",
    );
    let rows: Vec<(&str, &str)> = success
        .iter()
        .map(|row| (text(row, "object"), text(row, "generator")))
        .collect();
    let both = |object| [(object, "interpolate"), (object, "refine")];
    assert_eq!(rows, OBJECTS.map(both).concat());
    for row in &success {
        let number = |column: &str| row[column].as_f64().unwrap();
        assert_eq!(number("candidates_n"), PER_OBJECT as f64);
        assert!(number("draws_n") >= number("candidates_n"), "{row}");
        assert_eq!(number("outside_n"), 0.0, "{row}");
        let chart = match text(row, "generator") {
            "refine" => "screen",
            _ => "screen_line",
        };
        let chart = format!("reports/baseline/{chart}/success/all/rates.svg");
        let svg = fs::read_to_string(bench.lake().join(chart)).unwrap();
        assert!(svg.contains(text(row, "object")));
    }
    let rates = ask(
        &bench,
        "select generator, approach, objects_n, candidate_rate_low as low, \
         candidate_rate_mean as mean, candidate_rate_high as high \
         from rates where origin = 'all' order by generator",
    );
    let generators: Vec<&str> = rates.iter().map(|row| text(row, "generator")).collect();
    assert_eq!(generators, ["interpolate", "refine"]);
    for row in &rates {
        let number = |column: &str| row[column].as_f64().unwrap();
        assert_eq!(text(row, "approach"), "follow");
        assert_eq!(number("objects_n"), OBJECTS.len() as f64);
        assert!(
            (number("low")..=number("high")).contains(&number("mean")),
            "{row}"
        );
    }
}

#[test]
fn baseline_screens_are_those_of_the_main_pipeline_and_follow_the_motion() {
    let [file, whole] = [FILE, "pipelines/cgf.toml"].map(|file| {
        let text = fs::read_to_string(file).unwrap();
        Pipeline::parse(file.as_ref(), &text, &pipeline::kinds(), None, &[]).unwrap()
    });
    let [drawn, line] = ["screen", "screen_line"].map(|name| file.find(name).unwrap().config());
    assert_eq!(drawn, line);
    // But for trials under errors, which change no verdict.
    let (mut drawn, mut of_main) = (drawn, whole.find("screen").unwrap().config());
    for config in [&mut drawn, &mut of_main] {
        for trials in ["robustness", "pose_errors_per_object"] {
            assert!(config.as_object_mut().unwrap().remove(trials).is_some());
        }
    }
    assert_eq!(drawn, of_main);
    assert_eq!(drawn["protocol"]["approach"], "follow");
}
