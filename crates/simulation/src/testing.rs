//! Settings that the unit tests share.

use crate::{
    config::{ControllerKind, DriveConfig, Offset, SceneConfig, Support},
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
        shortcuts: Shortcuts::NONE,
    }
}
