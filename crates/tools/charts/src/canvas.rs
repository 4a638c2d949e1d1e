//! The one place that writes SVG.

use std::fmt::Write;

use crate::style::{DARK, INK};

/// Alignment of a text relative to its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of a text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Text {
    pub(crate) size: f64,
    pub(crate) anchor: Anchor,
    pub(crate) color: &'static str,
    pub(crate) weight: Weight,
}

/// Weight of a text's font.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Weight {
    Normal,
    Bold,
}

/// Style of a line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stroke {
    pub(crate) color: &'static str,
    pub(crate) width: f64,
    pub(crate) dashes: &'static str,
}

/// A picture in the making; coordinates are pixels from the upper left corner.
pub(crate) struct Canvas {
    body: String,
    width: f64,
    height: f64,
}

impl Canvas {
    pub(crate) fn new(width: f64, height: f64) -> Self {
        Self {
            body: String::new(),
            width,
            height,
        }
    }

    pub(crate) fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Stroke) {
        self.path(&[from, to], stroke);
    }

    /// A line through points; nothing for fewer than two.
    pub(crate) fn path(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        if points.len() < 2 {
            return;
        }
        self.put("<path d=\"");
        for (idx, [x, y]) in points.iter().enumerate() {
            let step = if idx == 0 { 'M' } else { 'L' };
            let _infallible = write!(self.body, "{step}{x:.2} {y:.2}");
        }
        let Stroke {
            color,
            width,
            dashes,
        } = stroke;
        let _infallible = write!(
            self.body,
            "\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" stroke-linejoin=\"round\""
        );
        if !dashes.is_empty() {
            let _infallible = write!(self.body, " stroke-dasharray=\"{dashes}\"");
        }
        self.put("/>\n");
    }

    /// A rectangle by two corners, whose title a viewer shows where it is pointed at.
    pub(crate) fn titled_rectangle(&mut self, corners: [[f64; 2]; 2], color: &str, title: &str) {
        self.put("<g>");
        self.title(title);
        self.rectangle(corners, color, 1.0);
        self.put("</g>\n");
    }

    /// A dot whose title a viewer shows where it is pointed at, or near it.
    pub(crate) fn titled_dot(&mut self, place: [f64; 2], radius: f64, color: &str, title: &str) {
        /// Distance within which a dot counts as pointed at, in pixels.
        const NEAR: f64 = 7.0;
        self.put("<g>");
        self.title(title);
        if radius < NEAR {
            self.dot(place, NEAR, color, 0.0);
        }
        if radius > 0.0 {
            self.dot(place, radius, color, 1.0);
        }
        self.put("</g>\n");
    }

    fn title(&mut self, title: &str) {
        self.put("<title>");
        self.put(&xml(title));
        self.put("</title>");
    }

    /// A rectangle by two corners.
    pub(crate) fn rectangle(&mut self, corners: [[f64; 2]; 2], color: &str, opacity: f64) {
        let [[x0, y0], [x1, y1]] = corners;
        let (x, y) = (x0.min(x1), y0.min(y1));
        let (width, height) = ((x1 - x0).abs(), (y1 - y0).abs());
        let _infallible = writeln!(
            self.body,
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" \
             fill=\"{color}\" fill-opacity=\"{opacity}\"/>"
        );
    }

    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], radius: f64, color: &str, opacity: f64) {
        let _infallible = writeln!(
            self.body,
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{color}\" \
             fill-opacity=\"{opacity}\"/>"
        );
    }

    /// A text whose base line goes through a place.
    pub(crate) fn text(&mut self, [x, y]: [f64; 2], look: Text, text: &str) {
        let place = format!("x=\"{x:.2}\" y=\"{y:.2}\"");
        self.text_at(&place, look, text);
    }

    /// A text that goes up, whose base line goes through a place.
    pub(crate) fn text_upwards(&mut self, [x, y]: [f64; 2], look: Text, text: &str) {
        let place = format!("transform=\"translate({x:.2} {y:.2}) rotate(-90)\"");
        self.text_at(&place, look, text);
    }

    fn text_at(&mut self, place: &str, look: Text, text: &str) {
        let anchor = match look.anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (size, color) = (look.size, look.color);
        let _infallible = write!(
            self.body,
            "<text {place} font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{color}\""
        );
        if look.weight == Weight::Bold {
            self.put(" font-weight=\"bold\"");
        }
        self.put(">");
        self.put(&xml(text));
        self.put("</text>\n");
    }

    fn put(&mut self, text: &str) {
        self.body.push_str(text);
    }

    /// The whole picture, on white; on black for a viewer that prefers that, except in print.
    pub(crate) fn finish(self) -> String {
        let Self {
            body,
            width,
            height,
        } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" \
             font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\">\n\
             <style>{DARK}</style>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n{body}</svg>\n"
        )
    }
}

impl Text {
    pub(crate) fn new(size: f64, anchor: Anchor) -> Self {
        Self {
            size,
            anchor,
            color: INK,
            weight: Weight::Normal,
        }
    }
}

impl Stroke {
    pub(crate) fn solid(color: &'static str, width: f64) -> Self {
        Self {
            color,
            width,
            dashes: "",
        }
    }
}

/// A text as XML has it; characters that XML does not allow become a question mark.
fn xml(text: &str) -> String {
    let is_no_xml = |c: char| c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}');
    escaped(text).replace(is_no_xml, "?")
}

/// Returns text that HTML takes as text, in elements and in quoted attributes.
pub fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '&' => escaped.push_str("&amp;"),
            '"' => escaped.push_str("&quot;"),
            character => escaped.push(character),
        }
    }
    escaped
}
