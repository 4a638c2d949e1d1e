//! Checks of a query: one read-only, unambiguous statement.

use std::ops::ControlFlow;

use sqlparser::{
    ast::{Expr, Function, GroupByExpr, Query, Select, SelectItem, Statement, Visit, Visitor},
    dialect::GenericDialect,
    parser::{Parser, ParserError, ParserOptions},
};

use super::faults;
use crate::outcome::CommandError;

/// The aggregate functions.
const AGGREGATES: [&str; 26] = [
    "array_agg",
    "avg",
    "corr",
    "count",
    "covar",
    "covar_pop",
    "covar_samp",
    "first",
    "group_concat",
    "last",
    "listagg",
    "max",
    "median",
    "min",
    "quantile_cont",
    "quantile_disc",
    "stddev",
    "stddev_samp",
    "stdev",
    "stdev_samp",
    "string_agg",
    "sum",
    "total",
    "var",
    "var_samp",
    "variance",
];

/// Checks that a query is a single read-only statement without ungrouped columns.
pub(super) fn check(sql: &str) -> Result<(), CommandError> {
    let statements = parse(sql).map_err(|err| faults::unreadable(&err.to_string()))?;
    match statements.as_slice() {
        [] => Err(faults::unreadable("it is empty")),
        [statement] => match statement.visit(&mut QueryVisitor) {
            ControlFlow::Break(trouble) => Err(trouble),
            ControlFlow::Continue(()) => Ok(()),
        },
        several => Err(CommandError::usage(
            format!("there are {} questions in one", several.len()),
            "ask one after the other",
        )),
    }
}

/// Reads it as polars does.
fn parse(sql: &str) -> Result<Vec<Statement>, ParserError> {
    let options = ParserOptions {
        trailing_commas: true,
        ..ParserOptions::default()
    };
    Parser::new(&GenericDialect)
        .with_options(options)
        .try_with_sql(sql)?
        .parse_statements()
}

/// Visits every statement and selection of a query.
struct QueryVisitor;

impl Visitor for QueryVisitor {
    type Break = CommandError;

    fn pre_visit_statement(&mut self, statement: &Statement) -> ControlFlow<CommandError> {
        match statement {
            Statement::Query(_) | Statement::ShowTables { .. } | Statement::Explain { .. } => {
                ControlFlow::Continue(())
            }
            other => {
                let text = other.to_string();
                let word = text.split_whitespace().next().unwrap_or_default();
                ControlFlow::Break(changes(word))
            }
        }
    }

    fn pre_visit_select(&mut self, select: &Select) -> ControlFlow<CommandError> {
        if select.into.is_some() {
            return ControlFlow::Break(changes("SELECT INTO"));
        }
        ungrouped(select).map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }
}

fn changes(word: &str) -> CommandError {
    CommandError::usage(
        format!("`{word}` is refused: questions read tables and change nothing"),
        "ask with SELECT, WITH, VALUES, SHOW TABLES or EXPLAIN; runs make tables, and `pipeline gc` \
         removes what nothing uses",
    )
}

/// Finds ungrouped columns beside aggregates: the choice of their row would be arbitrary.
fn ungrouped(select: &Select) -> Option<CommandError> {
    let GroupByExpr::Expressions(keys, _) = &select.group_by else {
        return None;
    };
    if !keys.is_empty() {
        return None;
    }
    let mut columns = Columns::default();
    for item in &select.projection {
        if let SelectItem::ExprWithAlias { alias, .. } = item {
            columns.aliases.push(alias.value.clone());
        }
    }
    for item in &select.projection {
        match item {
            SelectItem::Wildcard(_) | SelectItem::QualifiedWildcard(..) => {
                columns.add(item.to_string());
            }
            item => {
                let _never_breaks = item.visit(&mut columns);
            }
        }
    }
    if !columns.has_totals || columns.bare.is_empty() {
        return None;
    }
    let list = columns.bare.join(", ");
    let message = format!("`{list}` has a value in every row, and totals over all rows have one");
    let hint = if list.contains('*') {
        "name the columns instead of `*` and add `group by` with them".to_owned()
    } else {
        format!("add `group by {list}`")
    };
    Some(CommandError::usage(message, hint))
}

/// The names in a select list.
#[derive(Default)]
struct Columns {
    /// Aliases of the list.
    aliases: Vec<String>,
    /// Columns outside aggregates.
    bare: Vec<String>,
    has_totals: bool,
    /// Depth of enclosing aggregates and subqueries.
    n_around: usize,
    n_queries: usize,
}

impl Columns {
    fn add(&mut self, name: String) {
        if !self.bare.contains(&name) {
            self.bare.push(name);
        }
    }
}

impl Visitor for Columns {
    type Break = ();

    fn pre_visit_query(&mut self, _query: &Query) -> ControlFlow<()> {
        self.n_queries += 1;
        ControlFlow::Continue(())
    }

    fn post_visit_query(&mut self, _query: &Query) -> ControlFlow<()> {
        self.n_queries -= 1;
        ControlFlow::Continue(())
    }

