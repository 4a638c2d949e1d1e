//! Backward through the maximum and the last layer: a sparse part at the points that attain a maximum
//! and, where the statistics were measured, a part of the rank of the layer's input at all points.

use pulp::Arch;
use rayon::prelude::*;

use super::{Descent, Place, Running};
use crate::{
    point_net::{
        EPSILON, LayerGradient, LayerStack,
        cloud::Cloud,
        moments::{Axpy, Moments},
    },
    precision::{narrow, narrow_all, row_index},
    product::{LANES, PackedMatrix, Row, Sparse, project},
};

/// The gradient by the last layer's input.
pub(super) struct Top {
    critical: Vec<Critical>,
    dense: Option<Dense>,
}

/// The points of one cloud that attain a maximum.
struct Critical {
    /// Their numbers, in order.
    points: Vec<u32>,
    /// Index into `points` of the maximum of each output.
    slots: Vec<usize>,
    /// Gradient by the last layer's input at each of them, without the dense part.
    by: Vec<f32>,
}

/// The dense part at a point `x`: `offset − K x`.
struct Dense {
    /// `−K`.
    kernel: PackedMatrix,
    offset: Vec<f32>,
}

/// Values per output of the last layer that all clouds share: gradients by gain and shift, inverse
/// standard deviation, scale.
struct Outputs {
    by_gain: Vec<f64>,
    by_shift: Vec<f64>,
    inverse: Vec<f64>,
    scale: Vec<f64>,
}

impl Top {
    /// Returns the gradient by the last layer's input, and that by the layer's own numbers; `moments`
    /// are of its input, where statistics were measured.
    pub(super) fn new(
        layer_stack: &LayerStack,
        clouds: &[Cloud],
        moments: Option<&Moments>,
        by_features: &[f32],
    ) -> (Self, LayerGradient) {
        let idx = layer_stack.layers.len() - 1;
        let layer = &layer_stack.layers[idx];
        let (inputs, outputs) = (layer.inputs, layer.outputs);
        let sums = Outputs::new(layer_stack, clouds, by_features);
        let scale = narrow_all(&sums.scale);
        let (critical, rows): (Vec<Critical>, Vec<Vec<f32>>) = clouds
            .par_iter()
            .zip(by_features.par_chunks_exact(outputs))
            .map(|(cloud, by)| {
                let mut critical = Critical::of(cloud);
                critical.by = vec![0.0; critical.points.len() * inputs];
                for (c, &slot) in critical.slots.iter().enumerate() {
                    let by = by[c] * scale[c];
                    let weight = &layer.weight[c * inputs..(c + 1) * inputs];
                    let sums = &mut critical.by[slot * inputs..(slot + 1) * inputs];
                    for (sum, &w) in sums.iter_mut().zip(weight) {
                        *sum += by * w;
                    }
                }
                let rows = critical.inputs(layer_stack, idx, cloud);
                (critical, rows)
            })
            .unzip();
        let mut by_weight = vec![0.0_f64; outputs * inputs];
        by_weight
            .par_chunks_exact_mut(inputs)
            .enumerate()
            .for_each(|(c, by_weight)| {
                let of_clouds = critical.iter().zip(&rows);
                for ((critical, rows), by) in of_clouds.zip(by_features.chunks_exact(outputs)) {
                    let by = f64::from(by[c]) * sums.scale[c];
                    let x = &rows[critical.slots[c] * inputs..];
                    for (sum, &x) in by_weight.iter_mut().zip(x) {
                        *sum += by * f64::from(x);
                    }
                }
                if let Some(moments) = moments {
                    // − scale (Σ g) mean(x) − scale (Σ g y') mean(y' x), the last being Cov w / sigma.
                    let weight = &layer.weight[c * inputs..(c + 1) * inputs];
                    let (_, _, covariance) = moments.of_product(weight);
                    let constant = sums.scale[c] * sums.by_shift[c];
                    let slope = sums.scale[c] * sums.by_gain[c] * sums.inverse[c];
                    for ((sum, mean), along) in
                        by_weight.iter_mut().zip(&moments.mean).zip(&covariance)
                    {
                        *sum -= constant * mean + slope * along;
                    }
                }
            });
        let dense = moments.map(|moments| Dense::new(layer_stack, &sums, moments));
        let gradient = [
            narrow_all(&by_weight),
            narrow_all(&sums.by_gain),
            narrow_all(&sums.by_shift),
        ];
        (Self { critical, dense }, gradient)
    }

    /// Takes the gradient down one cloud to the output of the layer below the last.
    pub(super) fn descend(
        &self,
        layer_stack: &LayerStack,
        below: usize,
        cloud: &Cloud,
        number: usize,
    ) -> Descent {
        let width = layer_stack.layers[below].outputs;
        let critical = &self.critical[number];
        let mut running = Running::new(&layer_stack.layers[below], below);
        let kept = if below > 0 {
            cloud.patches() * width
        } else {
            0
        };
        let mut down = Vec::with_capacity(kept);
        let mut x = vec![[0.0; LANES]; width];
        let mut g = vec![[0.0; LANES]; width];
        let mut sparse = Sparse::default();
        let mut points = critical
            .points
            .iter()
            .zip(critical.by.chunks_exact(width))
            .peekable();
        for patch in 0..cloud.patches() {
            cloud.input(layer_stack, below + 1, patch, &mut x);
            if let Some(dense) = &self.dense {
                sparse.take(&x);
                let alone = std::slice::from_ref(&sparse);
                project(&dense.kernel, alone, &dense.offset, &mut g);
            } else {
                g.fill([0.0; LANES]);
            }
            let end = row_index((patch + 1) * LANES);
            while let Some((&point, by)) = points.next_if(|&(&point, _)| point < end) {
                let lane = point as usize % LANES;
                for (g, by) in g.iter_mut().zip(by) {
                    g[lane] += by;
                }
            }
            let place = Place::new(layer_stack, below, cloud, patch);
            running.absorb(&place, &x, &mut g);
            if below > 0 {
                down.extend_from_slice(&g);
            }
        }
        Descent {
            by: down,
            sums: running.finish(),
            by_weight: Vec::new(),
        }
    }
}

