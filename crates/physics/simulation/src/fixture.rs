//! Settings that the unit tests share.

use nalgebra::{Matrix3, Point3};

use crate::{config::SceneConfig, object::ObjectShape, shortcuts::Shortcuts};

/// A scene whose settings hold.
pub(crate) fn scene() -> SceneConfig {
    let drive = serde_json::json!({
        "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
    });
    let scene = serde_json::json!({"drive": drive, "shortcuts": Shortcuts::NONE});
    serde_json::from_value(scene).unwrap()
}

/// A cube of 5 cm and 0.2 kg.
pub(crate) fn cube() -> ObjectShape {
    let half = 0.025;
    let (mass_kg, side) = (0.2, 2.0 * half);
    let corners = [-half, half];
    ObjectShape {
        parts_m: vec![
            corners
                .iter()
                .flat_map(|&x| corners.iter().map(move |&y| (x, y)))
                .flat_map(|(x, y)| corners.iter().map(move |&z| Point3::new(x, y, z)))
                .collect(),
        ],
        surface: None,
        mass_kg,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::identity() * (mass_kg * side * side / 6.0),
    }
}
