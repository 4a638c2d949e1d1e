//! Duration of a query over a large table: 1 M rollouts in 1,000 partitions.
//!
//! The whole process is timed, from its start to the printed answer, beside a bare read of the same
//! files. `cargo bench --bench query`; `ROLLOUTS=10000` takes another number of rows.

#![expect(clippy::print_stdout, reason = "what is measured is for people")]

mod limits;

use std::{
    collections::BTreeMap,
    error::Error,
    fs,
    path::{Path, PathBuf},
    process::{Command, ExitCode, Stdio},
    sync::Arc,
    time::Instant,
};

use dataflow::{
    Fingerprint, NodeName, NodeRecord, Origin, OutputFingerprint, OutputRecord, PartitionKey,
    Record, RecordOutcome, RunRecord, RunStatus, Store, UnitName, UnitRef,
};
use lake::Lake;
use limits::Limits;
use schemas::{
    Table,
    candidates::DrawSource,
    rollouts::{ExecutedSmoothness, Measures, Rollout, Rollouts, Smoothness, Verdict},
};

/// Rows of the table, if `ROLLOUTS` does not say.
const ROWS: usize = 1_000_000;

/// Objects, and so files of the table.
const PARTITIONS: usize = 1000;

/// The answer must be there after this many seconds.
const BOUND_S: f64 = 1.0;

/// Times that each is measured; the fastest counts.
const TIMES: usize = 5;

/// Relative difference of the fastest of the times from run to run, with other programs beside.
const NOISE: f64 = 0.2;

const SQL: &str = "select object, avg(cast(success as double)) from rollouts group by object";

fn main() -> Result<ExitCode, Box<dyn Error>> {
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
            .env_remove("PIPELINE_DEPOT")
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
        "query of {rows} rows in {PARTITIONS} files: {query_s:.3} s; bare read of their {:.1} MB: {read_s:.3} s",
        n_bytes as f64 / 1e6
    );
    let mut limits = Limits::with_noise(NOISE);
    limits.keep("the answer, s", query_s, ..=BOUND_S);
    Ok(limits.end())
}

/// Writes a lake with one run, whose only stage made the table; returns its files.
fn make(folder: &Path, rows_per_file: usize) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let lake = Lake::open(folder);
    let node = NodeName::parse("screen.rollouts").unwrap();
    let recipe = Arc::new(OutputFingerprint {
        kind: "screen".to_owned(),
        output: "rollouts".parse().unwrap(),
        code: BTreeMap::new(),
        config: serde_json::Value::Null,
        schema: Rollouts::VERSION.to_owned(),
    });
    let mut units = Vec::new();
    for partition in 0..PARTITIONS {
        let object: PartitionKey = format!("object_{partition:04}").parse()?;
        let rollouts: Vec<Rollout> = (0..rows_per_file)
            .map(|row| rollout(object.as_str(), row))
            .collect();
        let fingerprint = Fingerprint {
            recipe: Arc::clone(&recipe),
            stage: node.stage.clone(),
            partition: object.clone(),
            inputs: BTreeMap::new(),
            files: BTreeMap::new(),
            facts: BTreeMap::new(),
            seed: 0,
        };
        let digest = fingerprint.digest();
        let making = lake.begin(&digest, &UnitName::new(&node, &object), &|_| {})?;
        lake::table::write(making.folder(), &rollouts)?;
        let outcome = RecordOutcome::Made {
            files: BTreeMap::new(),
            labels: BTreeMap::new(),
            metrics: BTreeMap::new(),
            provisional: false,
        };
        let record = making.commit(Record {
            fingerprint,
            outcome,
        })?;
        let unit = UnitRef {
            node: node.clone(),
            partition: object,
            fingerprint: digest,
            made_now: true,
        };
        units.push((unit, Arc::new(record.outcome)));
    }
    let run = RunRecord {
        pipeline: "bench".to_owned(),
        origin: Origin::default(),
        seed: 0,
        stages: BTreeMap::new(),
        outputs: vec![OutputRecord {
            node: node.clone(),
            partition: "object".to_owned(),
        }],
        nodes: vec![NodeRecord {
            node,
            description: String::new(),
            published: true,
            n_made_now: units.len(),
            n_made: units.len(),
            n_skipped: 0,
            n_filtered: 0,
            metrics: BTreeMap::new(),
            seconds: 0.0,
        }],
        units: units.iter().map(|(unit, _)| unit.clone()).collect(),
        status: RunStatus::Finished,
        seconds: 0.0,
    };
    let number = lake.begin_run(&run)?;
    lake.end_run(number, &run, &units)?;
    let files = lake.newest_table("rollouts")?.stages.into_iter();
    Ok(files.flat_map(|stage| stage.files.into_values()).collect())
}

/// A row with numbers that do not repeat, as measured ones do not.
fn rollout(object: &str, row: usize) -> Rollout {
    let number = (row as f64 * 0.618_033_988_75).fract();
    Rollout {
        candidate_id: format!("{object}-{row:05}"),
        generator: "cgf".to_owned(),
        source: DrawSource::replayed("a"),
        verdict: Verdict::ALL[row % Verdict::ALL.len()],
        measures: Measures {
            control_steps_n: 190,
            lift_m: 0.15 * number,
            slip_m: 1e-3 * number,
            displacement_m: 2e-2 * number,
            penetration_m: 3e-3 * number,
            contacts_n: 6,
            ..Measures::default()
        },
        smoothness: Smoothness::default(),
        executed: ExecutedSmoothness(None),
    }
}

/// Returns the shortest of a few times in seconds, and the result.
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
