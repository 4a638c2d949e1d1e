//! How long a question about a large table takes: 1 M rollouts in 1,000 partitions.
//!
//! The whole process is timed, from its start to the printed answer, beside a bare read of the same
//! files. `cargo bench --bench query`; `ROLLOUTS=10000` takes another number of rows.

#![expect(clippy::print_stdout, reason = "what is measured is for people")]

use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Instant,
};

use schemas::rollouts::{self, Rollout, Smoothness, Verdict};

/// Rows of the table, if `ROLLOUTS` does not say.
const ROWS: usize = 1_000_000;

/// Objects, and so files of the table.
const PARTITIONS: usize = 1000;

/// The answer must be there after this many seconds.
const BOUND_S: f64 = 1.0;

/// Times that each is measured; the fastest counts.
const TIMES: usize = 5;

const SQL: &str = "select object, avg(cast(success as double)) from rollouts group by object";

fn main() -> Result<(), Box<dyn Error>> {
    let rows = std::env::var("ROLLOUTS").map_or(Ok(ROWS), |text| text.parse())?;
    let lake = tempfile::tempdir()?;
    let files = make(lake.path(), rows.div_ceil(PARTITIONS))?;
    let (read_s, n_bytes) = fastest(|| {
        let mut n_bytes = 0;
        for file in &files {
            n_bytes += fs::read(file)?.len();
        }
        Ok(n_bytes)
    })?;
    let (query_s, n_lines) = fastest(|| {
        let asked = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .args(["query", SQL, "--format", "csv", "--lake"])
            .arg(lake.path())
            .stderr(Stdio::inherit())
            .output()?;
        Ok(String::from_utf8(asked.stdout)?.lines().count())
    })?;
    if n_lines != PARTITIONS + 1 {
        return Err(format!("{n_lines} lines, not one for each of {PARTITIONS} objects").into());
    }
    println!(
        "query of {rows} rows in {PARTITIONS} files: {query_s:.3} s (bound {BOUND_S} s); \
         bare read of their {:.1} MB: {read_s:.3} s",
        n_bytes as f64 / 1e6
    );
    if query_s > BOUND_S {
        return Err(format!("{query_s:.3} s is more than {BOUND_S} s").into());
    }
    Ok(())
}

/// Writes the table's files.
fn make(lake: &Path, rows_per_file: usize) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let table = lake.join("tables/rollouts/pipeline=bench/stage=screen");
    let mut files = Vec::new();
    for partition in 0..PARTITIONS {
        let object = format!("object_{partition:04}");
        let rollouts: Vec<Rollout> = (0..rows_per_file)
            .map(|row| rollout(&object, row))
            .collect();
        let folder = table.join(format!("object={object}"));
        fs::create_dir_all(&folder)?;
        lake::table::write(&folder, &rollouts::to_batch(&rollouts)?)?;
        files.push(folder.join(lake::table::FILE));
    }
    Ok(files)
}

/// A row with numbers that do not repeat, as measured ones do not.
fn rollout(object: &str, row: usize) -> Rollout {
    let number = (row as f64 * 0.618_033_988_75).fract();
    Rollout {
        candidate_id: format!("{object}-{row:05}"),
        generator: "cgf".to_owned(),
        verdict: Verdict::ALL[row % Verdict::ALL.len()],
        cost_n: 190,
        saved_n: 0,
        lift_m: 0.15 * number,
        slip_m: 1e-3 * number,
        displacement_m: 2e-2 * number,
        penetration_m: 3e-3 * number,
        contacts_n: 6,
        smoothness: Smoothness::default(),
    }
}

/// Returns the shortest of a few times in seconds, and what came out of it.
fn fastest<T>(work: impl Fn() -> Result<T, Box<dyn Error>>) -> Result<(f64, T), Box<dyn Error>> {
    let mut fastest: Option<(f64, T)> = None;
    for _ in 0..TIMES {
        let started = Instant::now();
        let result = work()?;
        let seconds = started.elapsed().as_secs_f64();
        if fastest.as_ref().is_none_or(|(least, _)| seconds < *least) {
            fastest = Some((seconds, result));
        }
    }
    fastest.ok_or_else(|| "nothing was measured".into())
}
