//! What a question means, where SQL engines differ: types decide, before any of them is converted.

use std::{error::Error, fmt, sync::Arc};

use datafusion::{
    arrow::datatypes::{DataType, TimeUnit},
    common::{
        DFSchema, DataFusionError, Result,
        config::ConfigOptions,
        tree_node::{Transformed, TreeNode},
    },
    logical_expr::{
        Between, BinaryExpr, Cast, Expr, ExprSchemable, LogicalPlan, LogicalPlanBuilder, Operator,
        Projection, Union, WindowFrame, WindowFunctionDefinition,
        expr::{InList, ScalarFunction},
        expr_rewriter::NamePreserver,
        lit,
        utils::merge_schema,
    },
    optimizer::AnalyzerRule,
    prelude::Column,
    scalar::ScalarValue,
};

use super::{arithmetic, membership, texts};

/// A question that is refused for what it means.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) message: String,
    pub(super) hint: String,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Error for Refusal {}

/// Returns a refusal as an error of the engine.
pub(super) fn refused(message: impl Into<String>, hint: impl Into<String>) -> DataFusionError {
    DataFusionError::External(Box::new(Refusal {
        message: message.into(),
        hint: hint.into(),
    }))
}

/// Gives every expression of a question its meaning.
#[derive(Debug)]
pub(super) struct Meaning;

impl AnalyzerRule for Meaning {
    fn name(&self) -> &'static str {
        "meaning"
    }

    fn analyze(&self, plan: LogicalPlan, _config: &ConfigOptions) -> Result<LogicalPlan> {
        Ok(plan.transform_up_with_subqueries(rewrite_step)?.data)
    }
}

/// Rewrites the expressions of one step, whose inputs are rewritten already.
fn rewrite_step(plan: LogicalPlan) -> Result<Transformed<LogicalPlan>> {
    let inputs = plan.inputs();
    let mut schema = merge_schema(&inputs);
    if inputs.is_empty() {
        schema.merge(plan.schema());
    }
    if let LogicalPlan::Join(join) = &plan {
        for (left, right) in &join.on {
            comparable(left.clone(), right.clone(), &schema)?;
        }
    }
    membership::check(&plan)?;
    let before = plan.schema().clone();
    let names = NamePreserver::new(&plan);
    let plan = plan.map_expressions(|expr| {
        let name = names.save(&expr);
        let rewritten = expr.transform_up(|expr| rewrite_expression(expr, &schema))?;
        Ok(rewritten.update_data(|expr| name.restore(expr)))
    })?;
    let plan = match plan.data {
        // Their types are those of the first row's expressions before they were rewritten.
        LogicalPlan::Values(rows) => LogicalPlanBuilder::values(rows.values)?.build()?,
        // Its types are those of its inputs before they were rewritten.
        LogicalPlan::Union(union) => {
            LogicalPlan::Union(Union::try_new_with_loose_types(union.inputs)?)
        }
        plan => plan.recompute_schema()?,
    };
    // Conditions without a column are not taken below totals, which have a row where there is none below.
    let is_one_row =
        matches!(&plan, LogicalPlan::Aggregate(totals) if totals.group_expr.is_empty());
    let plan = normalize_outputs(plan, &before)?;
    if !is_one_row || !plan.all_out_ref_exprs().is_empty() {
        return Ok(Transformed::yes(plan));
    }
    let fenced = LogicalPlanBuilder::from(plan).limit(0, Some(1))?.build()?;
    Ok(Transformed::yes(fenced))
}

