//! Orientation and latent code of each motion.

use cgf::{Cgf, EncodedDemonstration, Random};
use nalgebra::{Unit, Vector3};
use schemas::{
    candidates::{DrawSource, ObjectSplit, Origin},
    objects::Object,
    training::Split,
};
use spatial::RestingPose;

use crate::{
    SampleError,
    config::{RestingPoses, SampleConfig},
};

/// Resting orientation and code from which one motion is decoded.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Draw {
    /// Index of the object's resting orientation.
    pub(crate) rest: usize,
    /// The latent code.
    pub(crate) latent: Vec<f64>,
    /// Origin of the code.
    pub(crate) source: DrawSource,
}

/// The ways of drawing motions for one object.
pub(crate) struct Source<'a> {
    config: &'a SampleConfig,
    latent_dim: usize,
    /// Demonstrations about which codes are drawn, each with the orientation in which it lay; none for
    /// one of another object.
    demonstrations: Vec<(Option<usize>, &'a EncodedDemonstration)>,
    /// The two between which codes go, if they are not drawn.
    path: Option<[(Option<usize>, &'a EncodedDemonstration); 2]>,
    /// Weight of each orientation.
    weights: Vec<f64>,
    object_split: ObjectSplit,
}

impl<'a> Source<'a> {
    /// `rests` are the object's resting orientations as [`rests`] returns them.
    ///
    /// # Errors
    ///
    /// Fails if the function knows no demonstration of a name in the configuration.
    pub(crate) fn new(
        config: &'a SampleConfig,
        cgf: &'a Cgf,
        object: &Object,
        rests: &[RestingPose],
    ) -> Result<Self, SampleError> {
        let description = cgf.description();
        let all = &description.demonstrations;
        let with_rest = |demonstration: &'a EncodedDemonstration| {
            let is_own = demonstration.object == object.name;
            let nearest = || demonstration.rest().nearest(rests.iter().copied());
            let rest = is_own.then(|| nearest().map_or(0, |(idx, _)| idx));
            (rest, demonstration)
        };
        let named = |name: &String| {
            let found = all.iter().find(|demonstration| demonstration.name == *name);
            found
                .map(with_rest)
                .ok_or_else(|| SampleError::UnknownDemonstration {
                    name: name.clone(),
                    known: all.iter().map(|known| known.name.clone()).collect(),
                })
        };
        let demonstrations = if config.demonstrations.is_empty() {
            let learned = all.iter().filter(|known| known.split == Split::Training);
            let own = learned.map(with_rest);
            own.filter(|(rest, _)| rest.is_some()).collect()
        } else {
            let wanted = config.demonstrations.iter();
            wanted.map(named).collect::<Result<_, _>>()?
        };
        let is_learned = |known: &EncodedDemonstration| {
            known.split == Split::Training && known.object == object.name
        };
        let path = match config.path.as_slice() {
            [from, to] => Some([named(from)?, named(to)?]),
            _ => None,
        };
        let object_split = if all.iter().any(is_learned) {
            ObjectSplit::Seen
        } else {
            ObjectSplit::Unseen
        };
        let orientations = match (config.rests, object_split) {
            // Nothing is known of the recordings of an unseen object.
            (RestingPoses::Seen, ObjectSplit::Unseen) => RestingPoses::Stable,
            (chosen, _) => chosen,
        };
        Ok(Self {
            config,
            latent_dim: description.network.latent_dim,
            demonstrations,
            path,
            weights: weights(orientations, object, rests.len()),
            object_split,
        })
    }

    /// Draws motion `number` of the object for the `draw_n`th time, from 1.
    pub(crate) fn draw(&self, number: usize, draw_n: u32, random: &mut Random) -> Draw {
        let source = |origin: Origin, demonstration: &str| DrawSource {
            draw_n,
            origin,
            demonstration: demonstration.to_owned(),
            object_split: Some(self.object_split),
        };
        if let Some(path) = &self.path {
            let (rest, latent) = self.along(path, number);
            return Draw {
                rest,
                latent,
                source: source(Origin::Path, &path[0].1.name),
            };
        }
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
            let rest = rest.unwrap_or_else(|| choose(&self.weights, random.uniform()));
            return Draw {
                rest,
                latent,
                source: source(Origin::Posterior, &demonstration.name),
            };
        }
        let rest = choose(&self.weights, random.uniform());
        let latent = (0..self.latent_dim)
            .map(|_| self.config.spread * random.normal())
            .collect();
        Draw {
            rest,
            latent,
            source: source(Origin::Prior, ""),
        }
    }

    /// Returns an orientation and the code that is as far along the line from the first demonstration's mean to the
    /// second's as the number is among the motions; the object lies as in the first, or as most
    /// often if that is of another object.
    fn along(
        &self,
        path: &[(Option<usize>, &EncodedDemonstration); 2],
        number: usize,
    ) -> (usize, Vec<f64>) {
        let [(rest, from), (_, to)] = path;
        let last = self.config.per_object.saturating_sub(1).max(1);
        let share = number as f64 / last as f64;
        let means = from.latent_mean.iter().zip(&to.latent_mean);
        let latent = means.map(|(from, to)| (1.0 - share) * from + share * to);
        let rest = rest.unwrap_or_else(|| heaviest(&self.weights));
        (rest, latent.collect())
    }
}

