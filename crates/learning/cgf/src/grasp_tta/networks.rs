//! The two networks: one generates a grasp for an object, the other predicts its contact map on the object.

use std::sync::Arc;

use candle_core::Tensor;
use motion::HandState;
use spatial::Table;

use super::{
    GraspDescription, GraspNetworkConfig, HandSurface,
    loss::contact_map,
    nearest::{Cloud, Nearest},
    surface::PlacedSurface,
};
use crate::{
    CgfError, RestingObject,
    config::{Initialization, InputFrame},
    data::View,
    dense_product::product,
    hand_numbers,
    network::{constant, log_sigmoid},
    point_net::{self, Clouds, Measured, Statistics},
    precision::{narrow, narrow_all},
    random::Random,
    weights::{WeightTensors, Weights, leaf},
};

/// The point networks: of object and hand for the generator, and of both for the contact network.
pub(crate) const GENERATOR_NETS: [&str; 2] = ["object.", "hand."];
pub(crate) const CONTACT_NETS: [&str; 2] = ["contact.object.", "contact.hand."];
/// Numbers that the contact network sees of each point of the object.
const POINT_INPUTS: usize = 7;
/// Units of places, and of the way to the nearest point of the hand, in these numbers, in meters.
const PLACE_M: f64 = 0.1;
const WAY_M: f64 = 0.02;
/// Longest such way along an axis, in its unit: farther points count as untouched.
const FAR: f64 = 3.0;
/// Factor on the decoder's last layer, so that a training begins near the mean of all grasps.
const SMALL: f32 = 0.1;

/// Both networks with everything that is needed to use them.
#[derive(Debug, Clone)]
pub struct GraspNetworks {
    pub(crate) description: GraspDescription,
    pub(crate) weights: Weights,
    leaves: WeightTensors,
}

/// An object as both networks see it.
pub(crate) struct SeenObject {
    pub(crate) name: String,
    /// Points of its surface above the table.
    pub(crate) points: Cloud,
    /// `(1, feature)`, the generator's and the contact network's.
    features: [Tensor; 2],
}

/// Makes all numbers of both networks at random, for hands of so many numbers.
pub(crate) fn initialize(config: &GraspNetworkConfig, outputs: usize, seed: u64) -> Weights {
    let mut weights = Weights::default();
    let mut random = Random::new(seed, 0);
    for prefix in GENERATOR_NETS.into_iter().chain(CONTACT_NETS) {
        let mut net = Weights::default();
        let widths = &config.point_widths;
        point_net::initialize(&mut net, widths, Initialization::Centered, &mut random);
        weights.add_part(prefix, net);
    }
    let feature = config.point_widths.last().copied().unwrap_or(0);
    let mut linear = |name: &str, width: usize, inputs: &[(&str, usize)]| {
        for (input, n) in inputs {
            let bound = Initialization::Centered.bound(*n);
            weights.set_random(&format!("{name}.{input}"), &[width, *n], bound, &mut random);
        }
        weights.set_constant(&format!("{name}.bias"), width, 0.0);
    };
    let mut below = 2 * feature;
    for (layer, &width) in config.encoder_widths.iter().enumerate() {
        linear(&format!("encoder.{layer}"), width, &[("weight", below)]);
        below = width;
    }
    for name in ["encoder.mean", "encoder.log_variance"] {
        linear(name, config.latent_dim, &[("weight", below)]);
    }
    below = config.latent_dim + feature;
    for (layer, &width) in config.decoder_widths.iter().enumerate() {
        linear(&format!("decoder.{layer}"), width, &[("weight", below)]);
        below = width;
    }
    linear("decoder.hand", outputs, &[("weight", below)]);
    below = POINT_INPUTS;
    for (layer, &width) in config.contact_widths.iter().enumerate() {
        let name = format!("contact.{layer}");
        if layer == 1 {
            let inputs = [("weight", below), ("object", feature), ("hand", feature)];
            linear(&name, width, &inputs);
        } else {
            linear(&name, width, &[("weight", below)]);
        }
        below = width;
    }
    linear("contact.value", 1, &[("weight", below)]);
    weights.scale("decoder.hand.weight", SMALL);
    weights
}

