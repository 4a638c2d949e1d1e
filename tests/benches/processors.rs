//! Whether a small run makes the same bytes on other processors: with one, two and eight threads, and emulated by
//! `qemu-x86_64` (Debian's package `qemu-user`) as a processor that has AVX2 and no AVX-512.
//!
//! `cargo bench --bench processors` trains for two epochs on four objects and goes on to the screen. An emulated run
//! takes half an hour. Without the emulator only threads are compared. Without AVX2 the C library's sine and
//! exponential differ in their last bits.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

use std::{
    collections::BTreeMap,
    path::Path,
    process::{Command, ExitCode},
    time::Instant,
};

/// The emulator, and the processor that it stands for.
const EMULATOR: &str = "qemu-x86_64";
const PROCESSOR: &str = "Haswell";
/// Numbers of threads; the first is compared with everything else.
const THREADS: [&str; 3] = ["2", "1", "8"];
/// A small run up to the screen.
const RUN: [&str; 14] = [
    "run",
    "pipelines/cgf.toml",
    "--quiet",
    "--until",
    "screen",
    "--set",
    r#"ingest.objects=["003_cracker_box","006_mustard_bottle","011_banana","025_mug"]"#,
    "--set",
    "train.training.epochs=2",
    "--set",
    "sample.per_object=16",
    "--set",
    "screen.robustness.trials=2",
    "--lake",
];
const DIGESTS: &str = "select stage, artifact, partition, file, digest from artifacts";

/// Digests by stage, artifact, partition and file.
type Digests = BTreeMap<[String; 4], String>;

fn main() -> ExitCode {
    let mut others: Vec<(String, Digests)> = Vec::new();
    for n in THREADS {
        others.push((format!("{n} threads"), run(None, n)));
    }
    if Command::new(EMULATOR).arg("--version").output().is_err() {
        println!("{PROCESSOR}: skipped, there is no `{EMULATOR}`");
    } else {
        others.push((PROCESSOR.to_owned(), run(Some(PROCESSOR), THREADS[0])));
    }
    let (_, ours) = others.remove(0);
    assert!(!ours.is_empty());
    #[cfg(target_arch = "x86_64")]
    println!("AVX-512 here: {}", is_x86_feature_detected!("avx512f"));
    let mut is_same = true;
    for (name, theirs) in others {
        let differ = ours
            .iter()
            .filter(|(of, digest)| theirs.get(*of) != Some(*digest));
        let differ: Vec<String> = differ.map(|(of, _)| of.join(" ")).collect();
        println!("{name}: {} of {} files differ", differ.len(), ours.len());
        for of in differ.iter().take(10) {
            println!("  {of}");
        }
        is_same &= differ.is_empty() && theirs.len() == ours.len();
    }
    ExitCode::from(u8::from(!is_same))
}

/// Makes the run in a lake of its own.
fn run(processor: Option<&str>, threads: &str) -> Digests {
    let lake = tempfile::tempdir().unwrap();
    let before = Instant::now();
    let program = env!("CARGO_BIN_EXE_pipeline");
    let mut command = match processor {
        None => Command::new(program),
        Some(processor) => {
            let mut command = Command::new(EMULATOR);
            command.args(["-cpu", processor, program]);
            command
        }
    };
    command.args(RUN).arg(lake.path());
    command.env("RAYON_NUM_THREADS", threads);
    let root = env!("CARGO_MANIFEST_DIR");
    assert!(command.current_dir(root).status().unwrap().success());
    let on = processor.unwrap_or("here");
    println!(
        "{on}, {threads} threads: {:.0} s",
        before.elapsed().as_secs_f64()
    );
    digests(lake.path())
}

fn digests(lake: &Path) -> Digests {
    let mut query = Command::new(env!("CARGO_BIN_EXE_pipeline"));
    query
        .args(["query", DIGESTS, "--format", "json", "--lake"])
        .arg(lake);
    let answer = query.output().unwrap();
    assert!(answer.status.success());
    let rows = serde_json::Deserializer::from_slice(&answer.stdout).into_iter();
    let digests = rows.map(|row| {
        let row: BTreeMap<String, String> = row.unwrap();
        let of = ["stage", "artifact", "partition", "file"].map(|key| row[key].clone());
        (of, row["digest"].clone())
    });
    digests.collect()
}
