//! Lists of one column in one condition: the engine merges them as if no value were missing.
//!
//! `a not in (1, 2) or a not in (3)` becomes true, also where `a` is missing or a list has a null
//! (`ExprSimplifier` of `datafusion` 55, its rules of `IN` lists). Conditions that have two are simplified in
//! their parts.

use std::sync::Arc;

use datafusion::{
    common::{
        DFSchema, Result,
        tree_node::{Transformed, TreeNode, TreeNodeRecursion},
    },
    logical_expr::{
        BinaryExpr, Expr, LogicalPlan, Operator, expr_rewriter::NamePreserver,
        simplify::SimplifyContext, utils::merge_schema,
    },
    optimizer::{
        ApplyOrder, OptimizerConfig, OptimizerRule,
        simplify_expressions::{ExprSimplifier, SimplifyExpressions},
    },
};

/// Simplifies the expressions of a step, but for conditions that have two lists of one value.
#[derive(Debug, Default)]
pub(super) struct Simplify {
    whole: SimplifyExpressions,
}

impl OptimizerRule for Simplify {
    fn name(&self) -> &str {
        self.whole.name()
    }

    fn apply_order(&self) -> Option<ApplyOrder> {
        self.whole.apply_order()
    }

    fn supports_rewrite(&self) -> bool {
        true
    }

    fn rewrite(
        &self,
        plan: LogicalPlan,
        config: &dyn OptimizerConfig,
    ) -> Result<Transformed<LogicalPlan>> {
        let mut has_two = false;
        plan.apply_expressions(|expr| {
            has_two |= has_two_lists(expr)?;
            Ok(TreeNodeRecursion::Continue)
        })?;
        if has_two {
            in_parts(plan, config)
        } else {
            self.whole.rewrite(plan, config)
        }
    }
}

/// Simplifies the largest parts of each expression in which no two lists can meet.
fn in_parts(plan: LogicalPlan, config: &dyn OptimizerConfig) -> Result<Transformed<LogicalPlan>> {
    let schema = match &plan {
        LogicalPlan::TableScan(scan) => {
            DFSchema::try_from_qualified_schema(scan.table_name.clone(), &scan.source.schema())?
        }
        plan => merge_schema(&plan.inputs()),
    };
    let context = SimplifyContext::builder()
        .with_schema(Arc::new(schema))
        .with_config_options(config.options())
        .with_query_execution_start_time(config.query_execution_start_time())
        .build();
    // The sides of a join's conditions stay where they are.
    let is_join = matches!(plan, LogicalPlan::Join(_));
    let simplifier = ExprSimplifier::new(context).with_canonicalize(!is_join);
    let names = NamePreserver::new(&plan);
    plan.map_expressions(|expr| {
        let name = names.save(&expr);
        let reduced = expr.transform_down(|part| {
            let is_outermost = matches!(
                part,
                Expr::Alias(_) | Expr::AggregateFunction(_) | Expr::GroupingSet(_)
            );
            if is_outermost || has_two_lists(&part)? {
                return Ok(Transformed::no(part));
            }
            let (part, _) = simplifier.simplify_with_cycle_count_transformed(part)?;
            Ok(Transformed::new(
                part.data,
                part.transformed,
                TreeNodeRecursion::Jump,
            ))
        })?;
        Ok(reduced.update_data(|expr| name.restore(expr)))
    })
}

/// Whether two lists in an expression, or comparisons that make one, are of the same value.
fn has_two_lists(expr: &Expr) -> Result<bool> {
    let mut values: Vec<&Expr> = Vec::new();
    let mut has_two = false;
    expr.apply(|part| {
        if let Some(value) = listed(part) {
            has_two |= values.contains(&value);
            values.push(value);
        }
        Ok(TreeNodeRecursion::Continue)
    })?;
    Ok(has_two)
}

/// The value that is compared with a list, or with what is a constant once it is computed.
fn listed(expr: &Expr) -> Option<&Expr> {
    match expr {
        Expr::InList(list) => Some(&list.expr),
        Expr::BinaryExpr(BinaryExpr {
            left,
            op: Operator::Eq | Operator::NotEq,
            right,
        }) => match (left.any_column_refs(), right.any_column_refs()) {
            (true, false) => Some(left),
            (false, true) => Some(right),
            _ => None,
        },
        // They become lists, or comparisons with constants.
        Expr::ScalarFunction(function) => match (function.name(), function.args.as_slice()) {
            ("regexp_like", [value, ..]) | ("array_has", [_, value]) => Some(value),
            _ => None,
        },
        _ => None,
    }
}