impl Outputs {
    fn new(layer_stack: &LayerStack, clouds: &[Cloud], by_features: &[f32]) -> Self {
        let idx = layer_stack.layers.len() - 1;
        let (layer, normalized) = (&layer_stack.layers[idx], &layer_stack.normalized[idx]);
        let inverse: Vec<f64> = normalized
            .variance
            .iter()
            .map(|v| 1.0 / (v + EPSILON).sqrt())
            .collect();
        let scale = inverse
            .iter()
            .zip(&layer.gain)
            .map(|(i, &g)| i * f64::from(g))
            .collect();
        let (mut by_gain, mut by_shift) = (vec![0.0; layer.outputs], vec![0.0; layer.outputs]);
        for (cloud, by) in clouds.iter().zip(by_features.chunks_exact(layer.outputs)) {
            for c in 0..layer.outputs {
                let (by, y) = (f64::from(by[c]), f64::from(cloud.attained[c]));
                by_shift[c] += by;
                by_gain[c] += by * (y - normalized.mean[c]) * inverse[c];
            }
        }
        Self {
            by_gain,
            by_shift,
            inverse,
            scale,
        }
    }
}

impl Dense {
    /// `dx = − Σ_c w_c scale_c (a_c + b_c (w_c · x − mean_c) / sigma_c)` over the outputs c, with the
    /// means over all points `a` of g and `b` of g y'.
    fn new(layer_stack: &LayerStack, outputs: &Outputs, moments: &Moments) -> Self {
        let layer = &layer_stack.layers[layer_stack.layers.len() - 1];
        let inputs = layer.inputs;
        let factors: Vec<f64> = (0..layer.outputs)
            .map(|c| outputs.scale[c] * outputs.inverse[c] * outputs.by_gain[c] / moments.n)
            .collect();
        let weights: Vec<f64> = layer.weight.iter().map(|&w| f64::from(w)).collect();
        let mut kernel = vec![0.0_f64; inputs * inputs];
        kernel
            .par_chunks_exact_mut(inputs)
            .enumerate()
            .for_each(|(k, row)| {
                for (weight, factor) in weights.chunks_exact(inputs).zip(&factors) {
                    Arch::new().dispatch(Axpy {
                        factor: factor * weight[k],
                        x: weight,
                        sums: row,
                    });
                }
            });
        let offset = (0..inputs).map(|k| {
            let constant: f64 = (0..layer.outputs)
                .map(|c| {
                    let a = outputs.scale[c] * outputs.by_shift[c] / moments.n;
                    a * f64::from(layer.weight[c * inputs + k])
                })
                .sum();
            let row = &kernel[k * inputs..(k + 1) * inputs];
            let at_mean: f64 = row.iter().zip(&moments.mean).map(|(k, m)| k * m).sum();
            narrow(at_mean - constant)
        });
        let offset = offset.collect();
        Self {
            kernel: PackedMatrix::new(inputs, inputs, |output, input| {
                -narrow(kernel[output * inputs + input])
            }),
            offset,
        }
    }
}

impl Critical {
    fn of(cloud: &Cloud) -> Self {
        let mut points = cloud.critical.clone();
        points.sort_unstable();
        points.dedup();
        let slots = cloud
            .critical
            .iter()
            .map(|&point| points.partition_point(|&other| other < point))
            .collect();
        Self {
            points,
            slots,
            by: Vec::new(),
        }
    }

    /// The last layer's input at each of the points, one after the other.
    fn inputs(&self, layer_stack: &LayerStack, last: usize, cloud: &Cloud) -> Vec<f32> {
        let width = layer_stack.layers[last].inputs;
        let mut rows = Vec::with_capacity(self.points.len() * width);
        let mut x: Vec<Row> = vec![[0.0; LANES]; width];
        let mut current = usize::MAX;
        for &point in &self.points {
            let (patch, lane) = (point as usize / LANES, point as usize % LANES);
            if patch != current {
                cloud.input(layer_stack, last, patch, &mut x);
                current = patch;
            }
            rows.extend(x.iter().map(|row| row[lane]));
        }
        rows
    }
}

impl Cloud {
    /// Keeps the points that attain a maximum.
    pub(super) fn critical_alone(self, layer_stack: &LayerStack) -> Self {
        let Critical { points, slots, .. } = Critical::of(&self);
        let mut alone = Self::new(points.iter().map(|&point| self.point(point)));
        alone.critical = slots.into_iter().map(row_index).collect();
        alone.attained = self.attained;
        alone.raise(layer_stack, layer_stack.layers.len() - 1);
        alone
    }
}
