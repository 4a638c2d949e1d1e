//! Options of `kind = "program"`.

use std::{collections::BTreeMap, path::PathBuf};

use dataflow::{
    ArtifactName, ColumnName, NodeName, OptionFault, OptionFaults, PartitionKey, nearest,
};
use lake::Lake;
use options::{Options, above, options};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, Serializer};

use crate::artifacts::KnownArtifact;

/// Longest time limit, in seconds: a week.
const MAX_TIMEOUT_S: f64 = 604_800.0;
/// Largest memory limit, in megabytes.
const MAX_MEMORY_MB: u64 = 10_000_000;
/// Most partitions that one is fanned out to.
const MAX_FAN_OUT: usize = 10_000;
/// Word in `read` for the partition of the same key, the default.
const SAME: &str = "same";
/// Prefix of a word in `read` that names a label of the partition.
pub(crate) const LABEL: &str = "label:";
/// Prefix of a word in `read` that names a label of the partitions that are read.
pub(crate) const WHERE: &str = "where:";

/// Prefix of a table's name for the rows of all runs.
const ALL: &str = "all_";
/// Columns that every table has.
const RESERVED_COLUMNS: [&str; 4] = ["run", "pipeline", "stage", "fingerprint"];

/// Options of `kind = "program"`.
#[options]
pub struct ProgramConfig {
    /// The program and its arguments, without a shell. Every element that names a file counts as code and is
    /// passed as an absolute path: the program starts in a folder of its own.
    pub command: Vec<String>,
    /// Files that decide its output, as patterns such as `judge/**/*.py`: a change of one reruns it. The
    /// files named in `command` are among them without being listed.
    #[serde(skip_serializing)]
    #[option(default)]
    pub code: Vec<String>,
    /// Lock file of its environment, e.g. `requirements.txt`: a change reruns it.
    #[option(path, default)]
    pub lock: Option<PathBuf>,
    /// Files or folders that it reads beside its inputs, by name: copied to `files/NAME`; a change reruns it.
    #[option(path, default)]
    pub files: BTreeMap<String, PathBuf>,
    /// The artifact that it makes: a kind of this project's, or a table of its own with `columns`.
    pub makes: String,
    /// Columns of a table of its own, by name.
    #[option(default)]
    pub columns: BTreeMap<String, ColumnConfig>,
    /// Kind of item that one partition of a table of its own holds, e.g. `object`: the column of its key.
    #[option(default = "part".to_owned())]
    pub partition: String,
    /// `INPUT.COLUMN`: a table of its own has one row for each row of this input, with the same values in the
    /// column of this name.
    #[option(default)]
    pub one_row_per: Option<String>,
    /// The input of which each partition becomes one; without it, all partitions of all inputs become one.
    #[option(default)]
    pub each: Option<String>,
    /// Partitions of the other inputs that it reads, by name, with `each`: the partition of the `same` key (the
    /// default), `all`, as `label:NAME` the one whose key is this label of the partition, or as `where:NAME` every one
    /// whose label of this name is the key of the partition.
    #[serde(serialize_with = "but_the_default")]
    #[option(default)]
    pub read: BTreeMap<String, String>,
    /// Names of several partitions that are made of one: each has a run of its own, which gets its name.
    #[option(default)]
    pub fan_out: Vec<String>,
    /// Values for the program; a change of one reruns it.
    #[option(default)]
    pub options: serde_json::Map<String, serde_json::Value>,
    /// Time limit of a unit in seconds, after which it is killed: more than a simulation of a few thousand
    /// motions takes.
    #[option(
        default = 3600.0, range = above(0.0, MAX_TIMEOUT_S),
        why = "a program that hangs must end"
    )]
    pub timeout_s: f64,
    /// Memory limit of a unit, all its processes together, in megabytes: half of a small workstation's. Enforced
    /// on Linux.
    #[option(default = 8000, range = 10..=MAX_MEMORY_MB, why = "less starts no interpreter")]
    pub memory_mb: u64,
}

/// Writes which partitions are read, without what is read in any case: written out, it reruns nothing.
fn but_the_default<S: Serializer>(
    read: &BTreeMap<String, String>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let chosen = read.iter().filter(|(_, word)| *word != SAME);
    serializer.collect_map(chosen)
}

/// A column of a table.
#[options]
#[schemars(inline)]
pub struct ColumnConfig {
    /// Its type.
    #[serde(rename = "type")]
    pub kind: ColumnType,
    /// Unit of its numbers, e.g. `m`.
    #[option(default)]
    pub unit: Option<String>,
    /// Its meaning.
    #[option(default)]
    pub about: String,
}

