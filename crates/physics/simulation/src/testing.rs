//! Settings that the unit tests share.

use nalgebra::{Matrix3, Point3};

use crate::{
    config::{ControllerKind, DriveConfig, Offset, SceneConfig, Support},
    object::ObjectShape,
    shortcuts::Shortcuts,
};

/// A scene whose settings hold.
pub(crate) fn scene() -> SceneConfig {
    SceneConfig {
        friction: 1.0,
        table_friction: None,
        object_mass_kg: None,
        object_density_kg_per_m3: None,
        support: Support::Table,
        mass_scale: 1.0,
        hand_mass_scale: 1.0,
        object_offset: Offset::default(),
        time_step_s: 0.004,
        substeps: 1,
        steps_per_control: 5,
        prediction_m: 0.002,
        contact_recycle_m: 0.0,
        fingers_touch: false,
        fingers_touch_palm: false,
        settle_s: 1.0,
        drive: DriveConfig {
            controller: ControllerKind::Pd,
            stiffness: 20.0,
            damping: 1.0,
            torque_limit: 0.7,
            armature: 0.001,
            stop_stiffness: 200.0,
            delay_s: 0.0,
        },
        palm_drive: None,
        palm_compliance: None,
        shortcuts: Shortcuts::NONE,
    }
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
