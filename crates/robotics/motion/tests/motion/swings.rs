//! Random motions whose rates are exact.

use std::f64::consts::TAU;

use motion::{HandRates, JointRates, Motion, Step};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use spatial::{Object, Pose, Twist};

/// A number that swings: value, velocity and acceleration at a time.
#[derive(Debug, Clone, Copy)]
struct Swing {
    amplitude: f64,
    hz: f64,
    phase: f64,
    drift: f64,
}

impl Swing {
    fn at(self, time_s: f64) -> [f64; 3] {
        let speed = TAU * self.hz;
        let (sin, cos) = (speed * time_s + self.phase).sin_cos();
        [
            self.amplitude * sin + self.drift * time_s,
            self.amplitude * speed * cos + self.drift,
            -self.amplitude * speed * speed * sin,
        ]
    }
}

fn swing(amplitude: f64, hz: f64) -> impl Strategy<Value = Swing> {
    let drift = -0.2..0.2_f64;
    (0.0..amplitude, 0.05..hz, 0.0..TAU, drift).prop_map(|(amplitude, hz, phase, drift)| Swing {
        amplitude,
        hz,
        phase,
        drift,
    })
}

/// Motions of a palm and of these joints over 1.5 s that start and end at any speed, some of them slow and
/// some far beyond what a robot can do.
pub(crate) fn motions(names: &'static [&'static str]) -> impl Strategy<Value = Motion<Object>> {
    let place = prop::collection::vec(swing(0.3, 1.0), 3);
    let turn = (swing(1.0, 1.0), swing(1.0, 1.0));
    let joints = prop::collection::vec(swing(1.0, 1.5), names.len());
    (place, turn, joints, 15..60_usize).prop_map(|(place, (yaw, pitch), joints, n)| {
        let step = |idx: usize| {
            let time_s = 1.5 * idx as f64 / (n - 1) as f64;
            let place: Vec<[f64; 3]> = place.iter().map(|s| s.at(time_s)).collect();
            let along = |order: usize| Vector3::from_fn(|axis, _| place[axis][order]);
            // First about z, then about the y that this makes.
            let [yaw, yaw_1, yaw_2] = yaw.at(time_s);
            let [pitch, pitch_1, pitch_2] = pitch.at(time_s);
            let z = Vector3::z();
            let first = UnitQuaternion::from_scaled_axis(z * yaw);
            let y = first * Vector3::y();
            let rotation = first * UnitQuaternion::from_scaled_axis(Vector3::y() * pitch);
            let pose = Isometry3::from_parts(Translation3::from(along(0)), rotation);
            let q = |order: usize| joints.iter().map(|s| s.at(time_s)[order]).collect();
            Step {
                time_s,
                frame_from_palm: Pose::new(pose),
                q_rad: q(0),
                rates: HandRates {
                    palm_velocity: Twist::new(along(1), z * yaw_1 + y * pitch_1),
                    palm_acceleration: Twist::new(
                        along(2),
                        z * yaw_2 + y * pitch_2 + (z * yaw_1).cross(&(y * pitch_1)),
                    ),
                    joints: JointRates {
                        velocity: q(1),
                        acceleration: q(2),
                    },
                },
            }
        };
        Motion::new(names, (0..n).map(step).collect()).unwrap()
    })
}
