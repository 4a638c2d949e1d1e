//! Shows how a training went, by the checkpoint of its last epoch.
//!
//! Three tables with charts: the losses (`training`), what is used of the latent code (`latents`), and
//! how near the motions of the mean codes are to those that they were encoded from
//! (`reconstruction`). This crate links the stage `train` and not the other way around: editing it
//! makes no checkpoint again.

mod latents;
mod reconstruction;
mod report;
mod training;

pub use latents::{LatentMetrics, LatentsReport};
pub use reconstruction::{ReconstructionMetrics, ReconstructionReport};
pub use report::TrainReport;
pub use training::{TrainingMetrics, TrainingReport};
