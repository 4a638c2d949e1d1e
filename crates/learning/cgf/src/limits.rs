//! Joint ranges of a hand, and network outputs that stay within them.

use candle_core::{DType, Tensor};
use robot::Joint;
use serde::{Deserialize, Serialize};

use crate::{
    CgfError, config::JointOutputs, hand_numbers::PALM_WIDTH, network::constant, precision::narrow,
};

/// Range of a joint's positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRange {
    /// Least position in radians (meters if prismatic); `None` if unlimited.
    pub lower: Option<f64>,
    /// Greatest position in radians (meters if prismatic); `None` if unlimited.
    pub upper: Option<f64>,
}

impl JointRange {
    pub(crate) fn of(joint: &Joint) -> Self {
        let finite = |limit: f64| limit.is_finite().then_some(limit);
        Self {
            lower: finite(joint.lower),
            upper: finite(joint.upper),
        }
    }

    /// Returns the nearest position in the range.
    pub fn clamp(&self, position: f64) -> f64 {
        let above = self.lower.map_or(position, |lower| position.max(lower));
        self.upper.map_or(above, |upper| above.min(upper))
    }
}

/// Takes a network's numbers for the joints to positions: `middle + half · tanh((x − middle) / half)`
/// for a joint that is kept within its limits, `half` being half of its range, and as they are for
/// the others.
///
/// About the middle of the range the number is the position; every derivative in time exists.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Limits {
    /// Middle and half of the range of each joint that is kept within its limits.
    ranges: Vec<Option<(f64, f64)>>,
}

impl Limits {
    pub(crate) fn new(outputs: JointOutputs, ranges: &[JointRange]) -> Self {
        let limits = |range: &JointRange| match (outputs, range.lower, range.upper) {
            (JointOutputs::WithinLimits, Some(lower), Some(upper)) if upper > lower => {
                Some((lower.midpoint(upper), (upper - lower) / 2.0))
            }
            _ => None,
        };
        Self {
            ranges: ranges.iter().map(limits).collect(),
        }
    }

    /// Maps the joints' numbers among a hand's (meters, matrix entries, radians) to positions.
    pub(crate) fn apply(&self, numbers: &mut [f64]) {
        for (x, range) in numbers.iter_mut().skip(PALM_WIDTH).zip(&self.ranges) {
            if let Some((middle, half)) = range {
                *x = middle + half * ((*x - middle) / half).tanh();
            }
        }
    }

    /// Does so with numbers and their first and second derivatives in time, by the chain rule.
    pub(crate) fn apply_with_rates(&self, numbers: &mut [Vec<f64>; 3]) {
        let [values, firsts, seconds] = numbers;
        let rates = firsts.iter_mut().zip(seconds);
        let joints = values
            .iter_mut()
            .zip(rates)
            .skip(PALM_WIDTH)
            .zip(&self.ranges);
        for ((x, (first, second)), range) in joints {
            if let Some((middle, half)) = range {
                let share = ((*x - middle) / half).tanh();
                let slope = 1.0 - share * share;
                *second = slope * (*second - 2.0 * share * *first * *first / half);
                *first *= slope;
                *x = middle + half * share;
            }
        }
    }

    /// Does so on the tape, with `(rows, 9 + dof)` numbers; `None` if no joint is kept.
    pub(crate) fn on_tape(&self, numbers: &Tensor) -> Result<Option<Tensor>, CgfError> {
        if self.ranges.iter().all(Option::is_none) {
            return Ok(None);
        }
        let row = |number: fn(&(f64, f64)) -> f64, free: f64| {
            let joints = self.ranges.iter();
            let joints = joints.map(|range| narrow(range.as_ref().map_or(free, number)));
            Ok::<_, CgfError>(
                constant(joints.collect(), &[self.ranges.len()])?.to_device(numbers.device())?,
            )
        };
        let (middle, half) = (row(|r| r.0, 0.0)?, row(|r| r.1, 1.0)?);
        let joints = numbers.narrow(1, PALM_WIDTH, self.ranges.len())?;
        let share = joints
            .broadcast_sub(&middle)?
            .broadcast_div(&half)?
            .tanh()?;
        let kept = share.broadcast_mul(&half)?.broadcast_add(&middle)?;
        let kept = if self.ranges.iter().any(Option::is_none) {
            let is_kept = self.ranges.iter().map(|range| u8::from(range.is_some()));
            let is_kept = Tensor::from_iter(is_kept, numbers.device())?;
            is_kept
                .broadcast_as(joints.shape())?
                .where_cond(&kept, &joints)?
        } else {
            kept
        };
        debug_assert_eq!(kept.dtype(), DType::F32);
        Ok(Some(Tensor::cat(
            &[&numbers.narrow(1, 0, PALM_WIDTH)?, &kept],
            1,
        )?))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Tensor, Var};

