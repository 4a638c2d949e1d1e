//! Claims of `pipelines/studies/refinement_parts.toml`: the same motions as drawn and refined, through the same physics.

use std::{
    collections::{BTreeMap, BTreeSet},
    process::{Command, Output},
};

use robot::RobotModel;
use serde_json::Value;

use crate::program::bench::{Bench, stderr};

/// The pipeline file, from the root of the project.
const FILE: &str = "pipelines/studies/refinement_parts.toml";
const OBJECTS: [&str; 2] = ["003_cracker_box", "006_mustard_bottle"];
const PER_OBJECT: usize = 12;

/// Runs the file's first variant with little training and few motions of two objects.
fn run(bench: &Bench) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["run", FILE, "--lake"])
        .arg(bench.lake());
    for value in [
        &format!("ingest.root={}", bench.root().display()),
        &format!("sample.objects={OBJECTS:?}"),
        "train.unseen_fold=2/4",
        "train.held_out_share=0.0",
        "train.network.points=64",
        "train.training.epochs=60",
        &format!("sample.per_object={PER_OBJECT}"),
        "refine.squeeze_m=0.008",
        "screen.protocol.squeeze_rad=0.0",
        "refine.restart_angle_rad=0.5",
        "refine.balance_weight=0.1",
        "refine.contact_weight=3.0",
        "refine.clearance_m=0.008",
        "refine.object_weight=3.0",
        "refine.table_weight=3.0",
        "refine.self_collision_weight=1.0",
    ] {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    ran
}

/// Asks the lake in SQL.
fn ask(bench: &Bench, sql: &str) -> Vec<Value> {
    let answer = bench.ask(&["query", sql, "--format", "json"]);
    assert!(answer.status.success(), "{}", stderr(&answer));
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    rows.collect::<Result<_, _>>().unwrap()
}

#[test]
fn drawn_and_refined_motions_stand_side_by_side() {
    let bench = Bench::new();
    run(&bench);
    let hand = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/data/robots/allegro_right.urdf"
    );
    let hand = RobotModel::from_urdf(&std::fs::read_to_string(hand).unwrap()).unwrap();
    let mut names: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for row in ask(
        &bench,
        "select stage, candidate_id, origin, q_rad from candidates",
    ) {
        let text = |column: &str| row[column].as_str().unwrap().to_owned();
        names
            .entry(text("stage"))
            .or_default()
            .insert(text("candidate_id"));
        assert_eq!(text("origin"), "prior");
        let q_rad: Vec<f64> = serde_json::from_value(row["q_rad"].clone()).unwrap();
        assert!(q_rad.len() > hand.dof());
        for q_rad in q_rad.chunks(hand.dof()) {
            for (q, joint) in q_rad.iter().zip(hand.joints()) {
                assert!((joint.lower..=joint.upper).contains(q), "{q} {joint:?}");
            }
        }
    }
    assert_eq!(names["sample"].len(), OBJECTS.len() * PER_OBJECT);
    assert_eq!(names["sample"], names["refine"]);
    // Hands that were drawn into object and table are not there any more.
    let sql = "select stage, sum(table_n + early_contact_n) as n from success group by stage";
    let refused: BTreeMap<String, f64> = ask(&bench, sql)
        .iter()
        .map(|row| {
            let stage = row["stage"].as_str().unwrap().to_owned();
            (stage, row["n"].as_f64().unwrap())
        })
        .collect();
    let (drawn, refined) = (refused["screen_drawn"], refused["screen"]);
    assert!(drawn >= 6.0 && refined <= drawn / 2.0, "{refused:?}");
    let again = run(&bench);
    assert!(
        stderr(&again).contains("nothing to run"),
        "{}",
        stderr(&again)
    );
}
