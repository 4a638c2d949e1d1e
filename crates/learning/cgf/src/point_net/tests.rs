//! The fast form against the plain one on candle's tape in `f64`.

use std::sync::Arc;

use candle_core::{D, Device, Tensor, Var};

use super::{
    Clouds, EPSILON, LayerGradient, Measured, PointNet, Statistics, features, initialize, names,
    tape,
};
use crate::{config::Initialization, precision::narrow, random::Random, weights::Weights};

/// Sizes of a point network and of what it sees.
struct Sizes {
    widths: &'static [usize],
    clouds: usize,
    points: usize,
}

const SMALL: Sizes = Sizes {
    widths: &[6, 9, 17],
    clouds: 3,
    points: 50,
};

fn setting(sizes: &Sizes) -> (Weights, Clouds, Vec<f32>) {
    let mut random = Random::new(5, 0);
    let mut weights = Weights::default();
    let widths = sizes.widths;
    initialize(&mut weights, widths, Initialization::Centered, &mut random);
    // Gains of both signs, statistics other than 0 and 1.
    for (layer, &width) in widths.iter().enumerate() {
        for name in ["gain", "shift", "mean", "variance"] {
            let values = (0..width).map(|_| {
                let x = narrow(random.normal());
                if name == "variance" { x.abs() + 0.1 } else { x }
            });
            let values = values.collect();
            weights.set(&format!("point_net.{layer}.{name}"), &[width], values);
        }
    }
    let mut numbers = |n: usize| {
        (0..n)
            .map(|_| narrow(random.normal()))
            .collect::<Vec<f32>>()
    };
    let xyz = numbers(sizes.clouds * sizes.points * 3);
    let by = numbers(sizes.clouds * widths[widths.len() - 1]);
    let points = sizes.points;
    (weights, Clouds { points, xyz }, by)
}

/// Features and the gradients of `Σ by · feature`, layer by layer, in `f64`.
fn plain(
    sizes: &Sizes,
    (weights, clouds, by): (&Weights, &Clouds, &[f32]),
    statistics: Statistics,
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let tensor = |values: &[f32], shape: &[usize]| {
        let values: Vec<f64> = values.iter().map(|&x| f64::from(x)).collect();
        Tensor::from_vec(values, shape, &Device::Cpu).unwrap()
    };
    let mut vars = Vec::new();
    let mut x = tensor(&clouds.xyz, &[sizes.clouds * sizes.points, 3]);
    let n_layers = sizes.widths.len();
    let width = sizes.widths[n_layers - 1];
    for layer in 0..n_layers {
        let [w, gain, shift] = names(layer).map(|name| {
            let array = weights.array(&name).unwrap();
            Var::from_tensor(&tensor(&array.values, &array.shape)).unwrap()
        });
        let y = x.matmul(&w.t().unwrap()).unwrap();
        let stored = |name: &str| {
            let array = weights.array(&format!("point_net.{layer}.{name}")).unwrap();
            tensor(&array.values, &[1, array.values.len()])
        };
        let (mean, variance) = match statistics {
            Statistics::Measured => {
                let mean = y.mean_keepdim(0).unwrap();
                let variance = y
                    .broadcast_sub(&mean)
                    .unwrap()
                    .sqr()
                    .unwrap()
                    .mean_keepdim(0)
                    .unwrap();
                (mean, variance)
            }
            Statistics::Stored => (stored("mean"), stored("variance")),
        };
        let sigma = (variance + EPSILON).unwrap().sqrt().unwrap();
        let y = y
            .broadcast_sub(&mean)
            .unwrap()
            .broadcast_div(&sigma)
            .unwrap();
        let y = y
            .broadcast_mul(&gain)
            .unwrap()
            .broadcast_add(&shift)
            .unwrap();
        x = if layer + 1 < n_layers {
            y.relu().unwrap()
        } else {
            y
        };
        vars.extend([w, gain, shift]);
    }
    let features = x
        .reshape((sizes.clouds, sizes.points, width))
        .unwrap()
        .transpose(1, 2)
        .unwrap();
    let features = features.contiguous().unwrap().max(D::Minus1).unwrap();
    let loss = (&features * tensor(by, &[sizes.clouds, width]))
        .unwrap()
        .sum_all()
        .unwrap();
    let grads = loss.backward().unwrap();
    let gradients = vars.iter().map(|var| {
        grads
            .get(var)
            .unwrap()
            .flatten_all()
            .unwrap()
            .to_vec1()
            .unwrap()
    });
    (
        features.flatten_all().unwrap().to_vec1().unwrap(),
        gradients.collect(),
    )
}

