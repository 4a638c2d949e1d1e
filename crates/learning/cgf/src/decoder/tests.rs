use candle_core::{Device, Tensor};
use motion::HandState;
use nalgebra::{UnitQuaternion, Vector3};
use rayon::ThreadPoolBuilder;
use spatial::Table;

use super::*;
use crate::{
    config::{
        EncoderRotation, EncoderTimes, Initialization, InputFrame, JointOutputs, LatentPrior,
        LatentVariance, NetworkConfig,
    },
    limits::JointRange,
    network,
    network::{Curve, Network, constant},
    random::Random,
};

const DOF: usize = 16;
const OUTPUTS: usize = 9 + DOF;

fn config(activation: Activation) -> NetworkConfig {
    NetworkConfig {
        points: 64,
        point_widths: vec![8, 48],
        encoder_steps: 4,
        hand_widths: vec![8],
        encoder_widths: vec![16],
        latent_dim: 12,
        decoder_widths: vec![64, 160, 96],
        activation,
        frame: InputFrame::Object,
        encoder_times: EncoderTimes::Equal,
        encoder_rotation: EncoderRotation::Columns,
        latent_variance: LatentVariance::Free,
        prior: LatentPrior::Normal,
        local_points: 0,
        local_widths: vec![8],
        joints: match activation {
            Activation::Relu => JointOutputs::Free,
            Activation::Silu => JointOutputs::WithinLimits,
        },
    }
}

fn limits(config: &NetworkConfig) -> Limits {
    let range = JointRange {
        lower: Some(-1.0),
        upper: Some(1.6),
    };
    Limits::new(config.joints, &[range; DOF])
}

/// A network with weights so large that its motions bend and turn.
fn weights(config: &NetworkConfig) -> Weights {
    let mut weights = network::initialize(config, DOF, Initialization::Centered, 5);
    let mut random = Random::new(5, 9);
    for (name, array) in weights.learned_mut() {
        for value in &mut array.values {
            if name.ends_with("bias") {
                *value = (0.5 * random.normal()) as f32;
            } else if name.starts_with("decoder.0.time") {
                *value *= 4.0;
            } else if name.starts_with("decoder.3") {
                *value *= 10.0;
            }
        }
    }
    weights
}

/// Units of each output, and a rotation about which the network's is a change.
fn normalization() -> Normalization {
    let mut mean = vec![0.1, -0.2, 0.3, 0.8, 0.1, -0.3, 0.2, 0.9, 0.1];
    mean.extend([0.4; DOF]);
    let mut scale = vec![0.2; 3];
    scale.extend([0.5; 6]);
    scale.extend([0.7; DOF]);
    Normalization { mean, scale }
}

fn decoder<T: Number>(activation: Activation) -> Decoder<T> {
    let config = config(activation);
    Decoder::new(
        ("decoder", config.decoder_widths.len()),
        activation,
        &normalization(),
        limits(&config),
        &weights(&config),
    )
    .unwrap()
}

fn feature() -> Vec<f32> {
    let mut random = Random::new(1, 0);
    (0..48).map(|_| random.normal() as f32).collect()
}

fn latents(n: usize) -> Vec<Vec<f64>> {
    let mut random = Random::new(2, 0);
    let mut latent = || (0..12).map(|_| random.normal()).collect();
    (0..n).map(|_| latent()).collect()
}

fn equal_times(n: usize) -> Vec<f64> {
    crate::model::equal_times(n).collect()
}

/// All numbers of a hand but its rotation.
fn numbers(grasp: &HandState<Table>) -> Vec<f64> {
    let position = grasp.frame_from_palm.translation.vector;
    position.iter().chain(&grasp.q_rad).copied().collect()
}

fn rate_numbers(rate: &HandDerivative) -> Vec<f64> {
    rate.palm.linear.iter().chain(&rate.q).copied().collect()
}

fn rotation(grasp: &HandState<Table>) -> UnitQuaternion<f64> {
    grasp.frame_from_palm.rotation
}

/// The greatest difference of vectors, as a share of the greatest number.
fn difference(found: &[Vec<f64>], expected: &[Vec<f64>]) -> f64 {
    let (found, expected) = (found.concat(), expected.concat());
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(largest > 1e-2, "{largest}");
    let apart = found.iter().zip(&expected).map(|(a, b)| (a - b).abs());
    apart.fold(0.0, f64::max) / largest
}

