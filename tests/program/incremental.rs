//! Nothing runs twice, and what changed runs: no more and no less.

use std::{collections::BTreeMap, fs};

use serde_json::Value;

use crate::bench::{Bench, labels, put, stderr, stdout};

fn counts(pairs: &[(&str, usize)]) -> BTreeMap<String, usize> {
    pairs
        .iter()
        .map(|&(name, count)| (name.to_owned(), count))
        .collect()
}

#[test]
fn the_same_command_again_runs_nothing_and_says_so() {
    let bench = Bench::new();
    let ran = bench.run_well(&[]);
    for stage in [
        "ingest", "retarget", "train", "sample", "screen", "dispatch",
    ] {
        assert!(stderr(&ran).contains(stage), "{}", stderr(&ran));
    }
    let shown = bench.published();
    let again = bench.run_well(&[]);
    assert!(
        stderr(&again).contains("6 stages cached, nothing to run"),
        "{}",
        stderr(&again)
    );
    // A run that makes nothing leaves no trace.
    assert_eq!(bench.runs().len(), 1);
    assert_eq!(bench.published(), shown);
    let plan = bench.command("plan", &[]).output().unwrap();
    assert_eq!(stdout(&plan), "cached   everything; nothing to run\n");
}

#[test]
fn a_changed_value_reruns_its_stage_and_what_follows_and_plan_names_it() {
    let bench = Bench::new();
    bench.run_well(&["--until", "sample"]);
    let change = ["--until", "sample", "--set", "train.training.kl_weight=0.5"];
    let plan = bench.command("plan", &change).output().unwrap();
    let text = stdout(&plan);
    assert!(
        text.contains("`training.kl_weight` changed from 0.002 to 0.5"),
        "{text}"
    );
    assert!(
        !text
            .lines()
            .any(|line| line.starts_with("run") && line.contains("retarget")),
        "{text}"
    );
    let plan = bench
        .command("plan", &[&change[..], &["--format", "json"]].concat())
        .output()
        .unwrap();
    let plan: Value = serde_json::from_slice(&plan.stdout).unwrap();
    let states = |node: usize| plan["nodes"][node]["units"][0]["state"].as_str().unwrap();
    assert_eq!(
        [0, 1, 2, 3, 4, 5, 6].map(states),
        [
            "cached", "cached", "cached", "cached", "cached", "cached", "run"
        ]
    );
    // What shows the training, and what is drawn from it.
    assert_eq!([7, 8, 9, 10, 11].map(states), ["perhaps"; 5]);

    bench.run_well(&change);
    let made = bench.made_by_newest_run();
    let names: Vec<&str> = made.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "sample.candidates",
            "sample.sampling",
            "train.checkpoint",
            "train.latents",
            "train.reconstruction",
            "train.training"
        ]
    );
}

#[test]
fn one_changed_recording_reruns_its_own_units_and_what_gathers_them() {
    let bench = Bench::with_own_sample();
    bench.run_well(&["--until", "train"]);
    // The hand is elsewhere in one image of the reach, so the demonstration differs.
    let images = labels(&bench.a_recording());
    let middle = images.len() / 4;
    fs::copy(&images[middle + 1], &images[middle]).unwrap();
    bench.run_well(&["--until", "train"]);
    let expected = counts(&[
        ("ingest.demonstrations", 1),
        ("ingest.objects", 1),
        ("retarget.tracking", 1),
        ("retarget.trajectories", 1),
        ("train.checkpoint", 1),
        ("train.latents", 1),
        ("train.reconstruction", 1),
        ("train.training", 1),
    ]);
    assert_eq!(bench.made_by_newest_run(), expected);
}

