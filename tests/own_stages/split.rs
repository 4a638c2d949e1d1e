//! `split`: files outside the lake become partitions.

use std::{fs, path::PathBuf};

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Labels, Line, Outcome, Output, Outputs, Scope, SourceFile,
    Stage, Unit,
};
use lake::LakeError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    OwnError,
    bytes::{self, Bytes, Change},
    hooks,
};

/// Reads the files of a folder.
pub(crate) struct Split<const VERSION: u8>;

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

impl dataflow::Options for SplitConfig {}

impl<const VERSION: u8> Stage for Split<VERSION> {
    type Config = SplitConfig;

    const KIND: &'static str = "split";
    const ABOUT: &'static str = "Reads the files of a folder";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const VERSION: u8> Output for Split<VERSION> {
    type Stage = Self;
    type Metrics = Bytes;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "parts";
    const SCHEMA: &'static str = "parts/1";
    const PARTITION: &'static str = "part";
    const LINE: Option<Line<Bytes>> =
        Some(|summary| format!("{} files → {} parts", summary.item_count(), summary.n_made));

    fn units(config: &SplitConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let entries = fs::read_dir(&config.root).map_err(OwnError::at(&config.root))?;
        let mut units = Vec::new();
        for entry in entries {
            let path = entry.map_err(OwnError::at(&config.root))?.path();
            if let Some(name) = path.file_stem().filter(|_| path.is_file()) {
                let unit = Unit::new(name.to_string_lossy()).labeled_by_data();
                units.push(unit.with_file(SourceFile::named_by_file(&path)));
            }
        }
        Ok(units)
    }

    fn make(
        config: &SplitConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<Bytes>, BoxedDiagnostic> {
        hooks::started::<Self>(cx)?;
        let is_named = |names: &[String]| names.iter().any(|name| *cx.partition() == **name);
        if is_named(&config.leave_out) {
            return Ok(Outcome::filtered("named in `leave_out`"));
        }
        if is_named(&config.skip) {
            return Ok(Outcome::skipped("named in `skip`"));
        }
        let file = inputs.files().first().ok_or(LakeError::MissingInput {
            what: "file of bytes",
        })?;
        let beginning = bytes::beginning(&file.path, 3)?;
        if beginning == b"bad" {
            return Ok(Outcome::skipped("begins with `bad`"));
        }
        let change = Change {
            add: config.add,
            modulo: config.modulo,
        };
        let tally = bytes::write_changed(cx.partition().as_str(), &file.path, change, cx.folder())?;
        let metrics = tally.metrics();
        if config.table {
            bytes::write_table(cx.folder(), &[tally])?;
        }
        let labels = Labels::from([("group".to_owned(), group_of(&beginning))]);
        Ok(Outcome::Labeled(metrics, labels))
    }
}

/// The group of a file: the letter with which it begins.
fn group_of(beginning: &[u8]) -> String {
    match beginning.first() {
        Some(letter) if letter.is_ascii_alphabetic() => char::from(*letter).to_string(),
        _ => "other".to_owned(),
    }
}
