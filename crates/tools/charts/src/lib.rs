//! Charts as SVG, for reports: lines, scattered points, bars, estimates and histograms.
//!
//! ```
//! use charts::{Captions, Scale, Series, lines};
//!
//! let captions = Captions {
//!     title: "Training",
//!     x: "epoch",
//!     y: "loss",
//! };
//! let falling = Series {
//!     name: "training".to_owned(),
//!     points: vec![[1.0, 0.8], [2.0, 0.4], [3.0, 0.3]],
//! };
//! let svg = lines(&captions, Scale::Log, &[falling]).unwrap();
//! assert!(svg.starts_with("<svg "));
//! ```
//!
//! Invariants: equal arguments give equal bytes, with no clock, no fonts of the system and no
//! randomness; numbers that are not finite, and on a logarithmic axis those that are not positive,
//! are left out, so that a line breaks there; a chart with nothing left to draw is `None`, not an
//! empty picture. The plot area has a fixed size: the legend is to the right of it and widens the
//! picture. Colors are distinguishable for color-blind readers (Okabe and Ito, *Color universal
//! design*, 2008), and dashes distinguish further lines.
//!
//! Text uses the viewer's common sans-serif font, so its width is only estimated here.

mod axis;
mod bars;
mod canvas;
mod captions;
mod figure;
mod histogram;
mod intervals;
mod lines;
mod scatter;
mod style;

pub use axis::Scale;
pub use bars::{Bars, bars};
pub use canvas::escaped;
pub use captions::{Captions, Series};
pub use histogram::{Sample, histogram};
pub use intervals::{Estimate, Estimates, intervals};
pub use lines::lines;
pub use scatter::scatter;
