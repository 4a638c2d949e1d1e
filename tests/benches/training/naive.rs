//! The same network as one writes it in candle's operations: a matrix product over all points of all
//! clouds, batch normalization over rows, a maximum over points, inputs put side by side.
//! Link poses and the contact are left out, which is in its favor.

use candle_core::{D, Device, Result, Tensor, Var};
use cgf::Random;

use crate::{CLOUDS, POINTS, contender::Server};

const FRAMES: usize = 25;
const SEEN: usize = 20;
const OUTPUTS: usize = 25;
const LATENT: usize = 256;

/// Does steps on request.
pub(crate) fn serve() {
    let mut model = Model::new().unwrap();
    let Some(mut server) = Server::ready() else {
        return;
    };
    loop {
        let loss = model.step().unwrap();
        if !server.answer(loss) {
            return;
        }
    }
}

/// A matrix with a bias, and Adam's moments of both.
struct Linear {
    weight: Learned,
    bias: Learned,
}

struct Learned {
    value: Var,
    moments: [Tensor; 2],
}

struct Model {
    random: Random,
    points: Vec<(Linear, Learned)>,
    hand: Vec<Linear>,
    trunk: Vec<Linear>,
    mean: Linear,
    log_variance: Linear,
    decoder: Vec<Linear>,
    steps: i32,
    clouds: Tensor,
    hands: Tensor,
    times: Tensor,
    targets: Tensor,
}

impl Model {
    fn new() -> Result<Self> {
        let mut random = Random::new(4, 0);
        let mut layers = |widths: &[usize]| -> Result<Vec<Linear>> {
            let pairs = widths.windows(2);
            pairs
                .map(|pair| Linear::new(pair[0], pair[1], &mut random))
                .collect()
        };
        let points = layers(&[3, 64, 128, 1024])?
            .into_iter()
            .map(|linear| {
                let gain = Learned::new(vec![1.0; linear.bias.value.elem_count()], 1)?;
                Ok((linear, gain))
            })
            .collect::<Result<Vec<_>>>()?;
        let hand = layers(&[22, 256, 256, 64])?;
        let trunk = layers(&[SEEN * 64 + 1024, 256, 256])?;
        let mut heads = layers(&[256, LATENT])?;
        heads.extend(layers(&[256, LATENT])?);
        let decoder = layers(&[1 + LATENT + 1024, 256, 512, 256, OUTPUTS])?;
        let (log_variance, mean) = (heads.pop().unwrap(), heads.pop().unwrap());
        Ok(Self {
            clouds: normal(&mut random, &[CLOUDS * POINTS, 3])?,
            hands: normal(&mut random, &[CLOUDS * SEEN, 22])?,
            times: normal(&mut random, &[CLOUDS * FRAMES, 1])?,
            targets: normal(&mut random, &[CLOUDS * FRAMES, OUTPUTS])?,
            random,
            points,
            hand,
            trunk,
            mean,
            log_variance,
            decoder,
            steps: 0,
        })
    }

    fn features(&self) -> Result<Tensor> {
        let mut x = self.clouds.clone();
        for (idx, (linear, gain)) in self.points.iter().enumerate() {
            let y = x.matmul(&linear.weight.value.t()?)?;
            let mean = y.mean_keepdim(0)?;
            let centered = y.broadcast_sub(&mean)?;
            let sigma = (centered.sqr()?.mean_keepdim(0)? + 1e-5)?.sqrt()?;
            x = centered
                .broadcast_div(&sigma)?
                .broadcast_mul(&gain.value)?
                .broadcast_add(&linear.bias.value)?;
            if idx + 1 < self.points.len() {
                x = x.relu()?;
            }
        }
        x.reshape((CLOUDS, POINTS, ()))?.max(1)
    }

