//! The pose of a camera from points that the robot has touched.

use nalgebra::{Matrix3, Point3, Vector3};
use spatial::{Base, Camera, Pose};

use crate::{
    agreement::{Agreement, Residual},
    alignment::{Alignment, align},
    calibrated::{Calibration, CameraPose},
    checks::{check_count, check_points},
    error::{CalibrationError, Field},
};

/// A point that was measured in both frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    /// The point in the frame of the robot's base, in meters.
    pub in_base: Point3<f64>,
    /// The point in the frame of the camera, in meters.
    pub in_camera: Point3<f64>,
}

/// Number of points from which each can be left out.
const LEAVE_ONE_OUT_N: usize = 4;
/// Least spread of points beside a line, relative to that along it.
const LEAST_ASPECT: f64 = 0.05;
/// Least spread of points beside a line, in meters: 1 mm of noise then turns the camera by 10° at most.
const LEAST_ACROSS_M: f64 = 0.005;
/// Ratio of distances that is none of noise.
const GROSS_SCALE: f64 = 1.5;
/// Least difference of a ratio of distances from 1 that is not taken for noise.
const LEAST_SCALE_CHANGE: f64 = 0.02;
/// Factor by which another scale or a reflection must lower the residual.
const FAR_BETTER: f64 = 5.0;
/// Residual below which neither is considered, in meters.
const GOOD_M: f64 = 1e-4;

/// Returns the pose of a camera that stands still, from at least 3 points in the frames of base and camera: the rigid
/// transform with the least squares of distances (Umeyama 1991; Kabsch, *A solution for the best rotation to relate two
/// sets of vectors*, Acta Crystallographica 1976).
///
/// # Errors
///
/// Fails if there are fewer than 3 or too many points, if they lie on a line, if a point occurs twice, if a number is
/// not finite or no position in meters, or if another scale or a mirrored axis explains them far better.
pub fn calibrate_by_points(pairs: &[PointPair]) -> Result<Calibration, CalibrationError> {
    check_count(pairs.len())?;
    check_points(pairs)?;
    let sums = Sums::of(pairs);
    // In another unit every distance may be small.
    check_spread(&sums, 0.0)?;
    check_gross_scale(&sums)?;
    check_spread(&sums, LEAST_ACROSS_M)?;
    let alignment = align(&sums.correlation()).ok_or(CalibrationError::NoSolution)?;
    let base_from_camera = sums.pose(&alignment);
    let residuals = Agreement(
        pairs
            .iter()
            .map(|it| error(&base_from_camera, it))
            .collect(),
    );
    check_far_better(&sums, &alignment, residuals.rms().offset_m)?;
    Ok(Calibration {
        camera: CameraPose::Fixed(base_from_camera),
        board: None,
        residuals,
        held_out: held_out(pairs, &sums),
    })
}

fn error(base_from_camera: &Pose<Base, Camera>, pair: &PointPair) -> Residual {
    Residual {
        offset_m: (*base_from_camera * pair.in_camera - pair.in_base).norm(),
        rotation_rad: None,
    }
}

/// Returns the error with which the other points predict each.
fn held_out(pairs: &[PointPair], sums: &Sums) -> Vec<Option<Residual>> {
    if pairs.len() < LEAVE_ONE_OUT_N {
        return Vec::new();
    }
    let without = |pair: &PointPair| {
        let sums = sums.without(pair);
        let [along_m, across_m] = spreads(&sums.base_scatter(), sums.n);
        if is_line(along_m, across_m, LEAST_ACROSS_M) {
            return None;
        }
        let alignment = align(&sums.correlation())?;
        Some(error(&sums.pose(&alignment), pair))
    };
    pairs.iter().map(without).collect()
}

/// Refuses points that lie on a line in one of the frames.
fn check_spread(sums: &Sums, least_across_m: f64) -> Result<(), CalibrationError> {
    for (field, scatter) in [
        (Field::InBase, sums.base_scatter()),
        (Field::InCamera, sums.camera_scatter()),
    ] {
        let [along_m, across_m] = spreads(&scatter, sums.n);
        if is_line(along_m, across_m, least_across_m) {
            return Err(CalibrationError::Collinear {
                field,
                along_m,
                across_m,
            });
        }
    }
    Ok(())
}

/// Refuses frames with another unit.
fn check_gross_scale(sums: &Sums) -> Result<(), CalibrationError> {
    let [base, camera] = [sums.base_scatter(), sums.camera_scatter()].map(|it| it.trace());
    let factor = (base / camera).sqrt();
    if (1.0 / GROSS_SCALE..GROSS_SCALE).contains(&factor) {
        return Ok(());
    }
    Err(CalibrationError::Scale { factor })
}

