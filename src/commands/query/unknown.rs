//! Syntax that engines read in several ways, or read and leave out: refused by name.

use std::ops::ControlFlow;

use datafusion::sql::sqlparser::ast::{
    BinaryOperator, Expr, Join, JoinConstraint, JoinOperator, Query, Select, TableFactor, Visitor,
};

use super::{faults, question};
use crate::outcome::CommandError;

/// Operators and functions within each other; the time to answer grows with the third power.
const DEPTH: usize = 128;

/// Finds what is refused.
#[derive(Default)]
pub(super) struct Syntax {
    depth: usize,
}

impl Visitor for Syntax {
    type Break = CommandError;

    fn pre_visit_query(&mut self, query: &Query) -> ControlFlow<CommandError> {
        let left_out = [
            ("for", !query.locks.is_empty() || query.for_clause.is_some()),
            ("settings", query.settings.is_some()),
            ("format", query.format_clause.is_some()),
            ("|>", !query.pipe_operators.is_empty()),
        ];
        refuse(left_out)?;
        question::check_order(query)
    }

    fn pre_visit_select(&mut self, select: &Select) -> ControlFlow<CommandError> {
        let left_out = [
            ("prewhere", select.prewhere.is_some()),
            ("connect by", !select.connect_by.is_empty()),
            ("cluster by", !select.cluster_by.is_empty()),
            ("distribute by", !select.distribute_by.is_empty()),
            ("sort by", !select.sort_by.is_empty()),
            ("lateral view", !select.lateral_views.is_empty()),
            ("top", select.top.is_some()),
        ];
        refuse(left_out)?;
        for table in &select.from {
            for join in &table.joins {
                of_join(join)?;
            }
        }
        ControlFlow::Continue(())
    }

    fn pre_visit_table_factor(&mut self, table: &TableFactor) -> ControlFlow<CommandError> {
        match table {
            TableFactor::Table {
                with_hints,
                version,
                with_ordinality,
                partitions,
                json_path,
                sample,
                index_hints,
                ..
            } => refuse([
                ("with", !with_hints.is_empty() || !index_hints.is_empty()),
                ("version", version.is_some()),
                ("with ordinality", *with_ordinality),
                ("partition", !partitions.is_empty()),
                ("a path in JSON", json_path.is_some()),
                ("tablesample", sample.is_some()),
            ]),
            TableFactor::Derived {
                sample, lateral, ..
            } => refuse([("tablesample", sample.is_some()), ("lateral", *lateral)]),
            TableFactor::Function { lateral, .. } => refuse([("lateral", *lateral)]),
            _ => ControlFlow::Continue(()),
        }
    }

    fn post_visit_expr(&mut self, _expr: &Expr) -> ControlFlow<CommandError> {
        self.depth -= 1;
        ControlFlow::Continue(())
    }

    fn pre_visit_expr(&mut self, expr: &Expr) -> ControlFlow<CommandError> {
        self.depth += 1;
        if self.depth > DEPTH {
            return ControlFlow::Break(faults::too_deep());
        }
        match expr {
            Expr::BinaryOp { op, .. } => of_operator(op),
            Expr::IsDistinctFrom(_, right) | Expr::IsNotDistinctFrom(_, right)
                if is_loose(right) =>
            {
                break_with(
                    "what belongs to `is distinct from` is not clear",
                    "put it in parentheses: `(a is distinct from b) and …`",
                )
            }
            Expr::SimilarTo { .. } | Expr::RLike { .. } => break_with(
                "`similar to` means several things",
                "write `regexp_like(text, 'PATTERN')`, or `like`",
            ),
            Expr::AnyOp { .. } | Expr::AllOp { .. } => break_with(
                "`any` and `all` are not known here",
                "write `in (select …)`, `exists (select …)`, or compare with `(select max(…) …)`",
            ),
            Expr::Like {
                pattern,
                escape_char: None,
                ..
            }
            | Expr::ILike {
                pattern,
                escape_char: None,
                ..
            } if pattern.to_string().contains('\\') => break_with(
                "a backslash in `like` is an escape for some and a character for others",
                "write `like 'a#%b' escape '#'`, with a character of your own",
            ),
            _ => ControlFlow::Continue(()),
        }
    }
}