/// Returns the contact network's inputs at each point of an object, `(points, 7)`: its place, the way to the hand's
/// nearest point, and the contact map of the current hand.
pub(crate) fn point_inputs(
    object: &Cloud,
    hand: &PlacedSurface<'_>,
    nearest: &[Nearest],
    map: &[f64],
) -> Vec<f32> {
    let mut inputs = Vec::with_capacity(POINT_INPUTS * object.len());
    for (idx, (near, contact)) in nearest.iter().zip(map).enumerate() {
        let place = object.point(idx).map(f64::from);
        let touching = &hand.points[near.idx as usize];
        inputs.extend(place.map(|x| narrow(x / PLACE_M)));
        let way = (0..3).map(|axis| (touching[axis] - place[axis]) / WAY_M);
        inputs.extend(way.map(|x| narrow(x.clamp(-FAR, FAR))));
        inputs.push(narrow(*contact));
    }
    inputs
}

/// Returns a hand's surface as a cloud's numbers.
pub(crate) fn hand_cloud(hand: &PlacedSurface<'_>) -> Vec<f32> {
    hand.narrowed().concat()
}

impl GraspNetworks {
    pub(crate) fn new(description: GraspDescription, weights: Weights) -> Result<Self, CgfError> {
        Ok(Self {
            leaves: weights.constants()?,
            description,
            weights,
        })
    }

    /// Returns everything but the weights.
    pub fn description(&self) -> &GraspDescription {
        &self.description
    }

    fn tape(&self) -> Tape<'_> {
        Tape {
            config: &self.description.network,
            leaves: &self.leaves,
        }
    }

    /// Prepares an object in its resting pose for both networks.
    pub(crate) fn seen(&self, object: &RestingObject) -> Result<SeenObject, CgfError> {
        let points = self.description.network.points;
        let view = View::of(object, InputFrame::Resting)?;
        let xyz = view.cloud(points, &nalgebra::UnitQuaternion::identity());
        let points_cloud = Cloud::new(&xyz);
        let clouds = Arc::new(Clouds { points, xyz });
        let feature = |prefix: &str| {
            let (features, _) = self.tape().features(prefix, &clouds, Statistics::Stored)?;
            Ok::<_, CgfError>(features)
        };
        Ok(SeenObject {
            name: object.object.clone(),
            points: points_cloud,
            features: [feature(GENERATOR_NETS[0])?, feature(CONTACT_NETS[0])?],
        })
    }

    /// Decodes a latent code: the hand's numbers in meters and radians.
    pub(crate) fn decode(&self, object: &SeenObject, latent: &[f64]) -> Result<Vec<f32>, CgfError> {
        let latent = constant(narrow_all(latent), &[1, latent.len()])?;
        let decoded = self.tape().decode(&latent, &object.features[0])?;
        let decoded = decoded.flatten_all()?.to_vec1::<f32>()?;
        let units = &self.description.normalization;
        let units = units.mean.iter().zip(&units.scale);
        let numbers = decoded.iter().zip(units);
        Ok(numbers
            .map(|(x, (mean, scale))| narrow(f64::from(*x) * scale + mean))
            .collect())
    }

    /// Predicts where a hand should touch: a contact value for each point of the object, of which the largest is 1.
    pub(crate) fn predicted_map(
        &self,
        object: &SeenObject,
        surface: &HandSurface,
        row: &[f32],
    ) -> Result<Vec<f32>, CgfError> {
        let hand = surface.placed(row);
        let (nearest, map) = contact_map(&object.points, &hand);
        let inputs = point_inputs(&object.points, &hand, &nearest, &map);
        let inputs = constant(inputs, &[object.points.len(), POINT_INPUTS])?;
        let clouds = Arc::new(Clouds {
            points: surface.len(),
            xyz: hand_cloud(&hand),
        });
        let tape = self.tape();
        let (hand, _) = tape.features(CONTACT_NETS[1], &clouds, Statistics::Stored)?;
        let map = tape.contact_map(&inputs, &object.features[1], &hand)?;
        let map = map.flatten_all()?.to_vec1::<f32>()?;
        let most = map.iter().fold(f32::MIN_POSITIVE, |most, x| most.max(*x));
        Ok(map.into_iter().map(|x| x / most).collect())
    }

    /// Returns the hand of numbers in meters and radians.
    pub(crate) fn hand_of(object: &str, row: &[f32]) -> Result<HandState<Table>, CgfError> {
        let numbers: Vec<f64> = row.iter().copied().map(f64::from).collect();
        let hand = hand_numbers::to_hand(&numbers);
        let finite = numbers.iter().all(|x| x.is_finite());
        hand.filter(|_| finite).ok_or_else(|| CgfError::NotFinite {
            name: object.to_owned(),
            what: "a sampled hand",
        })
    }
}

