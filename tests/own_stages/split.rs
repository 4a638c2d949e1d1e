//! `split`: files outside the lake become partitions.

use std::{collections::BTreeMap, fs, path::PathBuf};

use dataflow::{
    Code, Context, Input, Inputs, Made, Outcome, Output, Scope, SourceFile, Stage, Summary, Unit,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    OwnError,
    bytes::{self, Change},
    code, hooks,
};

/// Reads the files of a folder.
pub(crate) enum Split<const VERSION: u8> {}

/// Options of `kind = "split"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SplitConfig {
    /// Folder whose files are read; each is a partition named like the file without its ending.
    // The files' bytes count, not where they lie: the same dataset elsewhere is the same dataset.
    #[serde(skip_serializing)]
    root: PathBuf,
    /// Added to every byte.
    #[serde(default)]
    add: u8,
    /// Every byte is divided by this and the remainder is kept; 0 keeps the byte.
    #[serde(default)]
    modulo: u8,
    /// Whether each partition has a table beside its bytes.
    #[serde(default)]
    table: bool,
    /// Partitions that count as unusable, as do files that begin with `bad`.
    #[serde(default)]
    skip: Vec<String>,
    /// Partitions that are left out.
    #[serde(default)]
    leave_out: Vec<String>,
}

impl<const VERSION: u8> Stage for Split<VERSION> {
    type Config = SplitConfig;
    type Error = OwnError;

    const KIND: &'static str = "split";
    const ABOUT: &'static str = "Reads the files of a folder";
    const CODE: Code = code(VERSION);
    const INPUTS: &'static [Input] = &[];
    const OUTPUTS: &'static [Output] = &[Output {
        artifact: "parts",
        schema: "parts/1",
        partition: "part",
        parallel: true,
    }];

    fn units(config: &SplitConfig, _output: &str, _scope: &Scope) -> Result<Vec<Unit>, OwnError> {
        let entries = fs::read_dir(&config.root).map_err(OwnError::at(&config.root))?;
        let mut units = Vec::new();
        for entry in entries {
            let path = entry.map_err(OwnError::at(&config.root))?.path();
            if let Some(name) = path.file_stem().filter(|_| path.is_file()) {
                let unit = Unit::new(name.to_string_lossy());
                units.push(unit.with_file(SourceFile::named_by_file(&path)));
            }
        }
        Ok(units)
    }

    fn run(config: &SplitConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome, OwnError> {
        hooks::started(Self::KIND, cx)?;
        let is_named = |names: &[String]| names.iter().any(|name| name == cx.partition());
        if is_named(&config.leave_out) {
            let reason = "named in `leave_out`".to_owned();
            return Ok(Outcome::Filtered { reason });
        }
        if is_named(&config.skip) {
            let reason = "named in `skip`".to_owned();
            return Ok(Outcome::Skipped { reason });
        }
        let mut made = Made::default();
        for file in inputs.files() {
            let beginning = bytes::beginning(&file.path, 3)?;
            if beginning == b"bad" {
                let reason = "begins with `bad`".to_owned();
                return Ok(Outcome::Skipped { reason });
            }
            let change = Change {
                add: config.add,
                modulo: config.modulo,
            };
            let tally = bytes::write_changed(cx.partition(), &file.path, change, cx.folder())?;
            made.labels = BTreeMap::from([("group".to_owned(), group_of(&beginning))]);
            made.metrics = BTreeMap::from([("bytes".to_owned(), tally.bytes as f64)]);
            if config.table {
                bytes::write_table(cx.folder(), &[tally])?;
            }
        }
        Ok(Outcome::Made(made))
    }

    fn describe(_output: &str, summary: &Summary) -> String {
        let n_files = summary.n_made + summary.n_skipped + summary.n_filtered;
        format!("{n_files} files → {} parts", summary.n_made)
    }
}

/// The group of a file: the letter with which it begins.
fn group_of(beginning: &[u8]) -> String {
    match beginning.first() {
        Some(letter) if letter.is_ascii_alphabetic() => char::from(*letter).to_string(),
        _ => "other".to_owned(),
    }
}
