//! Fixtures of the tests: a box on a table and a hand that grasps it.

use std::path::Path;

use approach::HandBody;
use grasp_fixture::{Artifacts, FLEXION, GRASP_Q, StandingBox, URDF};

use crate::GraspTtaConfig;

/// The box.
pub(crate) const BOX: StandingBox = StandingBox {
    half_m: [0.03, 0.03, 0.08],
};

/// Returns options of small networks that are hardly trained.
pub(crate) fn config() -> GraspTtaConfig {
    let value = serde_json::json!({
        "hand": URDF, "flexion_joints": FLEXION, "per_object": 4, "hand_points": 200,
        "network": { "points": 64, "point_widths": [16, 32], "encoder_widths": [32], "latent_dim": 4,
            "decoder_widths": [32], "contact_widths": [8, 16, 8] },
        "training": { "epochs": 4, "contact_epochs": 2, "batch": 2 },
        "adaptation": { "steps": 60 },
    });
    serde_json::from_value(value).unwrap()
}

/// Returns the Allegro hand.
pub(crate) fn body() -> HandBody {
    HandBody::new(grasp_fixture::hand(), &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// Writes the stage's inputs: three grasps, about the box's vertical.
pub(crate) fn artifacts(root: &Path, with_field: bool) -> Artifacts {
    let trajectories = [("a", 0.0), ("b", 0.1), ("c", -0.1)];
    let trajectories = trajectories.map(|(name, angle_rad)| BOX.reached(name, &GRASP_Q, angle_rad));
    BOX.artifacts(root, &trajectories, with_field)
}
