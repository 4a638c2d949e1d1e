//! One filled partition of every table, which the tests write, read and break.

use std::fmt::Debug;

use motion::{HandRates, JointRates, Motion, Step};
use nalgebra::{Isometry3, Unit, Vector3};
use schemas::{
    Table,
    candidates::{Candidate, Candidates, DrawSource, ObjectSplit, Origin},
    completions::CompletedObject,
    demonstrations::{self, Demonstration},
    distance_fields::FieldInfo,
    draws::{Draw, Draws, Refusal},
    executions::{self, Execution},
    latents,
    objects::{self, Object},
    pose_errors::PoseErrorTrial,
    rates::{ALL_ORIGINS, Rate},
    reconstruction::{self, Reconstruction},
    robustness::{Robustness, TrialVerdict},
    rollouts::{self, Rollout, Verdict},
    sampling::{self, SampleMeasures},
    smoothness::{CandidateSmoothness, ExecutedSmoothness, Smoothness, Variation, Variations},
    success::Success,
    tracking::TrackingSummary,
    training::{self, Split},
    trajectories::{self, Trajectory},
    trials::Trials,
    views::{View, Views},
};
use spatial::{Pose, RestingPose, Twist};

/// An operation on a table of each kind.
pub(crate) trait EachTable {
    /// Applies the operation to the partition `key`.
    fn table<T: Table + PartialEq + Debug>(&self, key: &str, table: &T);
}

/// Applies an operation to every filled table.
pub(crate) fn each(tables: &impl EachTable) {
    tables.table("005_tomato_soup_can", &object());
    tables.table("can", &views());
    tables.table("can", &completion());
    tables.table("a", &demonstration());
    tables.table("can", &field());
    tables.table("a", &trajectory());
    tables.table("can", &tracking());
    tables.table("cgf", &training());
    tables.table("cgf", &reconstruction());
    tables.table("cgf", &latents());
    tables.table("can", &candidates());
    tables.table("can", &draws());
    tables.table("can", &sampling());
    tables.table("can", &rollouts());
    tables.table("can", &smoothness());
    tables.table("can", &robustness());
    tables.table("can", &pose_errors());
    tables.table("all", &success());
    tables.table("all", &rates());
    tables.table("can", &executions());
    tables.table("all", &trials());
}

fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Unit::new_normalize(Vector3::new(0.0, 0.6, 0.8)),
        height_m: 0.07,
    }
}

fn pose<To, From>(x: f64) -> Pose<To, From> {
    // Read back once, so that the quaternion is as it is stored.
    let pose = Pose::<To, From>::new(Isometry3::new(Vector3::new(x, 0.2, 0.3), Vector3::x()));
    Pose::from_array(pose.to_array()).unwrap()
}

fn joints() -> Vec<String> {
    ["joint_0", "joint_1"].map(str::to_owned).to_vec()
}

pub(crate) fn object() -> Object {
    Object {
        name: "005_tomato_soup_can".to_owned(),
        mass_kg: 0.349,
        center_of_mass_m: [0.0, 0.1, 0.2],
        inertia_kg_m2: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
        points_m: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]],
        normals: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        watertight: true,
        mirror: Some(objects::Mirror {
            normal: Vector3::y_axis(),
            offset_m: 0.01,
            error_m: 0.002,
        }),
        vertices_m: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2]],
        parts_m: vec![vec![[0.0; 3], [1.0; 3]], vec![[2.0; 3]]],
        rests: vec![objects::RestingOrientation {
            rest: rest(),
            seen_n: 3,
            probability: 0.5,
        }],
    }
}

pub(crate) fn views() -> Views {
    vec![View {
        view: "can-0".to_owned(),
        width: 3,
        height: 2,
        focal_px: [500.0, 501.0],
        center_px: [1.0, 0.5],
        world_from_camera: pose(0.1),
        table: vec![[0.0, 0.0, 1.0, 0.02]],
        depth_step_m: 1e-4,
        depth: vec![0, 5000, 5001, 5002, 5003, 5004],
        mask: vec![1, 2, 3],
        world_from_object: vec![pose(0.4)],
    }]
}

pub(crate) fn completion() -> CompletedObject {
    CompletedObject {
        world_from_object: pose(0.3),
        views_n: 2,
        seen_m: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]],
        seen_normals: vec![[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        unseen_m: vec![0.01, 0.02, 0.0],
        symmetric: true,
        free_share: 0.25,
    }
}