/// Returns the object's resting orientations: the one that is given; else its own, or upright on its
/// lowest point if it has none.
pub(crate) fn rests(config: &SampleConfig, object: &Object) -> Vec<RestingPose> {
    if let (RestingPoses::Given, Some(up)) = (config.rests, config.rest_up) {
        return vec![on_lowest_point(object, Unit::new_normalize(up.into()))];
    }
    if object.rests.is_empty() {
        return vec![on_lowest_point(object, Vector3::z_axis())];
    }
    object
        .rests
        .iter()
        .map(|orientation| orientation.rest)
        .collect()
}

/// Puts the mesh's lowest point on the table.
fn on_lowest_point(object: &Object, up_in_object: Unit<Vector3<f64>>) -> RestingPose {
    let vertices = object.vertices_m.iter();
    let heights = vertices.map(|&vertex| up_in_object.dot(&Vector3::from(vertex)));
    let lowest = heights.min_by(f64::total_cmp).unwrap_or(0.0);
    RestingPose {
        up_in_object,
        height_m: -lowest,
    }
}

fn weights(rests: RestingPoses, object: &Object, n: usize) -> Vec<f64> {
    if rests == RestingPoses::Given || object.rests.is_empty() {
        return vec![1.0; n];
    }
    let seen: Vec<f64> = object
        .rests
        .iter()
        .map(|rest| f64::from(rest.seen_n))
        .collect();
    let stable: Vec<f64> = object.rests.iter().map(|rest| rest.probability).collect();
    let usable = |weights: &[f64]| weights.iter().sum::<f64>() > 0.0;
    if rests == RestingPoses::Seen && usable(&seen) {
        return seen;
    }
    if rests == RestingPoses::Stable && usable(&stable) {
        return stable;
    }
    let mut weights = vec![0.0; n];
    if let Some(weight) = weights.get_mut(heaviest(&stable)) {
        *weight = 1.0;
    }
    weights
}

/// Returns the index of the greatest weight, the first among equals.
fn heaviest(weights: &[f64]) -> usize {
    let mut best = 0;
    for (idx, weight) in weights.iter().enumerate() {
        if *weight > weights[best] {
            best = idx;
        }
    }
    best
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
        check(&[1.0, 1.0, 2.0], 0.3, 1);
        check(&[0.0, 2.0, 0.0], 0.0, 1);
        check(&[0.0, 2.0, 0.0], 0.999, 1);
    }
}
