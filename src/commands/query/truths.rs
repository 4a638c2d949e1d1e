//! Sums and means of true and false, and of decimals in moving windows.

use std::{
    collections::VecDeque,
    hash::{Hash, Hasher},
};

use datafusion::{
    arrow::{
        array::{Array, ArrayRef},
        datatypes::{DataType, FieldRef},
    },
    common::{Result, cast::as_float64_array, internal_err, utils::take_function_args},
    logical_expr::{
        Accumulator, AggregateUDF, AggregateUDFImpl, GroupsAccumulator, ReversedUDAF, Signature,
        Volatility,
        function::{AccumulatorArgs, StateFieldsArgs},
    },
    scalar::ScalarValue,
};

/// Sum or mean of the decimals in a moving window, added anew for each row: subtracting a value from a sum loses
/// digits, and never removes infinity.
#[derive(Debug)]
struct WindowSum {
    values: VecDeque<f64>,
    is_mean: bool,
}

impl Accumulator for WindowSum {
    fn update_batch(&mut self, values: &[ArrayRef]) -> Result<()> {
        let [values] = take_function_args("sum", values)?;
        self.values
            .extend(as_float64_array(values)?.iter().flatten());
        Ok(())
    }

    fn retract_batch(&mut self, values: &[ArrayRef]) -> Result<()> {
        let [values] = take_function_args("sum", values)?;
        let n = values.len() - values.null_count();
        self.values.drain(..n.min(self.values.len()));
        Ok(())
    }

    fn supports_retract_batch(&self) -> bool {
        true
    }

    fn evaluate(&mut self) -> Result<ScalarValue> {
        let sum = (!self.values.is_empty()).then(|| self.values.iter().sum::<f64>());
        let n = if self.is_mean {
            self.values.len() as f64
        } else {
            1.0
        };
        Ok(ScalarValue::Float64(sum.map(|sum| sum / n)))
    }

    fn size(&self) -> usize {
        size_of_val(self) + self.values.capacity() * size_of::<f64>()
    }

    fn state(&mut self) -> Result<Vec<ScalarValue>> {
        internal_err!("a window is not split")
    }

    fn merge_batch(&mut self, _states: &[ArrayRef]) -> Result<()> {
        internal_err!("a window is not split")
    }
}

/// A function of numbers that takes true for one and false for zero.
#[derive(Debug)]
pub(super) struct OfTruths {
    numbers: AggregateUDF,
    signature: Signature,
}

impl OfTruths {
    pub(super) fn new(numbers: AggregateUDF) -> Self {
        Self {
            numbers,
            signature: Signature::user_defined(Volatility::Immutable),
        }
    }
}

impl PartialEq for OfTruths {
    fn eq(&self, other: &Self) -> bool {
        self.numbers == other.numbers
    }
}

impl Eq for OfTruths {}

impl Hash for OfTruths {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.numbers.hash(state);
    }
}

impl AggregateUDFImpl for OfTruths {
    fn name(&self) -> &str {
        self.numbers.name()
    }

    fn aliases(&self) -> &[String] {
        self.numbers.aliases()
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn coerce_types(&self, kinds: &[DataType]) -> Result<Vec<DataType>> {
        let [kind] = kinds else {
            return datafusion::common::plan_err!("Function '{}' takes one argument", self.name());
        };
        let is_mean = self.name() == "avg";
        match kind {
            kind if kind.is_decimal() => Ok(vec![kind.clone()]),
            kind if kind.is_floating() => Ok(vec![DataType::Float64]),
            kind if kind.is_integer() || kind.is_null() || *kind == DataType::Boolean => {
                let whole = if is_mean {
                    DataType::Float64
                } else {
                    DataType::Int64
                };
                Ok(vec![whole])
            }
            _ => datafusion::common::plan_err!("Function '{}' is about numbers", self.name()),
        }
    }

    fn return_type(&self, kinds: &[DataType]) -> Result<DataType> {
        self.numbers.return_type(kinds)
    }

    fn accumulator(&self, args: AccumulatorArgs) -> Result<Box<dyn Accumulator>> {
        self.numbers.accumulator(args)
    }

    fn state_fields(&self, args: StateFieldsArgs) -> Result<Vec<FieldRef>> {
        self.numbers.state_fields(args)
    }

    fn groups_accumulator_supported(&self, args: AccumulatorArgs) -> bool {
        self.numbers.groups_accumulator_supported(args)
    }

    fn create_groups_accumulator(
        &self,
        args: AccumulatorArgs,
    ) -> Result<Box<dyn GroupsAccumulator>> {
        self.numbers.create_groups_accumulator(args)
    }

    fn create_sliding_accumulator(&self, args: AccumulatorArgs) -> Result<Box<dyn Accumulator>> {
        let is_decimal = args.expr_fields.first().is_some_and(|field| {
            let kind = field.data_type();
            *kind == DataType::Float64 && !args.is_distinct
        });
        if !is_decimal {
            return self.numbers.create_sliding_accumulator(args);
        }
        Ok(Box::new(WindowSum {
            values: VecDeque::new(),
            is_mean: self.name() == "avg",
        }))
    }

    fn reverse_expr(&self) -> ReversedUDAF {
        ReversedUDAF::Identical
    }
}
