//! Quantiles between values, to the last digit: the engine's own are rounded to a millionth of the distance.

use std::mem::size_of_val;

use datafusion::{
    arrow::{
        array::{ArrayRef, AsArray},
        datatypes::{DataType, Field, FieldRef, Float64Type},
    },
    common::{Result, internal_err},
    logical_expr::{
        Accumulator, AggregateUDFImpl, Signature, Volatility,
        function::{AccumulatorArgs, StateFieldsArgs},
        utils::format_state_name,
    },
    scalar::ScalarValue,
};

use super::meaning::refused;

/// `quantile_cont(values, share)`.
#[derive(Debug, PartialEq, Eq, Hash)]
pub(super) struct Quantile {
    signature: Signature,
}

impl Quantile {
    pub(super) fn new() -> Self {
        Self {
            signature: Signature::uniform(2, vec![DataType::Float64], Volatility::Immutable),
        }
    }
}

impl AggregateUDFImpl for Quantile {
    fn name(&self) -> &'static str {
        "quantile_cont"
    }

    fn signature(&self) -> &Signature {
        &self.signature
    }

    fn return_type(&self, _kinds: &[DataType]) -> Result<DataType> {
        Ok(DataType::Float64)
    }

    fn state_fields(&self, args: StateFieldsArgs) -> Result<Vec<FieldRef>> {
        let name = |part| format_state_name(args.name, part);
        let values = DataType::new_list(DataType::Float64, true);
        Ok(vec![
            Field::new(name("values"), values, true).into(),
            Field::new(name("share"), DataType::Float64, true).into(),
        ])
    }

    fn accumulator(&self, args: AccumulatorArgs) -> Result<Box<dyn Accumulator>> {
        if args.is_distinct {
            return Err(refused(
                "`quantile_cont(distinct …)` is not known here",
                "name the values in `with part as (select distinct …)`, and ask `part`",
            ));
        }
        Ok(Box::new(Values {
            values: Vec::new(),
            share: None,
        }))
    }
}

/// The values so far.
#[derive(Debug)]
struct Values {
    values: Vec<f64>,
    share: Option<f64>,
}

impl Values {
    fn add(&mut self, values: &ArrayRef) {
        let values = values.as_primitive::<Float64Type>();
        self.values.extend(values.iter().flatten());
    }
}

impl Accumulator for Values {
    fn update_batch(&mut self, arguments: &[ArrayRef]) -> Result<()> {
        let [values, shares] = arguments else {
            return internal_err!("two arguments");
        };
        for share in shares.as_primitive::<Float64Type>().iter().flatten() {
            let is_other = self
                .share
                .is_some_and(|known| known.total_cmp(&share).is_ne());
            if !(0.0..=1.0).contains(&share) || is_other {
                return Err(refused(
                    "the share of a quantile is one number from 0 to 1",
                    "write it as, e.g., `quantile_cont(lift_m, 0.9)`",
                ));
            }
            self.share = Some(share);
        }
        self.add(values);
        Ok(())
    }

    fn evaluate(&mut self) -> Result<ScalarValue> {
        self.values.sort_by(f64::total_cmp);
        let value = self.share.and_then(|share| between(&self.values, share));
        Ok(ScalarValue::Float64(value))
    }

    fn size(&self) -> usize {
        size_of_val(self) + self.values.capacity() * size_of::<f64>()
    }

    fn state(&mut self) -> Result<Vec<ScalarValue>> {
        let values: Vec<ScalarValue> = self.values.iter().copied().map(ScalarValue::from).collect();
        let values = ScalarValue::new_list_nullable(&values, &DataType::Float64);
        Ok(vec![
            ScalarValue::List(values),
            ScalarValue::Float64(self.share),
        ])
    }

    fn merge_batch(&mut self, states: &[ArrayRef]) -> Result<()> {
        let [lists, shares] = states else {
            return internal_err!("two states");
        };
        for list in lists.as_list::<i32>().iter().flatten() {
            self.add(&list);
        }
        self.share = shares
            .as_primitive::<Float64Type>()
            .iter()
            .flatten()
            .next()
            .or(self.share);
        Ok(())
    }
}

/// The value at a share of sorted ones, between its two neighbors.
fn between(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = share * last as f64;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the share is from 0 to 1"
    )]
    let below = place.floor() as usize;
    let (low, high) = (*sorted.get(below)?, *sorted.get((below + 1).min(last))?);
    // Infinity has no distance to itself.
    if low.total_cmp(&high).is_eq() {
        return Some(low);
    }
    Some(low + (place - below as f64) * (high - low))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_their_neighbors() {
        assert_eq!(between(&[], 0.5), None);
        assert_eq!(between(&[3.0], 0.5), Some(3.0));
        assert_eq!(between(&[1.0, 2.0, 4.0], 0.75), Some(3.0));
        assert_eq!(between(&[1.0, 2.0], 1.0), Some(2.0));
        assert_eq!(
            between(&[0.0, 3e5 + 1.0], 1.0 / 3.0),
            Some(100_000.0 + 1.0 / 3.0)
        );
    }
}