#[test]
fn an_option_reruns_only_what_it_decides() {
    let bench = Bench::new();
    let only = ["--until", "ingest", "--set"];
    let run = |bench: &Bench, change: &str| bench.run_well(&[&only[..], &[change]].concat());
    run(&bench, "ingest.objects=[\"025_mug\"]");
    let all = bench.made_by_newest_run();
    assert_eq!(all["ingest.shapes"], 1);
    // Surface points are the shapes' alone.
    let fewer = ["ingest.objects=[\"025_mug\"]", "ingest.points_n=100"];
    bench.run_well(&[&only[..], &[fewer[0], "--set", fewer[1]]].concat());
    let expected = counts(&[("ingest.objects", 1), ("ingest.shapes", 1)]);
    assert_eq!(bench.made_by_newest_run(), expected);
    // What was read of one object is not read again for two; what was left out is another unit now.
    run(&bench, "ingest.objects=[\"024_bowl\", \"025_mug\"]");
    let made = bench.made_by_newest_run();
    assert_eq!(made["ingest.shapes"], 1);
    // The sample here has one recording of each object.
    assert_eq!(made["ingest.demonstrations"], 1, "{made:?}");
}

#[test]
fn equal_bytes_stop_the_rerun() {
    let bench = Bench::with_own_sample();
    bench.run_well(&["--until", "retarget"]);
    let meta = bench.a_recording().join("meta.yml");
    let text = fs::read_to_string(&meta).unwrap();
    put(
        &meta,
        &format!("{text}# a comment changes nothing that is read\n"),
    );
    bench.run_well(&["--until", "retarget"]);
    assert_eq!(
        bench.made_by_newest_run(),
        counts(&[("ingest.demonstrations", 1)])
    );
}

#[test]
fn a_damaged_artifact_is_noticed_before_use_and_made_again() {
    let bench = Bench::new();
    bench.run_well(&["--until", "retarget"]);
    let shown = bench.published();
    let (table, _) = shown
        .iter()
        .find(|(name, _)| name.contains("trajectories"))
        .unwrap();
    let path = bench.lake().join(table);
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let mut permissions = fs::metadata(&path).unwrap().permissions();
    #[expect(
        clippy::permissions_set_readonly_false,
        reason = "the file is the test's own"
    )]
    permissions.set_readonly(false);
    fs::set_permissions(&path, permissions).unwrap();
    // The shown file and the blob are one, so this damages what the next stage reads.
    overwrite(&path, &bytes);
    let plan = bench.command("plan", &["--until", "train"]);
    let plan = stdout(&{ plan }.output().unwrap());
    assert!(plan.contains("missing or damaged in the lake"), "{plan}");
    bench.run_well(&["--until", "train"]);
    let expected = counts(&[
        ("retarget.trajectories", 1),
        ("train.checkpoint", 1),
        ("train.latents", 1),
        ("train.reconstruction", 1),
        ("train.training", 1),
    ]);
    assert_eq!(bench.made_by_newest_run(), expected);
    let again = bench.run_well(&["--until", "train"]);
    assert!(
        stderr(&again).contains("nothing to run"),
        "{}",
        stderr(&again)
    );
    let mended = bench.published();
    for (name, digest) in &shown {
        assert_eq!(mended.get(name), Some(digest), "{name}");
    }
}

/// Changes bytes in place, keeping the file.
fn overwrite(path: &std::path::Path, bytes: &[u8]) {
    use std::io::Write;
    let mut file = fs::File::options().write(true).open(path).unwrap();
    file.write_all(bytes).unwrap();
}

#[test]
fn a_question_in_sql_prints_a_table() {
    let bench = Bench::new();
    bench.run_well(&["--until", "screen"]);
    let ask = |format: &str| {
        let sql = "select object, count(*) as n, avg(cast(success as double)) as rate \
                   from rollouts group by object order by object";
        let lake = bench.lake();
        std::process::Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .args(["query", sql, "--format", format, "--lake"])
            .arg(lake)
            .output()
            .unwrap()
    };
    let table = stdout(&ask("table"));
    let mut lines = table.lines();
    assert_eq!(
        lines.next().unwrap().split_whitespace().collect::<Vec<_>>(),
        ["object", "n", "rate"]
    );
    let rows: Vec<Vec<&str>> = lines
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert!(rows.len() >= 10, "{table}");
    assert!(rows.iter().all(|row| row[1] == "4"), "{table}");
    let json = stdout(&ask("json"));
    let first: Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!(first["n"], 4);
    assert!(stdout(&ask("csv")).starts_with("object,n,rate\n"));
    assert!(ask("parquet").stdout.starts_with(b"PAR1"));
}