pub(crate) fn field() -> FieldInfo {
    FieldInfo {
        spacing_m: 0.0025,
        margin_m: 0.025,
        center_of_mass_m: [0.1, 0.2, 0.3],
        hull_m: vec![[0.0; 3], [1.0, 2.0, 3.0]],
    }
}

pub(crate) fn tracking() -> TrackingSummary {
    TrackingSummary {
        trajectories_n: 18,
        steps_n: 600,
        tip_error_mean_m: 1.0,
        tip_error_median_m: 2.0,
        tip_error_p95_m: 3.0,
        limit_margin_least_rad: 4.0,
        contacts_n: 70,
        contact_gap_median_m: 5.0,
        contact_gap_p90_m: 6.0,
        penetration_median_m: 7.0,
        penetration_p90_m: 8.0,
        below_table_share: 9.0,
        q_velocity_p95_rad_per_s: 10.0,
        q_acceleration_p95_rad_per_s2: 11.0,
    }
}

pub(crate) fn demonstration() -> Demonstration {
    let mut keypoints_m = [[0.5; 3]; demonstrations::KEYPOINTS];
    keypoints_m[20] = [1.0, 2.0, 3.0];
    let step = |image: u32, time_s: f64| demonstrations::Step {
        image,
        time_s,
        cameras_n: 3,
        bridged: image == 7,
        keypoints_m,
    };
    Demonstration {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        subject: "s".to_owned(),
        hand: demonstrations::Side::Left,
        mirrored: true,
        start_reason: "first hand".to_owned(),
        end_reason: "it moved".to_owned(),
        rest: rest(),
        steps: vec![step(7, 0.25), step(9, 0.5)],
    }
}

pub(crate) fn trajectory() -> Trajectory {
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: pose(0.1),
        q_rad: vec![0.3, time_s],
        rates: trajectories::TrajectoryRates {
            palm_velocity: Twist::from_array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
            joints: JointRates {
                velocity: vec![1.0, 2.0],
                acceleration: vec![3.0, 4.0],
            },
        },
    };
    let tracking = trajectories::Tracking {
        keypoint_errors_m: vec![0.03, 0.04],
        tip_errors_m: vec![0.03],
        contact_gaps_m: vec![-0.001],
        limit_margin_rad: 0.1,
        penetration_m: 0.002,
        table_penetration_m: 0.001,
    };
    Trajectory {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        keypoints: vec!["thumb_tip".to_owned(), "wrist".to_owned()],
        tips: vec!["thumb_tip".to_owned()],
        rest: rest(),
        motion: Motion::new(&joints(), vec![step(0.1), step(0.2)]).unwrap(),
        tracking: vec![tracking; 2],
    }
}

pub(crate) fn candidates() -> Candidates {
    let step = |time_s: f64| Step {
        time_s,
        frame_from_palm: pose(time_s),
        q_rad: vec![time_s, 2.0 * time_s],
        rates: HandRates {
            palm_velocity: Twist::from_array([1.0, 2.0, 3.0, 4.0, 5.0, time_s]),
            palm_acceleration: Twist::from_array([6.0, 5.0, 4.0, 3.0, 2.0, time_s]),
            joints: JointRates {
                velocity: vec![3.0 * time_s, 0.0],
                acceleration: vec![0.0, 4.0 * time_s],
            },
        },
    };
    let motion = |name: &str, times: &[f64]| Candidate {
        candidate_id: name.to_owned(),
        generator: "cgf".to_owned(),
        source: source(2),
        latent: vec![0.5; times.len()],
        table_from_object: pose(0.9),
        limit_excess_rad: 0.01,
        depth_m: Some(0.002),
        residual_m2: None,
        motion: Motion::new(
            &joints(),
            times.iter().map(|&time_s| step(time_s)).collect(),
        )
        .unwrap(),
    };
    Candidates {
        object: "can".to_owned(),
        joints: joints().into(),
        candidates: vec![
            motion("can-0", &[0.0, 0.5, 1.0]),
            motion("can-1", &[0.0, 0.25]),
        ],
    }
}

