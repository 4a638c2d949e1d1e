//! Runs can be listed, tagged, compared, traced and queried.

use std::{collections::BTreeSet, fs, process::Output, sync::OnceLock};

use serde_json::{Value, json};

use crate::program::bench::{Bench, put, stderr, stdout};

/// A lake with three runs: as the file says; another value; and, after the first was gone through again,
/// all of it there already, one that fails. Tests only look at it, and at tags of their own.
fn lake() -> &'static Bench {
    static LAKE: OnceLock<Bench> = OnceLock::new();
    LAKE.get_or_init(|| {
        let bench = Bench::new();
        let until = ["--until", "retarget"];
        bench.run_well(&until);
        bench.run_well(&[&until[..], &["--set", "retarget.clearance_m=0.01"]].concat());
        bench.run_well(&until);
        let nowhere = ["--set", "train.unseen_objects=[\"999_nowhere\"]"];
        let failed = bench.run(&[&["--until", "train"][..], &nowhere].concat());
        assert_eq!(failed.status.code(), Some(1), "{}", stderr(&failed));
        bench
    })
}

fn done(bench: &Bench, arguments: &[&str]) -> String {
    let output = bench.ask(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    stdout(&output)
}

fn json_of(bench: &Bench, arguments: &[&str]) -> Value {
    let text = done(bench, &[arguments, &["--format", "json"]].concat());
    serde_json::from_str(&text).unwrap()
}

/// Asserts that a command is refused as wrong, with these words.
fn refused(output: &Output, says: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    for part in says {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
}

/// The cells of a column of comma-separated values.
fn column(text: &str, name: &str) -> Vec<String> {
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let position = header.split(',').position(|column| column == name).unwrap();
    let cell = |line: &str| line.split(',').nth(position).unwrap().to_owned();
    lines.map(cell).collect()
}

#[test]
fn runs_are_listed_with_their_values_counts_and_ends() {
    let runs = lake().runs();
    let of = |key: &str| runs.iter().map(|run| run[key].clone()).collect::<Vec<_>>();
    assert_eq!(of("run"), [1, 2, 3]);
    let ended = ["finished", "finished", "failed"];
    assert_eq!(of("status"), ended);
    let n_units = runs[0]["n_made_now"].as_u64().unwrap();
    let n_trajectories = runs[1]["n_made_now"].as_u64().unwrap();
    assert!(n_units > n_trajectories && n_trajectories > 0);
    assert_eq!(runs[1]["n_cached"], n_units - n_trajectories);
    let overrides = runs[1]["overrides"].as_array().unwrap();
    assert_eq!(overrides.last().unwrap(), "retarget.clearance_m=0.01");

    let text = done(lake(), &["runs", "--last", "2"]);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert!(lines[0].starts_with("run  started (UTC)"), "{text}");
    assert!(lines[1].trim_start().starts_with('2'), "{text}");
    assert!(lines[2].contains("failed: "), "{text}");
    assert_eq!(
        done(lake(), &["runs", "--pipeline", "cgf"]).lines().count(),
        4
    );
    let other = lake().ask(&["runs", "--pipeline", "cfg"]);
    refused(
        &other,
        &["no run of a pipeline `cfg`", "there are runs of: cgf"],
    );
}

#[test]
fn a_tag_names_a_run_until_it_is_taken_away() {
    let run_of = |name: &str| json_of(lake(), &["diff", "1", name])["new"].clone();
    done(lake(), &["tag", "newest~1", "wide"]);
    assert_eq!(run_of("wide"), 2);
    let runs = lake().runs();
    assert_eq!(runs[1]["tags"], json!(["wide"]));
    let moved = lake().ask(&["tag", "1", "wide"]);
    assert!(
        stderr(&moved).contains("`wide` is run 1, no longer run 2"),
        "{}",
        stderr(&moved)
    );
    assert_eq!(run_of("wide"), 1);
    let near = lake().ask(&["diff", "1", "wdie"]);
    refused(&near, &["no run is tagged `wdie`", "did you mean `wide`?"]);
    done(lake(), &["untag", "wide"]);
    let gone = lake().ask(&["untag", "wide"]);
    refused(&gone, &["no run is tagged `wide`", "`pipeline runs`"]);
    for name in ["12", "newest", "a/b"] {
        let output = lake().ask(&["tag", "1", name]);
        refused(&output, &["is not a name for a tag", "letters"]);
    }
}

#[test]
fn newest_counts_finished_runs_only() {
    let run_of = |name: &str| json_of(lake(), &["diff", "1", name])["new"].clone();
    // The first one was repeated after the second, and is not recorded again.
    assert_eq!(run_of("newest"), 1);
    assert_eq!(run_of("newest~1"), 2);
    for name in ["newest~2", "newest~x", "99"] {
        refused(
            &lake().ask(&["diff", "1", name]),
            &[&format!("no run `{name}`"), "`pipeline runs` lists them"],
        );
    }
}

#[test]
fn diff_names_the_difference_and_nothing_else() {
    let text = done(lake(), &["diff", "1", "2"]);
    assert!(!text.contains("ingest"), "{text}");
    assert!(!text.contains("inputs"), "{text}");
    let words: Vec<Vec<&str>> = text
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(words[0], ["values"]);
    assert_eq!(words[1], ["retarget.clearance_m", "0.008", "→", "0.01"]);
    assert_eq!(words[2], ["metrics"]);
    assert_eq!(
        words[3][..3],
        ["retarget.trajectories", "partitions", "changed"]
    );

    let difference = json_of(lake(), &["diff", "1", "2"]);
    let values = json!([{"key": "retarget.clearance_m", "old": 0.008, "new": 0.01}]);
    assert_eq!(difference["values"], values);
    let outputs = difference["outputs"].as_array().unwrap();
    // The trajectories, and the report on them.
    assert_eq!(outputs.len(), 2);
    assert_eq!(outputs[0]["added"], json!([]));
    assert!(outputs[0]["changed"].as_array().unwrap().len() > 5);
    let metrics = outputs[0]["metrics"].as_array().unwrap();
    assert!(
        metrics
            .iter()
            .any(|metric| metric["metric"] == "keypoint_error_m")
    );
    assert_eq!(done(lake(), &["diff", "1", "newest"]), "no difference\n");
}

#[test]
fn changed_and_missing_files_are_named_and_equal_bytes_are_no_difference() {
    let bench = Bench::with_own_sample();
    bench.run_well(&["--until", "ingest"]);
    let recording = bench.a_recording();
    let meta = recording.join("meta.yml");
    put(
        &meta,
        &format!("{}# a comment\n", fs::read_to_string(&meta).unwrap()),
    );
    bench.run_well(&["--until", "ingest"]);
    let difference = json_of(&bench, &["diff", "1", "2"]);
    let inputs = difference["inputs"].as_array().unwrap();
    assert_eq!(inputs.len(), 1, "{inputs:?}");
    assert!(inputs[0]["name"].as_str().unwrap().ends_with("meta.yml"));
    assert_eq!(inputs[0]["change"], "changed");
    assert_eq!(difference["outputs"], json!([]));
    // The bytes are the same, and both runs have them.
    let sql = "select run, count(*) as n from all_demonstrations group by run order by run";
    let rows = done(&bench, &["query", sql, "--format", "csv"]);
    let counts = column(&rows, "n");
    assert_eq!(counts.len(), 2, "{rows}");
    assert_eq!(counts[0], counts[1]);

    fs::remove_dir_all(&recording).unwrap();
    bench.run_well(&["--until", "ingest"]);
    let text = done(&bench, &["diff", "2"]);
    assert!(text.contains("meta.yml"), "{text}");
    assert!(text.contains("partitions removed"), "{text}");
    assert!(text.contains(" files in "), "{text}");
    // A recording, its object's shape and its object are gone, and nothing else.
    assert!(text.lines().count() < 30, "{text}");
    let difference = json_of(&bench, &["diff", "2", "3"]);
    assert!(difference["inputs"].as_array().unwrap().len() > 40);
    let removed = difference["outputs"].as_array().unwrap().iter();
    let removed = removed.map(|output| output["removed"].as_array().unwrap().len());
    assert_eq!(removed.collect::<Vec<_>>(), [1, 1, 1]);

    // Without records, the runs' metrics are still compared.
    fs::remove_dir_all(bench.lake().join("units")).unwrap();
    let output = bench.ask(&["diff", "2", "3"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("were collected"),
        "{}",
        stderr(&output)
    );
    assert!(stdout(&output).contains("partitions removed"));
}

#[test]
fn lineage_reaches_source_files_and_results() {
    let overview = done(lake(), &["lineage", "retarget.trajectories"]);
    let lines: Vec<&str> = overview.lines().collect();
    assert!(lines[0].starts_with("retarget.trajectories"), "{overview}");
    assert!(overview.contains("─ ingest.demonstrations"), "{overview}");
    assert!(overview.contains("filtered"), "{overview}");
    let readers = done(lake(), &["lineage", "ingest.objects", "--down"]);
    assert!(readers.contains("─ retarget.trajectories"), "{readers}");

    let all = json_of(lake(), &["lineage", "retarget.trajectories"]);
    assert_eq!(all["members"].as_array().unwrap().len(), 5);

    let sql = "select min(sequence) as sequence from trajectories";
    let answer = done(lake(), &["query", sql, "--format", "csv"]);
    let sequence = answer.lines().nth(1).unwrap();
    let text = done(lake(), &["lineage", "retarget.trajectories", sequence]);
    for part in [
        &format!("─ ingest.demonstrations {sequence}"),
        "─ ingest.objects ",
        "─ file hand",
        " more files",
        " UTC in ",
    ] {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
    let family = json_of(lake(), &["lineage", "retarget.trajectories", sequence]);
    let members = family["members"].as_array().unwrap();
    let name = |output: &Value, partition: &Value| format!("{output} {partition}");
    let known: BTreeSet<String> = members
        .iter()
        .map(|member| name(&member["output"], &member["partition"]))
        .collect();
    assert_eq!(known.len(), members.len());
    let mut n_files = 0;
    for member in members {
        for read in member["reads"].as_array().unwrap() {
            for partition in read["partitions"].as_array().unwrap() {
                assert!(known.contains(&name(&read["output"], partition)), "{read}");
            }
        }
        n_files += member["files"].as_object().unwrap().len();
        assert!(member["made"]["started"].as_str().unwrap().ends_with('Z'));
    }
    assert!(n_files > 40);

    let down = done(
        lake(),
        &["lineage", "ingest.demonstrations", sequence, "--down"],
    );
    assert!(
        down.contains(&format!("─ retarget.trajectories {sequence}")),
        "{down}"
    );
    refused(
        &lake().ask(&["lineage", "retarget.trajectory"]),
        &["no artifact", "did you mean `retarget.trajectories`?"],
    );
}

#[test]
fn artifacts_and_tables_are_shown_as_a_run_had_them() {
    let sql = "select * from trajectories order by sequence, step";
    let ask = |arguments: &[&str]| {
        done(
            lake(),
            &[&["query", sql, "--format", "csv"], arguments].concat(),
        )
    };
    let newest = ask(&[]);
    assert!(newest.lines().count() > 100);
    assert_eq!(ask(&["--run", "newest"]), newest);
    assert_eq!(ask(&["--run", "1"]), newest);
    let other = ask(&["--run", "2"]);
    assert_eq!(other.lines().next(), newest.lines().next());
    assert_ne!(other, newest);
    let sql = "select run, count(*) as n from all_trajectories group by run order by run";
    let rows = done(lake(), &["query", sql, "--format", "csv"]);
    assert_eq!(column(&rows, "run"), ["1", "2", "3"]);
    assert_eq!(column(&rows, "n")[0], column(&rows, "n")[2]);

    let inspect = |run: &str| done(lake(), &["inspect", "retarget.trajectories", "--run", run]);
    assert!(inspect("2").starts_with("retarget.trajectories of run 2\n"));
    let metrics = |run: &str| inspect(run).lines().skip(1).collect::<Vec<_>>().join("\n");
    assert_eq!(metrics("1"), metrics("3"));
    assert_ne!(metrics("1"), metrics("2"));
}