/// Casts the outputs of aggregates and windows: sums, which are added without a limit, and ranks to whole numbers
/// of 64 bits (it fails where one does not fit), decimals to one zero and one NaN.
fn normalize_outputs(plan: LogicalPlan, before: &DFSchema) -> Result<LogicalPlan> {
    let n_given = match &plan {
        LogicalPlan::Aggregate(totals) => totals.group_expr_len()?,
        LogicalPlan::Window(window) => window.input.schema().fields().len(),
        _ => return Ok(plan),
    };
    let mut is_settled = true;
    let mut columns = Vec::new();
    for (idx, ((table, old), (_, new))) in before.iter().zip(plan.schema().iter()).enumerate() {
        let column = Expr::Column(Column::new(table.cloned(), new.name()));
        let is_rank = *new.data_type() == DataType::UInt64;
        let is_sum = old.data_type().is_integer() && *new.data_type() == SUM;
        let settled = if idx < n_given {
            None
        } else if is_rank || is_sum {
            Some(Expr::Cast(Cast::new(
                Box::new(column.clone()),
                DataType::Int64,
            )))
        } else if *new.data_type() == DataType::Float64 {
            arithmetic::one_zero(column.clone())
        } else {
            None
        };
        is_settled &= settled.is_none();
        columns.push(match settled {
            Some(settled) => settled.alias_qualified(table.cloned(), old.name()),
            None => column,
        });
    }
    if is_settled {
        return Ok(plan);
    }
    Projection::try_new(columns, plan.into()).map(LogicalPlan::Projection)
}

/// In which sums of whole numbers are added.
const SUM: DataType = DataType::Decimal128(38, 0);

fn rewrite_expression(expr: Expr, schema: &DFSchema) -> Result<Transformed<Expr>> {
    let rewritten = match expr {
        Expr::BinaryExpr(BinaryExpr { left, op, right }) => {
            rewrite_operator(*left, op, *right, schema)?
        }
        Expr::Negative(inner) if inner.get_type(schema)?.is_numeric() => {
            let negated = arithmetic::negated((*inner).clone());
            negated.unwrap_or(Expr::Negative(inner))
        }
        Expr::Literal(ScalarValue::Float64(Some(value)), note) => {
            Expr::Literal(ScalarValue::Float64(Some(value + 0.0)), note)
        }
        Expr::Between(_) | Expr::InList(_) | Expr::InSubquery(_) | Expr::Case(_) => {
            rewrite_comparison(expr, schema)?
        }
        Expr::Cast(_) | Expr::TryCast(_) => rewrite_cast(expr, schema)?,
        Expr::AggregateFunction(mut aggregate) => {
            rewrite_aggregate_arguments(aggregate.func.name(), &mut aggregate.params.args, schema)?;
            Expr::AggregateFunction(aggregate)
        }
        Expr::WindowFunction(mut window) => {
            if let WindowFunctionDefinition::AggregateUDF(function) = &window.fun {
                check_frame(function.name(), &window.params.window_frame)?;
                rewrite_aggregate_arguments(function.name(), &mut window.params.args, schema)?;
            }
            Expr::WindowFunction(window)
        }
        Expr::ScalarFunction(function) => rewrite_function(function, schema)?,
        other => return Ok(Transformed::no(other)),
    };
    Ok(Transformed::yes(rewritten))
}

/// Refuses moments of a moving window, from which the engine subtracts what leaves it: digits are lost, and
/// infinity stays.
fn check_frame(name: &str, frame: &WindowFrame) -> Result<()> {
    let is_moment = ["std", "var", "cov", "corr", "regr"]
        .iter()
        .any(|start| name.starts_with(start));
    if !is_moment || frame.start_bound.is_unbounded() {
        return Ok(());
    }
    Err(refused(
        format!("`{name}` over a moving window loses digits"),
        "join the table with itself on the rows of each window, and group by the row",
    ))
}

/// What is compared is of one kind.
fn rewrite_comparison(expr: Expr, schema: &DFSchema) -> Result<Expr> {
    Ok(match expr {
        Expr::Between(Between {
            expr,
            negated,
            low,
            high,
        }) => {
            let (_, low) = comparable((*expr).clone(), *low, schema)?;
            let (_, high) = comparable((*expr).clone(), *high, schema)?;
            Expr::Between(Between::new(expr, negated, low.into(), high.into()))
        }
        Expr::InList(InList {
            expr,
            list,
            negated,
        }) => {
            let list = list.into_iter().map(|item| {
                let (_, item) = comparable((*expr).clone(), item, schema)?;
                Ok(item)
            });
            let list = list.collect::<Result<_>>()?;
            Expr::InList(InList::new(expr, list, negated))
        }
        Expr::InSubquery(mut inside) => {
            let field = inside.subquery.subquery.schema().field(0).clone();
            let other = typed(field.data_type());
            let (expr, _) = comparable(*inside.expr, other, schema)?;
            inside.expr = expr.into();
            Expr::InSubquery(inside)
        }
        Expr::Case(mut case) => {
            if let Some(of) = &case.expr {
                for (when, _) in &mut case.when_then_expr {
                    let (_, same) = comparable((**of).clone(), (**when).clone(), schema)?;
                    *when = same.into();
                }
            }
            Expr::Case(case)
        }
        other => other,
    })
}

