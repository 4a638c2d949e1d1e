//! Whole batches: everything from the object's points and the motions to the weighted total of the losses
//! and its gradients by all weights.

use std::sync::Arc;

use candle_core::Device;
use nalgebra::Point3;
use robot::RobotModel;

use super::{TOLERANCE, assert_near, below, golden, hand, network_config};
use crate::{
    Activation, Augmentation, Contact, EncoderRotation, Initialization, JointOutputs, LatentNoise,
    LatentVariance, Losses, NetworkConfig, Normalization, Outputs, Reduction, Schedule, Times,
    TrainingConfig, TrainingDevice,
    batch::Batch,
    limits::Limits,
    point_net::{Clouds, Statistics},
    step::Objective,
    training::ranges,
    weights::Weights,
};

/// The choices of a case that are not numbers.
struct Case {
    name: &'static str,
    activation: Activation,
    encoder_rotation: EncoderRotation,
    latent_variance: LatentVariance,
    joints: JointOutputs,
    latent_noise: LatentNoise,
    reduction: Reduction,
    contact: Contact,
    statistics: Statistics,
}

/// The terms of the default, the paper and the released code.
const CASES: [Case; 3] = [
    Case {
        name: "default",
        activation: Activation::Silu,
        encoder_rotation: EncoderRotation::Columns,
        latent_variance: LatentVariance::BelowPrior,
        joints: JointOutputs::WithinLimits,
        latent_noise: LatentNoise::PerMotion,
        reduction: Reduction::Mean,
        contact: Contact::TouchSurface,
        statistics: Statistics::Measured,
    },
    Case {
        name: "paper",
        activation: Activation::Relu,
        encoder_rotation: EncoderRotation::Columns,
        latent_variance: LatentVariance::Free,
        joints: JointOutputs::Free,
        latent_noise: LatentNoise::PerMotion,
        reduction: Reduction::Sum,
        contact: Contact::TouchCenter,
        statistics: Statistics::Measured,
    },
    Case {
        name: "released",
        activation: Activation::Relu,
        encoder_rotation: EncoderRotation::AxisAngle,
        latent_variance: LatentVariance::Free,
        joints: JointOutputs::Free,
        latent_noise: LatentNoise::PerTime,
        reduction: Reduction::Mean,
        contact: Contact::Demonstrated,
        statistics: Statistics::Stored,
    },
];

#[test]
fn the_weighted_total_and_its_gradients_equal_pytorch() {
    let golden = golden();
    let hand = hand();
    for case in &CASES {
        check(&golden, &hand, case);
    }
}

fn check(golden: &Weights, hand: &Arc<RobotModel>, case: &Case) {
    let folder = format!("objective/{}", case.name);
    let arrays = below(golden, &format!("{folder}/"), "");
    let weights = below(golden, &format!("{folder}/weights/"), "");
    let network = NetworkConfig {
        latent_variance: case.latent_variance,
        joints: case.joints,
        ..network_config(case.activation, case.encoder_rotation)
    };
    let training = training(&arrays, case);
    let objective = Objective {
        hand,
        network: &network,
        training: &training,
        tips: ["finger_tip", "thumb_tip"]
            .map(|tip| hand.link(tip).unwrap())
            .to_vec(),
        body: None,
        local_normalization: None,
        limits: Limits::new(network.joints, &ranges(hand)),
        device: Device::Cpu,
    };
    let wide = |name: &str| -> Vec<f64> {
        let array = arrays.array(name).unwrap();
        array.values.iter().map(|&x| x.into()).collect()
    };
    let normalization = Normalization {
        mean: wide("shift"),
        scale: wide("scale"),
    };
    let mut batch = batch(&arrays, &network);
    let (losses, gradients, _) = objective
        .gradients(&weights, &normalization, &batch, case.statistics)
        .unwrap();
    check_losses(&arrays, "losses", &losses);
    let expected = below(golden, &format!("{folder}/gradient/"), "");
    let names: Vec<&str> = expected.iter().map(|(name, _)| name).collect();
    assert_eq!(names, gradients.keys().collect::<Vec<_>>(), "{folder}");
    for (name, expected) in expected.iter() {
        assert_near(&gradients[name], expected, &format!("{folder} {name}"));
    }
    // How held-out motions are measured.
    batch.noise.clear();
    let losses = objective.measure(&weights, &normalization, &batch).unwrap();
    check_losses(&arrays, "mean_codes", &losses);
}

