//! Fixtures of this crate's tests.

use std::collections::BTreeMap;

use object_shapes::ShapeOptions;
use schemas::demonstrations::Side;

use crate::{
    config::{Format, IngestConfig, Landmarks, ReachRule, TableRule},
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
