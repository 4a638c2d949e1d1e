//! Scattered points.

use crate::{
    axis::{Axis, AxisRange, Scale},
    captions::{Captions, Series},
    figure::{Figure, Mark, Side},
    style::{DATA_HEIGHT, color},
};

/// More points than this are drawn small.
const MANY: usize = 300;

/// Draws a dot at each point of each series; where many lie on each other the color is deeper. `None` if
/// no point is finite.
pub fn scatter(captions: &Captions, series: &[Series]) -> Option<String> {
    let points = series.iter().flat_map(|series| &series.points);
    let drawn: Vec<[f64; 2]> = points
        .filter(|[x, y]| x.is_finite() && y.is_finite())
        .copied()
        .collect();
    let x = Axis::new(
        Scale::Linear,
        AxisRange::Round,
        6,
        drawn.iter().map(|[x, _]| *x),
    );
    let y = Axis::new(
        Scale::Linear,
        AxisRange::Round,
        5,
        drawn.iter().map(|[_, y]| *y),
    );
    let (x, y) = x.zip(y)?;
    let names: Vec<&str> = series.iter().map(|series| series.name.as_str()).collect();
    let around = (&x, &Side::Axis(&y));
    let mut figure = Figure::new(captions, DATA_HEIGHT, around, (&names, Mark::Dot));
    let radius = if drawn.len() > MANY { 2.5 } else { 4.0 };
    for (idx, series) in series.iter().enumerate() {
        for [right, up] in &series.points {
            if let (Some(right), Some(up)) = (x.place(*right), y.place(*up)) {
                let place = figure.at([right, up]);
                figure.canvas.dot(place, radius, color(idx), 0.6);
            }
        }
    }
    Some(figure.canvas.finish())
}
