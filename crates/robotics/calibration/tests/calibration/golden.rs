//! Calibrations against `SciPy` and `OpenCV`, whose numbers `../golden/make.py` wrote down.

use calibration::{Agreement, Calibration, Measurements};
use nalgebra::{Isometry3, Matrix4, Rotation3, UnitQuaternion};
use serde_json::Value;

/// Largest difference from `SciPy`'s minimum, whose derivatives are numeric, in meters and radians.
const TOLERANCE: f64 = 1e-7;

const FILES: [(&str, &str); 3] = [
    ("fixed", include_str!("../golden/fixed.json")),
    ("wrist", include_str!("../golden/wrist.json")),
    ("points", include_str!("../golden/points.json")),
];

fn golden() -> Value {
    serde_json::from_str(include_str!("../golden/golden.json")).unwrap()
}

fn found(text: &str) -> Calibration {
    Measurements::parse(text.as_bytes())
        .unwrap()
        .calibrate()
        .unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    let list = value.as_array().unwrap();
    list.iter().map(|it| it.as_f64().unwrap()).collect()
}

fn pose(value: &Value) -> Isometry3<f64> {
    let matrix = Matrix4::from_row_slice(&numbers(value));
    let rotation = matrix.fixed_view::<3, 3>(0, 0).into_owned();
    Isometry3::from_parts(
        matrix.fixed_view::<3, 1>(0, 3).into_owned().into(),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    )
}

fn difference(a: &Isometry3<f64>, b: &Isometry3<f64>) -> [f64; 2] {
    let offset = a.translation.vector - b.translation.vector;
    [offset.norm(), a.rotation.angle_to(&b.rotation)]
}

#[test]
fn poses_are_those_of_scipy() {
    let golden = golden();
    for (name, text) in FILES {
        let (found, theirs) = (found(text), &golden[name]);
        let mut pairs = vec![(found.camera.pose(), "scipy")];
        pairs.extend(found.board.map(|board| (board.pose(), "scipy_board")));
        for (ours, key) in pairs {
            for difference in difference(&ours, &pose(&theirs[key])) {
                assert!(difference < TOLERANCE, "{name} {key}: {difference:e}");
            }
        }
        let Agreement(residuals) = &found.residuals;
        let check = |ours: Vec<f64>, theirs: &Value| {
            for (ours, theirs) in ours.iter().zip(numbers(theirs)) {
                assert!((ours - theirs).abs() < TOLERANCE, "{name}: {ours} {theirs}");
            }
        };
        let offsets: Vec<f64> = residuals.iter().map(|it| it.offset_m).collect();
        assert_eq!(offsets.len(), 12);
        check(offsets, &theirs["offsets_m"]);
        if name != "points" {
            let turns = residuals.iter().filter_map(|it| it.rotation_rad);
            check(turns.collect(), &theirs["rotations_rad"]);
        }
    }
}

#[test]
fn poses_are_nearer_to_the_truth_than_those_in_closed_form() {
    let golden = golden();
    for (name, text) in &FILES[..2] {
        let theirs = &golden[*name];
        let truth = pose(&theirs["true"]);
        let ours = difference(&found(text).camera.pose(), &truth);
        for method in ["opencv_park", "opencv_tsai"] {
            let theirs = difference(&pose(&theirs[method]), &truth);
            for (ours, theirs) in ours.iter().zip(theirs) {
                assert!(*ours < theirs, "{name} {method}: {ours} {theirs}");
            }
        }
    }
}