/// The type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum ColumnType {
    /// UTF-8.
    Text,
    /// A floating-point number of 64 bits.
    Number,
    /// A signed integer of 64 bits.
    Integer,
    /// True or false.
    Boolean,
    /// A list of numbers.
    Numbers,
    /// A list of integers.
    Integers,
}

/// Partitions of an input that a unit reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Read<'a> {
    /// The partition of the same key.
    Same,
    /// Every partition.
    All,
    /// The partition whose key is the value of this label.
    Label(&'a str),
    /// Every partition that has the key as this label.
    Where(&'a str),
}

impl ProgramConfig {
    /// Returns the partitions of an input that a unit reads.
    pub(crate) fn read_of(&self, input: &str) -> Read<'_> {
        match (&self.each, self.read.get(input)) {
            (None, _) => Read::All,
            (Some(_), None) => Read::Same,
            (Some(_), Some(word)) => word_of(word).unwrap_or(Read::Same),
        }
    }

    /// Returns the input and the column of `one_row_per`.
    pub(crate) fn rows_of(&self) -> Option<(&str, &str)> {
        self.one_row_per.as_deref()?.split_once('.')
    }

    /// Returns the faults of the options beyond their types; `known` are the artifacts of this project that a program
    /// can make.
    pub(crate) fn faults_for(&self, known: &[KnownArtifact]) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        if self.command.first().is_none_or(String::is_empty) {
            faults.note(
                "command",
                "names no program: write, e.g., [\"python3\", \"judge.py\"]",
            );
        }
        self.check_artifact(known, &mut faults);
        for name in self.files.keys().filter(|name| !is_word(name)) {
            faults.note(
                "files",
                format!("has the name `{name}`: use letters, digits and `_`"),
            );
        }
        let why = "each is a run of the program";
        faults.within("fan_out", self.fan_out.len(), 0..=MAX_FAN_OUT, why);
        let mut names = self.fan_out.clone();
        names.sort();
        if let Some([twice, _]) = names.array_windows().find(|[a, b]| a == b) {
            faults.note("fan_out", format!("has `{twice}` twice"));
        }
        for name in &self.fan_out {
            if let Err(err) = name.parse::<PartitionKey>() {
                faults.note("fan_out", format!("has the name `{name}`: {}", err.rule));
            }
        }
        if self.each.is_none() && !self.read.is_empty() {
            faults.note("read", "says what is read beside `each`, which is not set");
        }
        for (input, word) in &self.read {
            if word_of(word).is_none() {
                let problem = format!(
                    "is `{word}`, and must be `same`, `all`, `{LABEL}NAME` or \
                     `{WHERE}NAME`"
                );
                faults.note(&format!("read.{input}"), problem);
            }
        }
        if let Some(date) = self
            .options
            .iter()
            .find_map(|(key, value)| date_in(key, value))
        {
            faults.note(
                "options",
                format!("has the date `{date}`: write it as text, in quotes"),
            );
        }
        [faults.found(), self.faults()].concat()
    }

    fn check_artifact(&self, known: &[KnownArtifact], faults: &mut OptionFaults) {
        let names = known.iter().map(|known| known.artifact);
        let is_known = names.clone().any(|name| name == self.makes);
        match (is_known, self.columns.is_empty()) {
            (true, false) => faults.note(
                "columns",
                format!(
                    "are those of a table of its own, and `{}` has its own",
                    self.makes
                ),
            ),
            (false, true) => {
                let near = nearest(&self.makes, names.clone())
                    .map_or_else(String::new, |near| format!(", did you mean `{near}`"));
                let all: Vec<&str> = names.collect();
                faults.note(
                    "makes",
                    format!(
                        "is `{}`{near}? It is not among {}; a table of its own needs `columns`",
                        self.makes,
                        all.join(", ")
                    ),
                );
            }
            (false, false) if !is_word(&self.makes) => faults.note(
                "makes",
                format!(
                    "is `{}`, and must have letters, digits and `_` only",
                    self.makes
                ),
            ),
            (false, false)
                if Lake::history_tables().contains(&self.makes.as_str())
                    || self.makes.starts_with(ALL) =>
            {
                faults.note(
                    "makes",
                    format!(
                        "is `{}`, which is the name of a table of the lake itself, as are {} and those \
                         that begin with `{ALL}`: choose another",
                        self.makes,
                        Lake::history_tables().join(", "),
                    ),
                );
            }
            (false, false) => {
                if let Err(err) = self.makes.parse::<ArtifactName>() {
                    faults.note("makes", format!("is `{}`: {}", self.makes, err.rule));
                }
            }
            (true, true) => {}
        }
        self.check_columns(faults);
        self.check_partition(faults);
        self.check_rows(is_known, faults);
    }

    /// Checks the names of the columns.
    fn check_columns(&self, faults: &mut OptionFaults) {
        for name in self.columns.keys() {
            if !is_word(name) {
                faults.note(
                    "columns",
                    format!("has `{name}`: use letters, digits and `_`"),
                );
            }
            if *name == self.partition {
                let problem = format!("has `{name}`, which is the column of the partition's key");
                faults.note("columns", problem);
            }
        }
    }

    /// Checks the column of which each row of an input has one value.
    fn check_rows(&self, is_known: bool, faults: &mut OptionFaults) {
        match (&self.one_row_per, self.rows_of()) {
            (None, _) => {}
            (Some(_), _) if is_known => {
                faults.note(
                    "one_row_per",
                    format!("is for a table of its own, not `{}`", self.makes),
                );
            }
            (Some(_), Some((_, column))) if self.columns.contains_key(column) => {}
            (Some(given), Some((_, column))) => {
                faults.note(
                    "one_row_per",
                    format!("is `{given}`, but `columns` has no `{column}`"),
                );
            }
            (Some(given), None) => {
                faults.note(
                    "one_row_per",
                    format!("is `{given}`, and must be `INPUT.COLUMN`"),
                );
            }
        }
    }

    /// Checks the name of the column of partitions.
    fn check_partition(&self, faults: &mut OptionFaults) {
        if !is_word(&self.partition) {
            let problem = format!("is `{}`: use letters, digits and `_`", self.partition);
            faults.note("partition", problem);
        } else if let Err(err) = self.partition.parse::<ColumnName>() {
            faults.note(
                "partition",
                format!("is `{}`: {}", self.partition, err.rule),
            );
        }
        if RESERVED_COLUMNS.contains(&self.partition.as_str()) {
            let problem = format!(
                "is `{}`, which is a column that every table has, as are {}: choose another",
                self.partition,
                RESERVED_COLUMNS.join(", ")
            );
            faults.note("partition", problem);
        }
    }

    /// Returns the faults of the options that name inputs.
    pub(crate) fn wired_faults(&self, inputs: &BTreeMap<String, NodeName>) -> Vec<OptionFault> {
        let mut faults = OptionFaults::default();
        let mut check = |key: &str, input: &str| {
            if !inputs.contains_key(input) {
                let near = nearest(input, inputs.keys().map(String::as_str));
                let help = match near {
                    Some(near) => format!("did you mean `{near}`?"),
                    None => format!("write `inputs.{input} = \"STAGE.ARTIFACT\"`"),
                };
                faults.note(
                    key,
                    format!("names the input `{input}`, which is not wired: {help}"),
                );
            }
        };
        if let Some(each) = &self.each {
            check("each", each);
        }
        for input in self.read.keys() {
            check(&format!("read.{input}"), input);
        }
        if let Some((input, _)) = self.rows_of() {
            check("one_row_per", input);
        }
        faults.found()
    }
}

fn word_of(word: &str) -> Option<Read<'_>> {
    match word {
        SAME => Some(Read::Same),
        "all" => Some(Read::All),
        word => {
            let name = |prefix| word.strip_prefix(prefix).filter(|label| is_word(label));
            let label = name(LABEL).map(Read::Label);
            label.or_else(|| name(WHERE).map(Read::Where))
        }
    }
}

fn is_word(text: &str) -> bool {
    let mut letters = text.chars();
    letters
        .next()
        .is_some_and(|first| first.is_ascii_alphabetic())
        && letters.all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
}

/// Finds a TOML date, which JSON does not have.
fn date_in(key: &str, value: &serde_json::Value) -> Option<String> {
    const DATE: &str = "$__toml_private_datetime";
    match value {
        serde_json::Value::Object(fields) => fields.iter().find_map(|(name, value)| {
            if name == DATE {
                return Some(key.to_owned());
            }
            date_in(&format!("{key}.{name}"), value)
        }),
        serde_json::Value::Array(values) => values.iter().find_map(|value| date_in(key, value)),
        _ => None,
    }
}
