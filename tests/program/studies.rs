//! Claims of `pipelines/studies/paper_tables.toml`: every variant is screened over shared stages, and the query of each of the
//! paper's tables makes it.

use std::{path::Path, process::Command};

use serde_json::Value;

use crate::program::{
    bench::{Bench, stderr},
    tables::query::Query,
};

/// An object that is learned from, and one that is not.
const OBJECTS: [&str; 2] = ["006_mustard_bottle", "025_mug"];
/// The function's motions for each of them.
const PER_OBJECT: f64 = 6.0;
/// The planned motions for each of them.
const PLANNED: f64 = 4.0;

/// Runs the study with little training and few motions, its sweeps cut short.
fn studied() -> Bench {
    let bench = Bench::new();
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", "pipelines/studies/paper_tables.toml", "--lake"])
        .arg(bench.lake());
    let root = format!("ingest.root={}", bench.root().display());
    let mut values = vec![
        root,
        "train.held_out_share=0.0".to_owned(),
        "train.network.points=64".to_owned(),
        "train.training.epochs=20".to_owned(),
        "shared.unseen=[\"025_mug\"]".to_owned(),
        "refine.draws=1".to_owned(),
        format!("sample.per_object={PER_OBJECT}"),
        format!("sample_noisy.per_object={PER_OBJECT}"),
        format!("grasp_tta.per_object={PLANNED}"),
        "grasp_tta.network.points=64".to_owned(),
        "grasp_tta.hand_points=100".to_owned(),
        "grasp_tta.training.epochs=2".to_owned(),
        "grasp_tta.training.contact_epochs=2".to_owned(),
        "grasp_tta.adaptation.steps=20".to_owned(),
        format!("force_closure.per_object={PLANNED}"),
        format!("eigengrasp.per_object={PLANNED}"),
        "eigengrasp.steps=500".to_owned(),
        "cem_mpc.objects=[\"006_mustard_bottle\"]".to_owned(),
        "cem_mpc.per_object=1".to_owned(),
        "cem_mpc.population=12".to_owned(),
        "cem_mpc.elites=4".to_owned(),
        "dispatch.per_object=1".to_owned(),
        "dispatch_rrt.per_object=1".to_owned(),
        "dispatch_rrt_eigengrasp.per_object=1".to_owned(),
        "dispatch_rrt_tta.per_object=1".to_owned(),
        "dispatch_cem.per_object=1".to_owned(),
        "sample_noisy.point_noise=0.0,1.0".to_owned(),
        "screen_pose.pose_noise=1.0".to_owned(),
    ];
    let generators = [
        "sample",
        "sample_noisy",
        "grasp_tta",
        "force_closure",
        "eigengrasp",
    ];
    for stage in generators {
        values.push(format!("{stage}.objects={OBJECTS:?}"));
    }
    for controller in ["pd", "pd_velocity", "pd_interpolated", "pd_feedforward"] {
        values.push(format!("screen_{controller}.scene.hand_mass_scale=1.0"));
    }
    for value in &values {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    bench
}

/// Returns the rows of one of the paper's tables.
fn table(bench: &Bench, number: u32) -> Vec<Value> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/studies/tables");
    let query = Query::read(&folder.join(format!("paper_{number}.sql"))).unwrap();
    ask(bench, &query.sql)
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

fn text<'a>(row: &'a Value, column: &str) -> &'a str {
    row[column]
        .as_str()
        .unwrap_or_else(|| panic!("no `{column}` in {row}"))
}

#[test]
fn every_table_of_the_paper_is_made_of_one_run() {
    let bench = studied();
    // What comes before the sweeps is made once.
    let made = ask(
        &bench,
        "select stage, count(*) as n from units where stage in ('sample', 'screen_pd', 'screen_pose') \
         and artifact in ('candidates', 'rollouts') and made_now group by stage order by stage",
    );
    let made: Vec<f64> = made.iter().map(|row| number(row, "n")).collect();
    assert_eq!(made, [2.0, 3.0 * 2.0, 2.0]);
    smoothness(&table(&bench, 1));
    cost(&table(&bench, 2));
    cell(&table(&bench, 3));
    controllers(&bench, &table(&bench, 4));
    noise(&bench, &table(&bench, 5));
}

/// Motions that succeed have figures as planned and as executed, which are not the same.
fn smoothness(rows: &[Value]) {
    let own: Vec<&Value> = rows
        .iter()
        .filter(|row| text(row, "as") != "the paper's")
        .collect();
    assert_eq!(rows.len() - own.len(), 4);
    assert!(!own.is_empty());
    for pair in own.chunks(2) {
        assert_eq!(
            [text(pair[0], "as"), text(pair[1], "as")],
            ["planned", "executed"]
        );
        assert_eq!(pair[0]["motions"], pair[1]["motions"]);
        let [planned, executed] = [0, 1].map(|idx| number(pair[idx], "joints: acceleration"));
        assert!((planned - executed).abs() > 1e-6, "{pair:?}");
    }
}

