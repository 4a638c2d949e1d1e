//! The encoder and the continuous decoder, on candle's tape (section III-B of the paper).

use candle_core::{Device, Tensor};

use crate::{
    CgfError, basis_points,
    config::{Activation, Initialization, LatentPrior, LatentVariance, NetworkConfig},
    dense_product::product,
    hand_numbers::PALM_WIDTH,
    point_net,
    precision::narrow,
    random::Random,
    weights::{WeightTensors, Weights, leaf},
};

/// Makes all numbers of a network for a hand of `dof` joints at random.
pub(crate) fn initialize(
    config: &NetworkConfig,
    dof: usize,
    initialization: Initialization,
    seed: u64,
) -> Weights {
    let mut weights = Weights::default();
    let mut random = Random::new(seed, 0);
    point_net::initialize(
        &mut weights,
        &config.point_widths,
        initialization,
        &mut random,
    );
    let feature = last(&config.point_widths);
    let mut layers = LinearLayers {
        weights: &mut weights,
        random: &mut random,
        initialization,
    };
    let inputs = config.encoder_inputs(dof);
    let hand = layers.stack("encoder.hand", &config.hand_widths, &[("weight", inputs)]);
    let motion = hand * config.encoder_steps;
    let trunk = layers.stack(
        "encoder.trunk",
        &config.encoder_widths,
        &[("motion", motion), ("feature", feature)],
    );
    for name in ["encoder.mean", "encoder.log_variance"] {
        layers.linear(name, config.latent_dim, &[("weight", trunk)]);
    }
    let inputs = [
        ("time", 1),
        ("latent", config.latent_dim),
        ("feature", feature),
    ];
    let decoder = layers.stack("decoder", &config.decoder_widths, &inputs);
    let name = format!("decoder.{}", config.decoder_widths.len());
    layers.linear(&name, PALM_WIDTH + dof, &[("weight", decoder)]);
    if initialization == Initialization::Centered {
        // Start near the mean of all motions.
        layers.weights.scale(&format!("{name}.weight"), 0.1);
    }
    if config.local_points > 0 {
        let local = config.latent_dim + basis_points::width(config.local_points, dof);
        let inputs = [("time", 1), ("latent", local), ("feature", feature)];
        let widest = layers.stack("local", &config.local_widths, &inputs);
        let name = format!("local.{}", config.local_widths.len());
        layers.linear(&name, PALM_WIDTH + dof, &[("weight", widest)]);
        if initialization == Initialization::Centered {
            layers.weights.scale(&format!("{name}.weight"), 0.1);
        }
        let zeros = vec![0.0; 3 * config.local_points];
        layers
            .weights
            .set(basis_points::NAME, &[config.local_points, 3], zeros);
    }
    if config.prior == LatentPrior::Flow {
        let widest = layers.stack("prior", &PRIOR_WIDTHS, &inputs);
        let name = format!("prior.{}", PRIOR_WIDTHS.len());
        layers.linear(&name, config.latent_dim, &[("weight", widest)]);
    }
    weights
}

/// Widths of the flow's hidden layers.
const PRIOR_WIDTHS: [usize; 2] = [256, 256];
/// Steps in which the flow is followed.
const FLOW_STEPS: u32 = 10;

/// Linear layers whose numbers are made at random, one after another.
struct LinearLayers<'a> {
    weights: &'a mut Weights,
    random: &'a mut Random,
    initialization: Initialization,
}

