//! Calibrations of drawn measurements find the poses by which they were drawn.

use std::time::Instant;

use calibration::{
    Agreement, CalibrationError, CameraMount, PointPair, calibrate_by_points, calibrate_by_poses,
};
use nalgebra::{Isometry3, Point3};

use crate::drawing::{Drawing, MOUNTS};

/// Differences of a pose from the true one, in meters and radians.
fn errors(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> [f64; 2] {
    let offset = found.translation.vector - truth.translation.vector;
    [offset.norm(), found.rotation.angle_to(&truth.rotation)]
}

#[test]
fn exact_poses_are_found_exactly() {
    for seed in 0..20 {
        for mount in MOUNTS {
            for n in [3, 4, 10] {
                let mut drawing = Drawing::new(seed);
                let pairs = drawing.poses(mount, n, 0.0);
                let found = match calibrate_by_poses(mount, &pairs) {
                    Err(CalibrationError::OneAxis { .. }) if n < 5 => continue,
                    found => found.unwrap(),
                };
                let truth = drawing.camera(mount);
                for error in errors(&found.camera.pose(), &truth) {
                    assert!(error < 1e-9, "seed {seed}, {mount:?}, {n} poses: {error:e}");
                }
                let board = found.board.unwrap().pose();
                assert!(errors(&board, &drawing.board)[0] < 1e-9);
                assert!(found.residuals.rms().offset_m < 1e-9);
                if n == 10 {
                    let ahead = found.leave_one_out().unwrap().rms();
                    assert!(ahead.offset_m < 1e-9, "{ahead:?}");
                }
            }
        }
    }
}

#[test]
fn exact_points_are_found_exactly_also_on_a_plane() {
    for seed in 0..50 {
        for (n, height_m) in [(3, 0.2), (4, 0.2), (4, 0.0), (30, 0.2), (30, 0.0)] {
            let mut drawing = Drawing::new(seed);
            let pairs = drawing.points(n, height_m, 0.0);
            let found = match calibrate_by_points(&pairs) {
                Err(CalibrationError::Collinear { .. }) if n < 5 => continue,
                found => found.unwrap(),
            };
            let truth = drawing.camera(CameraMount::Fixed);
            for error in errors(&found.camera.pose(), &truth) {
                assert!(error < 1e-9, "seed {seed}, {n} points: {error:e}");
            }
            assert_eq!(found.held_out.len(), if n > 3 { n } else { 0 });
        }
    }
}

/// With noise of 1 mm and 0.2° (per axis) in what the camera sees, of 20 measurements.
#[test]
fn noise_moves_the_pose_by_no_more_than_it_should() {
    let n_seeds = 40;
    for mount in MOUNTS {
        let (mut offsets, mut turns, mut residuals, mut predicted) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..n_seeds {
            let mut drawing = Drawing::new(100 + seed);
            let pairs = drawing.poses(mount, 20, 1.0);
            let found = calibrate_by_poses(mount, &pairs).unwrap();
            let [offset, turn] = errors(&found.camera.pose(), &drawing.camera(mount));
            offsets += offset * offset;
            turns += turn * turn;
            residuals += found.residuals.rms().offset_m.powi(2);
            predicted += found.leave_one_out().unwrap().rms().offset_m.powi(2);
        }
        let [offset, turn, residual, ahead] = [offsets, turns, residuals, predicted]
            .map(|squares: f64| (squares / n_seeds as f64).sqrt());
        // The noise has a length of √3 mm, of which the solution takes the twelfth part of six numbers by 20.
        assert!(
            (1.4e-3..1.75e-3).contains(&residual),
            "{mount:?}: {residual}"
        );
        assert!((1.7e-3..2.3e-3).contains(&ahead), "{mount:?}: {ahead}");
        assert!(offset < 2e-3, "{mount:?}: {offset}");
        assert!(turn.to_degrees() < 0.2, "{mount:?}: {turn}");
    }
}

#[test]
fn noise_of_points_moves_the_pose_by_no_more_than_it_should() {
    let n_seeds = 40;
    let (mut at_points, mut residuals, mut predicted) = (0.0, 0.0, 0.0);
    for seed in 0..n_seeds {
        let mut drawing = Drawing::new(200 + seed);
        let pairs = drawing.points(20, 0.2, 1.0);
        let found = calibrate_by_points(&pairs).unwrap();
        // Where the robot grasps, not at the camera, which is a meter away.
        let middle = Point3::new(0.5, 0.0, 0.1);
        let truth = drawing.camera(CameraMount::Fixed);
        let seen = found.camera.pose() * (truth.inverse() * middle);
        at_points += (seen - middle).norm_squared();
        residuals += found.residuals.rms().offset_m.powi(2);
        predicted += found.leave_one_out().unwrap().rms().offset_m.powi(2);
    }
    let [at_points, residual, ahead] =
        [at_points, residuals, predicted].map(|squares: f64| (squares / n_seeds as f64).sqrt());
    assert!(at_points < 0.6e-3, "{at_points}");
    // √(3 − 6/20) mm.
    assert!((1.5e-3..1.8e-3).contains(&residual), "{residual}");
    assert!((1.75e-3..2.1e-3).contains(&ahead), "{ahead}");
}

#[test]
fn the_wrong_measurement_is_named() {
    for mount in MOUNTS {
        let mut pairs = Drawing::new(3).poses(mount, 12, 1.0);
        let moved = pairs[6]
            .camera_from_board
            .translated(&[0.0, 0.04, 0.0].into());
        pairs[6].camera_from_board = moved;
        let found = calibrate_by_poses(mount, &pairs).unwrap();
        let (number, error) = found.residuals.largest().unwrap();
        assert_eq!(number, 7);
        assert!(error.offset_m > 0.02, "{error:?}");
    }
    let mut pairs = Drawing::new(4).points(12, 0.2, 1.0);
    pairs[2].in_camera.x += 0.03;
    let found = calibrate_by_points(&pairs).unwrap();
    assert_eq!(found.residuals.largest().unwrap().0, 3);
}

/// The prediction of each measurement is that of a calibration without it.
#[test]
fn leaving_one_out_is_calibrating_without_it() {
    for mount in MOUNTS {
        let drawing = &mut Drawing::new(5);
        let pairs = drawing.poses(mount, 9, 1.0);
        let found = calibrate_by_poses(mount, &pairs).unwrap();
        for (idx, pair) in pairs.iter().enumerate() {
            let mut others = pairs.clone();
            others.remove(idx);
            let without = calibrate_by_poses(mount, &others).unwrap();
            let base_from_flange = *pair.base_from_flange;
            let a = match mount {
                CameraMount::Fixed => base_from_flange.inverse(),
                CameraMount::Wrist => base_from_flange,
            };
            let seen = a * without.camera.pose() * *pair.camera_from_board;
            let [offset, turn] = errors(&seen, &without.board.unwrap().pose());
            let predicted = found.held_out[idx].unwrap();
            // One step of Gauss and Newton: to a hundredth.
            assert!(
                (predicted.offset_m / offset - 1.0).abs() < 0.02,
                "{predicted:?} {offset}"
            );
            assert!((predicted.rotation_rad.unwrap() / turn - 1.0).abs() < 0.02);
        }
    }
    let pairs = Drawing::new(6).points(8, 0.2, 1.0);
    let found = calibrate_by_points(&pairs).unwrap();
    for (idx, pair) in pairs.iter().enumerate() {
        let mut others: Vec<PointPair> = pairs.clone();
        others.remove(idx);
        let without = calibrate_by_points(&others).unwrap().camera.pose();
        let error = (without * pair.in_camera - pair.in_base).norm();
        assert!((found.held_out[idx].unwrap().offset_m - error).abs() < 1e-9);
    }
}

#[test]
fn a_point_that_alone_is_beside_a_line_cannot_be_left_out() {
    let mut pairs = Drawing::new(8).points(4, 0.0, 0.0);
    let camera = Drawing::new(8).camera(CameraMount::Fixed);
    for (idx, pair) in pairs.iter_mut().enumerate() {
        let along = 0.1 * idx as f64;
        pair.in_base = if idx == 3 {
            Point3::new(0.5, 0.1, 0.0)
        } else {
            Point3::new(0.4 + along, 0.0, 0.0)
        };
        pair.in_camera = camera.inverse() * pair.in_base;
    }
    let found = calibrate_by_points(&pairs).unwrap();
    assert_eq!(found.indispensable(), Some(4));
    assert!(found.leave_one_out().is_none());
}

#[test]
fn many_poses_take_little_time() {
    let pairs = Drawing::new(9).poses(CameraMount::Fixed, 100, 1.0);
    let begun = Instant::now();
    let found = calibrate_by_poses(CameraMount::Fixed, &pairs).unwrap();
    let took = begun.elapsed();
    let Agreement(residuals) = &found.residuals;
    assert_eq!(residuals.len(), 100);
    println!("100 poses took {took:?}");
    // 10 ms on a quiet core.
    assert!(took.as_secs_f64() < 3.0, "{took:?}");
}
