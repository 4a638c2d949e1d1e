//! The operation against forward kinematics and central differences.

use std::sync::Arc;

use candle_core::{Device, Tensor, Var};
use nalgebra::{Isometry3, Translation3};
use robot::RobotModel;
use spatial::{rot6d, rotation_from_rot6d};

use super::{LinkParts, LinkPoses};
use crate::{hand_numbers::PALM_WIDTH, precision::narrow, random::Random};

/// A branching hand with a fixed tip, a joint off the axes, and a slide.
const HAND: &str = r#"<robot name="h">
  <link name="palm"/><link name="a"/><link name="b"/><link name="tip"/><link name="c"/>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/>
    <origin xyz="0.01 0.04 0.1" rpy="0.1 0.2 0.3"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="jb" type="revolute"><parent link="a"/><child link="b"/><axis xyz="1 1 0"/>
    <origin xyz="0 0 0.05" rpy="0 0 0.4"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="jt" type="fixed"><parent link="b"/><child link="tip"/><origin xyz="0 0.01 0.04"/></joint>
  <joint name="jc" type="prismatic"><parent link="palm"/><child link="c"/><axis xyz="0 0 1"/>
    <origin xyz="0.02 -0.03 0.1" rpy="0.5 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"#;

fn rows(n: usize, width: usize) -> Vec<f32> {
    let mut random = Random::new(2, 0);
    (0..n * width).map(|_| narrow(random.normal())).collect()
}

#[test]
fn poses_are_those_of_forward_kinematics() {
    let hand = Arc::new(RobotModel::from_urdf(HAND).unwrap());
    let width = PALM_WIDTH + hand.dof();
    let row = rows(1, width);
    let tensor = Tensor::from_slice(&row, (1, width), &Device::Cpu).unwrap();
    let poses = tensor
        .apply_op1_no_bwd(&LinkPoses::new(hand.clone(), LinkParts::OriginsAndColumns))
        .unwrap();
    let poses = poses.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    let number = |k: usize| f64::from(row[k]);
    let rotation = rotation_from_rot6d([3, 4, 5, 6, 7, 8].map(number)).unwrap();
    let frame = Isometry3::from_parts(Translation3::new(number(0), number(1), number(2)), rotation);
    let q: Vec<f64> = (PALM_WIDTH..width).map(number).collect();
    let links = hand.forward_kinematics::<spatial::Palm>(&q).unwrap();
    assert_eq!(poses.len(), 9 * links.len());
    for (pose, link) in poses.chunks_exact(9).zip(links) {
        let expected = frame * *link;
        let numbers = expected.translation.vector.iter().copied();
        for (a, b) in pose.iter().zip(numbers.chain(rot6d(&expected.rotation))) {
            assert!((f64::from(*a) - b).abs() < 1e-6);
        }
    }
}

#[test]
fn gradient_equals_central_differences() {
    let hand = Arc::new(RobotModel::from_urdf(HAND).unwrap());
    let (n, width) = (4, PALM_WIDTH + hand.dof());
    let at = rows(n, width);
    let weights = Tensor::from_vec(
        rows(n, 9 * hand.links().len()),
        (n, 9 * hand.links().len()),
        &Device::Cpu,
    )
    .unwrap();
    let loss = |values: &[f32]| {
        let var = Var::from_slice(values, (n, width), &Device::Cpu).unwrap();
        let poses = var
            .apply_op1(LinkPoses::new(hand.clone(), LinkParts::OriginsAndColumns))
            .unwrap();
        ((poses * &weights).unwrap().sum_all().unwrap(), var)
    };
    let (value, var) = loss(&at);
    let grads = value.backward().unwrap();
    let found: Vec<f32> = grads
        .get(&var)
        .unwrap()
        .flatten_all()
        .unwrap()
        .to_vec1()
        .unwrap();
    for k in 0..at.len() {
        let mut moved = at.clone();
        let h = 3e-3;
        let mut value = |x: f32| {
            moved[k] = x;
            loss(&moved).0.to_scalar::<f32>().unwrap()
        };
        let expected = (value(at[k] + h) - value(at[k] - h)) / (2.0 * h);
        // Central differences of f32 sums are good to about 1e-3.
        assert!(
            (expected - found[k]).abs() < 3e-3 * (1.0 + expected.abs()),
            "{k}: {expected}, found {}",
            found[k]
        );
    }
}
