//! The same weights and inputs give `PyTorch`'s outputs and gradients: `tests/golden/make.py` says how
//! they were made.

mod objective;

use std::{fs, sync::Arc};

use candle_core::{Device, Tensor, Var};
use nalgebra::Point3;
use robot::RobotModel;

use crate::{
    Activation, Contact, EncoderRotation, EncoderTimes, InputFrame, JointOutputs, LatentPrior,
    LatentVariance, NetworkConfig,
    kinematics::{LinkParts, LinkPoses},
    loss,
    network::{Curve, Network, constant},
    point_net::{self, Clouds, PointNet, Statistics},
    weights::{Array, Weights},
};

/// Share of the largest number of an array by which another one may differ.
const TOLERANCE: f32 = 1e-4;

fn golden() -> Weights {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/golden/golden.safetensors"
    );
    Weights::from_bytes(&fs::read(path).unwrap()).unwrap()
}

/// The hand of `hand.urdf`, its links in the order of the file, as the arrays have them.
fn hand() -> Arc<RobotModel> {
    let hand = RobotModel::from_urdf(include_str!("../tests/golden/hand.urdf")).unwrap();
    let names: Vec<&str> = hand.links().iter().map(|link| link.name.as_str()).collect();
    let expected = "palm finger finger_end finger_tip thumb thumb_tip";
    assert_eq!(names, expected.split(' ').collect::<Vec<_>>());
    assert_eq!(hand.joint_names(), ["bend", "bend_more", "slide"]);
    Arc::new(hand)
}

/// A small network of any hand.
fn network_config(activation: Activation, encoder_rotation: EncoderRotation) -> NetworkConfig {
    NetworkConfig {
        points: 64,
        point_widths: vec![8, 16, 32],
        encoder_steps: 4,
        hand_widths: vec![8, 5],
        encoder_widths: vec![7, 6],
        latent_dim: 3,
        decoder_widths: vec![9, 11],
        local_points: 0,
        local_widths: vec![8],
        activation,
        frame: InputFrame::Resting,
        encoder_times: EncoderTimes::Equal,
        encoder_rotation,
        latent_variance: LatentVariance::Free,
        prior: LatentPrior::Normal,
        joints: JointOutputs::Free,
    }
}

/// The arrays below a folder of names, under the names `to` gives them.
fn below(golden: &Weights, folder: &str, to: &str) -> Weights {
    let mut weights = Weights::default();
    for (name, array) in golden.iter() {
        if let Some(name) = name.strip_prefix(folder) {
            weights.set(&format!("{to}{name}"), &array.shape, array.values.clone());
        }
    }
    weights
}

fn tensor(array: &Array) -> Tensor {
    constant(array.values.clone(), &array.shape).unwrap()
}

fn variable(array: &Array) -> Var {
    Var::from_tensor(&tensor(array)).unwrap()
}

