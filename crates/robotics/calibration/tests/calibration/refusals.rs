//! Measurements that must be refused, each with its reason.

use calibration::{
    CalibrationError, CameraMount, MAX_FILE_BYTES, Measurements, PointPair, PosePair,
    calibrate_by_points, calibrate_by_poses,
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use spatial::{Pose, quaternion_xyzw, xyzw};

use crate::drawing::{Drawing, MOUNTS};

/// Checks an error's message with its causes and hint for their parts.
fn says<T: std::fmt::Debug>(found: Result<T, CalibrationError>, parts: &[&str]) {
    let err = found.unwrap_err();
    let cause = std::error::Error::source(&err).map_or_else(String::new, ToString::to_string);
    let text = format!("{err}: {cause}\n{}", err.hint().unwrap_or_default());
    for part in parts {
        assert!(text.contains(part), "no `{part}` in:\n{text}");
    }
}

fn changed(pairs: &[PointPair], change: impl Fn(&mut PointPair)) -> Vec<PointPair> {
    let mut pairs = pairs.to_vec();
    pairs.iter_mut().for_each(change);
    pairs
}

#[test]
fn points_that_do_not_determine_a_pose_are_refused() {
    let pairs = Drawing::new(1).points(8, 0.2, 1.0);
    says(
        calibrate_by_points(&pairs[..2]),
        &["there are 2 measurements, and at least 3", "4 are"],
    );
    says(
        calibrate_by_points(&vec![pairs[0]; 2001]),
        &["2001 measurements, more than 2000"],
    );
    let mut twice = pairs.clone();
    twice[5].in_base = twice[1].in_base;
    says(
        calibrate_by_points(&twice),
        &["`in_base_m` of measurements 2 and 6 is the same"],
    );
    let mut nan = pairs.clone();
    nan[3].in_camera.y = f64::NAN;
    says(
        calibrate_by_points(&nan),
        &["`in_camera_m` of measurement 4 is not finite"],
    );

    let camera = Drawing::new(1).camera(CameraMount::Fixed);
    let on_line = |across_m: f64| -> Vec<PointPair> {
        let point = |idx: usize| {
            let across = if idx.is_multiple_of(2) {
                across_m
            } else {
                -across_m
            };
            let in_base = Point3::new(0.3 + 0.1 * idx as f64, across, 0.1);
            PointPair {
                in_base,
                in_camera: camera.inverse() * in_base,
            }
        };
        (0..6).map(point).collect()
    };
    says(
        calibrate_by_points(&on_line(0.0)),
        &["lie on a line", "170.8 mm along it and by 0.0 mm"],
    );
    says(
        calibrate_by_points(&on_line(0.002)),
        &["lie on a line", "by 1.9 mm across", "different heights"],
    );
    assert!(calibrate_by_points(&on_line(0.03)).is_ok());
}

#[test]
fn points_in_other_units_and_mirrored_ones_are_named() {
    for noise in [0.0, 1.0] {
        let pairs = Drawing::new(2).points(8, 0.2, noise);
        let scaled = |base: f64, camera: f64| {
            calibrate_by_points(&changed(&pairs, |it| {
                it.in_base *= base;
                it.in_camera *= camera;
            }))
        };
        says(
            scaled(1000.0, 1.0),
            &[
                "`in_base_m` is up to",
                "divide points in millimeters by 1000",
            ],
        );
        says(
            scaled(1.0, 1000.0),
            &["`in_camera_m` is up to", "in meters"],
        );
        says(
            scaled(1000.0, 1000.0),
            &["`in_base_m` or `in_camera_m` is up to"],
        );
        says(scaled(1.0, 10.0), &["points are 0.100 times as far apart"]);
        says(
            scaled(0.01, 1.0),
            &[
                "points are 1.00e-2 times",
                "`in_camera_m` seems to be in centimeters",
            ],
        );
        says(
            scaled(0.001, 1.0),
            &[
                "times as far apart",
                "`in_camera_m` seems to be in millimeters: divide it by 1000",
            ],
        );
        says(
            scaled(1.0, 1.0 / 1.1),
            &["points are 1.", "times as far apart", "check the depths"],
        );
        for axis in 0..3 {
            let mirrored = changed(&pairs, |it| it.in_camera[axis] *= -1.0);
            says(
                calibrate_by_points(&mirrored),
                &["the points are mirrored", "change the sign of one axis"],
            );
        }
        assert!(calibrate_by_points(&pairs).is_ok());
    }
}

/// Noise must not be taken for another scale or a mirrored axis.
#[test]
fn noisy_points_are_not_refused() {
    for seed in 0..300 {
        for (n, height_m, noise) in [(3, 0.2, 3.0), (4, 0.0, 3.0), (5, 0.1, 3.0), (12, 0.0, 5.0)] {
            let pairs = Drawing::new(300 + seed).points(n, height_m, noise);
            let found = calibrate_by_points(&pairs);
            let is_line = matches!(found, Err(CalibrationError::Collinear { .. }));
            assert!(
                found.is_ok() || is_line,
                "{n} points, seed {seed}: {found:?}"
            );
        }
    }
}

#[test]
fn poses_that_do_not_determine_a_pose_are_refused() {
    let pairs = Drawing::new(3).poses(CameraMount::Fixed, 8, 1.0);
    let found = |pairs: &[PosePair]| calibrate_by_poses(CameraMount::Fixed, pairs);
    says(
        found(&pairs[..2]),
        &["there are 2 measurements, and at least 3"],
    );
    let mut twice = pairs.clone();
    twice[5].camera_from_board = twice[1].camera_from_board;
    says(
        found(&twice),
        &["`camera_from_board` of measurements 2 and 6 is the same"],
    );
    let mut nan = pairs.clone();
    nan[0].base_from_flange = Pose::new(Isometry3::translation(f64::NAN, 0.0, 0.0));
    says(
        found(&nan),
        &["`base_from_flange` of measurement 1 is not finite"],
    );
}

#[test]
fn rotations_about_one_axis_are_refused_with_the_axis() {
    for mount in MOUNTS {
        let turned = |beside_rad: f64, about_rad: f64| {
            let mut drawing = Drawing::new(4);
            let pairs: Vec<PosePair> = (0..10)
                .map(|idx| {
                    let part = f64::from(idx) / 9.0;
                    let turn =
                        UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, about_rad * part))
                            * UnitQuaternion::from_scaled_axis(Vector3::new(
                                beside_rad * (7.0 * part).sin(),
                                0.0,
                                0.0,
                            ));
                    let flange = Isometry3::from_parts(
                        Vector3::new(0.4, 0.1 * (5.0 * part).sin(), 0.3 + 0.2 * part).into(),
                        turn,
                    );
                    drawing.seen(mount, flange, 1.0)
                })
                .collect();
            calibrate_by_poses(mount, &pairs)
        };
        let frame = match mount {
            CameraMount::Fixed => "the base",
            CameraMount::Wrist => "the flange",
        };
        says(
            turned(0.0, 1.5),
            &[
                "the flange turns by up to 85.9° about [0.00, 0.00, 1.00] of",
                frame,
                "by 0.0° about other axes: at least 10°",
            ],
        );
        says(
            turned(0.05, 1.5),
            &[
                "1.00]",
                "of the",
                "at least 10° are needed",
                "tilt the flange",
            ],
        );
        says(turned(0.0, 0.0), &["by up to 0.0°"]);
        assert!(turned(0.5, 1.5).is_ok());
    }
}

