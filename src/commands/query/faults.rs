//! Errors of a query, in the project's words and with near names.

use dataflow::{Diagnostic, nearest};
use datafusion::{
    arrow::{datatypes::SchemaRef, error::ArrowError},
    common::{Column, SchemaError},
    error::DataFusionError,
    sql::sqlparser::parser::ParserError,
};
use lake::{Lake, LakeError};

use super::{engine, meaning::Refusal, source::Source};
use crate::outcome::CommandError;

/// An example query, for the hint of one that cannot be parsed.
const EXAMPLE: &str =
    "write it as, e.g., `select object, count(*) as n from rollouts group by object`";

/// Returns the error of a query that cannot be parsed.
pub(super) fn unreadable(err: &ParserError) -> CommandError {
    match err {
        ParserError::TokenizerError(text) | ParserError::ParserError(text) => not_read(text),
        ParserError::RecursionLimitExceeded => too_deep(),
    }
}

/// Returns the error of a query in which too much stands within each other.
pub(super) fn too_deep() -> CommandError {
    CommandError::usage(
        "cannot parse the SQL: it has too many parentheses or operators within each other",
        "name parts of it with `with part as (select …)`, and write `a in (1, 2, …)` for a chain of `or`",
    )
}

/// Returns the error of a query that cannot be parsed, for a reason.
pub(super) fn not_read(reason: &str) -> CommandError {
    CommandError::usage(format!("cannot parse the SQL: {reason}"), EXAMPLE)
}

/// Returns the error of a failed query, given the columns of the tables that were opened for it.
pub(super) fn explain(
    err: &DataFusionError,
    source: &mut Source,
    tables: &[SchemaRef],
) -> CommandError {
    let root = err.find_root();
    match root {
        DataFusionError::External(cause) => {
            if let Some(refusal) = cause.downcast_ref::<Refusal>() {
                return CommandError::usage(refusal.message.clone(), refusal.hint.clone());
            }
            if let Some(damage) = cause.downcast_ref::<LakeError>() {
                let hint = "`pipeline verify` says what is damaged in the lake".to_owned();
                let hint = damage.hint().unwrap_or(hint);
                return CommandError::failed(anyhow::anyhow!("{damage}"), Some(hint));
            }
            cannot("a part of it is not supported")
        }
        DataFusionError::SchemaError(fault, _) => column_error(fault, tables),
        DataFusionError::ArrowError(fault, _) => value_error(fault),
        DataFusionError::ResourcesExhausted(_) => cannot("it takes too much memory"),
        DataFusionError::Plan(text)
        | DataFusionError::NotImplemented(text)
        | DataFusionError::Execution(text) => text_error(text, source),
        _ => cannot("a part of it is not supported"),
    }
}

/// Returns the error of a question that the engine gave up.
pub(super) fn too_much() -> CommandError {
    cannot("a part of it is not supported")
}

fn cannot(reason: &str) -> CommandError {
    CommandError::usage(format!("cannot answer the question: {reason}"), EXAMPLE)
}

/// A column that is not there, or is in two tables.
fn column_error(fault: &SchemaError, tables: &[SchemaRef]) -> CommandError {
    match fault {
        SchemaError::FieldNotFound {
            field,
            valid_fields,
        } => {
            // Columns of the table that the query names.
            let is_of =
                |column: &&Column| field.relation.is_none() || column.relation == field.relation;
            let of_table = valid_fields.iter().filter(is_of);
            let mut columns: Vec<String> = of_table.map(|column| column.name.clone()).collect();
            if columns.is_empty()
                && !valid_fields.is_empty()
                && let Some(table) = &field.relation
            {
                return CommandError::usage(
                    format!("no table `{table}` in `from`, for `{}`", field.flat_name()),
                    "write the table's name, or its short name if `from` gives it one",
                );
            }
            if columns.is_empty() {
                let known = tables.iter().flat_map(|table| table.fields().iter());
                columns.extend(known.map(|field| field.name().clone()));
            }
            no_column(field, columns)
        }
        SchemaError::AmbiguousReference { field } => twice(&field.name),
        SchemaError::DuplicateQualifiedField { name, .. }
        | SchemaError::DuplicateUnqualifiedField { name } => twice(name),
    }
}

