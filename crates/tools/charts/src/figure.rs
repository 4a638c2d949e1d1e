//! The frame of all charts: plot area, grid, captions, legend.

use crate::{
    axis::{Axis, Tick},
    canvas::{Anchor, Canvas, Stroke, Text, Weight},
    captions::Captions,
    style::{
        BASE, DATA_WIDTH, FAINT_GRID, FAINT_INK, GAP, GRID, TEXT_SIZE, TICK_SIZE, TITLE_SIZE,
        color, dashes, text_width,
    },
};

/// Mark of a series in a legend.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mark {
    Line,
    Dot,
    Area,
}

/// The vertical axis.
pub(crate) enum Side<'a> {
    /// Numbers, with lines through the data.
    Axis(&'a Axis),
    /// Names, from the top, each in the middle of its share of the height.
    Names(&'a [String]),
}

/// A picture with its frame drawn.
pub(crate) struct Figure {
    pub(crate) canvas: Canvas,
    left: f64,
    top: f64,
    height: f64,
}

/// Width of the mark of a series in a legend.
const MARK_WIDTH: f64 = 22.0;
/// Row height of a legend.
const ROW: f64 = TEXT_SIZE * 1.6;

impl Figure {
    /// Draws the frame and the grid. A legend is drawn for more than one name.
    pub(crate) fn new(
        captions: &Captions,
        height: f64,
        (x, side): (&Axis, &Side),
        (legend, mark): (&[&str], Mark),
    ) -> Self {
        let beside = match side {
            Side::Axis(axis) => axis.text_width(),
            Side::Names(names) => widest(names.iter().map(String::as_str), TEXT_SIZE),
        };
        let has_caption = !captions.y.is_empty();
        let caption_width = if has_caption { TEXT_SIZE + GAP } else { 0.0 };
        let left = GAP * 1.5 + caption_width + beside + GAP;
        let top = GAP + TITLE_SIZE * 1.2 + GAP;
        let legend = if legend.len() > 1 { legend } else { &[] };
        let legend_width = match legend {
            [] => 0.0,
            names => GAP * 2.0 + MARK_WIDTH + GAP + widest(names.iter().copied(), TEXT_SIZE),
        };
        let title_width = text_width(captions.title, TITLE_SIZE) + 2.0 * GAP;
        let width = (left + DATA_WIDTH + legend_width + GAP * 2.5).max(left + title_width);
        let height = height.max(legend.len() as f64 * ROW);
        let bottom = TICK_SIZE + GAP + TEXT_SIZE + GAP * 2.0;
        let mut figure = Self {
            canvas: Canvas::new(width, top + height + bottom),
            left,
            top,
            height,
        };
        figure.grid(x, side);
        figure.captions(captions, caption_width);
        figure.legend(legend, mark);
        figure
    }

    /// The place of two shares in 0..=1, to the right and upwards.
    pub(crate) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.left + x * DATA_WIDTH,
            self.top + (1.0 - y) * self.height,
        ]
    }

    fn grid(&mut self, x: &Axis, side: &Side) {
        let quiet = |text: &Tick| {
            if text.text.is_empty() {
                FAINT_GRID
            } else {
                GRID
            }
        };
        let small = |anchor| Text {
            color: FAINT_INK,
            ..Text::new(TICK_SIZE, anchor)
        };
        // Labeled lines over unlabeled ones.
        let ordered = |ticks: &[Tick]| {
            let (faint, named): (Vec<Tick>, Vec<Tick>) =
                ticks.iter().cloned().partition(|tick| tick.text.is_empty());
            faint.into_iter().chain(named)
        };
        for tick in ordered(&x.ticks) {
            let (from, to) = (self.at([tick.place, 0.0]), self.at([tick.place, 1.0]));
            self.canvas.line(from, to, Stroke::solid(quiet(&tick), 1.0));
            let below = [from[0], from[1] + TICK_SIZE + GAP * 0.5];
            if !tick.text.is_empty() {
                self.canvas.text(below, small(Anchor::Middle), &tick.text);
            }
        }
        match side {
            Side::Axis(axis) => {
                for tick in ordered(&axis.ticks) {
                    let (from, to) = (self.at([0.0, tick.place]), self.at([1.0, tick.place]));
                    self.canvas.line(from, to, Stroke::solid(quiet(&tick), 1.0));
                    let beside = [from[0] - GAP * 0.7, from[1] + TICK_SIZE * 0.36];
                    if !tick.text.is_empty() {
                        self.canvas.text(beside, small(Anchor::End), &tick.text);
                    }
                }
                let (from, to) = (self.at([0.0, 0.0]), self.at([1.0, 0.0]));
                self.canvas.line(from, to, Stroke::solid(BASE, 1.0));
            }
            Side::Names(names) => {
                for (idx, name) in names.iter().enumerate() {
                    let share = 1.0 - (idx as f64 + 0.5) / names.len() as f64;
                    let [x, y] = self.at([0.0, share]);
                    let beside = [x - GAP, y + TEXT_SIZE * 0.36];
                    let look = Text::new(TEXT_SIZE, Anchor::End);
                    self.canvas.text(beside, look, name);
                }
            }
        }
    }

    fn captions(&mut self, captions: &Captions, caption_width: f64) {
        let title = Text {
            weight: Weight::Bold,
            ..Text::new(TITLE_SIZE, Anchor::Start)
        };
        let above = [self.left, GAP + TITLE_SIZE];
        self.canvas.text(above, title, captions.title);
        let look = Text::new(TEXT_SIZE, Anchor::Middle);
        let [x, y] = self.at([0.5, 0.0]);
        let below = [x, y + TICK_SIZE + GAP * 1.2 + TEXT_SIZE];
        self.canvas.text(below, look, captions.x);
        if caption_width > 0.0 {
            let [_, middle] = self.at([0.0, 0.5]);
            let beside = [GAP * 0.5 + TEXT_SIZE, middle];
            self.canvas.text_upwards(beside, look, captions.y);
        }
    }

    fn legend(&mut self, names: &[&str], mark: Mark) {
        let [x, y] = self.at([1.0, 1.0]);
        let x = x + GAP * 2.0;
        for (idx, name) in names.iter().enumerate() {
            let middle = y + (idx as f64 + 0.5) * ROW;
            let color = color(idx);
            match mark {
                Mark::Line => {
                    let stroke = Stroke {
                        color,
                        width: 2.5,
                        dashes: dashes(idx),
                    };
                    let to = [x + MARK_WIDTH, middle];
                    self.canvas.line([x, middle], to, stroke);
                }
                Mark::Dot => {
                    let at = [x + MARK_WIDTH * 0.5, middle];
                    self.canvas.dot(at, 5.0, color, 1.0);
                }
                Mark::Area => {
                    let half = TEXT_SIZE * 0.45;
                    let corners = [[x, middle - half], [x + MARK_WIDTH, middle + half]];
                    self.canvas.rectangle(corners, color, 1.0);
                }
            }
            let beside = [x + MARK_WIDTH + GAP * 0.8, middle + TEXT_SIZE * 0.36];
            let look = Text::new(TEXT_SIZE, Anchor::Start);
            self.canvas.text(beside, look, name);
        }
    }
}

fn widest<'a>(texts: impl Iterator<Item = &'a str>, size: f64) -> f64 {
    texts.map(|text| text_width(text, size)).fold(0.0, f64::max)
}