/// Compares velocities with central differences of positions and accelerations with those of
/// velocities, rotations included, at `times`.
fn check_rates(activation: Activation, latents: &[Vec<f64>], times: &[f64]) {
    const H: f64 = 1e-5;
    let decoder = decoder::<f64>(activation);
    let at = |times: &[f64]| {
        let motions = decoder.decode_with_rates(&feature(), latents, times);
        motions.unwrap().concat()
    };
    let shifted = |by: f64| at(&times.iter().map(|t| t + by).collect::<Vec<_>>());
    let (here, before, after) = (at(times), shifted(-H), shifted(H));
    let slope = |after: Vec<f64>, before: Vec<f64>| -> Vec<f64> {
        let pairs = after.iter().zip(&before);
        pairs
            .map(|(after, before)| (after - before) / (2.0 * H))
            .collect()
    };
    let mut found = [const { Vec::new() }; 4];
    let mut expected = [const { Vec::new() }; 4];
    for (here, (before, after)) in here.iter().zip(before.iter().zip(&after)) {
        found[0].push(rate_numbers(&here.velocity));
        expected[0].push(slope(numbers(&after.grasp), numbers(&before.grasp)));
        found[1].push(rate_numbers(&here.acceleration));
        expected[1].push(slope(
            rate_numbers(&after.velocity),
            rate_numbers(&before.velocity),
        ));
        let vector = |v: Vector3<f64>| v.iter().copied().collect::<Vec<f64>>();
        let turn = rotation(&after.grasp) * rotation(&before.grasp).inverse();
        found[2].push(vector(here.velocity.palm.angular));
        expected[2].push(vector(turn.scaled_axis() / (2.0 * H)));
        found[3].push(vector(here.acceleration.palm.angular));
        expected[3].push(slope(
            vector(after.velocity.palm.angular),
            vector(before.velocity.palm.angular),
        ));
    }
    for (what, (found, expected)) in found.iter().zip(&expected).enumerate() {
        // With ReLU only the rotation bends.
        if activation == Activation::Relu && what == 1 {
            assert!(found.concat().iter().all(|x| *x == 0.0));
            continue;
        }
        let off = difference(found, expected);
        assert!(off < 1e-5, "{activation:?}, {what}: {off}");
    }
}

#[test]
fn derivatives_equal_central_differences() {
    let times: Vec<f64> = (0..60).map(|k| f64::from(k) / 59.0).collect();
    check_rates(Activation::Silu, &latents(20), &times);
    // Those of a ReLU network away from its kinks, where they are the same on both sides.
    let mut checked = 0;
    for latent in latents(20) {
        for &t in &times {
            let decoder = decoder::<f64>(Activation::Relu);
            let near = [t - 1e-4, t, t + 1e-4];
            let motion =
                decoder.decode_with_rates(&feature(), std::slice::from_ref(&latent), &near);
            let slopes: Vec<Vec<f64>> = motion.unwrap()[0]
                .iter()
                .map(|step| rate_numbers(&step.velocity))
                .collect();
            if difference(&slopes[..1], &slopes[1..2]) < 1e-12
                && difference(&slopes[2..], &slopes[1..2]) < 1e-12
            {
                check_rates(Activation::Relu, std::slice::from_ref(&latent), &[t]);
                checked += 1;
            }
        }
    }
    assert!(checked > 600, "{checked} of 1200");
}

#[test]
fn smooth_motions_have_accelerations() {
    let times = equal_times(40);
    let greatest = |activation| {
        let motions = decoder::<f32>(activation).decode_with_rates(&feature(), &latents(8), &times);
        let all = motions.unwrap().concat();
        let numbers = all.iter().flat_map(|step| rate_numbers(&step.acceleration));
        numbers.fold(0.0_f64, |most, x| most.max(x.abs()))
    };
    assert!(greatest(Activation::Silu) > 1.0);
    assert_eq!(greatest(Activation::Relu), 0.0);
}

#[test]
fn interpolated_times_follow_the_network() {
    let decoder = decoder::<f32>(Activation::Silu);
    let latents = latents(11);
    let coarse = decoder
        .decode(&feature(), &latents, &equal_times(40))
        .unwrap();
    let fine = decoder
        .decode(&feature(), &latents, &equal_times(79))
        .unwrap();
    let mut bent = 0.0_f64;
    for (coarse, fine) in coarse.iter().zip(&fine) {
        let every_other: Vec<HandState<Table>> = fine.iter().step_by(2).cloned().collect();
        assert_eq!(coarse, &every_other);
        for (pair, between) in coarse.windows(2).zip(fine.iter().skip(1).step_by(2)) {
            let (a, b) = (numbers(&pair[0]), numbers(&pair[1]));
            for ((a, b), found) in a.iter().zip(b).zip(numbers(between)) {
                bent = bent.max((found - 0.5 * (a + b)).abs());
            }
        }
    }
    assert!(bent > 1e-4, "a line between samples is as good: {bent}");
}

