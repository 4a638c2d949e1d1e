//! Random motions whose rates are exact.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use robot::RobotModel;
use schemas::candidates::{Candidate, Rates, Step};
use spatial::Pose;

use crate::robots::Robots;

/// A hand with three joints, whose palm is a ball.
pub(crate) const HAND: &str = r#"<robot name="hand">
  <link name="palm"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="a"/><link name="b"/><link name="c"/>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/></joint>
  <joint name="jb" type="revolute"><parent link="palm"/><child link="b"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="7"/></joint>
  <joint name="jc" type="prismatic"><parent link="palm"/><child link="c"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="0.5"/></joint>
</robot>"#;

/// A hand that flies.
pub(crate) fn flying(hand: RobotModel) -> Robots {
    Robots {
        hand,
        hand_urdf: String::new(),
        arm: None,
    }
}

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

/// Motions of a palm and `dof` joints over 1.5 s that start and end at any speed, some of them slow and
/// some far beyond what a robot can do. The object lies so high that no table matters.
pub(crate) fn candidates(dof: usize) -> impl Strategy<Value = Candidate> {
    let place = prop::collection::vec(swing(0.3, 1.0), 3);
    let turn = (swing(1.0, 1.0), swing(1.0, 1.0));
    let joints = prop::collection::vec(swing(1.0, 1.5), dof);
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
            let spin = z * yaw_1 + y * pitch_1;
            let spin_rate = z * yaw_2 + y * pitch_2 + (z * yaw_1).cross(&(y * pitch_1));
            let six = |a: Vector3<f64>, b: Vector3<f64>| [a.x, a.y, a.z, b.x, b.y, b.z];
            let q = |order: usize| joints.iter().map(|s| s.at(time_s)[order]).collect();
            Step {
                time_s,
                object_from_palm: Pose::new(Isometry3::from_parts(
                    Translation3::from(along(0)),
                    rotation,
                )),
                q_rad: q(0),
                rates: Rates {
                    palm_velocity: six(along(1), spin),
                    palm_acceleration: six(along(2), spin_rate),
                    q_velocity_rad_per_s: q(1),
                    q_acceleration_rad_per_s2: q(2),
                },
            }
        };
        Candidate {
            candidate_id: "random".to_owned(),
            generator: "test".to_owned(),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 5.0)),
            limit_excess_rad: 0.0,
            steps: (0..n).map(step).collect(),
        }
    })
}
