//! Arithmetic that fails where a whole number has no room, instead of wrapping.
//!
//! Whole numbers have 64 bits and decimals are `f64`. `/` gives a decimal, of whole numbers too: `1 / 2` is 0.5.
//! There is one zero: arithmetic never gives `-0.0`, which would be another group and another key than `0.0`.

use std::sync::{Arc, LazyLock};

use datafusion::{
    arrow::{
        array::{Array, ArrayRef, AsArray, Datum},
        compute::{kernels::numeric, unary},
        datatypes::{DataType, Float64Type},
        error::ArrowError,
    },
    common::{Result, plan_err, utils::take_function_args},
    logical_expr::{
        ColumnarValue, Expr, Operator, ScalarFunctionArgs, ScalarUDF, ScalarUDFImpl, Signature,
        Volatility,
    },
    physical_expr_common::datum,
    scalar::ScalarValue,
};

/// Returns `left operator right` as it is computed here; `None` for what is no arithmetic.
pub(super) fn computed(left: Expr, operator: Operator, right: Expr) -> Option<Expr> {
    let function = FUNCTIONS.iter().find(|(known, _)| *known == operator)?;
    Some(function.1.call(vec![left, right]))
}

/// Returns a number with the sign changed.
pub(super) fn negated(number: Expr) -> Option<Expr> {
    let zero = Expr::Literal(ScalarValue::Int64(Some(0)), None);
    computed(zero, Operator::Minus, number)
}

/// Returns a decimal with one zero.
pub(super) fn one_zero(decimal: Expr) -> Option<Expr> {
    let zero = Expr::Literal(ScalarValue::Float64(Some(0.0)), None);
    computed(decimal, Operator::Plus, zero)
}

/// Returns a decimal with one zero and one NaN: those with a sign have another place in an order.
pub(super) fn plain(decimal: f64) -> f64 {
    if decimal.is_nan() {
        f64::NAN
    } else {
        // `-0.0 + 0.0` is `0.0`.
        decimal + 0.0
    }
}

static FUNCTIONS: LazyLock<[(Operator, Arc<ScalarUDF>); 5]> = LazyLock::new(|| {
    [
        (Operator::Plus, "plus", numeric::add as Kernel),
        (Operator::Minus, "minus", numeric::sub),
        (Operator::Multiply, "times", numeric::mul),
        (Operator::Divide, "divided_by", numeric::div),
        (Operator::Modulo, "modulo", numeric::rem),
    ]
    .map(|(operator, name, kernel)| {
        let arithmetic = Arithmetic {
            operator,
            name,
            kernel: Checked(kernel),
            signature: Signature::user_defined(Volatility::Immutable),
        };
        (operator, Arc::new(ScalarUDF::new_from_impl(arithmetic)))
    })
});

type Kernel = fn(&dyn Datum, &dyn Datum) -> std::result::Result<ArrayRef, ArrowError>;

/// A kernel, which is told from others by its operator.
#[derive(Debug, Clone, Copy)]
struct Checked(Kernel);

#[derive(Debug)]
struct Arithmetic {
    operator: Operator,
    name: &'static str,
    kernel: Checked,
    signature: Signature,
}

impl PartialEq for Arithmetic {
    fn eq(&self, other: &Self) -> bool {
        self.operator == other.operator
    }
}

impl Eq for Arithmetic {}

impl std::hash::Hash for Arithmetic {
    fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
        self.operator.hash(state);
    }
}

impl ScalarUDFImpl for Arithmetic {
    fn name(&self) -> &str {
        self.name
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn coerce_types(&self, kinds: &[DataType]) -> Result<Vec<DataType>> {
        let is_whole = |kind: &DataType| kind.is_integer() || kind.is_null();
        if let Some(other) = kinds
            .iter()
            .find(|kind| !kind.is_numeric() && !kind.is_null())
        {
            return plan_err!("`{}` needs numbers, not {other}", self.operator);
        }
        let kind = if self.operator != Operator::Divide && kinds.iter().all(is_whole) {
            DataType::Int64
        } else {
            DataType::Float64
        };
        Ok(vec![kind; 2])
    }

    fn return_type(&self, kinds: &[DataType]) -> Result<DataType> {
        let kinds = self.coerce_types(kinds)?;
        Ok(kinds.into_iter().next().unwrap_or(DataType::Null))
    }

    fn invoke_with_args(&self, args: ScalarFunctionArgs) -> Result<ColumnarValue> {
        let [left, right] = take_function_args(self.name, args.args)?;
        datum::apply(&left, &right, |left, right| {
            let result = (self.kernel.0)(left, right)?;
            Ok(match result.data_type() {
                DataType::Float64 => {
                    let decimals = result.as_primitive::<Float64Type>();
                    Arc::new(unary::<_, _, Float64Type>(decimals, plain))
                }
                _ => result,
            })
        })
    }
}
