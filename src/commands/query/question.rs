//! A question: one statement that reads, without what would be answered by chance.

use std::{collections::BTreeSet, ops::ControlFlow};

use datafusion::sql::sqlparser::{
    ast::{
        Expr, Function, GroupByExpr, Ident, ObjectName, OrderByExpr, OrderByKind, Query, Select,
        SelectItem, SetExpr, Statement, Value, Visit, VisitMut, Visitor, VisitorMut,
    },
    dialect::GenericDialect,
    keywords::Keyword,
    parser::{Parser, ParserError, ParserOptions},
    tokenizer::{Token, Tokenizer},
};

use super::{
    engine, faults,
    files::{NamedFile, NamedFiles},
    precedence::Precedence,
    unknown,
};
use crate::outcome::CommandError;

/// Parentheses and subqueries within each other.
const DEPTH: usize = 128;

/// Operators in a question: each link of a chain lies within the next.
const OPERATORS: usize = 1000;

/// A question that can be asked.
pub(super) struct Question {
    /// The statement, in which each named file is a table.
    pub(super) statement: Statement,
    /// Names of the tables in it.
    pub(super) tables: BTreeSet<String>,
    /// The files that it names.
    pub(super) files: Vec<NamedFile>,
    /// The columns as the question writes them; `None` where `*` stands for several.
    pub(super) columns: Vec<Option<String>>,
    /// It is `show tables`.
    pub(super) lists_tables: bool,
}

impl Question {
    /// Reads a question: a single statement that changes nothing, without ungrouped columns.
    pub(super) fn read(sql: &str) -> Result<Self, CommandError> {
        let mut statements = parse(sql).map_err(|err| faults::unreadable(&err))?;
        let (Some(mut statement), n_others) = (statements.pop(), statements.len()) else {
            return Err(faults::not_read("it is empty"));
        };
        if n_others > 0 {
            return Err(CommandError::usage(
                format!("there are {} questions in one", n_others + 1),
                "ask one after the other",
            ));
        }
        let _never_breaks = VisitMut::visit(&mut statement, &mut Precedence);
        for check in [
            Visit::visit(&statement, &mut QueryVisitor),
            Visit::visit(&statement, &mut unknown::Syntax::default()),
        ] {
            if let ControlFlow::Break(trouble) = check {
                return Err(trouble);
            }
        }
        let columns = columns(&statement);
        let mut files = NamedFiles::default();
        if let ControlFlow::Break(trouble) = VisitMut::visit(&mut statement, &mut files) {
            return Err(trouble);
        }
        let _never_breaks = VisitMut::visit(&mut statement, &mut Names);
        let mut tables = Relations::default();
        let _never_breaks = Visit::visit(&statement, &mut tables);
        Ok(Self {
            tables: tables.0,
            files: files.found,
            columns,
            lists_tables: matches!(statement, Statement::ShowTables { .. }),
            statement,
        })
    }
}

/// Reads statements.
fn parse(sql: &str) -> Result<Vec<Statement>, ParserError> {
    let options = ParserOptions {
        trailing_commas: true,
        ..ParserOptions::default()
    };
    let tokens = Tokenizer::new(&GenericDialect, sql).tokenize_with_location()?;
    let n_operators = tokens
        .iter()
        .filter(|token| is_operator(&token.token))
        .count();
    if n_operators > OPERATORS {
        return Err(ParserError::RecursionLimitExceeded);
    }
    Parser::new(&GenericDialect)
        .with_recursion_limit(DEPTH)
        .with_options(options)
        .with_tokens_with_locations(tokens)
        .parse_statements()
}

/// Whether a word or sign may stand in a chain, each link of which lies within the next.
fn is_operator(token: &Token) -> bool {
    match token {
        Token::Word(word) => matches!(
            word.keyword,
            Keyword::AND
                | Keyword::OR
                | Keyword::UNION
                | Keyword::EXCEPT
                | Keyword::INTERSECT
                | Keyword::JOIN
        ),
        Token::Whitespace(_)
        | Token::Comma
        | Token::LParen
        | Token::RParen
        | Token::Number(..)
        | Token::SingleQuotedString(_)
        | Token::Period
        | Token::SemiColon
        | Token::EOF => false,
        _ => true,
    }
}

