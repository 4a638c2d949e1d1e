//! Fixtures of the tests: a box on a table, a hand that grasps it, and a space of eigengrasps.

use approach::HandBody;
use grasp_fixture::{FLEXION, StandingBox, URDF};
use schemas::trajectories::Trajectory;

use crate::{EigengraspConfig, basis::Basis};

pub(crate) use grasp_fixture::GRASP_Q;

/// The box.
pub(crate) const BOX: StandingBox = StandingBox {
    half_m: [0.03, 0.03, 0.08],
};

/// Returns options with their defaults.
pub(crate) fn config() -> EigengraspConfig {
    let value = serde_json::json!({ "hand": URDF, "flexion_joints": FLEXION });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn body() -> HandBody {
    HandBody::new(grasp_fixture::hand(), &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// Returns two eigengrasps: all fingers bend, and the thumb turns.
pub(crate) fn basis() -> Basis {
    let along = |joints: &[usize], rad: f64| {
        let mut all = vec![0.0; 16];
        for &joint in joints {
            all[joint] = rad;
        }
        all
    };
    Basis {
        mean: GRASP_Q.to_vec(),
        eigengrasps: vec![
            along(&[1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15], 0.2),
            along(&[12], 0.1),
        ],
        explained: 0.9,
    }
}

/// Returns trajectories whose grasps differ in two directions.
pub(crate) fn trajectories() -> Vec<Trajectory> {
    let basis = basis();
    let grasp = |sequence: &str, amplitudes: [f64; 2]| {
        let q = (0..GRASP_Q.len()).map(|joint| {
            let along = basis.eigengrasps.iter().zip(amplitudes);
            GRASP_Q[joint]
                + along
                    .map(|(eigengrasp, a)| a * eigengrasp[joint])
                    .sum::<f64>()
        });
        BOX.reached(sequence, &q.collect::<Vec<f64>>(), 0.0)
    };
    vec![
        grasp("a", [-1.0, 0.5]),
        grasp("b", [1.0, 0.5]),
        grasp("c", [0.0, -1.0]),
    ]
}