/// The draws of [`candidates`], of the second motion three.
pub(crate) fn draws() -> Draws {
    let Candidates { candidates, .. } = candidates();
    let refused = |draw_n: u32, refusal: Refusal| Draw {
        source: source(draw_n),
        depth_m: Some(0.007),
        ..Draw::refused(&candidates[1], refusal)
    };
    vec![
        Draw::kept(&candidates[0]),
        refused(1, Refusal::Object),
        Draw::kept(&candidates[1]),
        refused(3, Refusal::Table),
        Draw {
            source: source(4),
            ..Draw::without_motion(&candidates[1], "2 joints, expected 3".to_owned())
        },
    ]
}

fn source(draw_n: u32) -> DrawSource {
    DrawSource {
        draw_n,
        origin: Origin::Posterior,
        demonstration: "a".to_owned(),
        object_split: Some(ObjectSplit::Seen),
    }
}

pub(crate) fn sampling() -> Vec<SampleMeasures> {
    let distance = |by: f64| sampling::GraspDistance {
        palm_m: 1.0 * by,
        palm_rad: 2.0 * by,
        q_rad: 3.0 * by,
    };
    let sampled = |name: &str, limit_excess_rad: f64| SampleMeasures {
        candidate_id: name.to_owned(),
        limit_excess_rad,
        approach_depth_m: 4.0,
        approach_depth_time_s: (limit_excess_rad > 0.1).then_some(5.0),
        grasp_depth_m: 6.0,
        table_depth_m: 7.0,
        demonstration: (limit_excess_rad > 0.1).then(|| ("a".to_owned(), distance(0.1))),
        from_mean: (limit_excess_rad > 0.1).then(|| distance(0.3)),
    };
    vec![sampled("can-0", 0.049), sampled("can-1", 0.2)]
}

pub(crate) fn robustness() -> Vec<Robustness> {
    let row = |name: &str, held_n: i64| Robustness {
        candidate_id: name.to_owned(),
        trials: Verdict::ALL
            .map(TrialVerdict)
            .into_iter()
            .zip([held_n, 0, 1, 2])
            .collect(),
        control_steps_n: 1000,
    };
    vec![row("can-0", 13), row("can-1", 0)]
}

fn pose_errors() -> Vec<PoseErrorTrial> {
    let trial = |name: &str, verdict| PoseErrorTrial {
        candidate_id: name.to_owned(),
        position_m: 0.005,
        yaw_rad: 0.1,
        verdict,
        control_steps_n: 120,
    };
    vec![
        trial("can-0", Verdict::Held),
        trial("can-1", Verdict::Dropped),
    ]
}

pub(crate) fn success() -> Vec<Success> {
    let row = |generator: &str, successes_n: i64| Success {
        object: "can".to_owned(),
        generator: generator.to_owned(),
        origin: Origin::Prior,
        object_split: Some(ObjectSplit::Unseen),
        verdicts: Verdict::ALL
            .into_iter()
            .zip([successes_n, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11])
            .collect(),
        draws_n: 400,
        control_steps_n: 1000,
        spread_palm_m: (successes_n > 0).then_some(1.0),
        spread_palm_rad: (successes_n > 0).then_some(2.0),
        spread_q_rad: (successes_n > 0).then_some(3.0),
        spread_n: successes_n,
    };
    vec![row("cgf", 40), row("interpolate", 0)]
}

pub(crate) fn rates() -> Vec<Rate> {
    let row = |origin: &str, object_split: Option<ObjectSplit>| Rate {
        generator: "cgf".to_owned(),
        origin: origin.to_owned(),
        object_split,
        protocol: "table_lift".to_owned(),
        approach: "follow".to_owned(),
        squeeze_rad: 0.15,
        friction: 1.0,
        torque_limit_nm: 0.7,
        object_mass: "measured".to_owned(),
        objects_n: 5,
        candidates_n: 50,
        draws_n: 200,
        successes_n: 40,
        candidate_rate_mean: object_split.map(|_| 0.8),
        candidate_rate_low: object_split.map(|_| 0.6),
        candidate_rate_high: object_split.map(|_| 0.9),
        draw_rate_mean: 0.2,
        draw_rate_low: 0.1,
        draw_rate_high: 0.4,
    };
    let seen = Some(ObjectSplit::Seen);
    vec![row(ALL_ORIGINS, seen), row("line", None)]
}

