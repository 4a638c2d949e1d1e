//! Motions of a hand and a box, as a screen would record them.

use geometry::TriMesh;
use glb::{Contact, Moment, MotionScene, ObjectMesh};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use robot::RobotModel;
use spatial::Pose;

pub(crate) const HAND: &str = include_str!("../../../../../data/robots/allegro_right.urdf");

pub(crate) fn hand() -> RobotModel {
    RobotModel::from_urdf(HAND).unwrap()
}

/// A box of 4 by 6 by 10 cm.
pub(crate) fn object() -> ObjectMesh {
    let half = Vector3::new(0.02, 0.03, 0.05);
    let mesh = TriMesh::cuboid(Point3::from(-half), Point3::from(half));
    ObjectMesh {
        vertices_m: mesh
            .vertices_m
            .iter()
            .map(|&vertex| vertex.into())
            .collect(),
        triangles: mesh.triangles,
    }
}

/// Frequencies and sizes of a motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MotionSpectrum {
    pub(crate) turns_per_s: f64,
    pub(crate) reach_m: f64,
    pub(crate) shake_m: f64,
}

/// A motion that reaches, closes, shakes and lifts; `steps` of 4 ms.
pub(crate) fn motion(hand: &RobotModel, wild: MotionSpectrum, steps: u32) -> Vec<Moment> {
    let moment = |step: u32| {
        let time_s = f64::from(step) * 0.004;
        let turn = std::f64::consts::TAU * wild.turns_per_s * time_s;
        let q: Vec<f64> = hand
            .joints()
            .iter()
            .enumerate()
            .map(|(idx, joint)| {
                let share = 0.5 + 0.5 * (turn + idx as f64).sin();
                joint.lower + share * (joint.upper - joint.lower)
            })
            .collect();
        let axis = Vector3::new(turn.sin(), 0.3, turn.cos());
        let rotation = UnitQuaternion::from_scaled_axis(axis * (1.0 + turn.sin()));
        let palm = [
            wild.reach_m * turn.cos(),
            wild.shake_m * (9.0 * turn).sin(),
            0.2,
        ];
        let lifted = [0.0, wild.shake_m * (31.0 * turn).cos(), 0.05 + 0.1 * time_s];
        Moment {
            time_s,
            table_from_root: Pose::from_parts(palm, rotation),
            q_command: Some(q.iter().map(|q| q + 0.05).collect()),
            q,
            table_from_object: Pose::from_parts(lifted, rotation.inverse()),
            contacts: (0..step % 4)
                .map(|idx| Contact {
                    point_in_table_m: [0.01 * f64::from(idx), 0.0, 0.05],
                    force_n: f64::from(idx),
                })
                .collect(),
        }
    };
    (0..steps).map(moment).collect()
}

pub(crate) fn scene<'a>(hand: &'a RobotModel, object: &'a ObjectMesh) -> MotionScene<'a> {
    MotionScene {
        name: "box-00001",
        robot: hand,
        object,
        about: &[],
    }
}
