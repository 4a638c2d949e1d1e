//! Why a unit's program did not make its artifact.

use std::{error::Error, io, path::PathBuf};

use dataflow::Diagnostic;
use lake::LakeError;
use schemas::SchemaError;

use crate::script::FirstLine;

/// Why a program could not be run, or did not make its artifact.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProgramError {
    /// A pattern of `code` cannot be read.
    #[error("`code` has the pattern `{pattern}`, which cannot be read: {reason}")]
    Pattern {
        /// The pattern.
        pattern: String,
        /// Why.
        reason: String,
    },
    /// A pattern of `code` matches nothing.
    #[error("`code` names `{pattern}`, which is no file here")]
    NoCode {
        /// The pattern.
        pattern: String,
    },
    /// A file that an option names does not exist.
    #[error("`{option}` names `{}`, which is no file here", path.display())]
    NoFile {
        /// The option.
        option: String,
        /// The path.
        path: PathBuf,
    },
    /// What an option names is there, and is no file.
    #[error("`{option}` names `{}`, which is neither a file nor a folder", path.display())]
    NotAFile {
        /// The option.
        option: String,
        /// The path.
        path: PathBuf,
    },
    /// A link in a folder that an option names leads back to a folder around it.
    #[error("`{option}` names a folder in which `{}` leads back to a folder around it", path.display())]
    LinkCircle {
        /// The option.
        option: String,
        /// The link.
        path: PathBuf,
    },
    /// A file that an option names cannot be opened.
    #[error("`{option}` names `{}`, which cannot be read", path.display())]
    Unopened {
        /// The option.
        option: String,
        /// The path.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
    /// An input has no partitions.
    #[error("its input `{input}` has no partitions")]
    NoPartitions {
        /// The input.
        input: String,
    },
    /// An input lacks the column by which rows are counted.
    #[error(
        "`one_row_per` names `{input}.{column}`, but partition `{key}` of `{input}` has no such column of text or integers"
    )]
    NoRows {
        /// The input.
        input: String,
        /// The column.
        column: String,
        /// The partition.
        key: String,
    },
    /// The program cannot be started.
    #[error("cannot start `{program}`{}", script.as_ref().map_or_else(String::new, ToString::to_string))]
    NotStarted {
        /// The program.
        program: String,
        /// What is wrong with its first line, if it is a script.
        script: Option<FirstLine>,
        /// Why.
        source: io::Error,
    },
    /// It ended with an exit code that is a failure.
    #[error("`{command}` {ended}{}", said(last_lines))]
    Failed {
        /// The command.
        command: String,
        /// Its end in words, e.g. `ended with exit code 1`.
        ended: String,
        /// The end of what it printed.
        last_lines: String,
        /// Its whole log.
        log: PathBuf,
        /// Elements of the command that look like files and are none.
        missing: Box<[String]>,
        /// A script of the command whose first line cannot be used.
        script: Option<Box<(String, FirstLine)>>,
    },
    /// It broke a limit.
    #[error(
        "`{command}` {problem}; it was killed with all its processes{}",
        said(last_lines)
    )]
    Killed {
        /// The command.
        command: String,
        /// The violation, e.g. `did not end within 60 s`.
        problem: String,
        /// The end of what it printed.
        last_lines: String,
        /// Its whole log.
        log: PathBuf,
        /// Advice to the user.
        advice: &'static str,
    },
    /// It broke a rule of its folder.
    #[error("`{command}` {problem}{}", said(last_lines))]
    Folder {
        /// The command.
        command: String,
        /// The violation, e.g. `changed its input`.
        problem: String,
        /// The end of what it printed.
        last_lines: String,
        /// Its whole log.
        log: PathBuf,
        /// Advice to the user.
        advice: &'static str,
    },
    /// Its output is not the artifact.
    #[error("`{command}` wrote `out/{file}`, which is not `{schema}`")]
    Table {
        /// The command.
        command: String,
        /// The file.
        file: String,
        /// The schema.
        schema: String,
        /// Why.
        source: Box<TableFault>,
    },
    /// The table that it wrote is compressed in a way that is not read here.
    #[error("`{command}` wrote `out/{file}` with the compression {codec}, which is not read")]
    Compression {
        /// The command.
        command: String,
        /// The file.
        file: String,
        /// The compression.
        codec: &'static str,
    },
    /// The table that it wrote cannot be read.
    #[error("`{command}` wrote `out/{file}`, which is not a whole Parquet file")]
    Unreadable {
        /// The command.
        command: String,
        /// The file.
        file: String,
        /// Why.
        source: Box<LakeError>,
    },
    /// Its folder cannot be written or read.
    #[error("cannot use `{}`", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The lake cannot give an input or keep the table.
    #[error(transparent)]
    Lake(#[from] LakeError),
    /// The rows are not those asked for.
    #[error(transparent)]
    TableFault(Box<TableFault>),
    /// The run is being interrupted.
    #[error("the run is interrupted")]
    Interrupted,
}