/// The quaternion's numbers read as if the first were `w`, written as if the last were.
fn scalar_first(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let [x, y, z, w] = xyzw(&pose.rotation);
    Isometry3::from_parts(pose.translation, quaternion_xyzw([w, x, y, z]).unwrap())
}

/// A pose written otherwise.
type Change = fn(&Isometry3<f64>) -> Isometry3<f64>;

#[test]
fn other_conventions_are_named() {
    for (mount, other, name) in [
        (
            CameraMount::Fixed,
            CameraMount::Wrist,
            "write `\"camera\": \"wrist\"`",
        ),
        (
            CameraMount::Wrist,
            CameraMount::Fixed,
            "write `\"camera\": \"fixed\"`",
        ),
    ] {
        for noise in [0.0, 1.0] {
            let pairs = Drawing::new(5).poses(mount, 12, noise);
            let read = |robot: Change, board: Change| {
                let pair = |it: &PosePair| PosePair {
                    base_from_flange: Pose::new(robot(&it.base_from_flange)),
                    camera_from_board: Pose::new(board(&it.camera_from_board)),
                };
                let pairs: Vec<PosePair> = pairs.iter().map(pair).collect();
                calibrate_by_poses(mount, &pairs)
            };
            let given: Change = |it| *it;
            let inverted: Change = Isometry3::inverse;
            let either = "times better with `base_from_flange` or `camera_from_board` inverted";
            says(read(inverted, given), &[either, "solvePnP", name]);
            says(read(given, inverted), &[either, name]);
            says(
                calibrate_by_poses(other, &pairs),
                &[either, "write `\"camera\": "],
            );
            says(
                read(scalar_first, given),
                &[
                    "with quaternions as wxyz of `base_from_flange`: ",
                    "are x, y, z, w",
                ],
            );
            says(
                read(given, scalar_first),
                &["with quaternions as wxyz of `camera_from_board`"],
            );
            says(
                read(scalar_first, scalar_first),
                &["as wxyz of `base_from_flange` and `camera_from_board`"],
            );
            says(
                read(scalar_first, inverted),
                &[
                    either,
                    "inverted, and quaternions as wxyz of `base_from_flange`",
                ],
            );
            // The loops then close backward.
            let backward = read(inverted, inverted).unwrap();
            let forward = read(given, given).unwrap().board.unwrap();
            assert!(
                (backward.camera.pose().inverse() * forward.pose())
                    .translation
                    .vector
                    .norm()
                    < 0.01
            );
            let millimeters: Change =
                |it| Isometry3::from_parts((it.translation.vector * 1e3).into(), it.rotation);
            says(
                read(millimeters, given),
                &[
                    "`base_from_flange` is up to",
                    "divide poses in millimeters by 1000",
                ],
            );
            says(
                read(given, millimeters),
                &["`camera_from_board` is up to", "positions are in meters"],
            );
            let larger: Change =
                |it| Isometry3::from_parts((it.translation.vector / 1.2).into(), it.rotation);
            says(
                read(given, larger),
                &["the board seems 1.", "times as large", "measure a square"],
            );
            assert!(read(given, given).is_ok());
        }
    }
}

