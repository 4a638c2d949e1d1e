//! Claims of `pipelines/planners.toml` and `pipelines/rivals.toml`, on the small sample at a small size: every motion
//! that is given to a planner is a row of it, and equal arguments give equal bytes on any number of threads.

use std::{collections::BTreeMap, process::Command};

use crate::program::bench::{Bench, stderr, stdout};

/// A tenth of the published budget of control, on one object.
const PLANNERS: [&str; 5] = [
    "cem_mpc.objects=[\"025_mug\"]",
    "cem_mpc.per_object=2",
    "cem_mpc.population=10",
    "cem_mpc.elites=2",
    "cem_mpc.iterations=1",
];
const GRASPS: [&str; 10] = [
    "random_palm.per_object=2",
    "force_closure.per_object=2",
    "eigengrasp.per_object=2",
    "eigengrasp.steps=400",
    "grasp_tta.per_object=2",
    "grasp_tta.network.points=64",
    "grasp_tta.hand_points=100",
    "grasp_tta.training.epochs=2",
    "grasp_tta.training.contact_epochs=2",
    "grasp_tta.adaptation.steps=20",
];

/// Runs a file with values on a number of threads, and returns what it published.
fn published(
    bench: &Bench,
    file: &str,
    values: &[&str],
    threads: &str,
) -> BTreeMap<String, String> {
    let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    program
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env("RAYON_NUM_THREADS", threads)
        .args(["run", file, "--jobs", threads, "--lake"])
        .arg(bench.lake())
        .args(["--set", &format!("ingest.root={}", bench.root().display())]);
    for value in values {
        program.args(["--set", value]);
    }
    let ran = program.output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    bench.published()
}

/// The first column of a query's rows.
fn column(bench: &Bench, query: &str) -> Vec<String> {
    let asked = bench.ask(&["query", query, "--format", "csv"]);
    assert_eq!(asked.status.code(), Some(0), "{}", stderr(&asked));
    stdout(&asked).lines().skip(1).map(str::to_owned).collect()
}

#[test]
fn planners_have_a_row_for_each_motion_and_equal_bytes_on_any_number_of_threads() {
    let training = [
        "train.network.points=64",
        "train.training.epochs=20",
        "sample.per_object=8",
    ];
    let values = [&training[..], &PLANNERS].concat();
    let bench = Bench::new();
    let one = published(&bench, "pipelines/planners.toml", &values, "1");
    let names = |stage: &str| {
        let query = format!(
            "select candidate_id from candidates where stage = '{stage}' order by candidate_id"
        );
        column(&bench, &query)
    };
    let given = names("refine");
    assert!(given.len() > 20, "{given:?}");
    let planned: Vec<String> = given.iter().map(|name| format!("{name}-rrt")).collect();
    assert_eq!(names("rrt"), planned);
    let controlled: Vec<String> = given
        .iter()
        .filter(|name| name.starts_with("025_mug"))
        .map(|name| format!("{name}-cem"))
        .collect();
    assert_eq!(names("cem_mpc"), controlled[..2]);
    let origins = "select distinct origin from candidates where stage = 'rrt' or stage = 'cem_mpc'";
    assert_eq!(column(&bench, origins), ["planner"]);
    let two = published(&Bench::new(), "pipelines/planners.toml", &values, "2");
    assert_eq!(one, two);
}

#[test]
fn generators_of_grasps_have_as_many_as_asked_and_equal_bytes_on_any_number_of_threads() {
    let bench = Bench::new();
    let one = published(&bench, "pipelines/rivals.toml", &GRASPS, "1");
    let counts = "select count(*) from candidates where origin = 'grasp' group by stage, object";
    let counts = column(&bench, counts);
    // Four generators for each object.
    assert!(
        counts.len() > 40 && counts.len().is_multiple_of(4),
        "{counts:?}"
    );
    assert!(counts.iter().all(|count| count == "2"), "{counts:?}");
    let two = published(&Bench::new(), "pipelines/rivals.toml", &GRASPS, "2");
    assert_eq!(one, two);
}