/// Why a table is not the requested one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableFault {
    /// A column is missing.
    #[error("column `{column}` ({expected}) is missing")]
    NoColumn {
        /// The column.
        column: String,
        /// Its type.
        expected: String,
    },
    /// There is a column that the schema does not have.
    #[error("there is no column `{column}`{}", near.as_ref().map_or_else(String::new, |near| format!(", did you mean `{near}`?")))]
    UnknownColumn {
        /// The column.
        column: String,
        /// A column with a similar name.
        near: Option<String>,
    },
    /// Two columns have one name.
    #[error("there are two columns `{column}`")]
    TwoColumns {
        /// The name.
        column: String,
    },
    /// A column has another type.
    #[error("column `{column}` is {found}, expected {expected}")]
    WrongType {
        /// The column.
        column: String,
        /// Its type.
        found: String,
        /// The type of the schema.
        expected: String,
    },
    /// A cell is null.
    #[error("column `{column}` is null in row {row}")]
    Null {
        /// The column.
        column: String,
        /// The row, from 0.
        row: usize,
    },
    /// A number is NaN or infinite.
    #[error("column `{column}` is {value} in row {row}, expected a finite number")]
    NotFinite {
        /// The column.
        column: String,
        /// The row, from 0.
        row: usize,
        /// The number.
        value: f64,
    },
    /// A list has another length.
    #[error("column `{column}` has a list of {found} in row {row}, expected {expected}")]
    Length {
        /// The column.
        column: String,
        /// The row, from 0.
        row: usize,
        /// Its length.
        found: usize,
        /// The length of the schema.
        expected: usize,
    },
    /// The rows are not those of the input.
    #[error(
        "column `{column}` has {} in row {row}, expected {}: {n_found} rows for the {n_expected} of `{input}`, \
         whose order they keep",
        shown(found.as_ref()), shown(expected.as_ref())
    )]
    Rows {
        /// The column.
        column: String,
        /// The input.
        input: String,
        /// The first row that differs, from 0.
        row: usize,
        /// Its value.
        found: Option<String>,
        /// The value of the input.
        expected: Option<String>,
        /// Number of rows.
        n_found: usize,
        /// Number of rows of the input.
        n_expected: usize,
    },
    /// A row contradicts the row of the input that it belongs to.
    #[error("column `{column}` is `{found}` in row {row}, and `{expected}` in `{input}`")]
    Contradicts {
        /// The column.
        column: String,
        /// The row, from 0.
        row: usize,
        /// Its value.
        found: String,
        /// The value of the input.
        expected: String,
        /// The input.
        input: String,
    },
    /// A column contradicts those from which it follows.
    #[error("column `{column}` in row {row} is not what follows from the row's other columns")]
    NotDerived {
        /// The column.
        column: String,
        /// The row, from 0.
        row: usize,
    },
    /// The artifact's own rules.
    #[error(transparent)]
    Rule(#[from] SchemaError),
    /// The columns do not fit together.
    #[error("columns do not fit together")]
    Arrow(arrow_schema::ArrowError),
}

impl TableFault {
    /// Returns advice to the user.
    fn hint(&self) -> String {
        match self {
            Self::NoColumn { .. } | Self::UnknownColumn { .. } | Self::WrongType { .. } | Self::Arrow(_) => "write it with the columns of `template.parquet`, an empty table beside `job.json`: \
                 `pa.Table.from_pylist(rows).select(columns.names).cast(columns)` with \
                 `columns = pq.read_schema(\"template.parquet\")`"
                    .to_owned(),
            Self::TwoColumns { column } => format!("keep one `{column}`: which one is meant is not known here"),
            Self::Null { column, .. } | Self::NotFinite { column, .. } => format!(
                "every row needs a value: leave the row out, or say in another column that `{column}` is unknown"
            ),
            Self::Length { .. } => "the template's column says how long its lists are".to_owned(),
            Self::Rows { .. } | Self::Contradicts { .. } => {
                "go through the rows of the input one by one, and add one for each".to_owned()
            }
            Self::NotDerived { .. } => "the schema's README says how it follows from them".to_owned(),
            Self::Rule(SchemaError::Invalid { column, .. }) if column == schemas::JOINTS => format!(
                "the schema's metadata names the hand's joints in the order of the lists: \
                 `columns.with_metadata({{**columns.metadata, b\"{column}\": b\"joint_0.0,joint_1.0,…\"}})`; the \
                 template has them where an input has"
            ),
            Self::Rule(_) => "schemas/README.md has the rules of each artifact".to_owned(),
        }
    }
}

