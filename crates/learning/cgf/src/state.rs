//! A training's state between two epochs, as bytes, so that it can resume.

use std::collections::HashMap;

use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};

use crate::{
    CgfError, Trainer, curve::Epoch, point_net::Statistics, training::Best, weights::Weights,
};

/// Version of the form.
const VERSION: &str = "training-state/1";
/// Key of the metadata in the safetensors header.
const ABOUT: &str = "about";
/// Prefixes of the tensors' names.
const WEIGHTS: &str = "weights/";
const FIRST_MOMENTS: &str = "first_moments/";
const SECOND_MOMENTS: &str = "second_moments/";
const BEST: &str = "best/";

/// Metadata: the state besides the tensors.
#[derive(Serialize, Deserialize)]
struct About {
    version: String,
    adam_step: i32,
    curve: Vec<Epoch>,
    best: Option<(usize, f32)>,
}

impl Trainer<'_> {
    /// Returns the bytes from which [`Trainer::restore`] resumes: a safetensors file.
    ///
    /// # Errors
    ///
    /// Fails if an array is too large for the format.
    pub fn state(&self) -> Result<Vec<u8>, CgfError> {
        let about = About {
            version: VERSION.to_owned(),
            adam_step: self.adam.steps(),
            curve: self.curve.clone(),
            best: self.best.as_ref().map(|best| (best.epoch, best.total)),
        };
        let mut arrays = Weights::default();
        arrays.add_part(WEIGHTS, self.weights.clone());
        let [first, second] = self.adam.moments();
        arrays.add_part(FIRST_MOMENTS, first);
        arrays.add_part(SECOND_MOMENTS, second);
        if let Some(best) = &self.best {
            arrays.add_part(BEST, best.weights.clone());
        }
        let about = HashMap::from([(ABOUT.to_owned(), serde_json::to_string(&about)?)]);
        arrays.to_bytes_about(Some(about))
    }

    /// Resumes from the [`Trainer::state`] of a training with equal arguments; the result is that of an
    /// uninterrupted training.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are damaged or of another training; the training then stays as it was.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), CgfError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes)?;
        let about = metadata
            .metadata()
            .as_ref()
            .and_then(|entries| entries.get(ABOUT))
            .map_or("", String::as_str);
        let about: About = serde_json::from_str(about)?;
        if about.version != VERSION {
            return Err(CgfError::Version {
                expected: VERSION,
                found: about.version,
            });
        }
        let arrays = Weights::from_bytes(bytes)?;
        let weights = arrays.part(WEIGHTS);
        weights.check_like(&self.weights)?;
        let best = about.best.map(|(epoch, total)| Best {
            epoch,
            total,
            weights: arrays.part(BEST),
        });
        if let Some(best) = &best {
            best.weights.check_like(&self.weights)?;
        }
        let moments = [FIRST_MOMENTS, SECOND_MOMENTS].map(|prefix| arrays.part(prefix));
        self.adam.restore(about.adam_step, moments, &weights)?;
        self.weights = weights;
        self.best = best;
        // The last completed epoch determines the statistics in use.
        let fixed = about.curve.len().checked_sub(1);
        self.statistics = if fixed.is_some_and(|epoch| self.is_fixed_in(epoch)) {
            Statistics::Stored
        } else {
            Statistics::Measured
        };
        self.curve = about.curve;
        Ok(())
    }
}
