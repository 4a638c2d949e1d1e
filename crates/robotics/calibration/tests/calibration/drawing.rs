//! Drawn measurements.

use calibration::{CameraMount, PointPair, PosePair};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use spatial::Pose;

pub(crate) const MOUNTS: [CameraMount; 2] = [CameraMount::Fixed, CameraMount::Wrist];

/// Standard deviations of noise 1, per axis, in meters and radians: 1 mm and 0.2°.
const NOISE: [f64; 2] = [1e-3, 0.2 * std::f64::consts::PI / 180.0];
/// Largest tilt of the flange about each axis, in radians.
const TILT_RAD: f64 = 0.7;

/// A laboratory with its random numbers.
pub(crate) struct Drawing {
    rng: ChaCha8Rng,
    fixed: Isometry3<f64>,
    wrist: Isometry3<f64>,
    /// The board's pose, on the flange or beside the robot.
    pub(crate) board: Isometry3<f64>,
}

impl Drawing {
    pub(crate) fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let fixed = pose(&mut rng, [1.0, 0.0, 0.8], 0.2, 3.0);
        let wrist = pose(&mut rng, [0.05, 0.0, 0.05], 0.02, 3.0);
        let board = pose(&mut rng, [0.3, 0.0, 0.05], 0.1, 0.5);
        Self {
            rng,
            fixed,
            wrist,
            board,
        }
    }

    /// Returns the camera's true pose.
    pub(crate) fn camera(&self, mount: CameraMount) -> Isometry3<f64> {
        match mount {
            CameraMount::Fixed => self.fixed,
            CameraMount::Wrist => self.wrist,
        }
    }

    pub(crate) fn poses(&mut self, mount: CameraMount, n: usize, noise: f64) -> Vec<PosePair> {
        let down = UnitQuaternion::from_scaled_axis(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
        let flange = |drawing: &mut Self| {
            let mut flange = pose(&mut drawing.rng, [0.45, 0.0, 0.45], 0.15, TILT_RAD);
            flange.rotation = down * flange.rotation;
            flange
        };
        let flanges: Vec<_> = (0..n).map(|_| flange(self)).collect();
        flanges
            .into_iter()
            .map(|base_from_flange| self.seen(mount, base_from_flange, noise))
            .collect()
    }

    /// Returns a pose of the flange with the board's as the camera sees it.
    pub(crate) fn seen(
        &mut self,
        mount: CameraMount,
        base_from_flange: Isometry3<f64>,
        noise: f64,
    ) -> PosePair {
        let a = match mount {
            CameraMount::Fixed => base_from_flange.inverse(),
            CameraMount::Wrist => base_from_flange,
        };
        let mut camera_from_board = (a * self.camera(mount)).inverse() * self.board;
        let [offset, turn] = NOISE.map(|size| self.normal() * size * noise);
        camera_from_board.translation.vector += offset;
        camera_from_board.rotation *= UnitQuaternion::from_scaled_axis(turn);
        PosePair {
            base_from_flange: Pose::new(base_from_flange),
            camera_from_board: Pose::new(camera_from_board),
        }
    }

    /// Draws points up to a height above the base.
    pub(crate) fn points(&mut self, n: usize, height_m: f64, noise: f64) -> Vec<PointPair> {
        let point = |drawing: &mut Self| {
            let [x, y, z] = [0.2, 0.3, height_m / 2.0].map(|size| uniform(&mut drawing.rng, size));
            let in_base = Point3::new(0.5 + x, y, height_m / 2.0 + z);
            let in_camera = drawing.fixed.inverse() * in_base;
            PointPair {
                in_base,
                in_camera: in_camera + drawing.normal() * NOISE[0] * noise,
            }
        };
        (0..n).map(|_| point(self)).collect()
    }

    fn normal(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.rng.sample(StandardNormal))
    }
}

fn pose(rng: &mut ChaCha8Rng, middle: [f64; 3], range_m: f64, turn_rad: f64) -> Isometry3<f64> {
    let offset = Vector3::from(middle) + Vector3::from_fn(|_, _| uniform(rng, range_m));
    let turn = Vector3::from_fn(|_, _| uniform(rng, turn_rad));
    Isometry3::from_parts(
        Translation3::from(offset),
        UnitQuaternion::from_scaled_axis(turn),
    )
}

/// Draws a number from −`size` to `size`.
fn uniform(rng: &mut ChaCha8Rng, size: f64) -> f64 {
    size * rng.random_range(-1.0..=1.0)
}