/// The networks on a tape.
pub(crate) struct Tape<'a> {
    pub(crate) config: &'a GraspNetworkConfig,
    pub(crate) leaves: &'a WeightTensors,
}

impl Tape<'_> {
    /// Computes the features of clouds, `(clouds, feature)`, by one of the point networks, and the statistics that it
    /// measured, by the arrays' names.
    pub(crate) fn features(
        &self,
        prefix: &str,
        clouds: &Arc<Clouds>,
        statistics: Statistics,
    ) -> Result<(Tensor, Measured), CgfError> {
        let own = self.leaves.iter().filter_map(|(name, tensor)| {
            let name = name.strip_prefix(prefix)?;
            Some((name.to_owned(), tensor.clone()))
        });
        let n_layers = self.config.point_widths.len();
        let (features, measured) =
            point_net::features(&own.collect(), n_layers, clouds, statistics)?;
        let named = measured.into_iter();
        let named = named.map(|(name, values)| (format!("{prefix}{name}"), values));
        Ok((features, named.collect()))
    }

    /// Encodes grasps from the features of object and hand: mean and log-variance of their latent codes, `(batch,
    /// latent)` each. A variance is never above the prior's.
    pub(crate) fn encode(
        &self,
        object: &Tensor,
        hand: &Tensor,
    ) -> Result<(Tensor, Tensor), CgfError> {
        let mut x = Tensor::cat(&[object, hand], 1)?;
        for layer in 0..self.config.encoder_widths.len() {
            x = self.linear(&format!("encoder.{layer}"), &x)?.relu()?;
        }
        let mean = self.linear("encoder.mean", &x)?;
        let log_variance = log_sigmoid(&self.linear("encoder.log_variance", &x)?)?;
        Ok((mean, log_variance))
    }

    /// Decodes latent codes, `(batch, latent)`, for objects, `(batch, feature)`: `(batch, outputs)`, in the network's
    /// units.
    pub(crate) fn decode(&self, latents: &Tensor, object: &Tensor) -> Result<Tensor, CgfError> {
        let mut x = Tensor::cat(&[latents, object], 1)?;
        for layer in 0..self.config.decoder_widths.len() {
            x = self.linear(&format!("decoder.{layer}"), &x)?.relu()?;
        }
        self.linear("decoder.hand", &x)
    }

    /// Predicts contact maps, `(batch, points)`, from the inputs at the points, `(batch × points, 7)`, and the
    /// features of objects and hands, `(batch, feature)` each.
    pub(crate) fn contact_map(
        &self,
        points: &Tensor,
        object: &Tensor,
        hand: &Tensor,
    ) -> Result<Tensor, CgfError> {
        let batch = object.dim(0)?;
        let n_points = points.dim(0)? / batch;
        let mut x = self.linear("contact.0", points)?.relu()?;
        for layer in 1..self.config.contact_widths.len() {
            let name = format!("contact.{layer}");
            x = self.linear(&name, &x)?;
            if layer == 1 {
                let whole =
                    (self.times(&name, "object", object)? + self.times(&name, "hand", hand)?)?;
                let width = whole.dim(1)?;
                x = x
                    .reshape((batch, n_points, width))?
                    .broadcast_add(&whole.unsqueeze(1)?)?
                    .reshape((batch * n_points, width))?;
            }
            x = x.relu()?;
        }
        let value = self.linear("contact.value", &x)?;
        // The logistic function, from one that does not overflow.
        let map = (((value * 0.5)?.tanh()? + 1.0)? * 0.5)?;
        Ok(map.reshape((batch, n_points))?)
    }

    fn linear(&self, name: &str, x: &Tensor) -> Result<Tensor, CgfError> {
        let bias = leaf(self.leaves, &format!("{name}.bias"))?;
        Ok(self.times(name, "weight", x)?.broadcast_add(bias)?)
    }

    fn times(&self, name: &str, input: &str, x: &Tensor) -> Result<Tensor, CgfError> {
        let weight = leaf(self.leaves, &format!("{name}.{input}"))?;
        Ok(product(x, &weight.t()?)?)
    }
}
