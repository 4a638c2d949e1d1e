//! Changes during a run, and questions beside runs and garbage collection. `PIPELINE_ALARMS` sets how many.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
    thread,
};

use crate::engine::place::{
    CHAIN, Place, Running, assert_same, chances, files_below, number, put, read, stderr, stdout,
    well, write_unnoticed,
};
use rand::{Rng, seq::IndexedRandom};

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

/// The blobs that only a run with this value made.
fn blobs_of_old(place: &Place) -> Vec<PathBuf> {
    let blobs = place.lake().join("blobs");
    place.run_well(&["--set", "first.add=70"]);
    let before = files_below(&blobs);
    place.run_well(&["--set", "first.add=77"]);
    let mut tag = place.bare(&place.lake(), "tag");
    tag.args(["2", "old"]);
    well(tag);
    let is_table_of_run = |blob: &Path| {
        let tables = files_below(&place.lake().join("tables"));
        let mut of_runs = tables
            .iter()
            .filter(|path| path.to_string_lossy().contains("run="));
        of_runs.any(|path| read(path) == read(blob))
    };
    let mut made = files_below(&blobs);
    made.retain(|blob| !before.contains(blob) && !is_table_of_run(blob));
    made
}

#[test]
fn beside_runs_and_collection_nothing_sound_is_called_damaged_and_no_damage_is_missed() {
    let n_times: usize = number("PIPELINE_ALARMS", 12);
    let place = Place::with_inputs(CHAIN, 3);
    let old = blobs_of_old(&place);
    let other = place.path("other.toml");
    fs::copy(place.pipeline(), &other).unwrap();
    let of_other = || {
        let mut command = place.bare(&place.lake(), "run");
        command.arg(&other);
        command
    };
    place.run_well(&[]);
    well(of_other());
    let is_over = AtomicBool::new(false);
    let n_runs = AtomicUsize::new(0);
    let repeat = |commands: &(dyn Fn(usize) -> Command + Sync)| {
        while !is_over.load(Ordering::Relaxed) {
            let made = commands(n_runs.fetch_add(1, Ordering::Relaxed))
                .output()
                .unwrap();
            assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
        }
    };
    // Some runs make something, some repeat an earlier one, and some are of another pipeline.
    let run = |idx: usize| match idx % 5 {
        0 => place.command("run", &["--set", "first.add=2"]),
        1 => of_other(),
        2 => place.command(
            "run",
            &["--set", &format!("second.add={}", 100 + idx % 150)],
        ),
        _ => place.command("run", &[]),
    };
    let collect = |_| {
        let mut gc = place.bare(&place.lake(), "gc");
        gc.args(["--keep", "1"]);
        gc
    };
    let mut rng = chances("alarms");
    let mut wrong = Vec::new();
    let mut n_damages = 0;
    thread::scope(|scope| {
        scope.spawn(|| repeat(&run));
        scope.spawn(|| repeat(&collect));
        for idx in 0..n_times {
            let verified = place.bare(&place.lake(), "verify").output().unwrap();
            if verified.status.code() != Some(0) {
                wrong.push(format!(
                    "verify: {}{}",
                    stdout(&verified),
                    stderr(&verified)
                ));
            }
            let sql = ["parts", "all_parts", "units"].choose(&mut rng).unwrap();
            let mut query = place.bare(&place.lake(), "query");
            let asked = query
                .arg(format!("select count(*) from {sql}"))
                .output()
                .unwrap();
            if asked.status.code() != Some(0) {
                wrong.push(format!("query of {sql}: {}", stderr(&asked)));
            }
            // One damage in twenty questions.
            if idx % 20 == 7 {
                let blob = old.choose(&mut rng).unwrap();
                let bytes = read(blob);
                let mut damaged = bytes.clone();
                let at = rng.random_range(0..bytes.len());
                damaged[at] ^= 1;
                write_unnoticed(blob, &damaged);
                let verified = place.bare(&place.lake(), "verify").output().unwrap();
                let name = blob.file_name().unwrap().to_str().unwrap();
                if !stdout(&verified).contains(name) {
                    wrong.push(format!("not found: {name}"));
                }
                write_unnoticed(blob, &bytes);
                n_damages += 1;
            }
        }
        is_over.store(true, Ordering::Relaxed);
    });
    println!(
        "{n_times} verify and query beside {} runs and collections, {n_damages} damages: {} wrong",
        n_runs.into_inner(),
        wrong.len()
    );
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

#[test]
fn of_several_pipelines_and_values_the_one_that_ran_last_is_the_newest() {
    let place = Place::with_inputs(CHAIN, 2);
    let names = ["g", "h", "k"];
    for name in names {
        fs::copy(place.pipeline(), place.path(&format!("{name}.toml"))).unwrap();
    }
    let run = |name: &str, arguments: &[&str]| {
        let mut command = place.bare(&place.lake(), "run");
        command
            .arg(place.path(&format!("{name}.toml")))
            .args(arguments);
        well(command);
    };
    let newest = || {
        let mut query = place.bare(&place.lake(), "query");
        query.args(["select distinct pipeline, stage from parts where stage = 'split'"]);
        query.args(["--format", "csv"]);
        stdout(&well(query)).lines().nth(1).unwrap().to_owned()
    };
    let other = ["--set", "first.add=5"];
    let order: [(&str, &[&str]); 12] = [
        ("g", &[]),
        ("h", &[]),
        ("g", &[]),
        ("g", &other),
        ("k", &[]),
        ("g", &[]),
        ("h", &[]),
        ("k", &[]),
        ("g", &other),
        ("h", &[]),
        ("g", &["--until", "first"]),
        ("g", &[]),
    ];
    for (idx, (name, arguments)) in order.into_iter().enumerate() {
        run(name, arguments);
        assert_eq!(newest(), format!("{name},split"), "after run {idx}");
        well(place.bare(&place.lake(), "verify"));
    }
    // Nothing sound is dropped.
    let before = files_below(&place.lake().join("every"));
    let mut drop = place.bare(&place.lake(), "verify");
    drop.arg("--drop");
    well(drop);
    assert_eq!(files_below(&place.lake().join("every")), before);
}