impl LinearLayers<'_> {
    /// Adds layers of these widths, each on the one before, the first with these inputs; returns the
    /// width of the last one.
    fn stack(&mut self, name: &str, widths: &[usize], inputs: &[(&str, usize)]) -> usize {
        let mut below = None;
        for (layer, &width) in widths.iter().enumerate() {
            let name = format!("{name}.{layer}");
            match below {
                None => self.linear(&name, width, inputs),
                Some(below) => self.linear(&name, width, &[("weight", below)]),
            }
            below = Some(width);
        }
        last(widths)
    }

    /// Adds a layer with a matrix for each named input of this width, and a bias.
    fn linear(&mut self, name: &str, width: usize, inputs: &[(&str, usize)]) {
        // All inputs of a layer together say how large its numbers are.
        let total: usize = inputs.iter().map(|(_, n)| n).sum();
        let bound = self.initialization.bound(total);
        for (input, n) in inputs {
            let input_bound = match self.initialization {
                Initialization::Centered => self.initialization.bound(*n),
                Initialization::Torch => bound,
            };
            let name = format!("{name}.{input}");
            self.weights
                .set_random(&name, &[width, *n], input_bound, self.random);
        }
        let name = format!("{name}.bias");
        match self.initialization {
            Initialization::Centered => self.weights.set_constant(&name, width, 0.0),
            Initialization::Torch => self.weights.set_random(&name, &[width], bound, self.random),
        }
    }
}

/// A part of the network that is a function of time.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Curve {
    /// The decoder, of latent codes.
    Decoder,
    /// The second decoder, of latent codes and the object as seen from the palm.
    Local,
    /// The flow's velocity, of its codes.
    Flow,
}

/// The parts of the network that live on the tape.
pub(crate) struct Network<'a> {
    pub(crate) config: &'a NetworkConfig,
    pub(crate) leaves: &'a WeightTensors,
}