/// Names the columns that are computed as they are written: the engine has names of its own, the same for some
/// that differ.
struct Names;

impl VisitorMut for Names {
    type Break = ();

    fn pre_visit_query(&mut self, query: &mut Query) -> ControlFlow<()> {
        let n_columns = columns_of(query).iter().flatten().count();
        let Some(order) = &mut query.order_by else {
            return ControlFlow::Continue(());
        };
        if let OrderByKind::Expressions(keys) = &mut order.kind
            && let [key] = keys.as_slice()
            && matches!(&key.expr, Expr::Identifier(name) if is_all(name))
        {
            let places = (1..=n_columns).map(|place| OrderByExpr {
                expr: Expr::value(Value::Number(place.to_string(), false)),
                ..key.clone()
            });
            *keys = places.collect();
        }
        ControlFlow::Continue(())
    }

    fn pre_visit_select(&mut self, select: &mut Select) -> ControlFlow<()> {
        for item in &mut select.projection {
            if let SelectItem::UnnamedExpr(expr) = item
                && !matches!(expr, Expr::Identifier(_) | Expr::CompoundIdentifier(_))
            {
                let alias = Ident::with_quote('"', expr.to_string());
                let expr = expr.clone();
                *item = SelectItem::ExprWithAlias { expr, alias };
            }
        }
        ControlFlow::Continue(())
    }
}

/// Refuses `order by all` where `*` stands for columns that are not known yet.
pub(super) fn check_order(query: &Query) -> ControlFlow<CommandError> {
    if let Some(order) = &query.order_by
        && let OrderByKind::Expressions(keys) = &order.kind
        && let [key] = keys.as_slice()
        && matches!(&key.expr, Expr::Identifier(name) if is_all(name))
    {
        let columns = columns_of(query);
        if columns.is_empty() || columns.iter().any(Option::is_none) {
            return ControlFlow::Break(CommandError::usage(
                "`order by all` needs the names of the columns, not `*`",
                "name them after `select`, or after `order by`",
            ));
        }
    }
    ControlFlow::Continue(())
}

/// Whether a name is `all` of `order by all`: every column in its order.
fn is_all(name: &Ident) -> bool {
    name.quote_style.is_none() && name.value.eq_ignore_ascii_case("all")
}

/// Names of the tables in a statement.
#[derive(Default)]
struct Relations(BTreeSet<String>);

impl Visitor for Relations {
    type Break = ();

    fn pre_visit_relation(&mut self, name: &ObjectName) -> ControlFlow<()> {
        if let [part] = name.0.as_slice()
            && let Some(name) = part.as_ident()
        {
            self.0.insert(name.value.clone());
        }
        ControlFlow::Continue(())
    }
}

/// The columns of the answer as the statement writes them.
fn columns(statement: &Statement) -> Vec<Option<String>> {
    match statement {
        Statement::Query(query) => columns_of(query),
        _ => Vec::new(),
    }
}

/// The columns of a query as it writes them; `None` where `*` stands for several.
fn columns_of(query: &Query) -> Vec<Option<String>> {
    let mut body = &query.body;
    let select = loop {
        match body.as_ref() {
            SetExpr::Select(select) => break select,
            SetExpr::Query(query) => body = &query.body,
            SetExpr::SetOperation { left, .. } => body = left,
            _ => return Vec::new(),
        }
    };
    let items = select.projection.iter().map(|item| match item {
        SelectItem::UnnamedExpr(Expr::Identifier(name)) => Some(name.value.clone()),
        SelectItem::UnnamedExpr(Expr::CompoundIdentifier(names)) => {
            names.last().map(|name| name.value.clone())
        }
        SelectItem::UnnamedExpr(expr) => Some(expr.to_string()),
        SelectItem::ExprWithAlias { alias, .. } => Some(alias.value.clone()),
        _ => None,
    });
    items.collect()
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
                let _never_breaks = Visit::visit(item, &mut columns);
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
    function.over.is_some() || engine::is_aggregate(&name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The message and the hint about a query.
    fn said(sql: &str) -> Option<(String, String)> {
        match Question::read(sql) {
            Ok(_) => None,
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
            assert_eq!(message, "cannot parse the SQL: it is empty", "{empty}");
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
