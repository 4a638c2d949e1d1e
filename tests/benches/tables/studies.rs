//! The lake in which commands make the data of tables, and the answers to queries over it.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    process::{Command, Output, Stdio},
};

use serde::Deserialize;
use serde_json::{Deserializer, Value};

use super::query::{self, Query};

/// The dataset's root in commands.
const DATASET: &str = "$DEXYCB";
/// A folder of functions in commands, and the environment variable that names it.
const FOLDS: [&str; 2] = ["$FOLDS", "PIPELINE_FOLDS"];
/// Files that decide results, beside the program and the dataset.
const SOURCES: [&str; 5] = [
    "pipelines",
    "data/checkpoints/allegro_right",
    "data/hands",
    "data/robots",
    "data/sample/recipe.toml",
];
/// Every item was used, or some were skipped, with reasons.
const DONE: [Option<i32>; 2] = [Some(0), Some(3)];

/// A lake for one program and one state of its pipeline files.
///
/// So it has at most one run of each variant that counts, also after a change of the program.
pub(crate) struct Studies {
    lake: PathBuf,
    dataset: Option<PathBuf>,
    folds: Option<PathBuf>,
    /// The runs of each command that has run.
    runs: BTreeMap<Vec<String>, Vec<u64>>,
}

/// A run, as the program lists it.
#[derive(Deserialize)]
struct Listed {
    run: u64,
    file: String,
    overrides: Vec<String>,
    status: String,
}

impl Studies {
    /// Opens the lake in a folder.
    ///
    /// # Errors
    ///
    /// Fails if the program or the pipeline files cannot be read.
    pub(crate) fn open(folder: &Path, dataset: Option<PathBuf>) -> io::Result<Self> {
        let mut digest = blake3::Hasher::new();
        digest.update(&fs::read(env!("CARGO_BIN_EXE_pipeline"))?);
        for source in SOURCES {
            add(
                &mut digest,
                &Path::new(env!("CARGO_MANIFEST_DIR")).join(source),
            )?;
        }
        Ok(Self {
            lake: folder.join(digest.finalize().to_hex().split_at(16).0),
            dataset,
            folds: std::env::var_os(FOLDS[1]).map(PathBuf::from),
            runs: BTreeMap::new(),
        })
    }

    /// Whether a query takes the dataset, or functions of folds, and they are not there.
    pub(crate) fn lack(&self, query: &Query) -> bool {
        let takes = |name: &str| query.commands.iter().flatten().any(|it| it.contains(name));
        (self.dataset.is_none() && takes(DATASET)) || (self.folds.is_none() && takes(FOLDS[0]))
    }

    /// Runs the commands of a query, as far as this has not happened yet, and answers it over their runs.
    ///
    /// # Errors
    ///
    /// Says which command failed.
    pub(crate) fn answer(&mut self, query: &Query) -> Result<Vec<Value>, String> {
        let mut runs = Vec::new();
        for command in &query.commands {
            if !self.runs.contains_key(command) {
                let made = self.run(command)?;
                self.runs.insert(command.clone(), made);
            }
            runs.extend(&self.runs[command]);
        }
        let output = self.ask(&["query", &query.over(&runs), "--format", "json"])?;
        let rows = Deserializer::from_slice(&output.stdout).into_iter();
        rows.collect::<Result<_, _>>()
            .map_err(|err| err.to_string())
    }

    /// Runs a command; returns the runs of its variants.
    fn run(&self, command: &[String]) -> Result<Vec<u64>, String> {
        let shown = |folder: &Option<PathBuf>, name| {
            let folder = folder.as_deref().unwrap_or(Path::new(name));
            folder.to_string_lossy().into_owned()
        };
        let [dataset, folds] = [shown(&self.dataset, DATASET), shown(&self.folds, FOLDS[0])];
        let words = command
            .iter()
            .map(|word| word.replace(DATASET, &dataset).replace(FOLDS[0], &folds));
        let words: Vec<String> = words.collect();
        println!("       pipeline {}", words.join(" "));
        let status = self
            .program(&words)
            .status()
            .map_err(|err| err.to_string())?;
        if !DONE.contains(&status.code()) {
            return Err(format!("`pipeline {}` failed: {status}", words.join(" ")));
        }
        let listed = self.ask(&["runs", "--format", "json"])?;
        let listed: Vec<Listed> =
            serde_json::from_slice(&listed.stdout).map_err(|err| err.to_string())?;
        let variants = query::variants(&words)?.into_iter();
        let numbers = variants.map(|values| {
            let values: Vec<String> = values.iter().map(ToString::to_string).collect();
            let is_it = |run: &&Listed| {
                run.status == "finished" && run.overrides == values && words.contains(&run.file)
            };
            let newest = listed.iter().filter(is_it).map(|run| run.run).max();
            newest.ok_or_else(|| format!("the lake has no run with {values:?}"))
        });
        numbers.collect()
    }

    /// Asks the program; its answer is in the output.
    fn ask(&self, arguments: &[&str]) -> Result<Output, String> {
        let mut program = self.program(arguments);
        let output = program.stderr(Stdio::inherit()).output();
        let output = output.map_err(|err| err.to_string())?;
        if output.status.success() {
            Ok(output)
        } else {
            Err(format!("`pipeline {}` failed", arguments.join(" ")))
        }
    }

    fn program(&self, arguments: &[impl AsRef<std::ffi::OsStr>]) -> Command {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(arguments)
            .arg("--lake")
            .arg(&self.lake);
        program
    }
}

/// Adds the files below a path, in order of their names.
fn add(digest: &mut blake3::Hasher, path: &Path) -> io::Result<()> {
    if !path.is_dir() {
        digest.update(&fs::read(path)?);
        return Ok(());
    }
    let below: io::Result<Vec<PathBuf>> =
        fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect();
    let mut below = below?;
    below.sort();
    below.iter().try_for_each(|path| add(digest, path))
}
