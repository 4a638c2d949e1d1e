//! Tables that a program writes are checked against what it was given and against themselves.

use std::{collections::BTreeMap, fs, path::Path, sync::Arc};

use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Output};
use motion::{HandRates, JointRates, Motion, Step};
use schemas::{
    candidates::{Candidate, Candidates, DrawSource},
    rollouts::{Rollout, Rollouts, Verdict},
};
use spatial::{Pose, Twist};
use stage_program::{Program, ProgramConfig, ProjectArtifacts};
use tempfile::TempDir;

fn candidates() -> Candidates {
    let joints: Arc<[String]> = vec!["j".to_owned()].into();
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: Pose::identity(),
        q_rad: vec![0.1],
        rates: HandRates {
            palm_velocity: Twist::from_array([0.0; 6]),
            palm_acceleration: Twist::from_array([0.0; 6]),
            joints: JointRates::zero(1),
        },
    };
    let candidate = |name: &str| Candidate {
        candidate_id: name.to_owned(),
        generator: "cgf".to_owned(),
        source: DrawSource::replayed("sequence"),
        latent: Vec::new(),
        table_from_object: Pose::identity(),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion: Motion::of_joints(Arc::clone(&joints), vec![step(0.0), step(1.0)]).unwrap(),
    };
    Candidates {
        object: "can".to_owned(),
        joints: Arc::clone(&joints),
        candidates: ["can-0", "can-1"].map(candidate).to_vec(),
    }
}

fn rollouts() -> Rollouts {
    let candidates = candidates().candidates;
    candidates
        .iter()
        .map(|candidate| Rollout::unsimulated(candidate, Verdict::Held))
        .collect()
}

/// Has a program copy this table, of which the text is edited on the way, as its rollouts.
fn made(rollouts: &Rollouts) -> Result<f64, BoxedDiagnostic> {
    let folder = TempDir::new().unwrap();
    let part = |name: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(&path).unwrap();
        path
    };
    lake::table::write(&part("candidates"), &candidates()).unwrap();
    lake::table::write(&part("rollouts"), rollouts).unwrap();
    let table = folder.path().join("rollouts").join(lake::table::FILE);
    run(&folder, "rollouts", &table, &part("made"))
}

/// Has a program copy a file as what it makes.
fn run(folder: &TempDir, makes: &str, table: &Path, made: &Path) -> Result<f64, BoxedDiagnostic> {
    let config: ProgramConfig = serde_json::from_value(serde_json::json!({
        "command": ["cp", table, "out/part.parquet"],
        "makes": makes,
        "each": "candidates",
    }))
    .unwrap();
    let key = "can".parse().unwrap();
    let candidates = Artifact {
        key,
        labels: BTreeMap::new(),
        files: BTreeMap::from([(
            lake::table::FILE.to_owned(),
            folder.path().join("candidates").join(lake::table::FILE),
        )]),
    };
    let inputs = BTreeMap::from([("candidates".to_owned(), vec![candidates.clone()])]);
    let inputs = Inputs::new(inputs, Vec::new());
    let cx = Context::detached(&candidates.key, 7, made);
    match <Program<ProjectArtifacts> as Output>::make(&config, &inputs, &cx)? {
        Outcome::Made(metrics) => Ok(metrics.accepted_n.unwrap_or(f64::NAN)),
        other => panic!("{other:?}"),
    }
}

/// The chain of messages of what a program wrote.
fn refused(rollouts: &Rollouts) -> String {
    let err = made(rollouts).unwrap_err();
    let source = std::error::Error::source(&err).unwrap();
    format!("{err}: {source}")
}

#[test]
fn the_template_names_the_joints_that_the_inputs_name() {
    let folder = TempDir::new().unwrap();
    for name in ["candidates", "made"] {
        fs::create_dir(folder.path().join(name)).unwrap();
    }
    lake::table::write(&folder.path().join("candidates"), &candidates()).unwrap();
    let made = folder.path().join("made");
    // An empty table with the template's metadata: without joints it is refused.
    run(&folder, "candidates", Path::new("template.parquet"), &made).unwrap();
    let table = lake::table::describe(&made.join(lake::table::FILE)).unwrap();
    assert_eq!(table.metadata[schemas::JOINTS], "j");
}

#[test]
fn one_rollout_for_each_candidate_is_accepted_and_counted() {
    let accepted: f64 = made(&rollouts()).unwrap();
    assert!((accepted - 2.0).abs() < 1e-12);
}

#[test]
fn rows_too_many_missing_and_of_other_candidates_are_named() {
    let mut more = rollouts();
    more.push(more[0].clone());
    let said = refused(&more);
    assert!(said.contains("which is not `rollouts/"), "{said}");
    assert!(
        said.contains("has `can-0` in row 2, expected nothing: 3 rows for the 2 of `candidates`"),
        "{said}"
    );
    let said = refused(&rollouts()[..1].to_vec());
    assert!(
        said.contains("has nothing in row 1, expected `can-1`"),
        "{said}"
    );
    let mut other = rollouts();
    other[1].generator = "own".to_owned();
    let said = refused(&other);
    assert!(
        said.contains("column `generator` is `own` in row 1, and `cgf` in `candidates`"),
        "{said}"
    );
    let mut other = rollouts();
    other[0].source.draw_n = 3;
    let said = refused(&other);
    assert!(
        said.contains("column `draw_n` is `3` in row 0, and `1` in `candidates`"),
        "{said}"
    );
}