/// Compares every term for itself: a small one may not hide behind a large one.
fn check_losses(arrays: &Weights, folder: &str, losses: &Losses) {
    let Losses {
        total,
        q,
        translation,
        origins,
        rotations,
        kl,
        contact,
        penetration: _,
        prior: _,
        coarse: _,
    } = *losses;
    for (name, found) in [
        ("total", total),
        ("q", q),
        ("translation", translation),
        ("origins", origins),
        ("rotations", rotations),
        ("kl", kl),
        ("contact", contact),
    ] {
        let name = format!("{folder}/{name}");
        let expected = number(arrays, &name);
        assert!(
            (found - expected).abs() <= TOLERANCE * expected.abs(),
            "{name}: {found}, expected {expected}"
        );
    }
}

fn number(arrays: &Weights, name: &str) -> f32 {
    let values = &arrays.array(name).unwrap().values;
    assert_eq!(values.len(), 1, "{name}");
    values[0]
}

/// Three motions about two objects.
fn batch(arrays: &Weights, network: &NetworkConfig) -> Batch {
    let values = |name: &str| arrays.array(name).unwrap().values.clone();
    let surfaces = arrays.array("surfaces").unwrap();
    let [_, n_points, 3] = surfaces.shape[..] else {
        panic!("{:?}", surfaces.shape);
    };
    let points: Vec<Point3<f64>> = surfaces
        .values
        .chunks_exact(3)
        .map(|p| Point3::new(p[0].into(), p[1].into(), p[2].into()))
        .collect();
    Batch {
        size: 3,
        n_times: 5,
        clouds: Arc::new(Clouds {
            points: network.points,
            xyz: values("clouds"),
        }),
        surfaces: points.chunks(n_points).map(<[_]>::to_vec).collect(),
        views: vec![1, 0, 1],
        surroundings: Vec::new(),
        motions: values("motions"),
        times: values("times"),
        physical: values("physical"),
        targets: values("targets"),
        noise: values("noise"),
        codes: vec![0.0; 3 * network.latent_dim],
        is_encoded: vec![1.0; 3],
        flow_noise: Vec::new(),
        flow_times: Vec::new(),
        local: Vec::new(),
        local_noise: Vec::new(),
    }
}

/// Training options that determine the losses of a batch; the others are arbitrary.
fn training(arrays: &Weights, case: &Case) -> TrainingConfig {
    let weight = |name: &str| number(arrays, &format!("weight_of/{name}")).into();
    TrainingConfig {
        device: TrainingDevice::Cpu,
        epochs: 1,
        validation_epochs: 1,
        batch: 3,
        learning_rate: 0.0,
        max_gradient_norm: None,
        schedule: Schedule::Cosine,
        halving_epochs: 1,
        grasp_steps: 2,
        grasp_weight: number(arrays, "grasp_weight").into(),
        random_times: 3,
        times: Times::Continuous,
        latent_noise: case.latent_noise,
        initialization: Initialization::Torch,
        augmentation: Augmentation::None,
        outputs: Outputs::Standardized,
        fixed_statistics_after: 1.0,
        reduction: case.reduction,
        q_weight: weight("q"),
        translation_weight: weight("translation"),
        origins_weight: weight("origins"),
        rotations_weight: weight("rotations"),
        kl_weight: weight("kl"),
        contact_weight: weight("contact"),
        penetration_weight: 0.0,
        local_noise_m: 0.0,
        contact: case.contact,
        tips: Vec::new(),
        tip_radius_m: number(arrays, "tip_radius_m").into(),
    }
}