/// Whether an expression is a condition without parentheses: the parser takes what follows
/// `is distinct from` as a whole, `and` too.
fn is_loose(expr: &Expr) -> bool {
    match expr {
        Expr::BinaryOp { op, .. } => !matches!(
            op,
            BinaryOperator::Plus
                | BinaryOperator::Minus
                | BinaryOperator::Multiply
                | BinaryOperator::Divide
                | BinaryOperator::Modulo
                | BinaryOperator::StringConcat
        ),
        Expr::Between { .. }
        | Expr::InList { .. }
        | Expr::InSubquery { .. }
        | Expr::Like { .. }
        | Expr::ILike { .. }
        | Expr::IsNull(_)
        | Expr::IsNotNull(_)
        | Expr::IsTrue(_)
        | Expr::IsFalse(_)
        | Expr::IsNotTrue(_)
        | Expr::IsNotFalse(_)
        | Expr::IsDistinctFrom(..)
        | Expr::IsNotDistinctFrom(..) => true,
        _ => false,
    }
}

fn of_operator(op: &BinaryOperator) -> ControlFlow<CommandError> {
    match op {
        BinaryOperator::BitwiseXor | BinaryOperator::Xor | BinaryOperator::PGBitwiseXor => {
            break_with(
                "`^` is a power for some and bits for others",
                "write `power(a, b)`",
            )
        }
        BinaryOperator::DuckIntegerDivide | BinaryOperator::MyIntegerDivide => break_with(
            "`//` is refused: it rounds in several ways",
            "write `cast(floor(a / b) as bigint)`, or `trunc` for `floor`",
        ),
        BinaryOperator::PGRegexMatch
        | BinaryOperator::PGRegexIMatch
        | BinaryOperator::PGRegexNotMatch
        | BinaryOperator::PGRegexNotIMatch => break_with(
            "`~` matches the whole text for some and a part for others",
            "write `regexp_like(text, 'PATTERN')`",
        ),
        BinaryOperator::PGBitwiseShiftLeft | BinaryOperator::PGBitwiseShiftRight => break_with(
            "shifts of bits are not known here",
            "write `a * power(2, n)`, or `a / power(2, n)`",
        ),
        _ => ControlFlow::Continue(()),
    }
}

/// `using` takes one of two columns: in outer joins the other may have the value.
fn of_join(join: &Join) -> ControlFlow<CommandError> {
    let (JoinOperator::Right(constraint)
    | JoinOperator::RightOuter(constraint)
    | JoinOperator::FullOuter(constraint)) = &join.join_operator
    else {
        return ControlFlow::Continue(());
    };
    match constraint {
        JoinConstraint::Using(_) | JoinConstraint::Natural => break_with(
            "`using` in a right or full join is refused",
            "write `on a.key = b.key`, and `coalesce(a.key, b.key)` for the column",
        ),
        _ => ControlFlow::Continue(()),
    }
}

fn refuse<const N: usize>(left_out: [(&str, bool); N]) -> ControlFlow<CommandError> {
    match left_out.into_iter().find(|(_, is_there)| *is_there) {
        Some((word, _)) => break_with(
            &format!("`{word}` is refused: it is not known here"),
            "ask with SELECT … FROM … JOIN … WHERE … GROUP BY … HAVING … ORDER BY … LIMIT",
        ),
        None => ControlFlow::Continue(()),
    }
}

fn break_with(message: &str, hint: &str) -> ControlFlow<CommandError> {
    ControlFlow::Break(CommandError::usage(message, hint))
}