fn assert_near(found: &[f32], expected: &[f64], what: &str) {
    let largest = expected.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        let error = (f64::from(*found) - expected).abs();
        assert!(
            error <= 1e-4 * largest,
            "{what}: {found}, expected {expected}"
        );
    }
}

/// Compares features and gradients with the plain form in `f64`, within 1e-4 of the largest of each
/// array.
fn check(sizes: &Sizes) {
    let (weights, clouds, by) = setting(sizes);
    for statistics in [Statistics::Measured, Statistics::Stored] {
        let (features, gradients) = plain(sizes, (&weights, &clouds, &by), statistics);
        let net = PointNet::new(&weights, sizes.widths.len()).unwrap();
        let pass = net.forward(&clouds, statistics);
        assert_near(&pass.features, &features, "feature");
        let found: Vec<LayerGradient> = net.backward(pass, &by);
        for (k, (found, expected)) in found.iter().flatten().zip(&gradients).enumerate() {
            assert_near(found, expected, &format!("{statistics:?}, gradient {k}"));
        }
    }
}

#[test]
fn equals_the_plain_form_in_value_and_gradient() {
    check(&SMALL);
    let sizes = |widths, clouds, points| Sizes {
        widths,
        clouds,
        points,
    };
    check(&sizes(&[5], 2, 33));
    check(&sizes(&[7, 12], 2, 32));
    check(&sizes(&[6, 7, 9, 5], 4, 47));
    check(&sizes(&[16, 18, 24, 30], 1, 700));
}

#[test]
fn equals_the_plain_form_at_the_widths_of_the_paper() {
    check(&Sizes {
        widths: &[64, 128, 1024],
        clouds: 4,
        points: 300,
    });
}

/// The plain form of the tape takes part in the same way on every device; here on the CPU.
#[test]
fn the_device_kernel_gives_the_features_gradients_and_statistics_of_the_cpu_kernel() {
    let (weights, clouds, by) = setting(&SMALL);
    let clouds = Arc::new(clouds);
    for statistics in [Statistics::Measured, Statistics::Stored] {
        let leaves = weights.variables(&Device::Cpu).unwrap();
        let n_layers = SMALL.widths.len();
        let run = |(features, measured): (Tensor, Measured)| {
            let by = Tensor::from_slice(&by, features.shape(), &Device::Cpu).unwrap();
            let loss = (&features * by).unwrap().sum_all().unwrap();
            let gradients = loss.backward().unwrap();
            let numbers = |tensor: &Tensor| tensor.flatten_all().unwrap().to_vec1().unwrap();
            let mut arrays: Vec<Vec<f32>> = vec![numbers(&features)];
            for name in (0..n_layers).flat_map(names) {
                arrays.push(numbers(gradients.get(&leaves[&name]).unwrap()));
            }
            if statistics == Statistics::Measured {
                arrays.extend(measured.into_iter().map(|(_, values)| values));
            }
            arrays
        };
        let fast = run(features(&leaves, n_layers, &clouds, statistics).unwrap());
        let plain = run(tape::plain(&leaves, n_layers, &clouds, statistics).unwrap());
        assert_eq!(fast.len(), plain.len());
        for (fast, plain) in fast.iter().zip(&plain) {
            let plain: Vec<f64> = plain.iter().map(|&x| f64::from(x)).collect();
            assert_near(fast, &plain, "array");
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let sizes = Sizes {
        widths: &[16, 32, 64],
        clouds: 5,
        points: 130,
    };
    let (weights, clouds, by) = setting(&sizes);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let net = PointNet::new(&weights, sizes.widths.len()).unwrap();
            let pass = net.forward(&clouds, Statistics::Measured);
            let features = pass.features.clone();
            (features, net.backward(pass, &by))
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn stored_statistics_of_the_same_clouds_give_nearly_the_same_features() {
    let (mut weights, clouds, _) = setting(&SMALL);
    let net = PointNet::new(&weights, SMALL.widths.len()).unwrap();
    let measured = net.forward(&clouds, Statistics::Measured);
    measured.store(1.0, &mut weights).unwrap();
    let net = PointNet::new(&weights, SMALL.widths.len()).unwrap();
    let stored = net.forward(&clouds, Statistics::Stored);
    for (a, b) in measured.features.iter().zip(&stored.features) {
        // The stored variance is the unbiased one of 150 points: 0.7 % more in each layer.
        assert!((a - b).abs() < 0.1 + 0.01 * a.abs(), "{a} {b}");
    }
}