/// Decimals become whole numbers only where they are.
fn rewrite_cast(expr: Expr, schema: &DFSchema) -> Result<Expr> {
    let (inner, to) = match &expr {
        Expr::Cast(cast) => (&cast.expr, cast.field.data_type()),
        Expr::TryCast(cast) => (&cast.expr, cast.field.data_type()),
        _ => return Ok(expr),
    };
    let from = inner.get_type(schema)?;
    texts::check_cast(&from, to)?;
    if !(from.is_floating() && to.is_integer()) {
        return Ok(expr);
    }
    if matches!(expr, Expr::TryCast(_)) {
        return Err(refused(
            "`try_cast` of decimals to whole numbers does not say how it rounds",
            "write `cast(round(…) as bigint)`",
        ));
    }
    let whole = texts::whole((**inner).clone());
    Ok(Expr::Cast(Cast::new(Box::new(whole), to.clone())))
}

/// Decimals that functions give have one zero.
fn rewrite_function(mut function: ScalarFunction, schema: &DFSchema) -> Result<Expr> {
    let called = Arc::clone(&function.func);
    let name = called.name();
    match name {
        "power" => {
            for argument in &mut function.args {
                convert(argument, &DataType::Float64);
            }
        }
        "nullif" => {
            if let [one, other] = function.args.as_slice() {
                let (one, other) = comparable(one.clone(), other.clone(), schema)?;
                function.args = vec![one, other];
            }
        }
        _ => {}
    }
    // They give an argument as it is.
    let is_choice = ["coalesce", "nvl", "nullif", "greatest", "least"].contains(&name);
    let expr = Expr::ScalarFunction(function);
    let is_decimal = expr.get_type(schema).is_ok_and(|kind| kind.is_floating());
    if is_choice || !is_decimal {
        return Ok(expr);
    }
    Ok(arithmetic::one_zero(expr.clone()).unwrap_or(expr))
}

/// Arithmetic is checked, and what is compared is of one kind.
fn rewrite_operator(left: Expr, op: Operator, right: Expr, schema: &DFSchema) -> Result<Expr> {
    let (one, other) = (left.get_type(schema)?, right.get_type(schema)?);
    let is_number = |kind: &DataType| kind.is_numeric() || kind.is_null();
    if is_number(&one)
        && is_number(&other)
        && let Some(computed) = arithmetic::computed(left.clone(), op, right.clone())
    {
        return Ok(computed);
    }
    let is_span = |kind: &DataType| matches!(kind, DataType::Interval(_) | DataType::Duration(_));
    let is_date = |kind: &DataType| matches!(kind, DataType::Date32 | DataType::Date64);
    let time = DataType::Timestamp(TimeUnit::Microsecond, None);
    let cast = |expr: Expr| Expr::Cast(Cast::new(Box::new(expr), time.clone()));
    let (left, right) = if is_comparison(op) {
        comparable(left, right, schema)?
    } else if is_date(&one) && is_span(&other) {
        // A day and two hours are a time.
        (cast(left), right)
    } else if is_span(&one) && is_date(&other) {
        (left, cast(right))
    } else {
        (left, right)
    };
    Ok(Expr::BinaryExpr(BinaryExpr::new(
        left.into(),
        op,
        right.into(),
    )))
}

fn is_comparison(op: Operator) -> bool {
    matches!(
        op,
        Operator::Eq
            | Operator::NotEq
            | Operator::Lt
            | Operator::LtEq
            | Operator::Gt
            | Operator::GtEq
            | Operator::IsDistinctFrom
            | Operator::IsNotDistinctFrom
    )
}