    use super::*;

    fn limits() -> Limits {
        let range = |lower, upper| JointRange { lower, upper };
        Limits::new(
            JointOutputs::WithinLimits,
            &[
                range(Some(-0.2), Some(1.4)),
                range(None, None),
                range(Some(0.0), Some(0.0)),
            ],
        )
    }

    fn numbers(joints: [f64; 3]) -> Vec<f64> {
        [vec![0.3; PALM_WIDTH], joints.to_vec()].concat()
    }

    #[test]
    fn joints_stay_within_their_limits_and_move_freely_in_the_middle() {
        let mut far = numbers([9.0, 9.0, 9.0]);
        limits().apply(&mut far);
        assert_eq!(far[PALM_WIDTH + 1..], [9.0, 9.0]);
        assert!(
            far[PALM_WIDTH] <= 1.4 && far[PALM_WIDTH] > 1.399_999,
            "{far:?}"
        );
        let mut low = numbers([-9.0, -9.0, -9.0]);
        limits().apply(&mut low);
        assert!(
            low[PALM_WIDTH] >= -0.2 && low[PALM_WIDTH] < -0.199_999,
            "{low:?}"
        );
        let mut middle = numbers([0.62, 0.0, 0.0]);
        limits().apply(&mut middle);
        assert!((middle[PALM_WIDTH] - 0.62).abs() < 1e-5, "{middle:?}");
        let mut free = numbers([9.0, 9.0, 9.0]);
        Limits::new(
            JointOutputs::Free,
            &[JointRange {
                lower: Some(0.0),
                upper: Some(1.0),
            }],
        )
        .apply(&mut free);
        assert_eq!(free, numbers([9.0, 9.0, 9.0]));
    }

    #[test]
    fn derivatives_equal_central_differences() {
        // x = 0.9 + 0.7 t + 0.2 t² at t = 0.
        let at = |t: f64| {
            let mut x = numbers([0.9 + 0.7 * t + 0.2 * t * t, 0.0, 0.0]);
            limits().apply(&mut x);
            x[PALM_WIDTH]
        };
        let zeros = vec![0.0; PALM_WIDTH + 3];
        let mut moving = [numbers([0.9, 0.0, 0.0]), zeros.clone(), zeros];
        (moving[1][PALM_WIDTH], moving[2][PALM_WIDTH]) = (0.7, 0.4);
        limits().apply_with_rates(&mut moving);
        let h = 1e-4;
        assert_eq!(moving[0][PALM_WIDTH], at(0.0));
        assert!((moving[1][PALM_WIDTH] - (at(h) - at(-h)) / (2.0 * h)).abs() < 1e-7);
        let second = (at(h) - 2.0 * at(0.0) + at(-h)) / (h * h);
        assert!((moving[2][PALM_WIDTH] - second).abs() < 1e-6, "{second}");
    }

    #[test]
    fn the_tape_computes_the_same_with_its_gradient() {
        let row: Vec<f32> = numbers([0.9, -3.0, 2.0]).into_iter().map(narrow).collect();
        let tensor = Tensor::from_slice(&row, (1, PALM_WIDTH + 3), &Device::Cpu).unwrap();
        let var = Var::from_tensor(&tensor).unwrap();
        let kept = limits().on_tape(var.as_tensor()).unwrap().unwrap();
        let mut expected = [
            numbers([0.9, -3.0, 2.0]),
            vec![1.0; PALM_WIDTH + 3],
            vec![0.0; PALM_WIDTH + 3],
        ];
        limits().apply_with_rates(&mut expected);
        let gradients = kept.sum_all().unwrap().backward().unwrap();
        let near = |found: &Tensor, expected: &[f64]| {
            let found = found.flatten_all().unwrap().to_vec1::<f32>().unwrap();
            for (found, expected) in found.iter().zip(expected) {
                assert!((f64::from(*found) - expected).abs() < 1e-6);
            }
        };
        near(&kept, &expected[0]);
        near(gradients.get(&var).unwrap(), &expected[1]);
        let free = Limits::new(JointOutputs::Free, &[]);
        assert!(free.on_tape(&tensor).unwrap().is_none());
    }
}