    fn pre_visit_expr(&mut self, expr: &Expr) -> ControlFlow<()> {
        if self.n_queries > 0 {
            return ControlFlow::Continue(());
        }
        match expr {
            Expr::Function(function) if is_over_rows(function) => {
                self.has_totals |= function.over.is_none();
                self.n_around += 1;
            }
            Expr::Identifier(name) if self.n_around == 0 && !self.aliases.contains(&name.value) => {
                self.add(name.to_string());
            }
            Expr::CompoundIdentifier(_) if self.n_around == 0 => self.add(expr.to_string()),
            _ => {}
        }
        ControlFlow::Continue(())
    }

    fn post_visit_expr(&mut self, expr: &Expr) -> ControlFlow<()> {
        match expr {
            Expr::Function(function) if self.n_queries == 0 && is_over_rows(function) => {
                self.n_around -= 1;
            }
            _ => {}
        }
        ControlFlow::Continue(())
    }
}

/// Whether a function is an aggregate or a window function.
fn is_over_rows(function: &Function) -> bool {
    let name = function.name.to_string().to_lowercase();
    function.over.is_some() || AGGREGATES.contains(&name.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message and the hint about a query.
    fn said(sql: &str) -> Option<(String, String)> {
        match check(sql) {
            Ok(()) => None,
            Err(CommandError::Usage { message, hint }) => Some((message, hint.unwrap())),
            Err(other) => panic!("{other:?}"),
        }
    }

    #[test]
    fn questions_that_read_are_let_through() {
        for sql in [
            "select 1",
            "select * from objects;",
            "with a as (select 1 as x) select x from a",
            "values (1, 2)",
            "show tables",
            "explain select 1",
            "select 'delete from objects' as text",
            "select a, b, from t",
            "(select 1) union all (select 2)",
            "-- drop table objects\nselect 1",
        ] {
            assert_eq!(said(sql), None, "{sql}");
        }
    }

    #[test]
    fn query_that_changes_data_is_refused() {
        for (sql, word) in [
            ("delete from objects", "DELETE"),
            ("DELETE FROM objects WHERE mass_kg > 1", "DELETE"),
            ("drop table objects", "DROP"),
            ("truncate objects", "TRUNCATE"),
            ("truncate table objects", "TRUNCATE"),
            ("create table a as select 1", "CREATE"),
            ("create or replace view a as select 1", "CREATE"),
            ("insert into objects values (1)", "INSERT"),
            ("update objects set mass_kg = 1", "UPDATE"),
            ("alter table objects rename to a", "ALTER"),
            ("copy objects to 'a.csv'", "COPY"),
            ("set a = 1", "SET"),
            ("explain delete from objects", "DELETE"),
            ("with a as (select 1) delete from objects", "DELETE"),
            (
                "with a as (delete from objects returning *) select * from a",
                "DELETE",
            ),
            ("select * into a from objects", "SELECT INTO"),
        ] {
            let (message, _) = said(sql).unwrap_or_else(|| panic!("{sql} is let through"));
            assert!(
                message.starts_with(&format!("`{word}` is refused")),
                "{sql}: {message}"
            );
        }
    }

    #[test]
    fn several_statements_are_refused() {
        let several = said("select 1; delete from objects").unwrap();
        assert_eq!(several.0, "there are 2 questions in one");
        for empty in ["", "  ", ";", "-- nothing"] {
            let (message, _) = said(empty).unwrap();
            assert_eq!(message, "cannot read the question: it is empty", "{empty}");
        }
    }

    #[test]
    fn columns_beside_totals_are_grouped_by() {
        for (sql, keys) in [
            ("select a, count(*) from t", "a"),
            ("select count(*), a, b from t", "a, b"),
            ("select a as x, sum(b) + 1 from t", "a"),
            ("select upper(a), avg(b) from t", "a"),
            ("select t.a, max(t.b) from t", "t.a"),
            ("select max(a) - a from t", "a"),
            ("select * from (select a, count(*) from t) as x", "a"),
            (
                "with x as (select \"a b\", min(c) from t) select * from x",
                "\"a b\"",
            ),
            ("select 1 union all select a, count(*) from t", "a"),
            (
                "select case when a > 1 then 1 else 2 end, COUNT(b) from t",
                "a",
            ),
        ] {
            let (message, hint) = said(sql).unwrap_or_else(|| panic!("{sql} is let through"));
            assert!(message.contains("totals over all rows"), "{message}");
            assert_eq!(hint, format!("add `group by {keys}`"), "{sql}");
        }
        let (_, hint) = said("select *, count(*) from t").unwrap();
        assert!(hint.starts_with("name the columns"), "{hint}");
    }

    #[test]
    fn totals_that_need_no_groups_are_let_through() {
        for sql in [
            "select a, count(*) from t group by a",
            "select a, count(*) from t group by all",
            "select count(*), avg(a) from t",
            "select 'all' as what, count(*) from t",
            "select a, count(*) over (partition by a) from t",
            "select a, row_number() over (order by a) from t",
            "select a, (select count(*) from u) from t",
            "select count(*) from t where a > 1 and b in (select c from u)",
            "select count(*) as n, n * 2 from t",
            "select sum(a * b) / count(*) from t",
            "select a from t",
            "select distinct a, b from t",
        ] {
            assert_eq!(said(sql), None, "{sql}");
        }
    }
}