/// Refuses points that another scale or a reflection explains far better.
fn check_far_better(
    sums: &Sums,
    alignment: &Alignment,
    rms_m: f64,
) -> Result<(), CalibrationError> {
    let [base, camera] = [sums.base_scatter(), sums.camera_scatter()].map(|it| it.trace());
    let n = sums.n as f64;
    let is_far_better = |squares: f64| (squares.max(0.0) / n).sqrt() * FAR_BETTER < rms_m;
    if rms_m < GOOD_M {
        return Ok(());
    }
    let mirrored = base + camera - 2.0 * alignment.mirrored_product;
    if is_far_better(mirrored) {
        return Err(CalibrationError::Mirrored {
            rms_m,
            mirrored_rms_m: (mirrored.max(0.0) / n).sqrt(),
        });
    }
    // Umeyama 1991, equations 42 and 43.
    let factor = alignment.product / camera;
    let scaled = base - alignment.product * factor;
    if sums.n >= LEAVE_ONE_OUT_N
        && (factor - 1.0).abs() > LEAST_SCALE_CHANGE
        && is_far_better(scaled)
    {
        return Err(CalibrationError::Scale { factor });
    }
    Ok(())
}

fn is_line(along_m: f64, across_m: f64, least_across_m: f64) -> bool {
    across_m < least_across_m || across_m < LEAST_ASPECT * along_m
}

/// Returns the standard deviations of points along the line nearest to them and across it, in meters, from their
/// scatter.
fn spreads(scatter: &Matrix3<f64>, n: usize) -> [f64; 2] {
    let mut squares: Vec<f64> = scatter.symmetric_eigenvalues().iter().copied().collect();
    squares.sort_by(|a, b| b.total_cmp(a));
    let spread = |idx: usize| {
        let square = squares.get(idx).copied().unwrap_or(0.0);
        (square.max(0.0) / n as f64).sqrt()
    };
    [spread(0), spread(1)]
}

/// Sums over points relative to their first means, so that a point can be taken out of them.
#[derive(Debug, Clone, Copy)]
struct Sums {
    n: usize,
    base_origin: Point3<f64>,
    camera_origin: Point3<f64>,
    base: Vector3<f64>,
    camera: Vector3<f64>,
    base_base: Matrix3<f64>,
    camera_camera: Matrix3<f64>,
    base_camera: Matrix3<f64>,
}

impl Sums {
    fn of(pairs: &[PointPair]) -> Self {
        let n = pairs.len() as f64;
        let base: Vector3<f64> = pairs.iter().map(|it| it.in_base.coords).sum();
        let camera: Vector3<f64> = pairs.iter().map(|it| it.in_camera.coords).sum();
        let none = Self {
            n: 0,
            base_origin: Point3::from(base / n),
            camera_origin: Point3::from(camera / n),
            base: Vector3::zeros(),
            camera: Vector3::zeros(),
            base_base: Matrix3::zeros(),
            camera_camera: Matrix3::zeros(),
            base_camera: Matrix3::zeros(),
        };
        let all = pairs.iter().fold(none, |sums, pair| sums.plus(pair, 1.0));
        Self {
            n: pairs.len(),
            ..all
        }
    }

    fn plus(&self, pair: &PointPair, weight: f64) -> Self {
        let base = pair.in_base - self.base_origin;
        let camera = pair.in_camera - self.camera_origin;
        Self {
            base: self.base + base * weight,
            camera: self.camera + camera * weight,
            base_base: self.base_base + base * base.transpose() * weight,
            camera_camera: self.camera_camera + camera * camera.transpose() * weight,
            base_camera: self.base_camera + base * camera.transpose() * weight,
            ..*self
        }
    }

    fn without(&self, pair: &PointPair) -> Self {
        Self {
            n: self.n - 1,
            ..self.plus(pair, -1.0)
        }
    }

    fn base_scatter(&self) -> Matrix3<f64> {
        self.base_base - self.base * self.base.transpose() / self.n as f64
    }

    fn camera_scatter(&self) -> Matrix3<f64> {
        self.camera_camera - self.camera * self.camera.transpose() / self.n as f64
    }

    fn correlation(&self) -> Matrix3<f64> {
        self.base_camera - self.base * self.camera.transpose() / self.n as f64
    }

    fn pose(&self, alignment: &Alignment) -> Pose<Base, Camera> {
        let base = self.base_origin + self.base / self.n as f64;
        let camera = self.camera_origin + self.camera / self.n as f64;
        let offset = base.coords - alignment.rotation * camera.coords;
        Pose::from_parts(offset, alignment.rotation)
    }
}