fn said(last_lines: &str) -> String {
    if last_lines.is_empty() {
        ", and printed nothing".to_owned()
    } else {
        format!("; its last lines:\n{last_lines}")
    }
}

fn shown(value: Option<&String>) -> String {
    value.map_or_else(|| "nothing".to_owned(), |value| format!("`{value}`"))
}

impl From<TableFault> for ProgramError {
    fn from(source: TableFault) -> Self {
        Self::TableFault(Box::new(source))
    }
}

impl ProgramError {
    /// Returns the message of a fault in what an option names, with its cause and without the option at
    /// its start.
    pub(crate) fn after_option(&self) -> String {
        let text = self.to_string();
        let rest = text
            .strip_prefix('`')
            .and_then(|rest| rest.split_once("` "));
        let rest = rest.map_or(text.as_str(), |(_, rest)| rest);
        match self.source() {
            Some(cause) => format!("{rest}: {cause}"),
            None => rest.to_owned(),
        }
    }

    /// Returns a function that says which file or folder an error is about.
    pub(crate) fn at(path: &std::path::Path) -> impl FnOnce(io::Error) -> Self + use<> {
        let path = path.to_owned();
        move |source| Self::Io { path, source }
    }
}

impl Diagnostic for ProgramError {
    fn hint(&self) -> Option<String> {
        let log = |log: &PathBuf| format!("its whole output is in `{}`", log.display());
        match self {
            Self::Pattern { .. } | Self::NoCode { .. } => Some(
                "patterns are relative to the folder in which `pipeline` runs: `*` matches within a folder, `**` \
                 across folders"
                    .to_owned(),
            ),
            Self::NoFile { path, .. } => Some(dataflow::missing(path)),
            Self::NotAFile { .. } => Some("name a file or a folder of files".to_owned()),
            Self::LinkCircle { path, .. } => Some(format!("remove the link: `rm {}`", path.display())),
            Self::Unopened { path, .. } => Some(format!("let yourself read it: `chmod u+r {}`", path.display())),
            Self::NoPartitions { input } => {
                Some(format!("look at its skipped items with `pipeline inspect`, at the artifact that `{input}` names"))
            }
            Self::NotStarted { program, script: Some(script), .. } => Some(script.hint(program)),
            Self::NotStarted { program, script: None, source } => Some(match source.kind() {
                io::ErrorKind::NotFound => format!(
                    "install `{program}`, put it on PATH, or name it in `command`; a path is relative to the folder \
                     in which `pipeline` runs"
                ),
                io::ErrorKind::PermissionDenied => format!("make it executable: `chmod +x {program}`"),
                _ => "run it by hand to see why".to_owned(),
            }),
            Self::Failed { log: path, ended: _, last_lines, missing, script, .. } => Some(
                if let Some((_, module)) = last_lines.rsplit_once("No module named ") {
                    let module = module.lines().next().unwrap_or_default().trim_matches(['\'', '"']);
                    format!("install `{module}` for this Python, or name another one in `command`; {}", log(path))
                } else if let Some((script, first_line)) = script.as_deref() {
                    format!("`{script}`{first_line}: {}; {}", first_line.hint(script), log(path))
                } else if let Some(missing) = missing.first() {
                    format!("`command` names `{missing}`, and there is no such file here; {}", log(path))
                } else {
                    log(path)
                },
            ),
            Self::Killed { log: path, advice, .. } | Self::Folder { log: path, advice, .. } => {
                Some(format!("{advice}; {}", log(path)))
            }
            Self::Table { source, .. } => Some(source.hint()),
            Self::Compression { .. } => Some(
                "write it with `compression=\"zstd\"` or `compression=\"snappy\"`, or without compression".to_owned(),
            ),
            Self::Unreadable { .. } => Some("close the file before the program ends".to_owned()),
            Self::NoRows { .. } => Some("`pipeline inspect` lists the columns of an artifact".to_owned()),
            Self::Lake(err) => err.hint(),
            Self::Io { .. } | Self::TableFault(_) | Self::Interrupted => None,
        }
    }
}
