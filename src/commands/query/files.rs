//! Files that a question names: `read_parquet('…')`, `read_csv('…')` or a path in quotes for a table.

use std::{
    fs,
    ops::ControlFlow,
    path::{Path, PathBuf},
};

use datafusion::sql::sqlparser::ast::{
    Expr, FunctionArg, FunctionArgExpr, Ident, ObjectName, TableAlias, TableFactor, Value,
    VisitorMut,
};

use super::{scan::FileTable, tables::Tables, values};
use crate::outcome::CommandError;

/// The option that allows files outside the lake.
const OPTION: &str = "--allow-files";

/// How a file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Parquet,
    Csv,
}

/// A file that a question names.
#[derive(Debug)]
pub(super) struct NamedFile {
    /// Name of its table in the statement.
    table: String,
    form: Form,
    path: PathBuf,
}

/// Gives each file of a statement a name as a table.
#[derive(Debug, Default)]
pub(super) struct NamedFiles {
    pub(super) found: Vec<NamedFile>,
}

impl VisitorMut for NamedFiles {
    type Break = CommandError;

    fn pre_visit_table_factor(&mut self, table: &mut TableFactor) -> ControlFlow<CommandError> {
        let TableFactor::Table {
            name, alias, args, ..
        } = table
        else {
            return ControlFlow::Continue(());
        };
        let Some(ident) = name.0.first().and_then(|part| part.as_ident()).cloned() else {
            return ControlFlow::Continue(());
        };
        let found = match args {
            Some(arguments) => {
                let word = ident.value.to_lowercase();
                let form = match word.as_str() {
                    "read_parquet" | "parquet_scan" => Form::Parquet,
                    "read_csv" | "read_csv_auto" => Form::Csv,
                    // Rows that a function makes.
                    _ => return ControlFlow::Continue(()),
                };
                let path = match arguments.args.as_slice() {
                    [FunctionArg::Unnamed(FunctionArgExpr::Expr(Expr::Value(value)))] => {
                        match &value.value {
                            Value::SingleQuotedString(path) => Some(path.clone()),
                            _ => None,
                        }
                    }
                    _ => None,
                };
                let Some(path) = path else {
                    return ControlFlow::Break(CommandError::usage(
                        format!("`{word}` takes one path and nothing else"),
                        format!("write `{word}('PATH')`"),
                    ));
                };
                (form, path)
            }
            None if ident.quote_style == Some('\'') => {
                let path = ident.value.clone();
                let is_csv = Path::new(&path)
                    .extension()
                    .is_some_and(|end| end.eq_ignore_ascii_case("csv"));
                (if is_csv { Form::Csv } else { Form::Parquet }, path)
            }
            None => return ControlFlow::Continue(()),
        };
        let (form, path) = found;
        let path = PathBuf::from(path);
        let table = format!("file {}", self.found.len() + 1);
        let stem = path.file_stem().and_then(|stem| stem.to_str());
        if alias.is_none() {
            *alias = Some(TableAlias {
                explicit: true,
                name: Ident::with_quote('"', stem.unwrap_or("file")),
                columns: Vec::new(),
                at: None,
            });
        }
        *args = None;
        *name = ObjectName::from(vec![Ident::with_quote('"', &table)]);
        self.found.push(NamedFile { table, form, path });
        ControlFlow::Continue(())
    }
}

/// Opens the files of a question, if they are in the lake or below a path that `--allow-files` names.
pub(super) fn open(
    files: &[NamedFile],
    lake: &Path,
    allowed: &[PathBuf],
    tables: &mut Tables,
) -> Result<(), CommandError> {
    for file in files {
        let path = check(&file.path, lake, allowed)?;
        let table = match file.form {
            Form::Parquet => parquet(&path),
            Form::Csv => values::csv(&path),
        };
        let table = table.map_err(|err| {
            CommandError::usage(
                format!("cannot read `{}`: {err:#}", file.path.display()),
                "name a file that another program can read: Parquet, or comma-separated values with \
                 a header",
            )
        })?;
        tables.add(&file.table, table)?;
    }
    Ok(())
}

/// Returns where a file really is, if it may be read.
fn check(path: &Path, lake: &Path, allowed: &[PathBuf]) -> Result<PathBuf, CommandError> {
    let shown = path.display();
    let outside = || {
        let beside = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let beside = beside.unwrap_or(Path::new("."));
        CommandError::usage(
            format!("`{shown}` is not in the lake, and `query` reads nothing else"),
            format!(
                "add `{OPTION} '{}'` to read what is there",
                beside.display()
            ),
        )
    };
    if path.to_string_lossy().contains("://") {
        return Err(CommandError::usage(
            format!("`{shown}` is not in the lake, and `query` reads nothing else"),
            format!("download it, and name its folder with `{OPTION} PATH`"),
        ));
    }
    let mut roots = allowed.iter().map(PathBuf::as_path).chain([lake]);
    let Ok(real) = fs::canonicalize(path) else {
        let is_named = roots.any(|root| path.starts_with(root));
        if !is_named {
            return Err(outside());
        }
        let is_pattern = path.to_string_lossy().contains(['*', '?', '[']);
        return Err(CommandError::usage(
            format!("`{shown}` does not exist"),
            if is_pattern {
                "paths are read as they stand: name the folder, and all Parquet files below it are read"
            } else {
                "check the path"
            },
        ));
    };
    if roots.any(|root| fs::canonicalize(root).is_ok_and(|root| real.starts_with(root))) {
        Ok(real)
    } else {
        Err(outside())
    }
}

/// Opens a Parquet file, or all that are below a folder.
fn parquet(path: &Path) -> anyhow::Result<FileTable> {
    let mut files = Vec::new();
    below(path, &mut files)?;
    files.sort();
    anyhow::ensure!(!files.is_empty(), "no file ends with `.parquet` there");
    let parts = (0..files.len()).map(|file| (file, Vec::new())).collect();
    FileTable::open(files, parts, &[])
}

fn below(path: &Path, files: &mut Vec<PathBuf>) -> anyhow::Result<()> {
    if !path.is_dir() {
        files.push(path.to_owned());
        return Ok(());
    }
    for entry in fs::read_dir(path)? {
        let path = entry?.path();
        let is_parquet = path.extension().is_some_and(|end| end == "parquet");
        // Links are not followed: they may lead elsewhere.
        if !path.is_symlink() && (path.is_dir() || is_parquet) {
            below(&path, files)?;
        }
    }
    Ok(())
}
