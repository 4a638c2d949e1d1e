//! Equal arguments give equal bytes: on any number of threads, and after `kill -9`.

use std::{
    collections::BTreeMap,
    env, fs,
    process::Stdio,
    thread,
    time::{Duration, Instant, SystemTime},
};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::program::{
    bench::{Bench, stdout},
    cell_lab::executed,
};

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let digests = |jobs: &str| {
        let bench = Bench::new();
        let ran = bench
            .command("run", &["--jobs", jobs])
            .env("RAYON_NUM_THREADS", jobs)
            .output()
            .unwrap();
        assert!(ran.status.success());
        bench.published()
    };
    let one = digests("1");
    let two = digests("2");
    assert!(one.len() > 50);
    assert_eq!(one, two);
}

/// The loader takes the C library's functions for processors without fused multiply-add where it is told to.
#[test]
fn results_of_other_elementary_functions_are_not_mixed() {
    if !(cfg!(all(target_arch = "x86_64", target_env = "gnu")) && has_fused_multiply_add()) {
        eprintln!("skipped: the C library has functions of one kind for this processor");
        return;
    }
    let bench = Bench::new();
    let until = ["--until", "ingest"];
    bench.run_well(&until);
    let elsewhere = bench
        .command("plan", &until)
        .env("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA")
        .output()
        .unwrap();
    let plan = stdout(&elsewhere);
    assert!(!plan.contains("cached"), "{plan}");
    assert!(
        plan.contains("rounds `sin`, `exp` and the like otherwise"),
        "{plan}"
    );
    let here = bench.command("plan", &until).output().unwrap();
    assert_eq!(stdout(&here), "cached   everything; nothing to run\n");
}

fn has_fused_multiply_add() -> bool {
    let processor = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    processor.split_whitespace().any(|feature| feature == "fma")
}

#[test]
fn a_killed_run_continues_to_the_same_bytes() {
    let expected = executed().published();
    let n_units = count_units(executed());
    let bench = Bench::new();
    // Early in the first stage, between stages, and late: whenever this many units are done.
    for done in [2, n_units / 3, n_units * 2 / 3, n_units - 3] {
        let mut run = bench
            .command("run", &[])
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        while count_units(&bench) < done {
            assert!(
                run.try_wait().unwrap().is_none(),
                "the run ended before it was killed"
            );
            std::thread::yield_now();
        }
        run.kill().unwrap();
        run.wait().unwrap();
        let before = count_units(&bench);
        // What was finished is not made again: the next run only adds.
        assert!(
            before >= done && before < n_units,
            "{done} {before} {n_units}"
        );
    }
    bench.run_well(&[]);
    assert_eq!(bench.published(), expected);
    assert_eq!(count_units(&bench), n_units);
}

/// Seconds after which training has surely saved its state again: it does so once a second.
const SAVED_S: f64 = 1.5;

#[test]
fn a_killed_training_continues_to_the_same_bytes() {
    let n_kills: u32 = env::var("PIPELINE_KILLS").map_or(3, |kills| kills.parse().unwrap());
    // Some motions are held out and the statistics are fixed half way, so that every part of a
    // training's state is gone on from.
    let training = |epochs: u32| -> Vec<String> {
        let epochs = format!("train.training.epochs={epochs}");
        let sets = [
            "train.held_out_share=0.2",
            "train.training.validation_epochs=3",
            &epochs,
        ];
        let sets = sets.into_iter().flat_map(|set| ["--set", set]);
        ["--until", "train"]
            .into_iter()
            .chain(sets)
            .map(str::to_owned)
            .collect()
    };
    let run = |bench: &Bench, arguments: &[String]| {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let mut run = bench.command("run", &arguments);
        run.stdout(Stdio::null()).stderr(Stdio::null());
        run
    };
    let well = |bench: &Bench, arguments: &[String]| {
        let started = Instant::now();
        assert!(run(bench, arguments).status().unwrap().success());
        started.elapsed().as_secs_f64()
    };
    let [undisturbed, bench] = [Bench::new(), Bench::new()];
    for bench in [&undisturbed, &bench] {
        well(bench, &["--until", "retarget"].map(str::to_owned));
    }
    // Long enough that no life comes to the end.
    let epoch_s = well(&undisturbed, &training(100)) / 100.0;
    let long = 1.5 * SAVED_S * f64::from(n_kills + 2) / epoch_s;
    let arguments = training(format!("{long:.0}").parse().unwrap());
    well(&undisturbed, &arguments);

    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut n_resumed = 0;
    for kill in 1..=n_kills {
        let left = state(&bench);
        n_resumed += u32::from(left.is_some());
        let mut life = run(&bench, &arguments).spawn().unwrap();
        // One life in three ends before it has saved anything, and some while they do.
        if rng.random_bool(0.67) {
            let started = Instant::now();
            while state(&bench) == left && started.elapsed().as_secs() < 60 {
                thread::sleep(Duration::from_millis(1));
            }
        }
        thread::sleep(Duration::from_secs_f64(rng.random_range(0.0..SAVED_S)));
        let ended = life.try_wait().unwrap();
        assert!(ended.is_none(), "ended before kill {kill} of {n_kills}");
        life.kill().unwrap();
        life.wait().unwrap();
    }
    assert!(n_resumed > 0, "no life went on from an earlier one");
    well(&bench, &arguments);
    assert_eq!(trained(&bench), trained(&undisturbed));
    println!("{n_kills} kills; {n_resumed} lives went on from a state of an earlier one");
}

/// The artifacts of the training that the lake shows, by path.
fn trained(bench: &Bench) -> BTreeMap<String, String> {
    let mut shown = bench.published();
    shown.retain(|path, _| path.contains("stage=train") || path.contains("/train/"));
    assert!(shown.len() >= 4, "{shown:?}");
    shown
}

/// When the resume state of an interrupted training was saved, if there is one.
fn state(bench: &Bench) -> Option<SystemTime> {
    let units = fs::read_dir(bench.lake().join("resume")).ok()?;
    let states = units.map(|unit| unit.unwrap().path().join("state.safetensors"));
    states
        .filter_map(|state| state.metadata().ok()?.modified().ok())
        .max()
}

/// Number of units whose results are kept.
fn count_units(bench: &Bench) -> usize {
    let Ok(folders) = fs::read_dir(bench.lake().join("units")) else {
        return 0;
    };
    folders
        .map(|folder| fs::read_dir(folder.unwrap().path()).map_or(0, Iterator::count))
        .sum()
}
