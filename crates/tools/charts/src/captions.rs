//! Title and axis labels of a chart, and its series.

/// The words around the data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Captions<'a> {
    /// Above the data.
    pub title: &'a str,
    /// Below the data: the horizontal quantity with its unit, e.g. `time [s]`.
    pub x: &'a str,
    /// Beside the data: the vertical quantity with its unit, e.g. `error at the tips [mm]`.
    pub y: &'a str,
}

/// Points that belong together. Points that are not finite are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// `[x, y]`, in the order in which a line goes through them.
    pub points: Vec<[f64; 2]>,
}
