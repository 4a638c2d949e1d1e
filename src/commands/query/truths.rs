//! Sums and means of true and false: how many are true, and which share.

use std::hash::{Hash, Hasher};

use datafusion::{
    arrow::datatypes::{DataType, FieldRef},
    common::Result,
    logical_expr::{
        Accumulator, AggregateUDF, AggregateUDFImpl, GroupsAccumulator, ReversedUDAF, Signature,
        Volatility,
        function::{AccumulatorArgs, StateFieldsArgs},
    },
};

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
        self.numbers.create_sliding_accumulator(args)
    }

    fn reverse_expr(&self) -> ReversedUDAF {
        ReversedUDAF::Identical
    }
}
