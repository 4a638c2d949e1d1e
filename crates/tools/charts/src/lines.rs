//! Lines through points.

use crate::{
    axis::{Axis, AxisRange, Scale},
    canvas::Stroke,
    captions::{Captions, Series},
    figure::{Figure, Mark, Side},
    style::{DATA_HEIGHT, color, dashes},
};

/// Lines of at most this many points have a dot at each.
const FEW: usize = 40;
/// Points of longer lines are too close to be pointed at.
const POINTED_AT: usize = 200;

/// Draws a line through the points of each series; `scale` is that of the upward axis. A line breaks
/// where a point has no place; `None` if none has one.
pub fn lines(captions: &Captions, scale: Scale, series: &[Series]) -> Option<String> {
    let points = || series.iter().flat_map(|series| &series.points);
    let has_place = |[x, y]: &[f64; 2]| x.is_finite() && y.is_finite();
    let drawn = || points().filter(|point| has_place(point));
    let x = Axis::new(Scale::Linear, AxisRange::Tight, 6, drawn().map(|[x, _]| *x));
    let y = Axis::new(scale, AxisRange::Round, 5, drawn().map(|[_, y]| *y));
    let (x, y) = x.zip(y)?;
    let names: Vec<&str> = series.iter().map(|series| series.name.as_str()).collect();
    let around = (&x, &Side::Axis(&y));
    let mut figure = Figure::new(captions, DATA_HEIGHT, around, (&names, Mark::Line));
    for (idx, series) in series.iter().enumerate() {
        let stroke = Stroke {
            color: color(idx),
            width: 2.0,
            dashes: dashes(idx),
        };
        let has_dots = series.points.len() <= FEW;
        let places: Vec<Option<[f64; 2]>> = series
            .points
            .iter()
            .map(|[right, up]| Some(figure.at([x.place(*right)?, y.place(*up)?])))
            .collect();
        // An isolated point would be invisible as a line.
        let mut isolated: Vec<[f64; 2]> = Vec::new();
        for piece in places.split(Option::is_none) {
            let piece: Vec<[f64; 2]> = piece.iter().flatten().copied().collect();
            figure.canvas.path(&piece, stroke);
            isolated.extend(piece.first().filter(|_| piece.len() == 1));
        }
        for (place, [right, up]) in places.iter().zip(&series.points) {
            let Some(place) = place else { continue };
            if series.points.len() > POINTED_AT && !isolated.contains(place) {
                continue;
            }
            let radius = if has_dots || isolated.contains(place) {
                3.0
            } else {
                0.0
            };
            let title = format!("{}: {up:.4} at {right}", series.name);
            figure.canvas.titled_dot(*place, radius, color(idx), &title);
        }
    }
    Some(figure.canvas.finish())
}
