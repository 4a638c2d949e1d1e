//! How fast and in how little memory `ingest` reads label files, beside a bare read of the same
//! bytes and beside `numpy`.
//!
//! `cargo bench --bench labels` makes 200 recordings of 72 images by 8 cameras, in `DexYCB`'s layout
//! without its images, in a temporary folder (115,200 files, 0.6 GB). Everything runs on one thread
//! with the files in the page cache. `PIPELINE_PYTHON` names the Python that has `numpy`, `python3`
//! where it is not set.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

#[path = "labels/recordings.rs"]
mod recordings;

use std::{
    collections::BTreeMap,
    env, fs,
    fs::File,
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Instant,
};

use dataflow::{Context, Inputs, Outcome, Scope, SourceFile, Stage, Unit};
use recordings::{GRASPED, N_OBJECTS};
use stage_ingest::{Ingest, IngestConfig, read::LabelReader};
use tempfile::TempDir;

/// How many times faster than `numpy` the reader has to be.
const LEAST_TIMES_FASTER: f64 = 20.0;
/// Most memory that the process may ever hold, in MiB.
const MOST_MIB: f64 = 1024.0;
/// Files that `numpy` reads; more would change nothing but the time that it takes.
const N_FOR_NUMPY: usize = 8000;
/// Times that each way is measured; the fastest counts, since what disturbs only slows.
const N_TIMES: usize = 3;

fn main() {
    let root = TempDir::new().unwrap();
    let started = Instant::now();
    recordings::write(root.path(), 200, 72);
    let config = config(root.path());
    let units = Ingest::units(&config, "demonstrations", &Scope::default()).unwrap();
    let labels: Vec<&SourceFile> = units
        .iter()
        .flat_map(|unit| &unit.files)
        .filter(|file| file.name.contains("/labels_"))
        .collect();
    let size: u64 = labels
        .iter()
        .map(|file| fs::metadata(&file.path).unwrap().len())
        .sum();
    println!(
        "{} label files of {} bytes on average, made in {:.0} s",
        labels.len(),
        size / labels.len() as u64,
        started.elapsed().as_secs_f64()
    );
    // Not what this bench measures: its own making of the files.
    let memory_before = peak_mib();

    println!(
        "{:<44} {:>10} {:>12}",
        "on one thread", "us a file", "files a s"
    );
    let bytes = row("reading the bytes", labels.len(), || read_bytes(&labels));
    let reader = row("reading landmarks and pose", labels.len(), || {
        read_labels(&labels);
    });
    println!("{:<44} {:>8.2} x", "  times a bare read", reader / bytes);
    let stage = row(
        "the stage, per label file of the recordings",
        labels.len(),
        || {
            run_stage(&config, &units);
        },
    );
    println!("{:<44} {:>8.2} x", "  times a bare read", stage / bytes);
    match numpy_us(&labels) {
        Ok(numpy) => {
            show("numpy, landmarks and pose", numpy);
            println!(
                "{:<44} {:>8.1} x {:>8.1} x allowed",
                "  times longer than the reader",
                numpy / reader,
                LEAST_TIMES_FASTER
            );
            println!(
                "{:<44} {:>8.1} x",
                "  times longer than the stage",
                numpy / stage
            );
        }
        Err(reason) => println!("numpy: skipped, {reason}"),
    }
    println!(
        "{:<44} {:>6.0} MiB {:>6.0} MiB allowed",
        "most memory held",
        peak_mib(),
        MOST_MIB
    );
    println!(
        "{:<44} {memory_before:>6.0} MiB",
        "  of it while making the files"
    );
}

/// The options of the bundled sample, with the made recordings as its dataset.
fn config(root: &Path) -> IngestConfig {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/cgf.toml");
    let mut text: toml_edit::DocumentMut = fs::read_to_string(file).unwrap().parse().unwrap();
    let mut options = text["stages"]["ingest"].as_table().unwrap().clone();
    options.remove("kind");
    options["root"] = toml_edit::value(root.to_str().unwrap());
    text.clear();
    text.extend(options);
    toml_edit::de::from_document(text).unwrap()
}

fn read_bytes(labels: &[&SourceFile]) {
    let mut buffer = vec![0; 1 << 20];
    for label in labels {
        let mut file = File::open(&label.path).unwrap();
        let mut len = 0;
        loop {
            match file.read(&mut buffer[len..]).unwrap() {
                0 => break,
                n => len += n,
            }
        }
        std::hint::black_box(&buffer[..len]);
    }
}

fn read_labels(labels: &[&SourceFile]) {
    let mut reader = LabelReader::new();
    for label in labels {
        std::hint::black_box(reader.read(label, N_OBJECTS, GRASPED).unwrap());
    }
}

/// Makes every demonstration, as a run does.
fn run_stage(config: &IngestConfig, units: &[Unit]) {
    for unit in units {
        let folder = TempDir::new().unwrap();
        let inputs = Inputs::new(BTreeMap::new(), unit.files.clone());
        let cx = Context::detached("demonstrations", &unit.partition, 7, folder.path());
        let outcome = Ingest::run(config, &inputs, &cx).unwrap();
        assert!(matches!(outcome, Outcome::Made(_)), "{outcome:?}");
    }
}

/// Returns how many microseconds `numpy` takes for one file, or why that cannot be said.
fn numpy_us(labels: &[&SourceFile]) -> Result<f64, String> {
    let python = env::var_os("PIPELINE_PYTHON").map_or_else(|| "python3".into(), PathBuf::from);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/benches/labels/numpy_reads.py");
    let mut process = Command::new(&python)
        .arg(script)
        .env("OMP_NUM_THREADS", "1")
        .env("OPENBLAS_NUM_THREADS", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|err| format!("cannot start `{}`: {err}", python.display()))?;
    let step = labels.len().div_ceil(N_FOR_NUMPY);
    let mut input = process.stdin.take().unwrap();
    for label in labels.iter().step_by(step) {
        // It fails where the process has ended; what that said is told below.
        let _ = writeln!(input, "{}", label.path.display());
    }
    drop(input);
    let output = process.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let said = said.lines().last().unwrap_or_default();
    String::from_utf8_lossy(&output.stdout)
        .trim()
        .parse()
        .map_err(|_no_number| format!("`{}`: {said}", python.display()))
}

/// Measures some work on `n_files` files and returns the microseconds that one takes.
fn row(what: &str, n_files: usize, mut work: impl FnMut()) -> f64 {
    let fastest = (0..N_TIMES)
        .map(|_| {
            let started = Instant::now();
            work();
            started.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    let us = fastest * 1e6 / n_files as f64;
    show(what, us);
    us
}

fn show(what: &str, us: f64) {
    println!("{what:<44} {us:>10.2} {:>12.0}", 1e6 / us);
}

/// The most memory that this process has held, in MiB.
fn peak_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}
