//! Which orientation and which latent code each motion gets.

use cgf::{Cgf, Demonstration, Random};
use schemas::objects::Object;
use spatial::Rest;

use crate::config::{Rests, SampleConfig};

/// What one motion is decoded from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Draw {
    /// Index of the object's resting orientation.
    pub(crate) rest: usize,
    /// The latent code.
    pub(crate) latent: Vec<f64>,
}

/// The ways of drawing motions for one object.
pub(crate) struct Source<'a> {
    config: &'a SampleConfig,
    latent_dim: usize,
    /// Demonstrations of this object, each with the orientation in which it lay.
    demonstrations: Vec<(usize, &'a Demonstration)>,
    /// Weight of each orientation.
    weights: Vec<f64>,
}

impl<'a> Source<'a> {
    /// `rests` are the object's resting orientations as [`rests`] returns them.
    pub(crate) fn new(
        config: &'a SampleConfig,
        cgf: &'a Cgf,
        object: &Object,
        rests: &[Rest],
    ) -> Self {
        let description = cgf.description();
        let demonstrations = description
            .demonstrations
            .iter()
            .filter(|demonstration| demonstration.object == object.name)
            .map(|demonstration| (nearest(rests, &demonstration.rest()), demonstration))
            .collect();
        Self {
            config,
            latent_dim: description.network.latent_dim,
            demonstrations,
            weights: weights(config.rests, object, rests.len()),
        }
    }

    /// Draws one motion.
    pub(crate) fn draw(&self, random: &mut Random) -> Draw {
        let about_demonstration = random.uniform() < self.config.demonstrated_share;
        if about_demonstration && !self.demonstrations.is_empty() {
            let (rest, demonstration) =
                self.demonstrations[random.index(self.demonstrations.len())];
            let latent = demonstration
                .latent_mean
                .iter()
                .zip(&demonstration.latent_deviation)
                .map(|(mean, deviation)| mean + self.config.spread * deviation * random.normal())
                .collect();
            return Draw { rest, latent };
        }
        let rest = choose(&self.weights, random.uniform());
        let latent = (0..self.latent_dim)
            .map(|_| self.config.spread * random.normal())
            .collect();
        Draw { rest, latent }
    }
}

/// Returns the object's resting orientations; upright at its lowest point if it has none.
pub(crate) fn rests(object: &Object) -> Vec<Rest> {
    if object.rests.is_empty() {
        let lowest = object
            .vertices_m
            .iter()
            .map(|[_, _, z]| *z)
            .fold(0.0, f64::min);
        return vec![Rest {
            up_in_object: nalgebra::Vector3::z_axis(),
            height_m: -lowest,
        }];
    }
    object
        .rests
        .iter()
        .map(|orientation| orientation.rest)
        .collect()
}

fn weights(rests: Rests, object: &Object, n: usize) -> Vec<f64> {
    let seen: Vec<f64> = object
        .rests
        .iter()
        .map(|rest| f64::from(rest.seen_n))
        .collect();
    let stable: Vec<f64> = object.rests.iter().map(|rest| rest.probability).collect();
    let usable = |weights: &[f64]| weights.iter().sum::<f64>() > 0.0;
    if rests == Rests::Seen && usable(&seen) {
        return seen;
    }
    if rests == Rests::Stable && usable(&stable) {
        return stable;
    }
    // The most probable one, the first among equals.
    let mut best = 0;
    for (idx, probability) in stable.iter().enumerate() {
        if *probability > stable[best] {
            best = idx;
        }
    }
    let mut weights = vec![0.0; n];
    if let Some(weight) = weights.get_mut(best) {
        *weight = 1.0;
    }
    weights
}

/// Returns the index in whose share of the total weight the number from `[0, 1)` falls.
fn choose(weights: &[f64], uniform: f64) -> usize {
    let mut left = uniform * weights.iter().sum::<f64>();
    let mut chosen = 0;
    for (idx, &weight) in weights.iter().enumerate() {
        if weight > 0.0 {
            chosen = idx;
            if left < weight {
                break;
            }
            left -= weight;
        }
    }
    chosen
}

fn nearest(rests: &[Rest], recorded: &Rest) -> usize {
    let agreement = |rest: &Rest| rest.up_in_object.dot(&recorded.up_in_object);
    rests
        .iter()
        .enumerate()
        .max_by(|(_, a), (_, b)| agreement(a).total_cmp(&agreement(b)))
        .map_or(0, |(idx, _)| idx)
}

#[cfg(test)]
mod tests {
    use super::choose;

    #[test]
    fn orientations_are_chosen_by_weight() {
        let check = |weights: &[f64], uniform: f64, expected: usize| {
            assert_eq!(choose(weights, uniform), expected, "{weights:?} {uniform}");
        };
        check(&[1.0], 0.99, 0);
        check(&[3.0, 1.0], 0.74, 0);
        check(&[3.0, 1.0], 0.76, 1);
        check(&[0.0, 2.0, 0.0], 0.0, 1);
        check(&[0.0, 2.0, 0.0], 0.999, 1);
    }
}
