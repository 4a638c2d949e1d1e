//! Style of all charts: colors, sizes in pixels.

/// Colors of series, darkest contrasts first: those of Okabe and Ito that show on white.
const COLORS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555",
];

/// Dashes of lines, one more for each time that the colors begin again.
const DASHES: [&str; 4] = ["", "6 3", "2 3", "8 3 2 3"];

/// Primary text.
pub(crate) const INK: &str = "#222222";
/// Secondary text.
pub(crate) const FAINT_INK: &str = "#555555";
/// Lines behind the data.
pub(crate) const GRID: &str = "#e6e6e6";
/// Minor grid lines.
pub(crate) const FAINT_GRID: &str = "#f3f3f3";
/// The base line.
pub(crate) const BASE: &str = "#888888";

/// The colors in the dark, by those on white; series keep their hue and become lighter where they must.
pub(crate) const DARK: &str = "@media screen and (prefers-color-scheme:dark){\
.chart [fill='#ffffff']{fill:#16181d}.chart [fill='#222222']{fill:#e6e8eb}.chart [fill='#555555']{fill:#b4b9c1}\
.chart [stroke='#e6e6e6']{stroke:#34383f}.chart [stroke='#f3f3f3']{stroke:#23262c}\
.chart [stroke='#888888']{stroke:#8b919b}\
.chart [fill='#0072b2']{fill:#4aa8e0}.chart [stroke='#0072b2']{stroke:#4aa8e0}\
.chart [fill='#d55e00']{fill:#f08a3c}.chart [stroke='#d55e00']{stroke:#f08a3c}\
.chart [fill='#009e73']{fill:#2fc79a}.chart [stroke='#009e73']{stroke:#2fc79a}\
.chart [stroke='#555555']{stroke:#b4b9c1}}";

/// Width of the area for data.
pub(crate) const DATA_WIDTH: f64 = 640.0;
/// Height of the area for data, where it does not follow from the number of bars.
pub(crate) const DATA_HEIGHT: f64 = 340.0;
/// Height of the title's text.
pub(crate) const TITLE_SIZE: f64 = 18.0;
/// Height of captions, and of names in legends.
pub(crate) const TEXT_SIZE: f64 = 14.0;
/// Height of the numbers beside axes.
pub(crate) const TICK_SIZE: f64 = 12.0;
/// Space between things.
pub(crate) const GAP: f64 = 10.0;

/// Mean width of a character of a sans-serif font over its height; names in lower case are narrower.
const CHARACTER: f64 = 0.58;

/// Estimates the width of a text.
pub(crate) fn text_width(text: &str, size: f64) -> f64 {
    text.chars().count() as f64 * size * CHARACTER
}

/// The color of a series by its place.
pub(crate) fn color(series: usize) -> &'static str {
    COLORS.get(series % COLORS.len()).unwrap_or(&INK)
}

/// The dashes of a line by its place.
pub(crate) fn dashes(series: usize) -> &'static str {
    let round = series / COLORS.len() % DASHES.len();
    DASHES.get(round).unwrap_or(&"")
}
