//! Changes during a run.

use std::fs;

use crate::place::{
    CHAIN, Place, Running, assert_same, files_below, put, read, stderr, stdout, well,
};

#[test]
fn nothing_is_kept_of_an_input_that_changes_while_it_is_read() {
    let place = Place::with_inputs(CHAIN, 2);
    place.input("held", b"a held one");
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let mut run = Running::start(place.held(&["--jobs", "1"]));
    run.wait_for(&place, "held");
    place.input("held", b"other bytes of it");
    place.let_go("held");
    let (code, said) = run.finish();
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("while it changed"), "{said}");
    assert!(said.contains("hint: run the same command again"), "{said}");
    // With the old bytes back nothing of the mixture is found.
    place.input("held", b"a held one");
    place.run_well(&[]);
    assert_same(&place.published(), &place.undisturbed(&[]), "");
}

#[test]
fn results_of_an_unfinished_run_can_be_queried() {
    let place = Place::with_inputs(CHAIN, 2);
    for partition in ["p000", "p001"] {
        place.let_go(partition);
    }
    let mut run = Running::start(place.held(&[]));
    run.wait_for_log(&place, "gather", |made| made.kind == "gather");
    let ask = || {
        let mut query = place.bare(&place.lake(), "query");
        query.args(["select stage, part from parts order by stage, part"]);
        query.args(["--format", "csv"]);
        stdout(&well(query))
    };
    let expected = "stage,part\nfirst,p000\nfirst,p001\nsplit,p000\nsplit,p001\n";
    assert_eq!(ask(), expected);
    well(place.bare(&place.lake(), "verify"));
    run.child.kill().unwrap();
    run.finish();
    assert_eq!(ask(), expected);
    well(place.bare(&place.lake(), "verify"));
    fs::remove_dir_all(place.path("gate")).unwrap();
    place.run_well(&[]);
    assert_same(&place.published(), &place.undisturbed(&[]), "");
    let changing = fs::read_dir(place.lake().join("changing"));
    assert!(changing.is_err(), "a run that ended has left nothing open");
}

#[test]
fn damaged_tables_of_runs_are_refused_and_made_again_from_their_records() {
    let place = Place::with_inputs(CHAIN, 3);
    place.run_well(&[]);
    let table = place.lake().join("tables/metrics/run=1/part.parquet");
    let whole = read(&table);
    let is_blob = |path: &std::path::PathBuf| read(path) == whole;
    let blobs = files_below(&place.lake().join("blobs"));
    let blob = blobs.into_iter().find(is_blob).unwrap();
    fs::remove_file(&blob).unwrap();
    put(&blob, &whole[..whole.len() / 2]);
    fs::remove_file(&table).unwrap();
    put(&table, b"no table");
    let mut query = place.bare(&place.lake(), "query");
    let asked = query.arg("select count(*) from metrics").output().unwrap();
    assert_eq!(asked.status.code(), Some(1));
    assert!(stderr(&asked).contains("metrics/run=1/part.parquet` is damaged"));
    let mut verify = place.bare(&place.lake(), "verify");
    let dropped = verify.arg("--drop").output().unwrap();
    assert_eq!(dropped.status.code(), Some(1), "{}", stderr(&dropped));
    assert_eq!(read(&table), whole);
    well(place.bare(&place.lake(), "verify"));
    let mut query = place.bare(&place.lake(), "query");
    query.arg("select count(*) from metrics");
    well(query);
}
