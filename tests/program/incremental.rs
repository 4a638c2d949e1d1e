//! Exactly the changed units rerun.

use std::{collections::BTreeMap, fs};

use serde_json::Value;

use crate::program::{
    bench::{Bench, labels, put, stderr, stdout},
    cell_lab::screened,
};

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
        "ingest", "retarget", "train", "sample", "refine", "screen", "dispatch", "report",
    ] {
        assert!(stderr(&ran).contains(stage), "{}", stderr(&ran));
    }
    let shown = bench.published();
    let again = bench.run_well(&[]);
    assert!(
        stderr(&again).contains("8 stages cached, nothing to run"),
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
fn a_value_of_many_digits_is_read_back_as_itself() {
    let bench = Bench::new();
    let until = [
        "--until",
        "screen",
        "--set",
        "screen.scene.friction=0.23333333333333334",
    ];
    bench.run_well(&until);
    let verified = bench.ask(&["verify"]);
    assert_eq!(verified.status.code(), Some(0), "{}", stdout(&verified));
    let again = bench.run_well(&until);
    let said = stderr(&again);
    assert!(said.contains("6 stages cached, nothing to run"), "{said}");
    let sql = "select number from settings where key = 'scene.friction'";
    let asked = bench.ask(&["query", sql, "--format", "json"]);
    let row: Value = serde_json::from_slice(&asked.stdout).unwrap();
    let friction = row["number"].as_f64().unwrap();
    assert_eq!(friction.to_bits(), 0.233_333_333_333_333_34_f64.to_bits());
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
    // The stages that show the training, and those that draw from it; rows of `draws` hold no motion and stay equal.
    assert_eq!([7, 8, 9, 10, 11, 12].map(states), ["pending"; 6]);

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
fn one_changed_recording_reruns_its_units_and_their_gathers() {
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
fn a_mass_reruns_neither_retargeting_nor_training() {
    let bench = Bench::new();
    bench.run_well(&["--until", "train"]);
    let heavier = "ingest.masses_kg={\"025_mug\" = 0.3}";
    bench.run_well(&["--until", "train", "--set", heavier]);
    let expected = counts(&[("ingest.objects", 1), ("ingest.shapes", 1)]);
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
    // The recordings of one object are not read again for two; those left out are another unit now.
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

/// Returns the output of `plan` with these arguments.
fn planned(bench: &Bench, arguments: &[&str]) -> String {
    let plan = bench.command("plan", arguments).output().unwrap();
    assert_eq!(plan.status.code(), Some(0), "{}", stderr(&plan));
    stdout(&plan)
}

const NOTHING: &str = "cached   everything; nothing to run\n";

#[test]
fn the_parsed_hand_decides_and_not_its_bytes() {
    let bench = Bench::new();
    let folder = bench.root().parent().unwrap().join("hands");
    fs::create_dir_all(&folder).unwrap();
    let urdf = include_str!("../../data/robots/allegro_right.urdf");
    let file = include_str!("../../data/hands/allegro_right.toml");
    let put_hand = |name: &str, urdf: &str, file: &str| {
        put(&folder.join(format!("{name}.urdf")), urdf);
        let file = file.replace("../robots/allegro_right.urdf", &format!("{name}.urdf"));
        put(&folder.join(format!("{name}.toml")), &file);
    };
    let with = |name: &str, more: &[&str], what: &dyn Fn(&[&str]) -> String| {
        let hand = format!("shared.hand={}/{name}.toml", folder.display());
        let arguments = ["--until", "screen", "--set", &hand];
        what(&[arguments.as_slice(), more].concat())
    };
    let run = |name: &str, more: &[&str]| {
        with(name, more, &|all| stderr(&bench.run_well(all)));
    };
    let plan = |name: &str| with(name, &[], &|all| planned(&bench, all));
    put_hand("hand", urdf, file);
    run("hand", &[]);
    let shown = bench.published();

    // Another name, another comment, another order of what has none.
    let commented = urdf.replacen("<robot ", "<!-- left of the window -->\n<robot ", 1);
    assert_ne!(commented, urdf);
    put_hand("ours", &commented, &format!("# ours\n{file}"));
    assert_eq!(plan("ours"), NOTHING);
    // The results rebuilt from the other file have the same bytes, recordings too.
    run("ours", &["--fresh", "retarget"]);
    assert_eq!(bench.published(), shown);

    // A joint that turns farther is another hand: the units that read it say so.
    let farther = urdf.replacen("upper=\"", "upper=\"1", 1);
    put_hand("farther", &farther, file);
    let text = plan("farther");
    for (state, node) in [
        ("run", "retarget.trajectories"),
        ("run", "train.checkpoint"),
        // Its candidates are not drawn yet.
        ("pending", "refine.candidates"),
    ] {
        let line = planned_line(&text, state, node);
        assert!(line.contains("file `hand` changed"), "{line}");
    }
    assert!(!text.contains("never made"), "{text}");

    // A weaker drive is another hand to the screen alone, another landmark to those that follow it.
    let weaker = file.replace("torque_limit = 0.7", "torque_limit = 0.5");
    assert_ne!(weaker, file);
    put_hand("weaker", urdf, &weaker);
    let text = plan("weaker");
    for stage in ["ingest", "retarget", "train", "sample", "refine"] {
        let of_stage = |line: &&str| line.contains(&format!(" {stage}."));
        for line in text.lines().filter(of_stage) {
            assert!(line.starts_with("cached "), "{text}");
        }
    }
    let line = planned_line(&text, "run", "screen.rollouts");
    assert!(line.contains("scene.drive.torque_limit"), "{line}");
    let thicker = file.replace("tip_radius_m = 0.012", "tip_radius_m = 0.011");
    put_hand("thicker", urdf, &thicker);
    let text = plan("thicker");
    let line = planned_line(&text, "run", "retarget.trajectories");
    assert!(line.contains("file `hand_table` changed"), "{line}");
    let line = planned_line(&text, "run", "train.checkpoint");
    assert!(line.contains("training.tip_radius_m"), "{line}");
}

/// The line of a plan about an output, which has this state.
fn planned_line<'a>(text: &'a str, state: &str, node: &str) -> &'a str {
    let mut lines = text.lines();
    let line = lines.find(|line| line.starts_with(state) && line.contains(node));
    line.unwrap_or_else(|| panic!("{node} is not `{state}`:\n{text}"))
}

#[test]
fn renamed_stage_is_recognized() {
    let bench = Bench::new();
    let folder = bench.root().parent().unwrap().join("renamed");
    fs::create_dir_all(&folder).unwrap();
    let file = include_str!("../../pipelines/cgf.toml");
    let renamed = file.replace("stages.retarget", "stages.move");
    let renamed = renamed.replace("\"retarget.", "\"move.");
    let renamed = renamed.replace(".retarget]", ".move]");
    let path = folder.join("cgf.toml");
    put(&path, &renamed);
    bench.run_well(&["--until", "retarget"]);
    let root = format!("ingest.root={}", bench.root().display());
    let plan = bench.ask(&[
        "plan",
        path.to_str().unwrap(),
        "--until",
        "move",
        "--set",
        &root,
    ]);
    let text = stdout(&plan);
    let told =
        "the stage was renamed from `retarget` to `move`, and its random numbers follow its name";
    for node in ["move.distance_fields", "move.trajectories"] {
        let mut lines = text.lines();
        let found = lines.any(|line| line.contains(node) && line.contains(told));
        assert!(found, "{node}:\n{text}{}", stderr(&plan));
    }
    assert!(!text.contains("never made"), "{text}");
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
    // The shown file and the blob are one, so this damages the next stage's input.
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
    let repaired = bench.published();
    for (name, digest) in &shown {
        assert_eq!(repaired.get(name), Some(digest), "{name}");
    }
}

/// Changes bytes in place, keeping the file.
fn overwrite(path: &std::path::Path, bytes: &[u8]) {
    use std::io::Write;
    let mut file = fs::File::options().write(true).open(path).unwrap();
    file.write_all(bytes).unwrap();
}

#[test]
fn sql_query_prints_a_table() {
    let bench = screened();
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