#[test]
fn decoding_is_independent_of_the_batch() {
    let check = |activation, n_times: usize| {
        let decoder = decoder::<f32>(activation);
        let (latents, times) = (latents(23), equal_times(n_times));
        let together = decoder
            .decode_with_rates(&feature(), &latents, &times)
            .unwrap();
        let values = decoder.decode(&feature(), &latents, &times).unwrap();
        for ((latent, moving), values) in latents.iter().zip(&together).zip(&values) {
            let alone = decoder.decode_with_rates(&feature(), std::slice::from_ref(latent), &times);
            assert_eq!(&alone.unwrap()[0], moving);
            let alone = decoder.decode(&feature(), std::slice::from_ref(latent), &times);
            assert_eq!(&alone.unwrap()[0], values);
            for (moving, grasp) in moving.iter().zip(values) {
                let apart = numbers(&moving.grasp);
                let apart = apart.iter().zip(numbers(grasp)).map(|(a, b)| (a - b).abs());
                assert!(apart.fold(0.0, f64::max) < 1e-5);
                assert!(rotation(&moving.grasp).angle_to(&rotation(grasp)) < 1e-5);
            }
        }
    };
    for n_times in [1, 2, 40, 700] {
        check(Activation::Silu, n_times);
    }
    check(Activation::Relu, 7);
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let decoder = decoder::<f32>(Activation::Silu);
    let (latents, times) = (latents(50), equal_times(40));
    let decode = |threads: usize| {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            decoder
                .decode_with_rates::<Table>(&feature(), &latents, &times)
                .unwrap()
        })
    };
    assert_eq!(decode(1), decode(2));
}

#[test]
fn decoding_agrees_with_the_tape() {
    for activation in [Activation::Silu, Activation::Relu] {
        let config = config(activation);
        let weights = weights(&config);
        let normalization = Normalization {
            mean: vec![0.0; OUTPUTS],
            scale: vec![1.0; OUTPUTS],
        };
        let decoder = Decoder::<f32>::new(
            ("decoder", 3),
            activation,
            &normalization,
            limits(&config),
            &weights,
        )
        .unwrap();
        let (n, times) = (9, equal_times(33));
        let latents = latents(n);
        let finish = |[values, ..]: [&[f32]; 3]| {
            let outputs = values.iter().zip(&decoder.shift);
            Some(outputs.map(|(y, shift)| f64::from(*y) + shift).collect())
        };
        let level = DerivativeLevel::Values;
        let found: Vec<Vec<f64>> = decoder
            .motions(&feature(), &latents, &times, level, &finish)
            .unwrap()
            .concat();
        let leaves = weights.constants().unwrap();
        let tape = Network {
            config: &config,
            leaves: &leaves,
        };
        let narrow = |numbers: &[f64]| numbers.iter().map(|&x| x as f32).collect::<Vec<f32>>();
        let expected = tape
            .curve(
                Curve::Decoder,
                &constant(narrow(&times.repeat(n)), &[n, times.len()]).unwrap(),
                &constant(narrow(&latents.concat()), &[n, 12]).unwrap(),
                &constant(feature(), &[1, 48]).unwrap(),
                &Tensor::zeros(n, candle_core::DType::U32, &Device::Cpu).unwrap(),
            )
            .unwrap()
            .to_vec2::<f32>()
            .unwrap();
        let expected: Vec<Vec<f64>> = expected
            .iter()
            .map(|row| row.iter().map(|&x| f64::from(x)).collect())
            .collect();
        let off = difference(&found, &expected);
        assert!(off < 1e-5, "{activation:?}: {off}");
    }
}

#[test]
fn codes_of_another_width_and_broken_rotations_are_refused() {
    let decoder = decoder::<f32>(Activation::Silu);
    let err = decoder
        .decode::<Table>(&feature(), &[vec![0.0; 5]], &[0.0])
        .unwrap_err();
    assert!(err.to_string().contains("`latent` has 5 numbers"), "{err}");
    let err = decoder
        .decode::<Table>(&[0.0; 3], &latents(1), &[0.0])
        .unwrap_err();
    assert!(err.to_string().contains("`feature` has 3 numbers"), "{err}");
    let err = decoder
        .decode::<Table>(&feature(), &[vec![f64::NAN; 12]], &[0.0])
        .unwrap_err();
    assert!(err.to_string().contains("a decoded rotation"), "{err}");
    let err = decoder.decode_with_rates::<Table>(&feature(), &[vec![f64::NAN; 12]], &[0.0]);
    assert!(err.unwrap_err().to_string().contains("a decoded rotation"));
    assert!(
        decoder
            .decode::<Table>(&feature(), &latents(2), &[])
            .unwrap()
            .iter()
            .all(Vec::is_empty)
    );
}