fn no_column(missing: &Column, mut columns: Vec<String>) -> CommandError {
    let column = missing.name.as_str();
    // A total, which the engine has not computed where it is needed.
    if column.contains('(') {
        return CommandError::usage(
            "cannot answer the question: a total stands where it cannot be computed",
            "name it in `with part as (select …, count(*) as n … group by …)`, and ask `part`",
        );
    }
    columns.retain(|column| !column.contains('('));
    columns.sort();
    columns.dedup();
    let list = format!("the columns are: {}", columns.join(", "));
    CommandError::usage(
        format!("no column `{}`", missing.flat_name()),
        near(column, columns.iter().map(String::as_str), list),
    )
}

fn twice(column: &str) -> CommandError {
    // The engine's name of an expression.
    if column.contains('(') {
        return CommandError::usage(
            "two columns without a name cannot be told apart",
            "give each a name of its own with `as`",
        );
    }
    CommandError::usage(
        format!("two columns are called `{column}`"),
        format!("write its table, e.g. `rollouts.{column}`, or name one of them with `as`"),
    )
}

/// Values that cannot be computed.
fn value_error(fault: &ArrowError) -> CommandError {
    match fault {
        ArrowError::ArithmeticOverflow(_) => overflow(),
        ArrowError::DivideByZero => CommandError::usage(
            "cannot answer the question: it takes the rest of a division by zero",
            "write `nullif(…, 0)` for the divisor",
        ),
        ArrowError::CastError(text)
        | ArrowError::ParseError(text)
        | ArrowError::InvalidArgumentError(text)
        | ArrowError::ComputeError(text) => {
            if text.contains("verflow") || text.contains("too large to store") {
                return overflow();
            }
            if text.contains("out of range") || text.contains("Can't cast value") {
                return overflow();
            }
            let value = between(text, "string '", "' to").or_else(|| between(text, "'", "'"));
            match value {
                Some(value) => CommandError::usage(
                    format!("`{value}` cannot be converted to {}", kind_in(text)),
                    "leave such values out with `where`, or write `try_cast(… as …)`",
                ),
                None => cannot("a value cannot be converted"),
            }
        }
        _ => cannot("a value cannot be computed"),
    }
}

fn overflow() -> CommandError {
    CommandError::usage(
        "cannot answer the question: a whole number is too large, they have 64 bits and as `int` 32",
        "convert what is computed with `cast(… as double)`, or with `bigint` for `int`",
    )
}

/// The type that a message of a conversion names.
fn kind_in(text: &str) -> &'static str {
    let kinds = [
        ("Int", "a whole number"),
        ("Float", "a number"),
        ("Decimal", "a number"),
        ("Date", "a date"),
        ("Timestamp", "a time"),
        ("timestamp", "a time"),
        ("Bool", "true or false"),
    ];
    let (_, to) = text.rsplit_once(" to ").unwrap_or(("", text));
    let found = kinds.iter().find(|(word, _)| to.contains(word));
    found.map_or("what is asked for", |(_, kind)| kind)
}

/// Refusals of the engine that have one cause: phrases of which one is in it, the message and the hint. The
/// first that fits counts.
const REFUSALS: [(&[&str], &str, &str); 7] = [
    (
        &["HAVING clause references"],
        "`having` is about groups, and a column in it has a value in every row",
        "add `group by`, or ask for rows with `where`",
    ),
    (
        &["not allowed in the WHERE clause"],
        "`where` is about rows, and a total in it is about groups",
        "write `having` after `group by`",
    ),
    (
        &["require unique expression names"],
        "two columns of a part of the question are the same",
        "name one of them with `as`",
    ),
    (
        &["more than one row"],
        "cannot answer the question: a subquery in the place of a value has several rows",
        "take one, e.g. with `max(…)`, or write `in (select …)`",
    ),
    (
        &["coerce", "infer common"],
        "cannot answer the question: it computes with values of two kinds, e.g. text and numbers",
        "convert one of them, e.g. with `cast(… as double)` or `cast(… as varchar)`",
    ),
    (
        &["different number of columns", "same number of columns"],
        "cannot answer the question: the parts of `union`, `except` or `intersect` have different columns",
        EXAMPLE,
    ),
    (
        &["ScalarSubquery", "anti join", "correlated"],
        "cannot answer the question: a subquery stands where it cannot be joined",
        "name it with `with part as (select …)` and write a join, e.g. with `group by` in the part",
    ),
];

