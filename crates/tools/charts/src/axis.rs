//! Axes: their ranges and tick labels.

use crate::style::{TICK_SIZE, text_width};

/// Scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences have equal lengths.
    Linear,
    /// Equal ratios have equal lengths; only positive numbers have a position.
    Log,
}

/// Ends of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AxisRange {
    /// At the smallest and the largest number.
    Tight,
    /// At round numbers around them, and at zero if that is not far.
    Round,
    /// At round numbers around them and at zero.
    Zero,
}

/// Kind of numbers along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Count {
    /// Only whole ones, such as epochs.
    Whole,
    /// Any.
    Any,
}

/// A tick: a position with a grid line, and a label unless it is empty.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Tick {
    /// In 0..=1 along the axis.
    pub(crate) place: f64,
    pub(crate) text: String,
}

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    scale: Scale,
    /// The range, as logarithms on a logarithmic axis.
    from: f64,
    to: f64,
    pub(crate) ticks: Vec<Tick>,
}

/// Numbers beyond this have no position: their differences might be infinite. On a logarithmic axis
/// neither do those below its inverse.
const MAX_ABS: f64 = 1e300;

/// Relative difference below which two numbers count as equal.
const RESOLUTION: f64 = 1e-9;

impl Scale {
    /// Position of a number before the range of the axis is known.
    fn position(self, value: f64) -> Option<f64> {
        let is_number = value.is_finite() && value.abs() <= MAX_ABS;
        match self {
            Self::Linear => is_number.then_some(value),
            Self::Log => (is_number && value >= 1.0 / MAX_ABS).then(|| value.log10()),
        }
    }
}

impl Axis {
    /// Returns an axis for these numbers with about `n_ticks` labels, or `None` if none has a
    /// position.
    pub(crate) fn new(
        scale: Scale,
        range: AxisRange,
        n_ticks: usize,
        values: impl Iterator<Item = f64>,
    ) -> Option<Self> {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut are_whole = true;
        for position in values.filter_map(|value| scale.position(value)) {
            (from, to) = (from.min(position), to.max(position));
            are_whole &= position.fract() == 0.0;
        }
        if from > to {
            return None;
        }
        Some(match scale {
            Scale::Linear => {
                // Along a line, whole numbers count something.
                let count = if are_whole && range == AxisRange::Tight {
                    Count::Whole
                } else {
                    Count::Any
                };
                Self::linear((range, count), n_ticks, from, to)
            }
            Scale::Log => Self::log(from, to),
        })
    }

    fn linear((range, count): (AxisRange, Count), n_ticks: usize, from: f64, to: f64) -> Self {
        let (mut from, mut to) = match range {
            AxisRange::Zero => (from.min(0.0), to.max(0.0)),
            // Zero is shown where it takes no more than half of the axis.
            AxisRange::Round if from > 0.0 && from <= to / 2.0 => (0.0, to),
            AxisRange::Round if to < 0.0 && to >= from / 2.0 => (from, 0.0),
            AxisRange::Round | AxisRange::Tight => (from, to),
        };
        let size = from.abs().max(to.abs());
        if to - from <= size * RESOLUTION {
            let room = if size > 0.0 { size / 10.0 } else { 1.0 };
            (from, to) = (from - room, to + room);
        }
        let step = match (count, (to - from) / n_ticks as f64) {
            (Count::Whole, wanted) if wanted < 1.0 => 1.0,
            // Two and a half is not a step between whole numbers.
            (Count::Whole, wanted) if wanted > 2.0 && wanted < 5.0 => 5.0,
            (_, wanted) => round_step(wanted),
        };
        if range != AxisRange::Tight {
            from = (from / step + RESOLUTION).floor() * step;
            to = (to / step - RESOLUTION).ceil() * step;
        }
        let first = (from / step - RESOLUTION).ceil();
        let n_steps = ((to - first * step) / step + RESOLUTION).floor();
        let ticks = (0..=count_of(n_steps)).map(|number| {
            let value = (first + number as f64) * step;
            Tick {
                place: (value - from) / (to - from),
                text: in_words(value, from.abs().max(to.abs()), step),
            }
        });
        Self {
            scale: Scale::Linear,
            from,
            to,
            ticks: ticks.collect(),
        }
    }

