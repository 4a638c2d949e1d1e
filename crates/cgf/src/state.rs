//! A training's state between two epochs, as bytes, so that it can go on where it was stopped.

use std::collections::HashMap;

use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};

use crate::{
    CgfError, Trainer,
    curve::Epoch,
    point_net::Statistics,
    training::Best,
    weights::{Array, Weights},
};

/// Version of the form.
const VERSION: &str = "training-state/1";
/// Key of what is not a tensor, in the safetensors header.
const ABOUT: &str = "about";
/// Prefixes of the tensors' names.
const WEIGHTS: &str = "weights/";
const FIRST_MOMENTS: &str = "first_moments/";
const SECOND_MOMENTS: &str = "second_moments/";
const BEST: &str = "best/";

/// What is not a tensor.
#[derive(Serialize, Deserialize)]
struct About {
    version: String,
    adam_step: i32,
    curve: Vec<Epoch>,
    best: Option<(usize, f32)>,
}

impl Trainer<'_> {
    /// Returns the bytes from which [`Trainer::restore`] goes on: a safetensors file.
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
        let mut put = |prefix: &str, weights: &Weights| {
            for (name, array) in weights.iter() {
                arrays.set(
                    &format!("{prefix}{name}"),
                    &array.shape,
                    array.values.clone(),
                );
            }
        };
        put(WEIGHTS, &self.weights);
        let [first, second] = self.adam.moments();
        put(FIRST_MOMENTS, &first);
        put(SECOND_MOMENTS, &second);
        if let Some(best) = &self.best {
            put(BEST, &best.weights);
        }
        let about = HashMap::from([(ABOUT.to_owned(), serde_json::to_string(&about)?)]);
        arrays.to_bytes_about(Some(about))
    }

    /// Goes on where [`Trainer::state`] of a training with equal arguments was taken; the result is the
    /// one of a training that was never stopped.
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
        let part = |prefix: &str| {
            let mut weights = Weights::default();
            for (name, Array { shape, values }) in arrays.iter() {
                if let Some(name) = name.strip_prefix(prefix) {
                    weights.set(name, shape, values.clone());
                }
            }
            weights
        };
        let weights = part(WEIGHTS);
        weights.check_like(&self.weights)?;
        let best = about.best.map(|(epoch, total)| Best {
            epoch,
            total,
            weights: part(BEST),
        });
        if let Some(best) = &best {
            best.weights.check_like(&self.weights)?;
        }
        let moments = [part(FIRST_MOMENTS), part(SECOND_MOMENTS)];
        self.adam.restore(about.adam_step, moments, &weights)?;
        self.weights = weights;
        self.best = best;
        // The last epoch that is done says which statistics it left.
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