    fn step(&mut self) -> Result<f32> {
        let features = self.features()?;
        let mut x = self.hands.clone();
        for (idx, linear) in self.hand.iter().enumerate() {
            x = linear.forward(&x)?;
            if idx + 1 < self.hand.len() {
                x = x.relu()?;
            }
        }
        let mut x = Tensor::cat(&[x.reshape((CLOUDS, ()))?, features.clone()], 1)?;
        for linear in &self.trunk {
            x = linear.forward(&x)?.relu()?;
        }
        let mean = self.mean.forward(&x)?;
        let log_variance = self.log_variance.forward(&x)?;
        let noise = normal(&mut self.random, &[CLOUDS, LATENT])?;
        let z = (&mean + ((&log_variance * 0.5)?.exp()? * noise)?)?;
        let repeated = |x: &Tensor| {
            let width = x.dim(D::Minus1)?;
            let all = x.unsqueeze(1)?.repeat((1, FRAMES, 1))?;
            all.reshape((CLOUDS * FRAMES, width))
        };
        let mut x = Tensor::cat(&[self.times.clone(), repeated(&z)?, repeated(&features)?], 1)?;
        for (idx, linear) in self.decoder.iter().enumerate() {
            x = linear.forward(&x)?;
            if idx + 1 < self.decoder.len() {
                x = x.relu()?;
            }
        }
        let q = (x - &self.targets)?.sqr()?.mean_all()?;
        let kl = (((mean.sqr()? + log_variance.exp()?)? - &log_variance)? - 1.0)?;
        let loss = (q + (kl.sum(1)?.mean_all()? * 5e-4)?)?;
        let gradients = loss.backward()?;
        self.steps += 1;
        let unbias = [0.9_f64, 0.999].map(|beta| 1.0 - beta.powi(self.steps));
        let linears = self.points.iter_mut().map(|(linear, _)| linear);
        let linears = linears
            .chain(&mut self.hand)
            .chain(&mut self.trunk)
            .chain([&mut self.mean, &mut self.log_variance])
            .chain(&mut self.decoder);
        let mut learned: Vec<&mut Learned> = Vec::new();
        for linear in linears {
            learned.extend([&mut linear.weight, &mut linear.bias]);
        }
        for learned in learned {
            if let Some(gradient) = gradients.get(&learned.value) {
                learned.step(gradient, unbias)?;
            }
        }
        loss.to_scalar()
    }
}

impl Linear {
    fn new(inputs: usize, outputs: usize, random: &mut Random) -> Result<Self> {
        let bound = (1.0 / inputs as f64).sqrt();
        let weight = numbers(inputs * outputs, || bound * (2.0 * random.uniform() - 1.0));
        Ok(Self {
            weight: Learned::new(weight, inputs)?,
            bias: Learned::new(vec![0.0; outputs], 1)?,
        })
    }

    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        x.matmul(&self.weight.value.t()?)?
            .broadcast_add(&self.bias.value)
    }
}

impl Learned {
    /// A matrix of rows of `width`, or a vector if `width` is 1.
    fn new(values: Vec<f32>, width: usize) -> Result<Self> {
        let n = values.len();
        let tensor = Tensor::from_vec(values, n, &Device::Cpu)?;
        let tensor = if width == 1 {
            tensor
        } else {
            tensor.reshape((n / width, width))?
        };
        Ok(Self {
            moments: [tensor.zeros_like()?, tensor.zeros_like()?],
            value: Var::from_tensor(&tensor)?,
        })
    }

    /// Adam.
    fn step(&mut self, gradient: &Tensor, unbias: [f64; 2]) -> Result<()> {
        let [m, v] = &self.moments;
        let m = ((m * 0.9)? + (gradient * 0.1)?)?;
        let v = ((v * 0.999)? + (gradient.sqr()? * 0.001)?)?;
        let step = ((&m / unbias[0])? / ((&v / unbias[1])?.sqrt()? + 1e-8)?)?;
        self.value.set(&(self.value.as_tensor() - (step * 5e-4)?)?)?;
        self.moments = [m.detach(), v.detach()];
        Ok(())
    }
}

fn normal(random: &mut Random, shape: &[usize]) -> Result<Tensor> {
    let values = numbers(shape.iter().product(), || random.normal());
    Tensor::from_vec(values, shape, &Device::Cpu)
}

fn numbers(n: usize, mut draw: impl FnMut() -> f64) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "tensors are `f32`")]
    (0..n).map(|_| draw() as f32).collect()
}