pub(crate) fn rollouts() -> Vec<Rollout> {
    let rollout = |verdict: Verdict| Rollout {
        candidate_id: verdict.as_str().to_owned(),
        generator: "cgf".to_owned(),
        source: source(2),
        protocol: Some("full_contact".to_owned()),
        verdict,
        measures: match verdict {
            Verdict::Infeasible => rollouts::Measures::default(),
            _ => rollouts::Measures {
                control_steps_n: 65,
                skipped_steps_n: Some(125),
                lift_m: Some(0.15),
                slip_m: Some(0.001),
                displacement_m: Some(0.002),
                penetration_m: Some(0.0005),
                finger_penetration_m: (verdict == Verdict::Held).then_some(0.0003),
                contacts_n: Some(4),
            },
        },
    };
    Verdict::ALL.map(rollout).into()
}

pub(crate) fn smoothness() -> Vec<CandidateSmoothness> {
    let variations = |first: f64| {
        let variation = |first: f64| Variation {
            position: first,
            velocity: first + 1.0,
            acceleration: first + 2.0,
        };
        Variations {
            joints: variation(first),
            cartesian: variation(first + 3.0),
        }
    };
    let of = |first: f64| Smoothness {
        paper: variations(first),
        released: variations(10.0 * first),
        robust: variations(100.0 * first),
    };
    let row = |candidate_id: &str, executed: Option<Smoothness>| CandidateSmoothness {
        candidate_id: candidate_id.to_owned(),
        drawn: of(1.0),
        executed: ExecutedSmoothness(executed),
    };
    let unmeasured = CandidateSmoothness {
        drawn: Smoothness::default(),
        ..row("can-2", None)
    };
    vec![row("can-0", Some(of(2.0))), row("can-1", None), unmeasured]
}

pub(crate) fn executions() -> Vec<Execution> {
    let execution = |outcome: executions::Outcome| Execution {
        goal_id: "00ff".to_owned(),
        candidate_id: "can-0".to_owned(),
        cell: "simulated".to_owned(),
        simulated: true,
        gap: "mass times 1.1".to_owned(),
        accepted: outcome != executions::Outcome::Rejected,
        outcome,
        message: "held".to_owned(),
        duration_s: 3.8,
        tracking_error_rad: 0.1,
        lift_m: 0.15,
    };
    executions::Outcome::ALL.map(execution).into()
}

pub(crate) fn trials() -> Vec<Trials> {
    vec![Trials {
        object: "can".to_owned(),
        cell: "lab".to_owned(),
        simulated: false,
        gap: String::new(),
        // Succeeded, failed, aborted, unknown, rejected, stopped.
        outcomes: executions::Outcome::ALL
            .into_iter()
            .zip([11, 4, 3, 2, 5, 7])
            .collect(),
    }]
}

pub(crate) fn training() -> Vec<training::EpochLosses> {
    let row = |epoch: i64, split: Split| training::EpochLosses {
        epoch,
        split,
        learning_rate: 1e-3,
        total: 2.0,
        q: 3.0,
        translation: 4.0,
        origins_m2: 5.0,
        rotations: 6.0,
        kl_nats: 7.0,
        contact_m2: 8.0,
        penetration_m2: 2e-5,
        coarse: 9.0,
        prior: (split == Split::Training).then_some(10.0),
    };
    vec![
        row(1, Split::Training),
        row(1, Split::HeldOut),
        row(2, Split::Training),
    ]
}

pub(crate) fn reconstruction() -> Reconstruction {
    let row = reconstruction::ReconstructionError {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        split: Split::Unseen,
        tip_error_mean_m: 1.0,
        tip_error_grasp_m: 2.0,
        palm_error_mean_m: 3.0,
        palm_error_grasp_m: 4.0,
        palm_rotation_mean_rad: 5.0,
        palm_rotation_grasp_rad: 6.0,
        joint_error_mean_rad: 7.0,
        joint_error_grasp_rad: 8.0,
        joint_errors_rad: vec![0.5, 13.5],
    };
    Reconstruction {
        joints: joints(),
        rows: vec![row.clone(), row],
    }
}

pub(crate) fn latents() -> Vec<latents::LatentDimension> {
    let row = |active: bool| latents::LatentDimension {
        dimension: i64::from(active),
        kl_nats: 0.5,
        mean_deviation: 0.25,
        deviation_mean: 0.75,
        active,
    };
    vec![row(false), row(true)]
}
