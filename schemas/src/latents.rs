//! `latents`: the use of a model's latent dimensions, one partition per model, one row per
//! dimension.
//!
//! All statistics are over the encoded training motions. A dimension is active if the variance of its means
//! is more than 0.01 (Burda, Grosse and Salakhutdinov, *Importance Weighted Autoencoders*, 2016,
//! section 5.2): the others carry no information about the motion.

use crate::{columns::columns, table::table};

columns! {
    /// The use of one dimension.
    #[derive(Debug, Clone, PartialEq)]
    pub struct LatentDimension {
        dimension: i64 => "place in the code, from 0",
        kl_nats: f64 ["nat"] => "divergence from the standard normal, mean over the motions",
        mean_deviation: f64 ["1"] => "standard deviation of the motions' means",
        deviation_mean: f64 ["1"] => "mean of the motions' standard deviations",
        active: bool => "whether motions differ in it",
    }
}

/// The dimensions of one model.
pub type Latents = Vec<LatentDimension>;
table! {"latents", 1, per "model", rows: LatentDimension}
