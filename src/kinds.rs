//! Every kind of stage: adding one is one line here.

use dataflow::Kind;
use report_dispatch::DispatchReport;
use report_ingest::IngestReport;
use report_retarget::RetargetReport;
use report_sample::SampleReport;
use report_screen::ScreenReport;
use report_train::TrainReport;
use stage_cem_mpc::CemMpc;
use stage_eigengrasp::Eigengrasp;
use stage_force_closure::ForceClosure;
use stage_grasp_tta::GraspTta;
use stage_interpolate::Interpolate;
use stage_program::{Program, Shipped};
use stage_refine::Refine;
use stage_replay::Replay;
use stage_report::Report;
use stage_rrt::Rrt;
use stage_transfer::Transfer;

use crate::sample;

/// Returns the kinds in the order of the flow, each named by its report if it has one.
pub fn kinds() -> Vec<Kind> {
    vec![
        Kind::generated::<IngestReport, _>(sample::generate),
        Kind::reported::<RetargetReport>(),
        Kind::of::<Replay>(),
        Kind::of::<Transfer>(),
        Kind::reported::<TrainReport>(),
        Kind::reported::<SampleReport>(),
        Kind::of::<Interpolate>(),
        Kind::of::<Eigengrasp>(),
        Kind::of::<ForceClosure>(),
        Kind::of::<GraspTta>(),
        Kind::of::<Refine>(),
        Kind::of::<Rrt>(),
        Kind::of::<CemMpc>(),
        Kind::reported::<ScreenReport>(),
        Kind::reported::<DispatchReport>(),
        Kind::of::<Report>(),
        Kind::of::<Program<Shipped>>(),
    ]
}
