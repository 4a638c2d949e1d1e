//! Hand landmarks by the hand model: known answers with made-up models of MANO's form, damage, and
//! the user's licensed files where there are any.

mod damage;
mod files;
mod real;

use std::{fs, path::Path};

use nalgebra::{Point3, Rotation3, Vector3};
use schemas::demonstrations::Side;
use serde::Deserialize;
use stage_ingest::ManoModel;

/// Largest accepted error, in meters: rounding of sums of a few thousand numbers below one.
const EXACT_M: f64 = 1e-13;
/// Unit of length of `make.py`, in meters.
const UNIT_M: f64 = 1.0 / 8192.0;

/// Results of `make.py`.
#[derive(Deserialize)]
struct Golden {
    flat: Vec<Flat>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Flat {
    side: String,
    coefficients: Vec<f64>,
}

#[derive(Deserialize)]
struct Case {
    side: String,
    betas: [f64; 10],
    pose: Vec<f64>,
    keypoints_m: Vec<[f64; 3]>,
}

fn golden() -> Golden {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mano");
    serde_json::from_str(&fs::read_to_string(folder.join("golden.json")).unwrap()).unwrap()
}

fn model(name: &str) -> ManoModel {
    ManoModel::from_pickle(&files::made_up(name)).unwrap()
}

fn pose(numbers: &[f64]) -> [f64; 51] {
    numbers.try_into().unwrap()
}

fn largest_error_m(found: &[Point3<f64>; 21], expected: &[Point3<f64>]) -> f64 {
    assert_eq!(expected.len(), 21);
    found
        .iter()
        .zip(expected)
        .map(|(found, expected)| (found - expected).norm())
        .fold(0.0, f64::max)
}

/// Checks every case of a side against a file.
fn check(file: &str, side: Side) {
    let model = model(file);
    assert_eq!(model.side(), side, "{file}");
    let name = match side {
        Side::Left => "left",
        Side::Right => "right",
    };
    let cases: Vec<Case> = golden().cases;
    let cases: Vec<&Case> = cases.iter().filter(|case| case.side == name).collect();
    assert_eq!(cases.len(), 8);
    for (k, case) in cases.into_iter().enumerate() {
        let found = model.shaped(&case.betas).keypoints(&pose(&case.pose));
        let expected: Vec<Point3<f64>> = case.keypoints_m.iter().map(|&at| at.into()).collect();
        let error_m = largest_error_m(&found, &expected);
        assert!(error_m < EXACT_M, "{error_m} m in case {k} of `{file}`");
    }
}

#[test]
fn both_sides_are_those_of_an_independent_computation() {
    check("right.pkl", Side::Right);
    check("left.pkl", Side::Left);
}

#[test]
fn every_way_to_save_a_model_is_the_same_model() {
    check("right_single.pkl", Side::Right);
    for protocol in 2..=5 {
        check(&format!("right_protocol_{protocol}.pkl"), Side::Right);
    }
}

/// Landmarks of the right hand at rest, in units, as `make.py` lays them out.
const AT_REST: [[f64; 3]; 21] = [
    [48.0, -16.0, 32.0],
    [272.0, 224.0, -96.0],
    [544.0, 432.0, -144.0],
    [736.0, 560.0, -176.0],
    [896.0, 656.0, -208.0],
    [800.0, 208.0, 32.0],
    [1136.0, 240.0, 32.0],
    [1328.0, 256.0, 32.0],
    [1472.0, 272.0, 16.0],
    [800.0, 32.0, 48.0],
    [1168.0, 32.0, 48.0],
    [1392.0, 32.0, 48.0],
    [1568.0, 32.0, 32.0],
    [736.0, -144.0, 32.0],
    [1072.0, -176.0, 32.0],
    [1280.0, -192.0, 32.0],
    [1440.0, -208.0, 16.0],
    [672.0, -288.0, 0.0],
    [944.0, -352.0, 0.0],
    [1088.0, -384.0, 0.0],
    [1216.0, -416.0, -16.0],
];

fn at_rest(side: Side) -> Vec<Point3<f64>> {
    let mirror = match side {
        Side::Left => -1.0,
        Side::Right => 1.0,
    };
    let points = AT_REST.iter();
    points
        .map(|&[x, y, z]| Point3::new(mirror * x, y, z) * UNIT_M)
        .collect()
}

#[test]
fn a_flat_hand_is_the_rest_hand_moved() {
    for (flat, side) in golden().flat.iter().zip([Side::Right, Side::Left]) {
        let model = model(&format!("{}.pkl", flat.side));
        let mut pose = [0.0; 51];
        pose[3..48].copy_from_slice(&flat.coefficients);
        let translation = Vector3::new(0.3, -0.2, 0.9);
        pose[48..].copy_from_slice(translation.as_slice());
        let expected: Vec<_> = at_rest(side).iter().map(|at| at + translation).collect();
        let error_m = largest_error_m(&model.shaped(&[0.0; 10]).keypoints(&pose), &expected);
        assert!(error_m < EXACT_M, "{error_m} m, {side:?}");
    }
}

#[test]
fn the_hand_turns_about_its_wrist_at_rest_and_is_translated_afterwards() {
    let golden = golden();
    let model = model("right.pkl");
    for case in golden.cases.iter().filter(|case| case.side == "right") {
        let hand = model.shaped(&case.betas);
        let mut pose = pose(&case.pose);
        pose[..3].fill(0.0);
        pose[48..].fill(0.0);
        let unturned = hand.keypoints(&pose);
        // A quarter turn about z: x becomes y.
        pose[2] = std::f64::consts::FRAC_PI_2;
        pose[48..].copy_from_slice(&[1.0, 2.0, 3.0]);
        let wrist = unturned[0];
        let expected: Vec<_> = unturned
            .iter()
            .map(|at| {
                let arm = at - wrist;
                wrist + Vector3::new(-arm.y, arm.x, arm.z) + Vector3::new(1.0, 2.0, 3.0)
            })
            .collect();
        let error_m = largest_error_m(&hand.keypoints(&pose), &expected);
        assert!(error_m < EXACT_M, "{error_m} m");
    }
}

#[test]
fn joint_moves_its_descendants_alone() {
    let flat = golden().flat.remove(0);
    let model = model("right.pkl");
    let hand = model.shaped(&[0.0; 10]);
    let mut pose = [0.0; 51];
    pose[3..48].copy_from_slice(&flat.coefficients);
    let rest = hand.keypoints(&pose);
    // Component 20 is −1.25 rad of angle 8 and 0.25 rad of angle 9: the end joint of the index
    // finger about z, and the first joint of the middle finger about x.
    pose[3 + 20] += 0.4;
    let bent = hand.keypoints(&pose);
    // Joints; tips move by pose blend shapes too.
    let turn = Rotation3::new(Vector3::new(0.1, 0.0, 0.0));
    for joint in (0..21).filter(|idx| *idx == 0 || idx % 4 != 0) {
        let expected = match joint {
            10 | 11 => rest[9] + turn * (rest[joint] - rest[9]),
            _ => rest[joint],
        };
        let error_m = (bent[joint] - expected).norm();
        assert!(error_m < EXACT_M, "{error_m} m at landmark {joint}");
    }
}
