//! Every kind of stage: adding one is one line here.

use dataflow::{Kind, code};
use stage_camera::SimulatedCamera;
use stage_cem_mpc::CemMpc;
use stage_complete::Complete;
use stage_dispatch::report::DispatchReport;
use stage_eigengrasp::Eigengrasp;
use stage_force_closure::ForceClosure;
use stage_grasp_tta::GraspTta;
use stage_ground_truth::GroundTruth;
use stage_ingest::report::IngestReport;
use stage_interpolate::Interpolate;
use stage_pretrained::Pretrained;
use stage_program::{Program, ProjectArtifacts};
use stage_refine::Refine;
use stage_register::Register;
use stage_replay::Replay;
use stage_report::Report;
use stage_retarget::report::RetargetReport;
use stage_rrt::Rrt;
use stage_sample::report::SampleReport;
use stage_screen::report::ScreenReport;
use stage_shapes::Shapes;
use stage_train::report::TrainReport;
use stage_transfer::Transfer;
use stage_views::RecordedViews;

use crate::sample;

/// A kind of which these options may be left out: they are in the file of its hand.
fn with_hand_file(kind: Kind, options: &'static [&'static str]) -> Kind {
    kind.completed(options, "hand", hand_files::complete)
}

/// Returns the kinds in the order of the flow, each named by its report if it has one.
pub fn kinds() -> Vec<Kind> {
    vec![
        Kind::generated::<IngestReport, _>(
            [code!("stage-ingest"), code!("report-ingest")],
            sample::generate,
        ),
        with_hand_file(
            Kind::reported::<RetargetReport>([code!("stage-retarget"), code!("report-retarget")]),
            &["hand_table"],
        ),
        Kind::of::<Shapes>(code!("stage-shapes")),
        Kind::of::<SimulatedCamera>(code!("stage-camera")),
        Kind::of::<RecordedViews>(code!("stage-views")),
        Kind::of::<Complete>(code!("stage-complete")),
        Kind::of::<Register>(code!("stage-register")),
        Kind::of::<GroundTruth>(code!("stage-ground_truth")),
        Kind::of::<Replay>(code!("stage-replay")),
        Kind::of::<Transfer>(code!("stage-transfer")),
        with_hand_file(
            Kind::reported::<TrainReport>([code!("stage-train"), code!("report-train")]),
            &["training.tips", "training.tip_radius_m"],
        ),
        Kind::of::<Pretrained>(code!("stage-pretrained")),
        with_hand_file(
            Kind::reported::<SampleReport>([code!("stage-sample"), code!("report-sample")]),
            &[],
        ),
        Kind::of::<Interpolate>(code!("stage-interpolate")),
        with_hand_file(
            Kind::of::<Eigengrasp>(code!("stage-eigengrasp")),
            &["flexion_joints"],
        ),
        with_hand_file(
            Kind::of::<ForceClosure>(code!("stage-force_closure")),
            &["hand_table", "flexion_joints"],
        ),
        with_hand_file(
            Kind::of::<GraspTta>(code!("stage-grasp_tta")),
            &["flexion_joints"],
        ),
        with_hand_file(Kind::of::<Refine>(code!("stage-refine")), &["hand_table"]),
        with_hand_file(Kind::of::<Rrt>(code!("stage-rrt")), &["hand_table"]),
        with_hand_file(
            Kind::of::<CemMpc>(code!("stage-cem_mpc")),
            &["hand_table", "scene.drive", "protocol.flexion_joints"],
        ),
        with_hand_file(
            Kind::reported::<ScreenReport>([code!("stage-screen"), code!("report-screen")]),
            &["scene.drive", "protocol.flexion_joints"],
        ),
        with_hand_file(
            Kind::reported::<DispatchReport>([code!("stage-dispatch"), code!("report-dispatch")]),
            &["simulated.scene.drive", "protocol.flexion_joints"],
        ),
        with_hand_file(Kind::of::<Report>(code!("stage-report")), &[]),
        Kind::of::<Program<ProjectArtifacts>>(code!("stage-program")),
    ]
}
