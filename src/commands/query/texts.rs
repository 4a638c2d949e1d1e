//! Conversions between numbers, times and text.

use std::sync::{Arc, LazyLock};

use datafusion::{
    arrow::{
        array::{ArrayRef, AsArray, StringArray},
        datatypes::{DataType, Float64Type},
    },
    common::{
        Result,
        config::ConfigOptions,
        tree_node::{Transformed, TreeNode},
    },
    logical_expr::{
        Cast, ColumnarValue, Expr, ExprSchemable, LogicalPlan, ScalarUDF, Volatility, create_udf,
        expr_rewriter::NamePreserver, utils::merge_schema,
    },
    optimizer::AnalyzerRule,
};

use super::meaning::refused;

/// Refuses conversions whose result nobody would expect.
pub(super) fn check_cast(from: &DataType, to: &DataType) -> Result<()> {
    let is_clock = |kind: &DataType| kind.is_temporal();
    if is_clock(from) && to.is_numeric() {
        return Err(refused(
            "a time is no number",
            "write `extract(epoch from …)` for its seconds since 1970",
        ));
    }
    if from.is_numeric() && is_clock(to) {
        return Err(refused(
            "a number is no time",
            "write `to_timestamp(…)` of the seconds since 1970",
        ));
    }
    Ok(())
}

/// Returns decimals that are whole numbers as they are; others fail.
pub(super) fn whole(decimals: Expr) -> Expr {
    static WHOLE: LazyLock<Arc<ScalarUDF>> = LazyLock::new(|| {
        Arc::new(of_decimals("whole", DataType::Float64, |array| {
            let values = array.as_primitive::<Float64Type>();
            match values.iter().flatten().find(|value| value.fract() != 0.0) {
                Some(value) => Err(refused(
                    format!(
                        "`{value}` is not a whole number, and `cast` does not say how it rounds"
                    ),
                    "write `cast(round(…) as bigint)`, or `floor`, `ceil` or `trunc` for `round`",
                )),
                None => Ok(array.clone()),
            }
        }))
    });
    WHOLE.call(vec![converted(decimals, DataType::Float64)])
}

fn converted(expr: Expr, kind: DataType) -> Expr {
    Expr::Cast(Cast::new(Box::new(expr), kind))
}

/// A function of decimals.
fn of_decimals(
    name: &str,
    gives: DataType,
    function: impl Fn(&ArrayRef) -> Result<ArrayRef> + Send + Sync + 'static,
) -> ScalarUDF {
    create_udf(
        name,
        vec![DataType::Float64],
        gives,
        Volatility::Immutable,
        Arc::new(move |arguments: &[ColumnarValue]| {
            let is_one = !arguments
                .iter()
                .any(|value| matches!(value, ColumnarValue::Array(_)));
            let arrays = ColumnarValue::values_to_arrays(arguments)?;
            let result = match arrays.first() {
                Some(array) => function(array)?,
                None => return Ok(arguments[0].clone()),
            };
            if is_one {
                let value = datafusion::scalar::ScalarValue::try_from_array(&result, 0)?;
                return Ok(ColumnarValue::Scalar(value));
            }
            Ok(ColumnarValue::Array(result))
        }),
    )
}

/// Writes decimals as text: after every conversion is known.
#[derive(Debug)]
pub(super) struct Texts;

impl AnalyzerRule for Texts {
    fn name(&self) -> &'static str {
        "texts"
    }

    fn analyze(&self, plan: LogicalPlan, _config: &ConfigOptions) -> Result<LogicalPlan> {
        let plan = plan.transform_up_with_subqueries(|plan| {
            let mut schema = merge_schema(&plan.inputs());
            if plan.inputs().is_empty() {
                schema.merge(plan.schema());
            }
            let names = NamePreserver::new(&plan);
            plan.map_expressions(|expr| {
                let name = names.save(&expr);
                let written = expr.transform_up(|expr| match expr {
                    Expr::Cast(Cast { expr, field }) if field.data_type().is_string() => {
                        let from = expr.get_type(&schema)?;
                        let to = field.data_type().clone();
                        if matches!(from, DataType::Timestamp(..)) {
                            return Err(refused(
                                "a time has no one form as text",
                                "write its form, e.g. `strftime(…, '%Y-%m-%d %H:%M:%S')`",
                            ));
                        }
                        if from.is_floating() {
                            let text = TEXT.call(vec![converted(*expr, DataType::Float64)]);
                            return Ok(Transformed::yes(converted(text, to)));
                        }
                        Ok(Transformed::no(Expr::Cast(Cast { expr, field })))
                    }
                    other => Ok(Transformed::no(other)),
                })?;
                Ok(written.update_data(|expr| name.restore(expr)))
            })
        })?;
        Ok(plan.data)
    }
}

static TEXT: LazyLock<Arc<ScalarUDF>> = LazyLock::new(|| {
    Arc::new(of_decimals("text", DataType::Utf8, |array| {
        let values = array.as_primitive::<Float64Type>();
        let texts: StringArray = values.iter().map(|value| value.map(text)).collect();
        Ok(Arc::new(texts))
    }))
});

/// A decimal with all its digits, as Python and `DuckDB` write it: `0.5`, `1.0`, `1e-07`, `1e+20`.
fn text(value: f64) -> String {
    if !value.is_finite() || value == 0.0 {
        return format!("{value:?}").to_lowercase();
    }
    let short = format!("{value:e}");
    let (digits, exponent) = short.split_once('e').unwrap_or((&short, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..16).contains(&exponent) {
        let plain = format!("{value}");
        return if plain.contains('.') {
            plain
        } else {
            plain + ".0"
        };
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{digits}e{sign}{:02}", exponent.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimals_have_all_their_digits_as_text() {
        for (value, says) in [
            (0.1, "0.1"),
            (-2.0, "-2.0"),
            (0.0, "0.0"),
            (1e15, "1000000000000000.0"),
            (1e16, "1e+16"),
            (1.5e-5, "1.5e-05"),
            (1e-4, "0.0001"),
            (f64::INFINITY, "inf"),
            (f64::NAN, "nan"),
        ] {
            assert_eq!(text(value), says);
        }
    }
}
