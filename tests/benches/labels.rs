//! Speed and memory of `ingest` reading label files, beside a bare read of the same bytes and
//! beside `numpy`.
//!
//! `cargo bench --bench labels` makes 200 recordings of 72 images by 8 cameras, in `DexYCB`'s layout
//! without its images, in a temporary folder (115,200 files, 0.6 GB). Everything runs on one thread
//! with the files in the page cache. `PIPELINE_PYTHON` names the Python that has `numpy`, `python3`
//! where it is not set.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;
#[expect(dead_code, reason = "numpy is asked once")]
mod python;
#[path = "labels/recordings.rs"]
mod recordings;

use std::{
    collections::BTreeMap, fs, fs::File, io::Read, path::Path, process::ExitCode, time::Instant,
};

use dataflow::{Context, Inputs, Outcome, Output, Pipeline, Scope, SourceFile, Unit};
use limits::Limits;
use python::Script;
use recordings::{GRASPED, N_OBJECTS};
use stage_ingest::{Demonstrations, Ingest, IngestConfig, read::LabelReader};
use tempfile::TempDir;

/// Least speedup of the reader over `numpy`.
const MIN_TIMES_FASTER: f64 = 20.0;
/// Most memory that the process may ever hold, in MiB.
const MAX_MIB: f64 = 1024.0;
/// Files that `numpy` reads; more would change nothing but the time that it takes.
const N_FOR_NUMPY: usize = 8000;
/// Times that each way is measured, one way after another; the fastest counts, since disturbances
/// only slow.
const N_ROUNDS: usize = 3;

/// Relative difference of the fastest of the rounds from run to run, with other programs beside.
const NOISE: f64 = 0.15;

fn main() -> ExitCode {
    let root = TempDir::new().unwrap();
    let started = Instant::now();
    recordings::write(root.path(), 200, 72);
    let config = config(root.path());
    let units = Demonstrations::units(&config, &Scope::default()).unwrap();
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

    let mut fastest = Us::default();
    for round in 0..N_ROUNDS {
        let artifacts = root.path().join(format!("artifacts-{round}"));
        fastest.take(&Us {
            bytes: us(labels.len(), || read_bytes(&labels)),
            reader: us(labels.len(), || read_labels(&labels)),
            stage: us(labels.len(), || run_stage(&config, &units, &artifacts)),
            numpy: numpy_us(&labels),
        });
    }
    let mut limits = Limits::with_noise(NOISE);
    fastest.print(&mut limits);
    println!(
        "{:<44} {memory_before:>6.0} MiB",
        "most memory held while making the files"
    );
    limits.keep("most memory held, MiB", peak_mib(), ..=MAX_MIB);
    limits.end()
}

/// The options of the bundled sample, with the made recordings as its dataset.
fn config(root: &Path) -> IngestConfig {
    let text = include_str!("../../pipelines/cgf.toml");
    let given = format!("ingest.root={}", root.display());
    let given = [given.parse().unwrap()];
    let read = Pipeline::parse("cgf.toml".as_ref(), text, &pipeline::kinds(), None, &given);
    let read = read.unwrap();
    let ingest = read.find("ingest").unwrap().options::<Ingest>();
    ingest.unwrap().clone()
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

/// Makes every demonstration, as a run does, below `artifacts`.
fn run_stage(config: &IngestConfig, units: &[Unit], artifacts: &Path) {
    for unit in units {
        let folder = artifacts.join(&unit.partition);
        fs::create_dir_all(&folder).unwrap();
        let inputs = Inputs::new(BTreeMap::new(), unit.files.clone());
        let cx = Context::detached(&unit.partition.parse().unwrap(), 7, &folder);
        let outcome = Demonstrations::make(config, &inputs, &cx).unwrap();
        assert!(matches!(outcome, Outcome::Made(_)), "{outcome:?}");
    }
}

/// Returns the microseconds that `numpy` takes for one file, or the reason why they are unknown.
fn numpy_us(labels: &[&SourceFile]) -> Result<f64, String> {
    let mut script = Script::start(&python::name(), "labels/numpy_reads.py", &[], 1)?;
    let step = labels.len().div_ceil(N_FOR_NUMPY);
    let paths: Vec<&Path> = labels
        .iter()
        .step_by(step)
        .map(|label| label.path.as_path())
        .collect();
    let us = script.ask(&serde_json::to_string(&paths).unwrap())?;
    Ok(us.parse().unwrap())
}

/// Microseconds for one file.
struct Us {
    bytes: f64,
    reader: f64,
    stage: f64,
    numpy: Result<f64, String>,
}

impl Default for Us {
    fn default() -> Self {
        Self {
            bytes: f64::INFINITY,
            reader: f64::INFINITY,
            stage: f64::INFINITY,
            numpy: Ok(f64::INFINITY),
        }
    }
}

impl Us {
    /// Keeps the faster of each.
    fn take(&mut self, other: &Self) {
        self.bytes = self.bytes.min(other.bytes);
        self.reader = self.reader.min(other.reader);
        self.stage = self.stage.min(other.stage);
        self.numpy = match (&self.numpy, &other.numpy) {
            (Ok(a), Ok(b)) => Ok(a.min(*b)),
            (_, failed) => failed.clone(),
        };
    }

    fn print(&self, limits: &mut Limits) {
        println!(
            "{:<44} {:>10} {:>12}",
            "on one thread", "us a file", "files a s"
        );
        show("reading the bytes", self.bytes);
        show("reading landmarks and pose", self.reader);
        times("  times a bare read", self.reader / self.bytes);
        show("the stage, per label file", self.stage);
        times("  times a bare read", self.stage / self.bytes);
        match &self.numpy {
            Ok(numpy) => {
                show("numpy, landmarks and pose", *numpy);
                times("  times longer than the stage", numpy / self.stage);
                let longer = numpy / self.reader;
                limits.keep("numpy over the reader", longer, MIN_TIMES_FASTER..);
            }
            Err(reason) => println!("numpy: skipped, {reason}"),
        }
    }
}

/// Measures some work on `n_files` files and returns the microseconds that one takes.
fn us(n_files: usize, work: impl FnOnce()) -> f64 {
    let started = Instant::now();
    work();
    started.elapsed().as_secs_f64() * 1e6 / n_files as f64
}

fn times(what: &str, factor: f64) {
    println!("{what:<44} {factor:>8.1} x");
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
