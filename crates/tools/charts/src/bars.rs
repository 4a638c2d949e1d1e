//! Bars beside names.

use std::collections::BTreeMap;

use crate::{
    axis::{Axis, AxisRange, Scale},
    canvas::Stroke,
    captions::Captions,
    figure::{Figure, Mark, Side},
    style::{BASE, GAP, TEXT_SIZE, color},
};

/// Bars of one color, one for each name.
#[derive(Debug, Clone, PartialEq)]
pub struct Bars {
    /// Its name in the legend.
    pub name: String,
    /// The value of each name; without one, or where it is not finite, there is no bar.
    pub values: BTreeMap<String, f64>,
}

/// Height of a bar that is one of several beside a name, and of one alone.
const BAR: [f64; 2] = [12.0, 16.0];

/// Draws a bar to the right for each name, from the top; of several series, one below the other.
/// `captions.x` says what the bars measure; `captions.y` may be empty where the names speak for
/// themselves. `None` if no value is finite.
pub fn bars(captions: &Captions, names: &[String], series: &[Bars]) -> Option<String> {
    let values = series.iter().flat_map(|bars| bars.values.values().copied());
    let axis = Axis::new(Scale::Linear, AxisRange::Zero, 6, values)?;
    let [several, alone] = BAR;
    let bar = if series.len() > 1 { several } else { alone };
    let share = (bar * series.len() as f64 + GAP).max(TEXT_SIZE * 1.4);
    let legend: Vec<&str> = series.iter().map(|bars| bars.name.as_str()).collect();
    let around = (&axis, &Side::Names(names));
    let height = share * names.len() as f64;
    let mut figure = Figure::new(captions, height, around, (&legend, Mark::Area));
    let zero = axis.place(0.0).unwrap_or_default();
    let [_, top] = figure.at([0.0, 1.0]);
    let [_, bottom] = figure.at([0.0, 0.0]);
    let share = (bottom - top) / names.len() as f64;
    for (idx, bars) in series.iter().enumerate() {
        for (number, name) in names.iter().enumerate() {
            let value = bars.values.get(name);
            let Some(end) = value.and_then(|value| axis.place(*value)) else {
                continue;
            };
            let middle = top + (number as f64 + 0.5) * share;
            let upper = middle + (idx as f64 - series.len() as f64 / 2.0) * bar;
            let ([from, _], [to, _]) = (figure.at([zero, 0.0]), figure.at([end, 0.0]));
            let corners = [[from, upper], [to, upper + bar - 1.0]];
            let series = if bars.name.is_empty() {
                String::new()
            } else {
                format!(", {}", bars.name)
            };
            let title = format!("{name}{series}: {}", value.unwrap_or(&0.0));
            figure.canvas.titled_rectangle(corners, color(idx), &title);
        }
    }
    let (from, to) = (figure.at([zero, 0.0]), figure.at([zero, 1.0]));
    figure.canvas.line(from, to, Stroke::solid(BASE, 1.0));
    Some(figure.canvas.finish())
}
