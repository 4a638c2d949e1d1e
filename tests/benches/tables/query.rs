//! Files of queries: the commands that make a table's data in comments, and below them the table in SQL.

use std::{fs, path::Path};

use dataflow::{Override, Sweep};
use datafusion::sql::sqlparser::{
    ast::{Expr, FunctionArguments, SelectItem, SetExpr, Statement},
    dialect::GenericDialect,
    parser::Parser,
};
use serde_json::Value;

/// Start of a command, in the comments above a query.
const COMMAND: &str = "pipeline run ";
/// The runs of a lake, in a query.
const RUNS: &str = "(select run from runs)";

/// The query of one table.
pub(crate) struct Query {
    /// Arguments of `pipeline` for each command that makes its data.
    pub(crate) commands: Vec<Vec<String>>,
    pub(crate) sql: String,
    pub(crate) columns: Vec<Column>,
}

/// A column of the table.
pub(crate) struct Column {
    /// As the query and the table's header name it.
    pub(crate) name: String,
    /// The decimals to which the query rounds it.
    decimals: Option<usize>,
}

impl Query {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Says what is not there or cannot be read.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let text =
            fs::read_to_string(path).map_err(|err| format!("`{}`: {err}", path.display()))?;
        Self::parse(&text).map_err(|reason| format!("`{}`: {reason}", path.display()))
    }

    /// Reads the text of a file.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let comments = text.lines().map_while(|line| line.strip_prefix("--"));
        // A command goes on below a line that ends in a backslash.
        let comments = comments.collect::<Vec<_>>().join("\n").replace("\\\n", "");
        let commands = comments.lines().map(str::trim);
        let commands = commands.filter(|line| line.starts_with(COMMAND));
        let words = |line: &str| line.split_whitespace().skip(1).map(str::to_owned).collect();
        let sql: Vec<&str> = text
            .lines()
            .skip_while(|line| line.starts_with("--"))
            .collect();
        let sql = sql.join("\n");
        if !sql.contains(RUNS) {
            return Err(format!("it nowhere says `run in {RUNS}`"));
        }
        Ok(Self {
            commands: commands.map(words).collect(),
            columns: columns(&sql)?,
            sql,
        })
    }

    /// Returns the query over these runs alone, instead of over all of the lake.
    pub(crate) fn over(&self, runs: &[u64]) -> String {
        let numbers: Vec<String> = runs.iter().map(u64::to_string).collect();
        self.sql.replace(RUNS, &format!("({})", numbers.join(", ")))
    }

    /// Returns the table in Markdown, from the rows of the answer.
    ///
    /// # Errors
    ///
    /// Says which column a row lacks.
    pub(crate) fn table(&self, rows: &[Value]) -> Result<Vec<String>, String> {
        let names = self.columns.iter().map(|column| column.name.clone());
        let rules = self.columns.iter().map(|_| "---".to_owned());
        let mut table = vec![line(names), line(rules)];
        for row in rows {
            let cells = self.columns.iter().map(|column| {
                let value = row.get(&column.name);
                let value = value.ok_or_else(|| format!("no `{}` in {row}", column.name))?;
                Ok(column.cell(value))
            });
            table.push(line(cells.collect::<Result<Vec<_>, String>>()?));
        }
        Ok(table)
    }
}

impl Column {
    /// Returns a value as the table shows it.
    fn cell(&self, value: &Value) -> String {
        match (value, self.decimals) {
            (Value::Null, _) => "-".to_owned(),
            (Value::String(text), _) => text.clone(),
            (Value::Number(number), Some(decimals)) => {
                let shown = format!("{:.decimals$}", number.as_f64().unwrap_or(f64::NAN));
                let is_zero = shown.chars().all(|c| matches!(c, '-' | '0' | '.'));
                if is_zero {
                    shown.replace('-', "")
                } else {
                    shown
                }
            }
            (other, _) => other.to_string(),
        }
    }
}

/// Returns the values of each variant of a command.
///
/// # Errors
///
/// Says what cannot be read in its pipeline file or in its values.
pub(crate) fn variants(command: &[String]) -> Result<Vec<Vec<Override>>, String> {
    let file = command.get(1).ok_or("a command names no pipeline file")?;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(file);
    let text = fs::read_to_string(&path).map_err(|err| format!("`{file}`: {err}"))?;
    let mut sweeps = Sweep::in_file(&path, &text).map_err(|err| err.to_string())?;
    for pair in command.windows(2).filter(|pair| pair[0] == "--set") {
        sweeps.push(pair[1].parse().map_err(|err| format!("{err}"))?);
    }
    let variants = Sweep::variants(&sweeps).into_iter();
    Ok(variants.map(|variant| variant.overrides).collect())
}

/// Returns a line of a table in Markdown.
fn line(cells: impl IntoIterator<Item = String>) -> String {
    let cells: Vec<String> = cells.into_iter().collect();
    format!("| {} |", cells.join(" | "))
}

/// Returns the columns of a query's answer.
fn columns(sql: &str) -> Result<Vec<Column>, String> {
    let statements = Parser::parse_sql(&GenericDialect, sql).map_err(|err| err.to_string())?;
    let [Statement::Query(query)] = statements.as_slice() else {
        return Err("it is not one query".to_owned());
    };
    let mut body = query.body.as_ref();
    let select = loop {
        body = match body {
            SetExpr::Select(select) => break select,
            SetExpr::SetOperation { left, .. } => left,
            SetExpr::Query(query) => &query.body,
            _ => return Err("it selects nothing".to_owned()),
        };
    };
    let columns = select.projection.iter().map(|item| match item {
        SelectItem::ExprWithAlias { expr, alias } => Ok(Column {
            name: alias.value.clone(),
            decimals: decimals(expr),
        }),
        other => Err(format!("`{other}` has no `as \"NAME\"`")),
    });
    columns.collect()
}

/// Returns the decimals of `round(…, DECIMALS)`.
fn decimals(expr: &Expr) -> Option<usize> {
    let Expr::Function(function) = expr else {
        return None;
    };
    let FunctionArguments::List(arguments) = &function.args else {
        return None;
    };
    let is_round = function.name.to_string() == "round";
    let last = arguments.args.last().filter(|_| is_round)?;
    last.to_string().parse().ok()
}
