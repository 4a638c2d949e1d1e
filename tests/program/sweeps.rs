//! Sweeps: every variant runs, and shared results are made once.

use crate::program::bench::{Bench, put, stderr, stdout};

const KL_WEIGHTS: [&str; 4] = [
    "--until",
    "train",
    "--set",
    "train.training.kl_weight=1e-3,1e-2",
];

/// Whether the line of a stage says that everything was in the lake; `None` if it has none.
fn is_cached(text: &str, stage: &str) -> Option<bool> {
    let lines = text.lines().filter(|line| line.starts_with("  "));
    let mut lines = lines.filter(|line| line.split_whitespace().nth(1) == Some(stage));
    lines.next().map(|line| line.ends_with(" cached"))
}

#[test]
fn every_variant_runs_and_shared_stages_run_once() {
    let bench = Bench::new();
    let ran = bench.run_well(&KL_WEIGHTS);
    let text = stderr(&ran);
    let (first, second) = text.split_once("variant 2 of 2: ").unwrap();
    assert!(first.starts_with("variant 1 of 2: train.training.kl_weight=0.001\n"));
    assert!(second.starts_with("train.training.kl_weight=0.01\n"));
    for (stage, again) in [("ingest", true), ("retarget", true), ("train", false)] {
        assert_eq!(is_cached(first, stage), Some(false), "{stage}\n{text}");
        assert_eq!(is_cached(second, stage), Some(again), "{stage}\n{text}");
    }
    let table: Vec<&str> = text.lines().rev().take(3).collect();
    assert!(table[2].starts_with("variant "), "{text}");
    for (row, label) in [
        (table[1], "kl_weight=0.001 "),
        (table[0], "kl_weight=0.01 "),
    ] {
        assert!(row.contains(label) && row.contains("tip error"), "{row}");
        assert!(row.ends_with(" s"), "{row}");
    }

    let plan = bench.command("plan", &KL_WEIGHTS).output().unwrap();
    let cached = "cached   everything; nothing to run\n";
    assert_eq!(stdout(&plan), cached.repeat(2));
    assert!(stderr(&plan).contains("variant 2 of 2"));
    let dry = bench.run(&[&KL_WEIGHTS[..], &["--dry-run"]].concat());
    assert_eq!(stdout(&dry), cached.repeat(2));
    let json = bench
        .command("plan", &[&KL_WEIGHTS[..], &["--format", "json"]].concat())
        .output()
        .unwrap();
    let plans: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    let plans = plans.as_array().unwrap();
    assert_eq!(plans.len(), 2);
    for plan in plans {
        assert!(
            plan["variant"].as_str().unwrap().contains("kl_weight"),
            "{plan}"
        );
        assert!(plan["plan"]["nodes"].is_array(), "{plan}");
    }
}

#[test]
fn complete_variants_are_not_recorded_again() {
    let bench = Bench::new();
    let until = ["--until", "retarget"];
    let with = |iterations: &str| {
        let set = format!("retarget.max_iterations={iterations}");
        bench.run_well(&[&until[..], &["--set", &set]].concat());
    };
    let newest = || {
        let run = lake::Lake::open(&bench.lake()).newest_run().unwrap();
        run.unwrap().number
    };
    with("10,20");
    let shown = bench.published();
    assert_eq!((bench.runs().len(), newest()), (2, 2));
    with("10,20");
    with("20");
    assert_eq!((bench.runs().len(), newest()), (2, 2));
    assert_eq!(bench.published(), shown);
    // What is shown is the first one's, and the run that commands speak of as well.
    with("10");
    assert_eq!((bench.runs().len(), newest()), (2, 1));
    assert_ne!(bench.published(), shown);
    let inspected = bench.ask(&["inspect", "retarget.trajectories"]);
    let inspected = stdout(&inspected) + &stderr(&inspected);
    assert!(!inspected.contains("run 2"), "{inspected}");
    // Plain commands find everything in order.
    let verified = bench.ask(&["verify"]);
    assert_eq!(verified.status.code(), Some(0), "{}", stderr(&verified));
    with("15");
    assert_eq!((bench.runs().len(), newest()), (3, 3));
    with("10,20");
    assert_eq!((bench.runs().len(), newest()), (3, 2));
}

#[test]
fn several_lists_make_their_product_in_order() {
    let sets = ["--set", "seed=1,2", "--set", "sample.steps=20,30"];
    let arguments = [&["--dry-run"], &sets[..]].concat();
    let dry = Bench::new().run(&arguments);
    assert_eq!(dry.status.code(), Some(0), "{}", stderr(&dry));
    let text = stderr(&dry);
    let announced: Vec<&str> = text.lines().collect();
    let expected = [
        "variant 1 of 4: seed=1, sample.steps=20",
        "variant 2 of 4: seed=1, sample.steps=30",
        "variant 3 of 4: seed=2, sample.steps=20",
        "variant 4 of 4: seed=2, sample.steps=30",
    ];
    assert_eq!(announced, expected);
}

#[test]
fn a_variant_that_fails_does_not_stop_the_others() {
    let bench = Bench::new();
    let file = include_str!("../../data/hands/allegro_right.toml");
    let lost = bench.lake().with_file_name("lost.toml");
    put(&lost, &file.replace("allegro_right.urdf", "such.urdf"));
    let hands = format!(
        "retarget.hand={},data/hands/allegro_right.toml",
        lost.display()
    );
    let ran = bench.run(&["--until", "retarget", "--set", &hands]);
    assert_eq!(ran.status.code(), Some(1));
    let text = stderr(&ran);
    assert!(text.contains("error: stage `retarget` failed"), "{text}");
    assert!(text.contains("error: 1 of 2 variants failed"), "{text}");
    let row = |hand: &str| {
        let rows = text
            .lines()
            .filter(|line| line.starts_with("retarget.hand="));
        let mut rows = rows.filter(|line| line.contains(hand));
        rows.next().unwrap().to_owned()
    };
    assert!(row("lost.toml").contains("failed"), "{text}");
    assert!(row("allegro_right.toml").contains("trajectories"), "{text}");
}

#[test]
fn a_wrong_value_is_found_before_any_variant_runs() {
    let bench = Bench::new();
    for (set, says) in [
        ("train.training.epoch=1,2", "did you mean `epochs`?"),
        ("sample.steps=20,many", "must be a whole number"),
        ("sample.steps=20,,30", "empty value"),
    ] {
        let ran = bench.run(&["--set", set]);
        assert_eq!(ran.status.code(), Some(2), "{set}: {}", stderr(&ran));
        assert!(stderr(&ran).contains(says), "{set}: {}", stderr(&ran));
    }
    assert!(!bench.lake().exists());
}
