//! Claims of `pipelines/feedforward.toml` and `pipelines/noise.toml`: every variant is screened
//! over shared stages, and the query beside the screen's README makes its table.

use std::{path::Path, process::Command};

use serde_json::Value;

use crate::{
    bench::{Bench, stderr},
    tables::query::Query,
};

/// Runs a study with little training and few motions, its sweeps cut short.
fn studied(file: &str, objects: &[&str], values: &[&str]) -> Bench {
    let bench = Bench::new();
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", file, "--lake"])
        .arg(bench.lake());
    let root = format!("ingest.root={}", bench.root().display());
    let chosen = format!("sample.objects={objects:?}");
    let common = [
        root.as_str(),
        chosen.as_str(),
        "train.held_out_share=0.0",
        "train.network.points=64",
        "train.training.epochs=20",
    ];
    for value in common.iter().chain(values) {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    bench
}

/// Returns the query of a table in the screen's README.
fn documented(table: &str) -> String {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/stages/screen/tables");
    let query = Query::read(&Path::new(folder).join(table)).unwrap();
    query.sql
}

fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let answer = bench.ask(&["query", sql, "--format", "json"]);
    assert!(answer.status.success(), "{}\n{sql}", stderr(&answer));
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    rows.collect::<Result<_, _>>().unwrap()
}

fn number(row: &Value, column: &str) -> f64 {
    row[column]
        .as_f64()
        .unwrap_or_else(|| panic!("no `{column}` in {row}"))
}

#[test]
fn feedforward_is_compared_with_pd_at_every_speed_and_mass() {
    const OBJECTS: [&str; 2] = ["003_cracker_box", "006_mustard_bottle"];
    const PER_OBJECT: f64 = 4.0;
    let bench = studied(
        "pipelines/feedforward.toml",
        &OBJECTS,
        &[
            &format!("sample.per_object={PER_OBJECT}"),
            "refine.draws=1",
            "screen.protocol.reach_s=0.8,0.4",
            "screen.scene.hand_mass_scale=1.0,3.0",
        ],
    );
    // Everything before the screen is made once.
    let made = ask(
        &bench,
        "select stage, count(*) as n from units where stage in ('sample', 'screen') \
         and artifact in ('candidates', 'rollouts') and made_now group by stage order by stage",
    );
    let made: Vec<f64> = made.iter().map(|row| number(row, "n")).collect();
    assert_eq!(made, [2.0, 2.0 * 8.0]);

    let screened = ask(
        &bench,
        "select sum(candidates_n) as n from all_success group by run",
    );
    let screened: Vec<f64> = screened.iter().map(|row| number(row, "n")).collect();
    assert_eq!(screened, [PER_OBJECT * OBJECTS.len() as f64; 8]);

    let rows = ask(&bench, &documented("feedforward.sql"));
    let settings: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| (number(row, "speed"), number(row, "hand's mass")))
        .collect();
    assert_eq!(settings, [(1.0, 1.0), (1.0, 3.0), (2.0, 1.0), (2.0, 3.0)]);
    for row in &rows {
        let [pd, ahead] = ["PD, %", "with feedforward, %"].map(|column| number(row, column));
        for share in [pd, ahead] {
            assert!((0.0..=100.0).contains(&share), "{row}");
        }
        assert!((ahead - pd - number(row, "gain")).abs() < 0.11, "{row}");
    }

    // The controllers do differ: not every figure of every rollout is the same.
    let lifts = ask(
        &bench,
        "select candidate_id, count(distinct displacement_m) as n from all_rollouts \
         where cost_n > 0 group by candidate_id",
    );
    assert!(lifts.iter().any(|row| number(row, "n") > 2.0), "{lifts:?}");
}

#[test]
fn noise_on_points_and_poses_is_screened_over_one_training() {
    const OBJECTS: [&str; 2] = ["006_mustard_bottle", "025_mug"];
    let bench = studied(
        "pipelines/noise.toml",
        &OBJECTS,
        &[
            &format!("sample_noisy.objects={OBJECTS:?}"),
            "sample.per_object=6",
            "sample_noisy.per_object=6",
            "sample_noisy.point_noise=0.0,1.0",
            "screen_pose.pose_noise=1.0",
            "train.unseen_objects=[\"025_mug\"]",
        ],
    );
    let rows = ask(&bench, &documented("noise.sql"));
    let found: Vec<(&str, f64)> = rows
        .iter()
        .map(|row| (row["noise on"].as_str().unwrap(), number(row, "s")))
        .collect();
    assert_eq!(found, [("points", 0.0), ("points", 1.0), ("pose", 1.0)]);
    for row in &rows {
        for column in ["seen: hold, %", "unseen: hold, %"] {
            assert!((0.0..=100.0).contains(&number(row, column)), "{row}");
        }
    }

    // A mistaken pose leaves the motions as they are, mistaken points do not.
    let distinct = |stage: &str| {
        let sql = format!(
            "select candidate_id, count(distinct limit_excess_rad) as n, \
             count(distinct object_from_palm) as m from all_candidates where stage = '{stage}' \
             group by candidate_id"
        );
        let rows = ask(&bench, &sql);
        assert!(!rows.is_empty());
        rows.iter().all(|row| number(row, "m") == 1.0)
    };
    assert!(distinct("sample"));
    assert!(!distinct("sample_noisy"));
    // An object that is believed to be an extent away is hardly ever grasped.
    let held = ask(
        &bench,
        "select stage, sum(successes_n) as held from all_success where stage = 'screen_pose' \
         group by stage",
    );
    assert!(number(&held[0], "held") <= 4.0, "{held:?}");
}