/// What the engine says in words.
fn text_error(text: &str, source: &mut Source) -> CommandError {
    let text = text.lines().next().unwrap_or_default();
    if let Some(table) = between(text, "table '", "' not found") {
        return no_table(table.rsplit('.').next().unwrap_or(table), source);
    }
    if let Some(function) = between(text, "Invalid function '", "'") {
        let names = engine::functions();
        if names.iter().any(|name| name == function) {
            return CommandError::usage(
                format!("cannot answer the question: `{function}` is about rows in an order"),
                format!("write `{function}(…) over (order by …)`"),
            );
        }
        let list = format!("the functions are: {}", names.join(", "));
        return CommandError::usage(
            format!("cannot answer the question: no function `{function}`"),
            near(function, names.iter().map(String::as_str), list),
        );
    }
    if let Some(column) = between(text, "column \"", "\" must appear") {
        return CommandError::usage(
            format!("`{column}` is neither grouped by nor in a total"),
            format!("add `{column}` to `group by`, or ask for e.g. `max({column})`"),
        );
    }
    let mut refusals = REFUSALS.iter();
    let is_said = |phrases: &[&str]| phrases.iter().any(|phrase| text.contains(phrase));
    if let Some((_, message, hint)) = refusals.find(|(phrases, ..)| is_said(phrases)) {
        return CommandError::usage(*message, *hint);
    }
    if text.contains("verflow") {
        return overflow();
    }
    if text.contains("Divide by zero") || text.contains("DivideByZero") {
        return value_error(&ArrowError::DivideByZero);
    }
    if let Some(function) = between(text, "table function '", "' not found") {
        return CommandError::usage(
            format!("cannot answer the question: no table `{function}(…)`"),
            "name a table, `read_parquet('PATH')`, `read_csv('PATH')` or `(values (…), (…)) as t(a, b)`",
        );
    }
    cannot(&plain(text))
}

/// The engine's words, if they are words that people use.
fn plain(text: &str) -> String {
    let is_inside = |word: &str| {
        let capitals = word.chars().zip(word.chars().skip(1));
        let is_camel = capitals
            .clone()
            .any(|(a, b)| a.is_lowercase() && b.is_uppercase());
        let has_digits =
            word.starts_with(char::is_uppercase) && word.ends_with(|c: char| c.is_ascii_digit());
        is_camel || has_digits || word.contains("::") || word.contains(['{', '}', '_', '[', '"'])
    };
    let is_plain = !text.split_whitespace().any(is_inside);
    let has_words = [
        "Int64",
        "Utf8",
        "Float64",
        "Date32",
        "Timestamp(",
        "Boolean(",
        "Physical",
        "Logical",
        "plan",
        "Planner",
        "DataFusion",
        "Arrow",
        "Expr",
        "UDF",
        "coercion",
        "schema",
    ];
    if is_plain && !has_words.iter().any(|word| text.contains(word)) {
        let text = text.trim_end_matches('.');
        let mut letters = text.chars();
        let first = letters.next().map(|first| {
            if letters.as_str().starts_with(char::is_lowercase) {
                first.to_lowercase().to_string()
            } else {
                first.to_string()
            }
        });
        return first.unwrap_or_default() + letters.as_str();
    }
    let call = between(text, "call '", "(").or_else(|| between(text, "function '", "'"));
    let call = call.or_else(|| between(text, "Function '", "'"));
    match call {
        Some(function) => format!("`{function}` does not take such values"),
        None => "a part of it is not supported".to_owned(),
    }
}

fn no_table(table: &str, source: &mut Source) -> CommandError {
    // The message does not depend on the list of tables.
    let shown = source.shown();
    let mut names: Vec<&str> = shown.iter().map(String::as_str).collect();
    names.sort_unstable();
    let list = format!("the tables are: {}", names.join(", "));
    let hint = if Lake::history_tables().contains(&table) {
        format!("it is written when a run ends, and none has ended in this lake; {list}")
    } else {
        near(table, names.into_iter(), list)
    };
    CommandError::usage(format!("no table `{table}`"), hint)
}

fn near<'a>(word: &str, names: impl Iterator<Item = &'a str>, list: String) -> String {
    match nearest(word, names) {
        Some(near) => format!("did you mean `{near}`? {list}"),
        None => list,
    }
}

fn between<'t>(text: &'t str, start: &str, end: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(start)?;
    let (word, _) = rest.split_once(end)?;
    Some(word)
}
