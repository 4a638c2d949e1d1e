//! This crate's training step: an epoch of one batch, which is drawn, learned from and recorded.

use std::{collections::BTreeMap, fs, sync::Arc};

use cgf::{
    Activation, Augmentation, Contact, EncoderRotation, EncoderTimes, Initialization, InputFrame,
    JointOutputs, LatentNoise, LatentPrior, LatentVariance, NetworkConfig, Outputs, Random,
    Reduction, RestingObject, Schedule, Times, Trainer, TrainingConfig, TrainingDevice,
    TrainingMotion, TrainingSet,
};
use motion::{Motion, Step};
use nalgebra::{Isometry3, Point3, Vector3};
use robot::RobotModel;
use spatial::{Pose, RestingPose};

use crate::{CLOUDS, HAND, POINTS, contender::Server};

/// Does steps on request.
pub(crate) fn serve() {
    let hand = Arc::new(RobotModel::from_urdf(&fs::read_to_string(HAND).unwrap()).unwrap());
    let set = TrainingSet {
        scenes: (0..CLOUDS).map(scene).collect(),
        tracks: (0..CLOUDS)
            .map(|number| track(number, hand.dof()))
            .collect(),
        distances: BTreeMap::new(),
    };
    let (network, training) = (network(), training());
    let mut trainer = Trainer::new(&set, &hand, &network, &training, 1).unwrap();
    let Some(mut server) = Server::ready() else {
        return;
    };
    loop {
        let loss = trainer.train_epoch().unwrap().training.total;
        if !server.answer(loss) {
            return;
        }
    }
}

/// A box or a cylinder, an object of its own for each number.
fn scene(number: usize) -> RestingObject {
    let mut random = Random::new(2, number as u64);
    let half: [f64; 3] = std::array::from_fn(|_| 0.02 + 0.08 * random.uniform());
    let points_in_object = (0..POINTS).map(|_| {
        let mut unit: [f64; 3] = std::array::from_fn(|_| 2.0 * random.uniform() - 1.0);
        if number.is_multiple_of(2) {
            let side = random.index(3);
            unit[side] = unit[side].signum();
        } else {
            let (sin, cos) = (std::f64::consts::PI * unit[0]).sin_cos();
            unit = [cos, sin, unit[2]];
        }
        Point3::from(std::array::from_fn::<_, 3, _>(|k| half[k] * unit[k]))
    });
    RestingObject {
        object: format!("object {number}"),
        rest: RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: half[2],
        },
        points_in_object: points_in_object.collect(),
    }
}

fn track(number: usize, dof: usize) -> TrainingMotion {
    let mut random = Random::new(3, number as u64);
    let mut vector = || Vector3::from_fn(|_, _| 0.2 * random.normal());
    let (from, to, turn) = (vector(), vector(), vector());
    let steps = (0..40).map(|k| {
        let share = f64::from(k) / 39.0;
        let isometry = Isometry3::new(from.lerp(&to, share), turn * share);
        Step {
            time_s: f64::from(k) / 30.0,
            frame_from_palm: Pose::new(isometry),
            q_rad: vec![share; dof],
            rates: (),
        }
    });
    let joints: Vec<String> = (0..dof).map(|joint| format!("joint {joint}")).collect();
    TrainingMotion {
        name: format!("motion {number}"),
        scene: number,
        split: schemas::training::Split::Training,
        code: None,
        motion: Motion::new(&joints, steps.collect()).unwrap(),
    }
}

/// The widths of the paper and, where it gives none, of the released code.
fn network() -> NetworkConfig {
    NetworkConfig {
        points: POINTS,
        point_widths: vec![64, 128, 1024],
        encoder_steps: 20,
        hand_widths: vec![256, 256, 64],
        encoder_widths: vec![256, 256],
        latent_dim: 256,
        decoder_widths: vec![256, 512, 256],
        local_points: 0,
        local_widths: vec![512],
        activation: Activation::Relu,
        frame: InputFrame::Object,
        encoder_times: EncoderTimes::Recorded,
        encoder_rotation: EncoderRotation::AxisAngle,
        latent_variance: LatentVariance::Free,
        prior: LatentPrior::Normal,
        joints: JointOutputs::Free,
    }
}

/// All loss terms of the released code, and a contact loss that has a gradient.
fn training() -> TrainingConfig {
    TrainingConfig {
        device: TrainingDevice::Cpu,
        epochs: 1_000_000,
        validation_epochs: 1_000_000,
        batch: CLOUDS,
        learning_rate: 5e-4,
        max_gradient_norm: None,
        schedule: Schedule::Halving,
        halving_epochs: 500_000,
        grasp_steps: 5,
        grasp_weight: 1.0,
        random_times: 20,
        times: Times::Recorded,
        latent_noise: LatentNoise::PerMotion,
        initialization: Initialization::Torch,
        augmentation: Augmentation::Any,
        outputs: Outputs::Physical,
        fixed_statistics_after: 1.0,
        reduction: Reduction::Mean,
        q_weight: 1.0,
        translation_weight: 10.0,
        origins_weight: 10.0,
        rotations_weight: 0.5,
        kl_weight: 1e-3,
        contact_weight: 50.0,
        penetration_weight: 0.0,
        local_noise_m: 0.0,
        contact: Contact::TouchCenter,
        tips: [
            "link_3.0_tip",
            "link_7.0_tip",
            "link_11.0_tip",
            "link_15.0_tip",
        ]
        .map(str::to_owned)
        .into(),
        tip_radius_m: 0.012,
    }
}
