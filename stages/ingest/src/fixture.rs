//! Fixtures of this crate's tests.

use std::collections::BTreeMap;

use schemas::demonstrations::Side;

use crate::{
    config::{Format, IngestConfig, Landmarks, ReachRule, ShapeOptions, TableRule},
    selection::Split,
};

/// Options that take everything of the right hand.
pub(crate) fn config() -> IngestConfig {
    IngestConfig {
        root: "data".into(),
        format: Format::DexYcb,
        hand: Side::Right,
        mirror: false,
        max_mirror_error_m: 0.005,
        subjects: Vec::new(),
        objects: Vec::new(),
        split: Split::All,
        rate_hz: None,
        landmarks: Landmarks::Either,
        mano_models: None,
        camera_agreement_m: 0.01,
        table: TableRule::Tag,
        min_table_objects_n: 2,
        reach: ReachRule::Robust,
        move_threshold_m: 0.004,
        move_threshold_rad: 0.07,
        jitter_factor: 4.0,
        settle_n: 5,
        max_gap_n: 3,
        min_steps_n: 11,
        max_table_error_m: 0.02,
        shape: ShapeOptions {
            points_n: 100,
            max_convex_parts_n: 4,
            part_tolerance_m: 0.0,
        },
        masses_kg: BTreeMap::new(),
        meshes: BTreeMap::new(),
    }
}

/// A box with these edges in meters, its middle shifted from the origin, as Wavefront OBJ.
pub(crate) fn brick(edges_m: [f64; 3], middle_m: [f64; 3]) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        text.push('v');
        for (axis, (edge, middle)) in edges_m.iter().zip(middle_m).enumerate() {
            let side = if corner & (1 << axis) == 0 { -0.5 } else { 0.5 };
            text += &format!(" {}", side * edge + middle);
        }
        text.push('\n');
    }
    for face in [
        "1 3 2", "2 3 4", "5 6 7", "6 8 7", "1 2 5", "2 6 5", "3 7 4", "4 7 8", "1 5 3", "3 5 7",
        "2 4 6", "4 8 6",
    ] {
        text += &format!("f {face}\n");
    }
    text
}
