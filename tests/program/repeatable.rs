//! Equal arguments give equal bytes: on any number of threads, and after `kill -9`.

use std::{fs, process::Stdio};

use crate::bench::Bench;

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

#[test]
fn a_killed_run_continues_to_the_same_bytes() {
    let undisturbed = Bench::new();
    undisturbed.run_well(&[]);
    let expected = undisturbed.published();
    let n_units = count_units(&undisturbed);
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

/// Number of units whose results are kept.
fn count_units(bench: &Bench) -> usize {
    let Ok(folders) = fs::read_dir(bench.lake().join("units")) else {
        return 0;
    };
    folders
        .map(|folder| fs::read_dir(folder.unwrap().path()).map_or(0, Iterator::count))
        .sum()
}
