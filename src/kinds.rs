//! Every kind of stage: adding one is one line here.

use dataflow::{Kind, code};
use stage_cem_mpc::CemMpc;
use stage_dispatch::report::DispatchReport;
use stage_eigengrasp::Eigengrasp;
use stage_force_closure::ForceClosure;
use stage_grasp_tta::GraspTta;
use stage_ingest::report::IngestReport;
use stage_interpolate::Interpolate;
use stage_program::{Program, Shipped};
use stage_refine::Refine;
use stage_replay::Replay;
use stage_report::Report;
use stage_retarget::report::RetargetReport;
use stage_rrt::Rrt;
use stage_sample::report::SampleReport;
use stage_screen::report::ScreenReport;
use stage_train::report::TrainReport;
use stage_transfer::Transfer;

use crate::sample;

/// Returns the kinds in the order of the flow, each named by its report if it has one.
pub fn kinds() -> Vec<Kind> {
    vec![
        Kind::generated::<IngestReport, _>(
            [code!("stage-ingest"), code!("report-ingest")],
            sample::generate,
        ),
        Kind::reported::<RetargetReport>([code!("stage-retarget"), code!("report-retarget")]),
        Kind::of::<Replay>(code!("stage-replay")),
        Kind::of::<Transfer>(code!("stage-transfer")),
        Kind::reported::<TrainReport>([code!("stage-train"), code!("report-train")]),
        Kind::reported::<SampleReport>([code!("stage-sample"), code!("report-sample")]),
        Kind::of::<Interpolate>(code!("stage-interpolate")),
        Kind::of::<Eigengrasp>(code!("stage-eigengrasp")),
        Kind::of::<ForceClosure>(code!("stage-force_closure")),
        Kind::of::<GraspTta>(code!("stage-grasp_tta")),
        Kind::of::<Refine>(code!("stage-refine")),
        Kind::of::<Rrt>(code!("stage-rrt")),
        Kind::of::<CemMpc>(code!("stage-cem_mpc")),
        Kind::reported::<ScreenReport>([code!("stage-screen"), code!("report-screen")]),
        Kind::reported::<DispatchReport>([code!("stage-dispatch"), code!("report-dispatch")]),
        Kind::of::<Report>(code!("stage-report")),
        Kind::of::<Program<Shipped>>(code!("stage-program")),
    ]
}
