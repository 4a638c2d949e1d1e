//! Settings that the unit tests share.

use crate::{
    config::{ControllerKind, DriveConfig, Offset, SceneConfig},
    shortcuts::Shortcuts,
};

/// A scene whose settings hold.
pub(crate) fn scene() -> SceneConfig {
    SceneConfig {
        friction: 1.0,
        mass_scale: 1.0,
        hand_mass_scale: 1.0,
        object_offset: Offset::default(),
        time_step_s: 0.004,
        substeps: 1,
        steps_per_control: 5,
        prediction_m: 0.002,
        contact_recycle_m: 0.0,
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