    fn log(from: f64, to: f64) -> Self {
        /// Decades beyond which only some powers of ten have lines.
        const MANY: f64 = 8.0;
        /// Decades below which numbers between powers of ten have names.
        const FEW: f64 = 3.0;
        // A little room, and never less than a third of a decade.
        let room = ((0.3 - (to - from)) / 2.0).max((to - from) * 0.03);
        let (from, to) = (from - room, to + room);
        let decades = to - from;
        let every = (decades / MANY).ceil().max(1.0);
        let mut ticks = Vec::new();
        for number in 0..=count_of(to.floor() - from.floor()) {
            let decade = from.floor() + number as f64;
            for digit in 1..10_u8 {
                let at = decade + f64::from(digit).log10();
                let has_line = match digit {
                    1 => decade.rem_euclid(every) == 0.0,
                    _ => every < 1.5,
                };
                if at < from || at > to || !has_line {
                    continue;
                }
                let is_named = match digit {
                    1 => true,
                    2 | 5 => decades < FEW,
                    _ => decades < 0.5,
                };
                let value = f64::from(digit) * 10.0_f64.powf(decade);
                let text = is_named.then(|| in_words(value, value, 10.0_f64.powf(decade)));
                ticks.push(Tick {
                    place: (at - from) / (to - from),
                    text: text.unwrap_or_default(),
                });
            }
        }
        Self {
            scale: Scale::Log,
            from,
            to,
            ticks,
        }
    }

    /// Returns the position of a number, in 0..=1 along the axis, or `None` if it has none.
    pub(crate) fn place(&self, value: f64) -> Option<f64> {
        let position = self.scale.position(value)?;
        Some((position - self.from) / (self.to - self.from))
    }

    /// Returns the width of the longest label, in pixels.
    pub(crate) fn text_width(&self) -> f64 {
        let widths = self
            .ticks
            .iter()
            .map(|tick| text_width(&tick.text, TICK_SIZE));
        widths.fold(0.0, f64::max)
    }
}

/// The smallest of 1, 2, 2.5, 5 and 10 times a power of ten that is not smaller.
fn round_step(step: f64) -> f64 {
    let power = 10.0_f64.powf(step.log10().floor());
    let digits = [1.0, 2.0, 2.5, 5.0];
    let enough = digits
        .iter()
        .find(|digit| *digit * power >= step * (1.0 - RESOLUTION));
    enough.map_or(10.0 * power, |digit| digit * power)
}

/// A small count that was computed as a number.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "held within small bounds first"
)]
fn count_of(number: f64) -> usize {
    /// Far more lines than an axis ever has.
    const MAX_VALUE: f64 = 1000.0;
    number.clamp(0.0, MAX_VALUE) as usize
}

/// A number with the digits that distinguish it from its neighbors at this step, on an axis whose
/// numbers are up to this large.
fn in_words(value: f64, largest: f64, step: f64) -> String {
    const SMALL: f64 = 1e-3;
    const LARGE: f64 = 1e6;
    let half = usize::from(has_half(step));
    if (SMALL..LARGE).contains(&largest) {
        let digits = count_of(-step.log10().floor()) + half;
        let text = format!("{value:.digits$}");
        let text = without_zeros(&text);
        return if text == "-0" { "0" } else { text }.to_owned();
    }
    if value.abs() < step * RESOLUTION {
        return "0".to_owned();
    }
    let digits = (value.abs().log10().floor() - step.log10().floor()).max(0.0);
    let digits = count_of(digits) + half;
    let text = format!("{value:.digits$e}");
    match text.split_once('e') {
        Some((digits, power)) => format!("{}e{power}", without_zeros(digits)),
        None => text,
    }
}

/// Whether a step is 2.5 times a power of ten.
fn has_half(step: f64) -> bool {
    let digit = step / 10.0_f64.powf(step.log10().floor());
    (digit - 2.5).abs() < RESOLUTION
}

