//! Makes one page of what a run learned, with motions to look at.
//!
//! The stage `report` reads whatever of a run is wired to it and writes `index.html`, which needs no
//! other file and no network, `report.md` for reviews of code, and the tables that they show as CSV.
//! [`PageData`] is what they show; [`render()`] writes it, of one run or of several side by side.
//!
//! Equal inputs give equal bytes: there is no clock, no host and no path in a page. Times that stages
//! took are no inputs; who knows them from a run's record adds them ([`PageData::seconds`]).
//! Nothing is simulated or judged here: motions are those of recordings.

mod config;
mod csv;
mod embed;
mod error;
mod estimates;
mod facts;
mod funnel;
mod gather;
mod html;
mod markdown;
mod motions;
mod numbers;
mod paper;
mod pictures;
mod png;
mod protocol;
mod recorded;
mod render;
mod report;
mod sections;
mod table;

pub use config::ReportConfig;
pub use error::ReportError;
pub use estimates::EstimatedObject;
pub use facts::Facts;
pub use gather::PageData;
pub use glb::{Contact, Moment, ObjectMesh};
pub use motions::{Motion, OutcomeGroup};
pub use pictures::Pictures;
pub use recorded::{RecordedMotion, of_candidate};
pub use render::{Rendered, render};
pub use report::{INPUTS, PageMetrics, Report, unit};
