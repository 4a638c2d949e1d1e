//! Estimates with their intervals beside names.

use std::collections::BTreeMap;

use crate::{
    axis::{Axis, AxisRange, Scale},
    canvas::Stroke,
    captions::Captions,
    figure::{Figure, Mark, Side},
    style::{BASE, GAP, TEXT_SIZE, color},
};

/// A value that is known up to an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// The interval's lower end.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
}

/// Estimates of one color, one for each name.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    /// Its name in the legend.
    pub name: String,
    /// The estimate of each name that has one.
    pub values: BTreeMap<String, Estimate>,
}

/// Height of an estimate that is one of several beside a name.
const EACH: f64 = 12.0;
/// Half of the height of the strokes at an interval's ends.
const HALF_END: f64 = 3.5;

/// Draws a dot for each name, from the top, and a line from the lower to the upper end of its interval; of
/// several series, one below the other. `captions.x` names the estimated quantity and the confidence;
/// `captions.y` may be empty where the names speak for themselves. The axis begins at zero. An estimate
/// that is not finite is left out; `None` if none is left.
pub fn intervals(captions: &Captions, names: &[String], series: &[Estimates]) -> Option<String> {
    let estimates = series.iter().flat_map(|all| all.values.values());
    let numbers = estimates.filter(|estimate| estimate.is_finite());
    let numbers = numbers.flat_map(|estimate| [estimate.low, estimate.value, estimate.high]);
    let axis = Axis::new(Scale::Linear, AxisRange::Zero, 6, numbers)?;
    let share = (EACH * series.len() as f64 + GAP).max(TEXT_SIZE * 1.4);
    let legend: Vec<&str> = series.iter().map(|all| all.name.as_str()).collect();
    let around = (&axis, &Side::Names(names));
    let height = share * names.len() as f64;
    let mut figure = Figure::new(captions, height, around, (&legend, Mark::Dot));
    let zero = axis.place(0.0).unwrap_or_default();
    let (from, to) = (figure.at([zero, 0.0]), figure.at([zero, 1.0]));
    figure.canvas.line(from, to, Stroke::solid(BASE, 1.0));
    let ([_, top], [_, bottom]) = (to, from);
    let share = (bottom - top) / names.len() as f64;
    for (idx, all) in series.iter().enumerate() {
        let below = EACH * (idx as f64 - (series.len() as f64 - 1.0) / 2.0);
        for (number, name) in names.iter().enumerate() {
            let estimate = all.values.get(name).filter(|estimate| estimate.is_finite());
            let Some([low, value, high]) = estimate.and_then(|it| it.places(&axis)) else {
                continue;
            };
            let y = top + (number as f64 + 0.5) * share + below;
            let title = estimate.map_or_else(String::new, |it| {
                let Estimate { value, low, high } = it;
                format!("{name}, {}: {value:.1} ({low:.1} to {high:.1})", all.name)
            });
            let [low, value, high] = [low, value, high].map(|place| figure.at([place, 0.0])[0]);
            let stroke = Stroke::solid(color(idx), 1.5);
            figure.canvas.line([low, y], [high, y], stroke);
            for end in [low, high] {
                let (above, below) = ([end, y - HALF_END], [end, y + HALF_END]);
                figure.canvas.line(above, below, stroke);
            }
            figure
                .canvas
                .titled_dot([value, y], 4.0, color(idx), &title);
        }
    }
    Some(figure.canvas.finish())
}

impl Estimate {
    fn is_finite(&self) -> bool {
        self.low.is_finite() && self.value.is_finite() && self.high.is_finite()
    }

    /// Returns the positions of its numbers on an axis.
    fn places(&self, axis: &Axis) -> Option<[f64; 3]> {
        let place = |number| axis.place(number);
        Some([place(self.low)?, place(self.value)?, place(self.high)?])
    }
}
