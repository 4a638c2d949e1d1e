//! Lines through points.

use crate::{
    axis::{Axis, Ends, Scale},
    canvas::Stroke,
    captions::{Captions, Series},
    figure::{Figure, Mark, Side},
    style::{DATA_HEIGHT, color, dashes},
};

/// Lines of at most this many points have a dot at each.
const FEW: usize = 40;

/// Draws a line through the points of each series; `scale` is that of the upward axis. A line breaks
/// where a point has no place; `None` if none has one.
pub fn lines(captions: &Captions, scale: Scale, series: &[Series]) -> Option<String> {
    let points = || series.iter().flat_map(|series| &series.points);
    let has_place = |[x, y]: &[f64; 2]| x.is_finite() && y.is_finite();
    let drawn = || points().filter(|point| has_place(point));
    let x = Axis::new(Scale::Linear, Ends::Tight, 6, drawn().map(|[x, _]| *x));
    let y = Axis::new(scale, Ends::Round, 5, drawn().map(|[_, y]| *y));
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
        for piece in places.split(Option::is_none) {
            let piece: Vec<[f64; 2]> = piece.iter().flatten().copied().collect();
            figure.canvas.path(&piece, stroke);
            // An isolated point would be invisible otherwise.
            for place in piece.iter().filter(|_| has_dots || piece.len() == 1) {
                figure.canvas.dot(*place, 3.0, color(idx), 1.0);
            }
        }
    }
    Some(figure.canvas.finish())
}
