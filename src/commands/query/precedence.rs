//! `a is distinct from b and c` as `(a is distinct from b) and c`: the parser takes all that follows as one side.

use std::ops::ControlFlow;

use datafusion::sql::sqlparser::ast::{BinaryOperator, Expr, UnaryOperator, Value, VisitorMut};

/// Puts `is distinct from` before `and` and `or`.
pub(super) struct Precedence;

impl VisitorMut for Precedence {
    type Break = ();

    fn pre_visit_expr(&mut self, expr: &mut Expr) -> ControlFlow<()> {
        if has_loose_side(expr) {
            let mut chain = Chain::default();
            chain.add(take(expr));
            *expr = chain.joined();
        }
        ControlFlow::Continue(())
    }
}

fn take(expr: &mut Expr) -> Expr {
    std::mem::replace(expr, Expr::value(Value::Null))
}

/// Whether a side of `is distinct from` in a chain of `and`, `or` and `not` is such a chain.
fn has_loose_side(expr: &Expr) -> bool {
    match expr {
        Expr::BinaryOp { left, op, right } if is_link(op) => {
            has_loose_side(left) || has_loose_side(right)
        }
        Expr::UnaryOp {
            op: UnaryOperator::Not,
            expr,
        } => has_loose_side(expr),
        Expr::IsDistinctFrom(_, right) | Expr::IsNotDistinctFrom(_, right) => {
            matches!(&**right, Expr::BinaryOp { op, .. } if is_link(op)) || has_loose_side(right)
        }
        _ => false,
    }
}

fn is_link(op: &BinaryOperator) -> bool {
    matches!(op, BinaryOperator::And | BinaryOperator::Or)
}

/// Conditions in the order of the text: those between two `or` belong together.
#[derive(Default)]
struct Chain {
    done: Vec<Vec<Expr>>,
    open: Vec<Expr>,
}

impl Chain {
    fn add(&mut self, expr: Expr) {
        match expr {
            Expr::BinaryOp { left, op, right } if is_link(&op) => {
                self.add(*left);
                if op == BinaryOperator::Or {
                    self.done.push(std::mem::take(&mut self.open));
                }
                self.add(*right);
            }
            Expr::UnaryOp {
                op: UnaryOperator::Not,
                expr,
            } => self.add_first(*expr, |expr| Expr::UnaryOp {
                op: UnaryOperator::Not,
                expr: expr.into(),
            }),
            Expr::IsDistinctFrom(left, right) => {
                self.add_first(*right, |right| Expr::IsDistinctFrom(left, right.into()));
            }
            Expr::IsNotDistinctFrom(left, right) => {
                self.add_first(*right, |right| Expr::IsNotDistinctFrom(left, right.into()));
            }
            other => self.open.push(other),
        }
    }

    /// Adds a chain whose first condition alone belongs to what stands before it.
    fn add_first(&mut self, chain: Expr, whole: impl FnOnce(Expr) -> Expr) {
        let mut others = Self::default();
        others.add(chain);
        let first = others.done.first_mut().unwrap_or(&mut others.open);
        if let Some(first) = first.first_mut() {
            let condition = take(first);
            *first = whole(condition);
        }
        let mut groups = others.done.into_iter().chain([others.open]);
        self.open.extend(groups.next().unwrap_or_default());
        for group in groups {
            self.done.push(std::mem::take(&mut self.open));
            self.open = group;
        }
    }

    fn joined(mut self) -> Expr {
        self.done.push(self.open);
        let groups = self.done.into_iter();
        let groups = groups.filter_map(|group| joined(group, &BinaryOperator::And));
        joined(groups, &BinaryOperator::Or).unwrap_or_else(|| Expr::value(Value::Null))
    }
}

fn joined(parts: impl IntoIterator<Item = Expr>, op: &BinaryOperator) -> Option<Expr> {
    parts.into_iter().reduce(|left, right| Expr::BinaryOp {
        left: left.into(),
        op: op.clone(),
        right: right.into(),
    })
}

#[cfg(test)]
mod tests {
    use datafusion::sql::sqlparser::{ast::VisitMut, dialect::GenericDialect, parser::Parser};

    use super::*;

    #[test]
    fn what_follows_is_distinct_from_is_a_condition_of_its_own() {
        for (sql, means) in [
            ("a is distinct from b and c", "(a is distinct from b) and c"),
            (
                "p and a is distinct from b or c",
                "(p and (a is distinct from b)) or c",
            ),
            (
                "p or a is not distinct from b and c or d and e",
                "(p or ((a is not distinct from b) and c)) or (d and e)",
            ),
            (
                "not a is distinct from b and c",
                "(not (a is distinct from b)) and c",
            ),
            (
                "a is distinct from b and c is distinct from d or e",
                "((a is distinct from b) and (c is distinct from d)) or e",
            ),
            (
                "a is distinct from (b and c) or d",
                "(a is distinct from (b and c)) or d",
            ),
            (
                "a is distinct from b + 1 and c",
                "(a is distinct from b + 1) and c",
            ),
        ] {
            let read = |sql: &str| {
                let mut parser = Parser::new(&GenericDialect).try_with_sql(sql).unwrap();
                let mut expr = parser.parse_expr().unwrap();
                let _never_breaks = VisitMut::visit(&mut expr, &mut Precedence);
                expr
            };
            let is = in_parentheses(read(sql)).to_string();
            assert_eq!(is, in_parentheses(read(means)).to_string(), "{sql}");
        }
    }

    /// An expression in which chains have parentheses around each link.
    fn in_parentheses(expr: Expr) -> Expr {
        match expr {
            Expr::Nested(inner) => in_parentheses(*inner),
            Expr::BinaryOp { left, op, right } if is_link(&op) => {
                Expr::Nested(Box::new(Expr::BinaryOp {
                    left: in_parentheses(*left).into(),
                    op,
                    right: in_parentheses(*right).into(),
                }))
            }
            Expr::UnaryOp { op, expr } => Expr::Nested(Box::new(Expr::UnaryOp {
                op,
                expr: in_parentheses(*expr).into(),
            })),
            other => other,
        }
    }
}