/// A decimal fraction without the zeros at its end.
fn without_zeros(text: &str) -> &str {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(scale: Scale, range: AxisRange, values: &[f64], expected: &[&str]) {
        let axis = Axis::new(scale, range, 5, values.iter().copied()).unwrap();
        let named = axis.ticks.iter().map(|tick| tick.text.as_str());
        let named: Vec<&str> = named.filter(|text| !text.is_empty()).collect();
        assert_eq!(named, expected, "{values:?}");
        let places: Vec<f64> = axis.ticks.iter().map(|tick| tick.place).collect();
        assert!(places.is_sorted(), "{places:?}");
        let within = |place: &f64| (-1e-6..=1.0 + 1e-6).contains(place);
        assert!(places.iter().all(within), "{places:?}");
        let of_values = values.iter().filter_map(|value| axis.place(*value));
        assert!(of_values.collect::<Vec<_>>().iter().all(within));
    }

    #[test]
    fn names_round_numbers() {
        use {AxisRange::*, Scale::*};
        check(Linear, Tight, &[1.0, 16.0], &["5", "10", "15"]);
        check(Linear, Tight, &[1.0, 3.0], &["1", "2", "3"]);
        check(
            Linear,
            Round,
            &[0.0, 10.0],
            &["0", "2", "4", "6", "8", "10"],
        );
        check(Linear, Round, &[3.0, 9.9], &["0", "2", "4", "6", "8", "10"]);
        check(Linear, Round, &[8.0, 9.9], &["8", "8.5", "9", "9.5", "10"]);
        check(Linear, Tight, &[1.0, 60.0], &["20", "40", "60"]);
        check(
            Linear,
            Zero,
            &[-0.4, -0.1],
            &["-0.4", "-0.3", "-0.2", "-0.1", "0"],
        );
        check(
            Linear,
            Round,
            &[-1.0, 1.0],
            &["-1", "-0.5", "0", "0.5", "1"],
        );
        check(
            Linear,
            Round,
            &[0.0, 1e-5],
            &["0", "2e-6", "4e-6", "6e-6", "8e-6", "1e-5"],
        );
        check(
            Linear,
            Round,
            &[1e7, 2e7],
            &["0", "5e6", "1e7", "1.5e7", "2e7"],
        );
        check(
            Linear,
            Round,
            &[0.0, 0.01],
            &["0", "0.002", "0.004", "0.006", "0.008", "0.01"],
        );
        check(
            Log,
            Round,
            &[0.02, 800.0],
            &["0.1", "1", "10", "100", "1000"],
        );
        check(Log, Round, &[0.1, 0.9], &["0.1", "0.2", "0.5"]);
    }

    #[test]
    fn survives_one_number_and_extremes() {
        use {AxisRange::*, Scale::*};
        for values in [
            &[0.0][..],
            &[5.0, 5.0],
            &[1.0, 1.0 + f64::EPSILON],
            &[-1e300, 1e300],
            &[f64::MIN_POSITIVE, 1e299],
            &[1e-320],
            &[f64::NAN, 3.0, f64::INFINITY],
        ] {
            for scale in [Linear, Log] {
                for range in [Tight, Round, Zero] {
                    let axis = Axis::new(scale, range, 5, values.iter().copied());
                    let is_small = |value: &f64| *value < 1e-300;
                    assert_eq!(axis.is_none(), scale == Log && values.iter().all(is_small));
                    let Some(axis) = axis else { continue };
                    assert!((1..100).contains(&axis.ticks.len()), "{values:?} {axis:?}");
                    for tick in &axis.ticks {
                        assert!(tick.place.is_finite(), "{values:?} {axis:?}");
                    }
                    for value in values {
                        let place = axis.place(*value).unwrap_or(0.5);
                        assert!((-1e-6..=1.0 + 1e-6).contains(&place), "{value} {axis:?}");
                    }
                }
            }
        }
        assert!(Axis::new(Linear, Round, 5, [f64::NAN].into_iter()).is_none());
    }
}