impl Network<'_> {
    /// Encodes motions to mean and log-variance of their latent codes, `(batch, latent)` each.
    ///
    /// `motions` is `(batch, steps, outputs)`, `features` `(scenes, feature)`, and `scenes` says which
    /// of them belongs to each motion.
    pub(crate) fn encode(
        &self,
        motions: &Tensor,
        features: &Tensor,
        scenes: &Tensor,
    ) -> Result<(Tensor, Tensor), CgfError> {
        let (batch, steps, outputs) = motions.dims3()?;
        let mut x = motions.reshape((batch * steps, outputs))?;
        for layer in 0..self.config.hand_widths.len() {
            x = self.activate(&self.linear(&format!("encoder.hand.{layer}"), &x)?)?;
        }
        x = x.reshape((batch, ()))?;
        for layer in 0..self.config.encoder_widths.len() {
            let name = format!("encoder.trunk.{layer}");
            x = if layer == 0 {
                let motion = self.times(&name, "motion", &x)?;
                let feature = self.times(&name, "feature", features)?;
                let sum = (motion + feature.index_select(scenes, 0)?)?;
                sum.broadcast_add(self.leaf(&name, "bias")?)?
            } else {
                self.linear(&name, &x)?
            };
            x = self.activate(&x)?;
        }
        let mean = self.linear("encoder.mean", &x)?;
        let log_variance = self.linear("encoder.log_variance", &x)?;
        let log_variance = match self.config.latent_variance {
            LatentVariance::Free => log_variance,
            LatentVariance::BelowPrior => log_sigmoid(&log_variance)?,
        };
        Ok((mean, log_variance))
    }

    /// Takes numbers of the standard normal distribution `(batch, latent)` along the flow of the objects' features, by
    /// the midpoint rule.
    pub(crate) fn flowed(
        &self,
        noise: Tensor,
        features: &Tensor,
        scenes: &Tensor,
    ) -> Result<Tensor, CgfError> {
        let batch = noise.dim(0)?;
        let step = 1.0 / f64::from(FLOW_STEPS);
        let mut codes = noise;
        for number in 0..FLOW_STEPS {
            let at = |share: f64| {
                let time = narrow((f64::from(number) + share) * step);
                Tensor::full(time, (batch, 1), codes.device())
            };
            let slope = self.curve(Curve::Flow, &at(0.0)?, &codes, features, scenes)?;
            let middle = (&codes + (slope * (0.5 * step))?)?;
            let slope = self.curve(Curve::Flow, &at(0.5)?, &middle, features, scenes)?;
            codes = (codes + (slope * step)?)?;
        }
        Ok(codes)
    }

    /// Computes a part of the network that is a function of time, for codes of a row each and the objects' features:
    /// `(batch × n, outputs)` at `times` `(batch, n)`.
    ///
    /// The first layer's parts of the code and the object are computed once per motion, not per time.
    pub(crate) fn curve(
        &self,
        part: Curve,
        times: &Tensor,
        codes: &Tensor,
        features: &Tensor,
        scenes: &Tensor,
    ) -> Result<Tensor, CgfError> {
        let (name, hidden) = match part {
            Curve::Decoder => ("decoder", self.config.decoder_widths.len()),
            Curve::Local => ("local", self.config.local_widths.len()),
            Curve::Flow => ("prior", PRIOR_WIDTHS.len()),
        };
        let (batch, n) = times.dims2()?;
        let first = format!("{name}.0");
        let feature = self.times(&first, "feature", features)?;
        let motion = (self.times(&first, "latent", codes)? + feature.index_select(scenes, 0)?)?
            .broadcast_add(self.leaf(&first, "bias")?)?;
        let width = motion.dim(1)?;
        let time = product(
            &times.reshape((batch * n, 1))?,
            &self.leaf(&first, "time")?.t()?,
        )?;
        let mut x = time
            .reshape((batch, n, width))?
            .broadcast_add(&motion.unsqueeze(1)?)?
            .reshape((batch * n, width))?;
        for layer in 1..=hidden {
            x = self.linear(&format!("{name}.{layer}"), &self.activate(&x)?)?;
        }
        Ok(x)
    }

    fn activate(&self, x: &Tensor) -> Result<Tensor, CgfError> {
        Ok(match self.config.activation {
            Activation::Relu => x.relu()?,
            Activation::Silu => x.silu()?,
        })
    }

    fn linear(&self, name: &str, x: &Tensor) -> Result<Tensor, CgfError> {
        Ok(self
            .times(name, "weight", x)?
            .broadcast_add(self.leaf(name, "bias")?)?)
    }

    fn times(&self, name: &str, input: &str, x: &Tensor) -> Result<Tensor, CgfError> {
        Ok(product(x, &self.leaf(name, input)?.t()?)?)
    }

    fn leaf(&self, name: &str, input: &str) -> Result<&Tensor, CgfError> {
        leaf(self.leaves, &format!("{name}.{input}"))
    }
}

/// `ln(1 / (1 + exp(−x)))`, from parts of which none overflows.
pub(crate) fn log_sigmoid(x: &Tensor) -> Result<Tensor, CgfError> {
    let below = (x.neg()?.relu()? * -1.0)?;
    let near = (x.abs()?.neg()?.exp()? + 1.0)?.log()?;
    Ok((below - near)?)
}

/// Returns a constant on the CPU from numbers, the last dimension fastest.
pub(crate) fn constant(values: Vec<f32>, shape: &[usize]) -> Result<Tensor, CgfError> {
    Ok(Tensor::from_vec(values, shape, &Device::Cpu)?)
}

fn last(widths: &[usize]) -> usize {
    widths.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::{constant, log_sigmoid};

    #[test]
    fn variances_stay_below_the_priors_without_overflow() {
        let xs = [-100.0, -3.0, 0.0, 3.0, 100.0];
        let logs = log_sigmoid(&constant(xs.to_vec(), &[5]).unwrap()).unwrap();
        for (x, log) in xs.iter().zip(logs.to_vec1::<f32>().unwrap()) {
            let expected = -(-f64::from(*x)).exp().ln_1p();
            assert!(
                (f64::from(log) - expected).abs() < 1e-5 * expected.abs() + 1e-6,
                "{x}: {log}"
            );
            assert!(log <= 0.0);
        }
    }
}
