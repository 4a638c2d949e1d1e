//! Orientation and latent code of each motion.

use cgf::{Cgf, EncodedDemonstration, Random};
use nalgebra::{Unit, Vector3};
use spatial::RestingPose;

use crate::{Orientations, SampledObject, SamplingError, SamplingOptions};

/// Origin of a latent code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CodeOrigin {
    /// The function's prior.
    Prior,
    /// The posterior of a demonstration.
    Posterior {
        /// Its name.
        demonstration: String,
    },
    /// The line between the means of two demonstrations.
    Path {
        /// Name of the first.
        from: String,
    },
}

/// Resting orientation and latent code from which one motion is decoded.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Code {
    /// Which draw of its motion it is, from 1.
    pub(crate) draw_n: u32,
    /// Index of the object's resting orientation.
    pub(crate) rest: usize,
    /// The latent code.
    pub(crate) latent: Vec<f64>,
    /// Origin of the code.
    pub(crate) origin: CodeOrigin,
}

/// The source of codes for one object.
pub(crate) struct CodeSource<'a> {
    options: &'a SamplingOptions,
    latent_dim: usize,
    /// Demonstrations about which codes are drawn, each with the orientation in which it lay; none for
    /// one of another object.
    demonstrations: Vec<(Option<usize>, &'a EncodedDemonstration)>,
    /// The two between which codes go, if they are not drawn.
    path: Option<[(Option<usize>, &'a EncodedDemonstration); 2]>,
    /// Weight of each orientation.
    weights: Vec<f64>,
}

impl<'a> CodeSource<'a> {
    /// `rests` are the object's resting orientations as [`rests`] returns them.
    ///
    /// # Errors
    ///
    /// Fails if the function knows no demonstration of a name in the options.
    pub(crate) fn new(
        options: &'a SamplingOptions,
        cgf: &'a Cgf,
        object: &SampledObject<'_>,
        rests: &[RestingPose],
    ) -> Result<Self, SamplingError> {
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
                .ok_or_else(|| SamplingError::UnknownDemonstration {
                    name: name.clone(),
                    known: all.iter().map(|known| known.name.clone()).collect(),
                })
        };
        let demonstrations = if options.demonstrations.is_empty() {
            let learned = all.iter().filter(|known| known.is_learned());
            let own = learned.map(with_rest);
            own.filter(|(rest, _)| rest.is_some()).collect()
        } else {
            let wanted = options.demonstrations.iter();
            wanted.map(named).collect::<Result<_, _>>()?
        };
        let path = match &options.path {
            Some([from, to]) => Some([named(from)?, named(to)?]),
            None => None,
        };
        let orientations = match options.orientations {
            // Nothing is known of the recordings of an unseen object.
            Orientations::Seen if !is_learned(cgf, object) => Orientations::Stable,
            chosen => chosen,
        };
        Ok(Self {
            options,
            latent_dim: description.network.latent_dim,
            demonstrations,
            path,
            weights: weights(orientations, object, rests.len()),
        })
    }

    /// Draws motion `number` of the object for the `draw_n`th time, from 1.
    pub(crate) fn draw(&self, number: usize, draw_n: u32, random: &mut Random) -> Code {
        let (rest, latent, origin) = self.code(number, random);
        Code {
            draw_n,
            rest,
            latent,
            origin,
        }
    }

    fn code(&self, number: usize, random: &mut Random) -> (usize, Vec<f64>, CodeOrigin) {
        if let Some(path) = &self.path {
            let (rest, latent) = self.along(path, number);
            let from = path[0].1.name.clone();
            return (rest, latent, CodeOrigin::Path { from });
        }
        let spread = self.options.spread;
        let about_demonstration = random.uniform() < self.options.posterior_share;
        if about_demonstration && !self.demonstrations.is_empty() {
            let (rest, demonstration) =
                self.demonstrations[random.index(self.demonstrations.len())];
            let latent = demonstration
                .latent_mean
                .iter()
                .zip(&demonstration.latent_deviation)
                .map(|(mean, deviation)| mean + spread * deviation * random.normal())
                .collect();
            let rest = rest.unwrap_or_else(|| choose(&self.weights, random.uniform()));
            let demonstration = demonstration.name.clone();
            return (rest, latent, CodeOrigin::Posterior { demonstration });
        }
        let rest = choose(&self.weights, random.uniform());
        let latent = (0..self.latent_dim).map(|_| spread * random.normal());
        (rest, latent.collect(), CodeOrigin::Prior)
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
        let last = self.options.n.saturating_sub(1).max(1);
        let share = number as f64 / last as f64;
        let means = from.latent_mean.iter().zip(&to.latent_mean);
        let latent = means.map(|(from, to)| (1.0 - share) * from + share * to);
        let rest = rest.unwrap_or_else(|| heaviest(&self.weights));
        (rest, latent.collect())
    }
}

/// Says whether the function was trained on motions to the object.
pub(crate) fn is_learned(cgf: &Cgf, object: &SampledObject<'_>) -> bool {
    cgf.description().objects.contains(object.name)
}

/// Returns the object's resting orientations: the one that is given; else its own, or upright on its
/// lowest point if it has none.
pub(crate) fn rests(options: &SamplingOptions, object: &SampledObject<'_>) -> Vec<RestingPose> {
    if let Orientations::Given(up) = options.orientations {
        return vec![on_lowest_point(object, up)];
    }
    if object.orientations.is_empty() {
        return vec![on_lowest_point(object, Vector3::z_axis())];
    }
    let own = object.orientations.iter();
    own.map(|orientation| orientation.rest).collect()
}

/// Puts the mesh's lowest point on the table.
fn on_lowest_point(object: &SampledObject<'_>, up_in_object: Unit<Vector3<f64>>) -> RestingPose {
    let vertices = object.vertices_m.iter();
    let heights = vertices.map(|&vertex| up_in_object.dot(&Vector3::from(vertex)));
    let lowest = heights.min_by(f64::total_cmp).unwrap_or(0.0);
    RestingPose {
        up_in_object,
        height_m: -lowest,
    }
}

fn weights(orientations: Orientations, object: &SampledObject<'_>, n: usize) -> Vec<f64> {
    let own = &object.orientations;
    if matches!(orientations, Orientations::Given(_)) || own.is_empty() {
        return vec![1.0; n];
    }
    let seen: Vec<f64> = own.iter().map(|rest| f64::from(rest.seen_n)).collect();
    let stable: Vec<f64> = own.iter().map(|rest| rest.probability).collect();
    let usable = |weights: &[f64]| weights.iter().sum::<f64>() > 0.0;
    if matches!(orientations, Orientations::Seen | Orientations::Recorded) && usable(&seen) {
        return seen;
    }
    if orientations == Orientations::Stable && usable(&stable) {
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