fn numbers(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

fn assert_near(found: &[f32], expected: &Array, what: &str) {
    assert_eq!(found.len(), expected.values.len(), "{what}");
    let largest = expected.values.iter().fold(0.0_f32, |m, x| m.max(x.abs()));
    for (found, expected) in found.iter().zip(&expected.values) {
        assert!(
            (found - expected).abs() <= TOLERANCE * largest,
            "{what}: {found}, expected {expected}"
        );
    }
}

/// The sum of a tensor's numbers, each times one of an array's.
fn weighted(tensor: &Tensor, by: &Array) -> Tensor {
    let by = constant(by.values.clone(), tensor.dims()).unwrap();
    (tensor * by).unwrap().sum_all().unwrap()
}

#[test]
fn point_net_equals_pytorch_in_training_and_evaluation_mode() {
    let golden = golden();
    let array = |name: &str| golden.array(name).unwrap();
    let weights = below(&golden, "point_net/weights/", "point_net.");
    let clouds = Arc::new(Clouds {
        points: 64,
        xyz: array("point_net/xyz").values.clone(),
    });
    for (mode, statistics) in [
        ("measured", Statistics::Measured),
        ("stored", Statistics::Stored),
    ] {
        let leaves = weights.variables(&Device::Cpu).unwrap();
        let (features, measured) = point_net::features(&leaves, 3, &clouds, statistics).unwrap();
        let expected = array(&format!("point_net/{mode}/features"));
        assert_near(&numbers(&features), expected, mode);
        let loss = weighted(&features, array("point_net/by"));
        let gradients = loss.backward().unwrap();
        for name in (0..3).flat_map(point_net::names) {
            let found = numbers(gradients.get(&leaves[&name]).unwrap());
            let short = name.strip_prefix("point_net.").unwrap();
            let expected = array(&format!("point_net/{mode}/gradient/{short}"));
            assert_near(&found, expected, &format!("{mode} {name}"));
        }
        if statistics == Statistics::Measured {
            let mut moved = weights.clone();
            point_net::store(&measured, 0.1, &mut moved).unwrap();
            for (name, expected) in below(&golden, "point_net/running/", "point_net.").iter() {
                assert_near(&moved.array(name).unwrap().values, expected, name);
            }
        }
    }
    let net = PointNet::new(&weights, 3).unwrap();
    let features = net.forward(&clouds, Statistics::Stored).features;
    assert_near(&features, array("point_net/stored/features"), "inference");
}

#[test]
fn encoder_and_decoder_equal_pytorch_with_either_activation() {
    let golden = golden();
    for (kind, activation) in [("relu", Activation::Relu), ("silu", Activation::Silu)] {
        let array = |name: &str| golden.array(&format!("{kind}/{name}")).unwrap();
        let config = network_config(activation, EncoderRotation::Columns);
        let leaves = below(&golden, &format!("{kind}/weights/"), "")
            .variables(&Device::Cpu)
            .unwrap();
        let network = Network {
            config: &config,
            leaves: &leaves,
        };
        let (features, latents) = (variable(array("features")), variable(array("latents")));
        let views = Tensor::new(&[0_u32, 1, 1, 2, 3], &Device::Cpu).unwrap();
        let (mean, log_variance) = network
            .encode(&tensor(array("motions")), &features, &views)
            .unwrap();
        let decoded = network
            .curve(
                Curve::Decoder,
                &tensor(array("times")),
                &latents,
                &features,
                &views,
            )
            .unwrap();
        let outputs = [
            ("mean", &mean),
            ("log_variance", &log_variance),
            ("decoded", &decoded),
        ];
        let mut loss = Tensor::new(0.0_f32, &Device::Cpu).unwrap();
        for (name, output) in outputs {
            assert_near(&numbers(output), array(name), &format!("{kind} {name}"));
            loss = (loss + weighted(output, array(&format!("by_{name}")))).unwrap();
        }
        let gradients = loss.backward().unwrap();
        let gradient = |of: &Tensor| numbers(gradients.get(of).unwrap());
        assert_near(&gradient(&features), array("by_features"), kind);
        assert_near(&gradient(&latents), array("by_latents"), kind);
        for (name, leaf) in &leaves {
            let expected = array(&format!("gradient/{name}"));
            assert_near(&gradient(leaf), expected, &format!("{kind} {name}"));
        }
    }
}

#[test]
fn link_poses_equal_pytorch() {
    let golden = golden();
    let array = |name: &str| golden.array(&format!("hand/{name}")).unwrap();
    let hand = hand();
    let n_links = hand.links().len();
    let (poses, by) = (array("poses"), array("by"));
    // Of each link, the origin's three numbers come before the columns' six.
    let only = |all: &Array, wanted: fn(usize) -> bool| Array {
        shape: vec![all.values.len()],
        values: all
            .values
            .iter()
            .enumerate()
            .map(|(idx, x)| if wanted(idx % 9) { *x } else { 0.0 })
            .collect(),
    };
    let whole = LinkPoses::new(hand.clone(), LinkParts::OriginsAndColumns);
    for (part, wanted) in [
        ("origins", (|k| k < 3) as fn(usize) -> bool),
        ("columns", |k| k >= 3),
    ] {
        let rows = variable(array("rows"));
        let found = rows.apply_op1(whole.clone()).unwrap();
        let found = found.reshape(((), n_links, 9)).unwrap();
        assert_near(&numbers(&found), poses, "poses");
        let gradients = weighted(&found, &only(by, wanted)).backward().unwrap();
        let found = numbers(gradients.get(&rows).unwrap());
        assert_near(&found, array(&format!("by_rows_of_{part}")), part);
    }
    // Where only the origins are asked for, they and their gradient are the same.
    let rows = variable(array("rows"));
    let origins = LinkPoses::new(hand, LinkParts::Origins);
    let found = rows.apply_op1(origins).unwrap();
    let found = found.reshape(((), n_links, 3)).unwrap();
    let origins_of = |all: &Array| Array {
        shape: found.dims().to_vec(),
        values: all.values.chunks(9).flat_map(|x| x[..3].to_vec()).collect(),
    };
    assert_near(&numbers(&found), &origins_of(poses), "origins alone");
    let gradients = weighted(&found, &origins_of(by)).backward().unwrap();
    let found = numbers(gradients.get(&rows).unwrap());
    assert_near(&found, array("by_rows_of_origins"), "origins alone");
}

/// Compares a loss and its gradients by some of its arguments.
fn check_loss(golden: &Weights, name: &str, by: &[&str], loss: impl Fn(&[Tensor]) -> Tensor) {
    let array = |key: &str| golden.array(&format!("loss/{name}/{key}")).unwrap();
    let arguments: Vec<Var> = by.iter().map(|key| variable(array(key))).collect();
    let tensors: Vec<Tensor> = arguments
        .iter()
        .map(|var| var.as_tensor().clone())
        .collect();
    let value = loss(&tensors);
    assert_near(&numbers(&value), array("value"), name);
    let gradients = value.backward().unwrap();
    for (key, argument) in by.iter().zip(&arguments) {
        let found = numbers(gradients.get(argument).unwrap());
        assert_near(
            &found,
            array(&format!("by_{key}")),
            &format!("{name} {key}"),
        );
    }
}

#[test]
fn every_loss_equals_pytorch() {
    let golden = golden();
    let array = |name: &str| golden.array(&format!("loss/{name}")).unwrap();
    let row_weights = loss::row_weights(2, 2, 3, 4.0).unwrap();
    check_loss(&golden, "squared_error", &["x"], |x| {
        loss::squared_error(&x[0], &tensor(array("squared_error/y")), &row_weights).unwrap()
    });
    check_loss(&golden, "squared_distance", &["x"], |x| {
        let y = tensor(array("squared_distance/y"));
        loss::squared_distance(&x[0], &y, &row_weights).unwrap()
    });
    check_loss(&golden, "kl", &["mean", "log_variance"], |x| {
        loss::kl_divergence(&x[0], &x[1]).unwrap()
    });
    for (name, contact) in [
        ("touch_center", Contact::TouchCenter),
        ("touch_surface", Contact::TouchSurface),
    ] {
        let points = &array(&format!("{name}/surface")).values;
        let surface: Vec<Point3<f64>> = points
            .chunks_exact(3)
            .map(|p| Point3::new(p[0].into(), p[1].into(), p[2].into()))
            .collect();
        check_loss(&golden, name, &["tips"], |x| {
            let surfaces = vec![surface.as_slice(); 6];
            loss::contact(&x[0], &surfaces, contact, 0.4).unwrap()
        });
    }
}