/// Each way is a row for seen and unseen objects, with what was tried and spent.
fn cost(rows: &[Value]) {
    let of = |way: &str, column: &str| -> Vec<String> {
        let rows = rows.iter().filter(|row| text(row, "grasp, motion") == way);
        rows.map(|row| row[column].to_string()).collect()
    };
    let function = "the function, refined";
    assert_eq!(of(function, "objects"), ["\"1 seen\"", "\"1 unseen\""]);
    assert_eq!(of(function, "tried"), ["6", "6"]);
    assert_eq!(of("the function, as sampled", "tried"), ["6", "6"]);
    assert_eq!(of("straight line", "tried"), ["6", "6"]);
    assert_eq!(of("force closure, RRT-Connect", "tried"), ["4", "4"]);
    assert_eq!(of("GraspTTA, RRT-Connect", "tried"), ["4", "4"]);
    assert_eq!(of("force closure, CEM-MPC", "tried"), ["1"]);
    for row in rows {
        let steps = ["control steps, full", "as simulated"].map(|column| text(row, column));
        if let [Ok(full), Ok(simulated)] = steps.map(str::parse::<f64>) {
            assert!(full >= simulated && simulated > 0.0, "{row}");
            let is_measured = text(row, "grasp, motion") != "GraspTTA, RRT-Connect";
            assert_eq!(
                text(row, "CPU, s").parse::<f64>().is_ok(),
                is_measured,
                "{row}"
            );
        }
        let plans = text(row, "grasp, motion").ends_with("RRT-Connect");
        let is_counted = text(row, "checks") != "-";
        assert_eq!(is_counted, plans && steps[0] != "-", "{row}");
    }
}

/// The paper's trials on a robot stand beside those at the simulated cell.
fn cell(rows: &[Value]) {
    let robots = rows
        .iter()
        .filter(|row| text(row, "grasp, motion").ends_with("robot"));
    assert_eq!(robots.count(), 4);
    let sent = rows.iter().filter(|row| text(row, "all objects") != "-");
    let sent: Vec<&str> = sent.map(|row| text(row, "all objects")).collect();
    assert!(!sent.is_empty());
    for sent in sent {
        let (held, n) = sent.split_once(" of ").unwrap();
        assert!(held.parse::<u32>().unwrap() <= n.parse().unwrap(), "{sent}");
    }
}

/// The controllers are compared at every speed, and differ.
fn controllers(bench: &Bench, rows: &[Value]) {
    let speeds: Vec<(f64, f64)> = rows
        .iter()
        .map(|row| (number(row, "speed"), number(row, "hand's mass")))
        .collect();
    assert_eq!(speeds, [(1.0, 1.0), (2.0, 1.0), (3.0, 1.0)]);
    for row in rows {
        let arms = [
            "PD, %",
            "with velocity",
            "at the faster rate",
            "with inverse dynamics",
        ];
        let [pd, _, _, dynamics] = arms.map(|column| {
            let share = number(row, column);
            assert!((0.0..=100.0).contains(&share), "{row}");
            share
        });
        assert!((dynamics - pd - number(row, "gain")).abs() < 0.11, "{row}");
    }
    let executed = ask(
        bench,
        "select candidate_id, count(distinct executed_robust_joints_position) as n from rollouts \
         where reached and stage like 'screen_pd%' group by candidate_id",
    );
    assert!(
        executed.iter().any(|row| number(row, "n") == 4.0),
        "{executed:?}"
    );
}

/// Noise on the points changes the motions, noise on the pose their outcome.
fn noise(bench: &Bench, rows: &[Value]) {
    let found: Vec<(&str, f64)> = rows
        .iter()
        .map(|row| (text(row, "noise on"), number(row, "s")))
        .collect();
    assert_eq!(found, [("points", 0.0), ("points", 1.0), ("pose", 1.0)]);
    let is_the_same = |stage: &str| {
        let sql = format!(
            "select candidate_id, count(distinct object_from_palm) as n from all_candidates \
             where stage = '{stage}' group by candidate_id"
        );
        let rows = ask(bench, &sql);
        assert!(!rows.is_empty());
        rows.iter().all(|row| number(row, "n") == 1.0)
    };
    assert!(is_the_same("sample"));
    assert!(!is_the_same("sample_noisy"));
    // An object that is believed to be an extent away is hardly ever grasped.
    let held = ask(
        bench,
        "select sum(successes_n) as held from success where stage = 'screen_pose'",
    );
    assert!(number(&held[0], "held") <= 4.0, "{held:?}");
}
