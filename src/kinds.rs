//! Every kind of stage: adding one is one line here.

use dataflow::Kind;

/// Returns the kinds in the order of the flow.
pub fn kinds() -> Vec<Kind> {
    vec![
        Kind::of::<stage_ingest::Ingest>(),
        Kind::of::<stage_retarget::Retarget>(),
        Kind::of::<stage_replay::Replay>(),
        Kind::of::<stage_train::Train>(),
        Kind::of::<stage_sample::Sample>(),
        Kind::of::<stage_interpolate::Interpolate>(),
        Kind::of::<stage_screen::Screen>(),
        Kind::of::<stage_dispatch::Dispatch>(),
    ]
}
