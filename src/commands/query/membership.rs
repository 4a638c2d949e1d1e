//! Where `in (select …)` can stand: elsewhere the engine takes a missing value for false.

use datafusion::{
    common::{
        Result,
        tree_node::{TreeNode, TreeNodeRecursion},
    },
    logical_expr::{BinaryExpr, Expr, LogicalPlan, Operator, expr::InSubquery},
};

use super::meaning::refused;

/// What a condition decides, seen from the place of a part of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// A row is kept if this and others are true.
    Alone,
    /// A row is kept if this is true, or another.
    Beside,
    /// It matters whether this is false or missing.
    Within,
}

/// Refuses a step in which `in` of a subquery stands where its answer may be wrong.
pub(super) fn check(step: &LogicalPlan) -> Result<()> {
    let place = match step {
        LogicalPlan::Filter(_) => Place::Alone,
        _ => Place::Within,
    };
    step.apply_expressions(|expr| {
        check_part(expr, place)?;
        Ok(TreeNodeRecursion::Continue)
    })?;
    Ok(())
}

fn check_part(expr: &Expr, place: Place) -> Result<()> {
    match expr {
        Expr::BinaryExpr(BinaryExpr { left, op, right })
            if matches!(op, Operator::And | Operator::Or) && place != Place::Within =>
        {
            let place = if *op == Operator::Or {
                Place::Beside
            } else {
                place
            };
            check_part(left, place)?;
            check_part(right, place)
        }
        Expr::InSubquery(inside) => check_one(inside, place),
        expr => {
            expr.apply_children(|part| {
                check_part(part, Place::Within)?;
                Ok(TreeNodeRecursion::Continue)
            })?;
            Ok(())
        }
    }
}

fn check_one(inside: &InSubquery, place: Place) -> Result<()> {
    let word = if inside.negated { "not in" } else { "in" };
    let is_known = match (inside.negated, place) {
        (_, Place::Within) | (true, Place::Beside) => false,
        (false, _) => true,
        (true, Place::Alone) => {
            inside.subquery.outer_ref_columns.is_empty() && inside.expr.any_column_refs()
        }
    };
    if is_known {
        return Ok(());
    }
    let not = if inside.negated { "not " } else { "" };
    Err(refused(
        format!("`{word} (select …)` is not known in this place"),
        format!(
            "write `{not}exists (select 1 from … where b = a)`, which does not ask whether values are missing"
        ),
    ))
}