/// Noise must not be taken for another convention.
#[test]
fn noisy_poses_are_not_refused() {
    for seed in 0..60 {
        for mount in MOUNTS {
            for (n, noise) in [(3, 3.0), (4, 5.0), (12, 5.0)] {
                let pairs = Drawing::new(400 + seed).poses(mount, n, noise);
                let found = calibrate_by_poses(mount, &pairs);
                let turns_little = matches!(found, Err(CalibrationError::OneAxis { .. }));
                assert!(
                    found.is_ok() || turns_little,
                    "{mount:?}, {n}, seed {seed}: {found:?}"
                );
            }
        }
    }
}

#[test]
fn files_that_hold_no_measurements_are_refused_with_the_place() {
    let pose = r#"{"position_m": [0, 0, 1], "quaternion_xyzw": [0, 0, 0, 1]}"#;
    let with = |camera_from_board: &str| {
        format!(
            r#"{{"camera": "fixed", "poses": [
            {{"base_from_flange": {pose}, "camera_from_board": {pose}}},
            {{"base_from_flange": {pose}, "camera_from_board": {camera_from_board}}}]}}"#
        )
    };
    let matrix = |rows: &str| with(&format!(r#"{{"matrix": {rows}}}"#));
    for (text, parts) in [
        (
            String::new(),
            &["does not hold measurements", "line 1", "`in_base_m`\": [x"][..1],
        ),
        (
            "[]".to_owned(),
            &["expected an object with `points`, or with `camera` and `poses`"],
        ),
        (
            "{}".to_owned(),
            &["the file has neither, expected `points` or `poses`"],
        ),
        (
            r#"{"points": [], "poses": []}"#.to_owned(),
            &["the file has both"],
        ),
        (
            r#"{"poses": []}"#.to_owned(),
            &["`camera` is missing", "\"camera\": \"wrist\""],
        ),
        (
            r#"{"camera": "hand", "poses": []}"#.to_owned(),
            &["unknown variant `hand`, expected `fixed` or `wrist`"],
        ),
        (
            r#"{"camera": "wrist", "points": []}"#.to_owned(),
            &["\"wrist\"", "stands still"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,0], "in_camera": [0,0,0]}]}"#.to_owned(),
            &["entry 1: unknown field `in_camera`", "line 1"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,0]}]}"#.to_owned(),
            &["entry 1: missing field `in_camera_m`"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,0], "in_base_m": [0,0,0]}]}"#.to_owned(),
            &["duplicate field `in_base_m`"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0], "in_camera_m": [0,0,0]}]}"#.to_owned(),
            &["point 1: in_base_m: it has 2 numbers, expected 3"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,0], "in_camera_m": [0,null,0]}]}"#.to_owned(),
            &["point 1: in_camera_m: `null` is no number"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,1e999], "in_camera_m": [0,0,0]}]}"#.to_owned(),
            &["entry 1: number out of range"],
        ),
        (
            r#"{"points": [{"in_base_m": [0,0,NaN], "in_camera_m": [0,0,0]}]}"#.to_owned(),
            &["entry 1: expected value at line 1"],
        ),
        (
            with("0"),
            &["entry 2: invalid type: integer `0`, expected a pose: `position_m` and"],
        ),
        (
            with("{}"),
            &[
                "pose 2: camera_from_board: a pose with no field is none",
                "give `position_m`",
            ],
        ),
        (
            with(r#"{"position_m": [0,0,1]}"#),
            &["a pose with `position_m` is none"],
        ),
        (
            with(r#"{"position_m": [0,0,1], "quaternion_xyzw": [0,0,0,2]}"#),
            &[
                "pose 2: camera_from_board.quaternion_xyzw: quaternion [x, y, z, w] = [0.0, 0.0, 0.0, 2.0] has length 2",
            ],
        ),
        (
            with(r#"{"position_m": "here", "quaternion_xyzw": [0,0,0,1]}"#),
            &["camera_from_board.position_m: it is `\"here\"`, expected 3 numbers"],
        ),
        (
            with(r#"{"position_m": [0,0,1], "rotation": [0,0,0,1]}"#),
            &["entry 2: unknown field `rotation`", "line 3"],
        ),
        (
            matrix("[[1,0,0,0],[0,1,0,0],[0,0,-1,0],[0,0,0,1]]"),
            &["pose 2: camera_from_board.matrix: it is left-handed"],
        ),
        (
            matrix("[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]"),
            &["its rows have length 2.0000, expected 1"],
        ),
        (
            matrix("[[1,0.1,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"),
            &["products of its rows are off by 0.1"],
        ),
        (
            matrix("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,0,0,1]]"),
            &["the last row is [5.0, 0.0, 0.0, 1.0]", "row by row"],
        ),
        (
            matrix("[[1,0,0],[0,1,0],[0,0,1]]"),
            &["it has 3 rows, expected 4", "four rows of four"],
        ),
        (
            matrix("[[1,0,0,0],[0,1,0],[0,0,1,0],[0,0,0,1]]"),
            &["it has 3 numbers, expected 4"],
        ),
    ] {
        says(
            Measurements::parse(text.as_bytes()).and_then(|it| it.calibrate()),
            parts,
        );
    }
    says(Measurements::parse(b"\xff\xfe{"), &["no text in UTF-8"]);
    says(
        Measurements::parse(&vec![b' '; MAX_FILE_BYTES + 1]),
        &["more than 4 MiB"],
    );
}

#[test]
fn matrices_and_quaternions_are_the_same_poses() {
    let rows = "[[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]";
    let flat = "[0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]";
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let numbers =
        format!(r#"{{"position_m": [0.1, 0.2, 0.3], "quaternion_xyzw": [0, 0, {half}, {half}]}}"#);
    let text = format!(
        "\u{feff}{{\"camera\": \"wrist\", \"poses\": [\
         {{\"base_from_flange\": {{\"matrix\": {rows}}}, \"camera_from_board\": {{\"matrix\": {flat}}}}},\
         {{\"base_from_flange\": {numbers}, \"camera_from_board\": {numbers}}}]}}"
    );
    let Measurements::Poses { mount, pairs } = Measurements::parse(text.as_bytes()).unwrap() else {
        panic!("these are poses");
    };
    assert_eq!(mount, CameraMount::Wrist);
    let same = *pairs[1].base_from_flange;
    for pose in [*pairs[0].base_from_flange, *pairs[0].camera_from_board] {
        assert!((pose.translation.vector - same.translation.vector).norm() < 1e-12);
        assert!(pose.rotation.angle_to(&same.rotation) < 1e-9);
    }
}