/// Sums of whole numbers and of yes and no have room, and what lies between whole numbers is a decimal.
fn rewrite_aggregate_arguments(
    name: &str,
    arguments: &mut [Expr],
    schema: &DFSchema,
) -> Result<()> {
    let Some(argument) = arguments.first_mut() else {
        return Ok(());
    };
    let kind = argument.get_type(schema)?;
    match name {
        "sum" | "avg" if kind.is_integer() || kind == DataType::Boolean => {
            if kind == DataType::Boolean {
                convert(argument, &DataType::Int64);
            }
            if name == "sum" {
                convert(argument, &SUM);
            }
        }
        "median" | "percentile_cont" if kind.is_integer() => {
            convert(argument, &DataType::Float64);
        }
        _ => {}
    }
    Ok(())
}

fn convert(expr: &mut Expr, kind: &DataType) {
    let inner = std::mem::take(expr);
    *expr = Expr::Cast(Cast::new(Box::new(inner), kind.clone()));
}

/// An expression of a type, for its kind alone.
fn typed(kind: &DataType) -> Expr {
    Expr::Cast(Cast::new(Box::new(lit(ScalarValue::Null)), kind.clone()))
}

/// Kinds of values; values of two kinds are not compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Number,
    Text,
    Boolean,
    Time,
    Other,
}

impl Kind {
    fn of(kind: &DataType) -> Self {
        match kind {
            DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View => Self::Text,
            DataType::Boolean => Self::Boolean,
            kind if kind.is_numeric() => Self::Number,
            kind if kind.is_temporal() => Self::Time,
            _ => Self::Other,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Number => "a number",
            Self::Text => "text",
            Self::Boolean => "true or false",
            Self::Time => "a time",
            Self::Other => "a list",
        }
    }
}

/// Returns two expressions that can be compared.
///
/// Text in quotes is read as the number that it is compared with; other text is not compared with numbers.
fn comparable(left: Expr, right: Expr, schema: &DFSchema) -> Result<(Expr, Expr)> {
    let (one, other) = (left.get_type(schema)?, right.get_type(schema)?);
    if one == DataType::Float32 && matches!(right, Expr::Literal(ScalarValue::Float64(_), _)) {
        let right = Expr::Cast(Cast::new(Box::new(right), one));
        return Ok((left, right));
    }
    if other == DataType::Float32 && matches!(left, Expr::Literal(ScalarValue::Float64(_), _)) {
        let (right, left) = comparable(right, left, schema)?;
        return Ok((left, right));
    }
    let kinds = (Kind::of(&one), Kind::of(&other));
    if kinds.0 == kinds.1 || one.is_null() || other.is_null() {
        return Ok((left, right));
    }
    match kinds {
        (Kind::Number, Kind::Text) if let Some(number) = number_in(&right) => Ok((left, number)),
        (Kind::Text, Kind::Number) if let Some(number) = number_in(&left) => Ok((number, right)),
        (Kind::Time, Kind::Text) | (Kind::Text, Kind::Time) => Ok((left, right)),
        (one, other) => Err(refused(
            format!(
                "{} is {} and {} is {}: they cannot be compared",
                shown(&left, "one side"),
                one.word(),
                shown(&right, "the other side"),
                other.word()
            ),
            "convert one of them, e.g. with `cast(… as double)` or `cast(… as varchar)`",
        )),
    }
}

/// Returns the number that is written in quotes.
fn number_in(expr: &Expr) -> Option<Expr> {
    let Expr::Literal(value, _) = expr else {
        return None;
    };
    let text = value.try_as_str()??.trim().to_owned();
    let whole = text.parse::<i64>().ok().map(lit);
    whole.or_else(|| text.parse::<f64>().ok().map(lit))
}

/// An expression in a message.
fn shown(expr: &Expr, otherwise: &str) -> String {
    match expr {
        Expr::Column(column) => format!("`{}`", column.name),
        Expr::Literal(value, _) => match value.try_as_str() {
            Some(Some(text)) => format!("`'{text}'`"),
            _ => format!("`{value}`"),
        },
        _ => otherwise.to_owned(),
    }
}
