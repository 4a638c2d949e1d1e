//! What is written reads back equal; what breaks a schema is refused.

use arrow_array::RecordBatch;
use nalgebra::{Isometry3, Unit, Vector3};
use schemas::{
    SchemaError, candidates, demonstrations, distance_fields, executions, latents, objects,
    reconstruction, rollouts, sampling, success, tracking, training, trajectories, trials,
};
use spatial::{Pose, Rest};

fn rest() -> Rest {
    Rest {
        up_in_object: Unit::new_normalize(Vector3::new(0.0, 0.6, 0.8)),
        height_m: 0.07,
    }
}

fn pose<To, From>(x: f64) -> Pose<To, From> {
    // Read back once, so that the quaternion is as it is stored.
    let pose = Pose::<To, From>::new(Isometry3::new(Vector3::new(x, 0.2, 0.3), Vector3::x()));
    Pose::from_array(pose.to_array()).unwrap()
}

fn variations(first: f64) -> rollouts::Variations {
    let variation = |first: f64| rollouts::Variation {
        position: first,
        velocity: first + 1.0,
        acceleration: first + 2.0,
    };
    rollouts::Variations {
        joints: variation(first),
        cartesian: variation(first + 3.0),
    }
}

fn joints() -> Vec<String> {
    ["joint_0", "joint_1"].map(str::to_owned).to_vec()
}

fn object() -> objects::Object {
    objects::Object {
        name: "005_tomato_soup_can".to_owned(),
        mass_kg: 0.349,
        center_of_mass_m: [0.0, 0.1, 0.2],
        inertia_kg_m2: [1.0, 2.0, 3.0, 0.1, 0.2, 0.3],
        points_m: vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.7, 0.8, 0.9]],
        normals: vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        watertight: true,
        mirror: Some(objects::Mirror {
            normal: nalgebra::Vector3::y_axis(),
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

fn trajectory() -> trajectories::Trajectory {
    trajectories::Trajectory {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        joints: joints(),
        keypoints: vec!["thumb_tip".to_owned(), "wrist".to_owned()],
        tips: vec!["thumb_tip".to_owned()],
        rest: rest(),
        steps: vec![trajectories::Step {
            time_s: 0.1,
            object_from_palm: pose(0.1),
            q_rad: vec![0.3, 0.4],
            rates: trajectories::Rates {
                palm_velocity: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
                q_velocity_rad_per_s: vec![1.0, 2.0],
                q_acceleration_rad_per_s2: vec![3.0, 4.0],
            },
            tracking: trajectories::Tracking {
                keypoint_errors_m: vec![0.03, 0.04],
                tip_errors_m: vec![0.03],
                contact_gaps_m: vec![-0.001],
                limit_margin_rad: 0.1,
                penetration_m: 0.002,
                table_penetration_m: 0.001,
            },
        }],
    }
}

#[test]
fn objects_read_back() {
    let batch = objects::to_batch(&[object()]).unwrap();
    assert_eq!(
        objects::from_batch("005_tomato_soup_can", &batch).unwrap(),
        object()
    );
    assert_eq!(batch.schema().as_ref(), &objects::schema());
}

#[test]
fn distance_fields_read_back() {
    let field = distance_fields::FieldInfo {
        spacing_m: 0.0025,
        margin_m: 0.025,
        center_of_mass_m: [0.1, 0.2, 0.3],
        hull_m: vec![[0.0; 3], [1.0, 2.0, 3.0]],
    };
    let batch = distance_fields::to_batch(&field).unwrap();
    assert_eq!(distance_fields::from_batch(&batch).unwrap(), field);
    assert_eq!(batch.schema().as_ref(), &distance_fields::schema());
}

#[test]
fn tracking_reads_back() {
    let report = tracking::TrackingReport {
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
    };
    let batch = tracking::to_batch(&report).unwrap();
    assert_eq!(tracking::from_batch(&batch).unwrap(), report);
    assert_eq!(batch.schema().as_ref(), &tracking::schema());
}

#[test]
fn demonstrations_read_back() {
    let mut keypoints_m = [[0.5; 3]; demonstrations::KEYPOINTS];
    keypoints_m[20] = [1.0, 2.0, 3.0];
    let demonstration = demonstrations::Demonstration {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        subject: "s".to_owned(),
        hand: demonstrations::Side::Left,
        mirrored: true,
        start_reason: "first hand".to_owned(),
        end_reason: "it moved".to_owned(),
        rest: rest(),
        steps: vec![demonstrations::Step {
            image: 7,
            time_s: 0.25,
            cameras_n: 3,
            bridged: true,
            keypoints_m,
        }],
    };
    let batch = demonstrations::to_batch(&demonstration).unwrap();
    assert_eq!(
        demonstrations::from_batch("a", &batch).unwrap(),
        demonstration
    );
}

#[test]
fn trajectories_read_back() {
    let batch = trajectories::to_batch(&trajectory()).unwrap();
    assert_eq!(trajectories::from_batch("a", &batch).unwrap(), trajectory());
}

#[test]
fn candidates_read_back() {
    let step = |time_s: f64| candidates::Step {
        time_s,
        object_from_palm: pose(time_s),
        q_rad: vec![time_s, 2.0 * time_s],
        rates: candidates::Rates {
            palm_velocity: [1.0, 2.0, 3.0, 4.0, 5.0, time_s],
            palm_acceleration: [6.0, 5.0, 4.0, 3.0, 2.0, time_s],
            q_velocity_rad_per_s: vec![3.0 * time_s, 0.0],
            q_acceleration_rad_per_s2: vec![0.0, 4.0 * time_s],
        },
    };
    let motion = |name: &str, times: &[f64]| candidates::Candidate {
        candidate_id: name.to_owned(),
        generator: "cgf".to_owned(),
        latent: vec![0.5; times.len()],
        table_from_object: pose(0.9),
        limit_excess_rad: 0.01,
        steps: times.iter().map(|&time_s| step(time_s)).collect(),
    };
    let candidates = candidates::Candidates {
        object: "can".to_owned(),
        joints: joints(),
        candidates: vec![
            motion("can-0", &[0.0, 0.5, 1.0]),
            motion("can-1", &[0.0, 0.25]),
        ],
    };
    let batch = candidates::to_batch(&candidates).unwrap();
    assert_eq!(candidates::from_batch("can", &batch).unwrap(), candidates);
}

#[test]
fn sampling_reads_back() {
    let distance = |by: f64| sampling::GraspDistance {
        palm_m: 1.0 * by,
        palm_rad: 2.0 * by,
        q_rad: 3.0 * by,
    };
    let sampled = |name: &str, limit_excess_rad: f64| sampling::Sampled {
        candidate_id: name.to_owned(),
        limit_excess_rad,
        approach_depth_m: 4.0,
        approach_depth_time_s: 5.0,
        grasp_depth_m: 6.0,
        table_depth_m: 7.0,
        demonstration: (limit_excess_rad > 0.1).then(|| ("a".to_owned(), distance(0.1))),
        from_mean: distance(0.3),
    };
    let motions = [sampled("can-0", 0.049), sampled("can-1", 0.2)];
    assert_eq!(
        motions.each_ref().map(sampling::Sampled::within_limits),
        [true, false]
    );
    let batch = sampling::to_batch(&motions).unwrap();
    assert_eq!(sampling::from_batch(&batch).unwrap(), motions);
    assert_eq!(batch.schema().as_ref(), &sampling::schema());
}

#[test]
fn success_reads_back() {
    let row = |generator: &str, successes_n: i64| success::Success {
        object: "can".to_owned(),
        generator: generator.to_owned(),
        verdicts_n: [successes_n, 2, 3, 4, 5, 6, 7, 8, 9],
        control_steps_n: 1000,
        spread: sampling::GraspDistance {
            palm_m: 1.0,
            palm_rad: 2.0,
            q_rad: 3.0,
        },
        spread_n: successes_n,
    };
    let rows = [row("cgf", 40), row("interpolate", 0)];
    assert_eq!(
        rows.each_ref().map(success::Success::candidates_n),
        [84, 44]
    );
    let per_success = rows
        .each_ref()
        .map(success::Success::control_steps_per_success);
    assert_eq!(per_success, [25.0, 0.0]);
    assert_eq!(rows[0].count(rollouts::Verdict::Table), 3);
    let batch = success::to_batch(&rows).unwrap();
    assert_eq!(success::from_batch(&batch).unwrap(), rows);
    assert_eq!(batch.schema().as_ref(), &success::schema());

    // Counts that do not add up are another's.
    let idx = batch.schema().index_of("candidates_n").unwrap();
    let mut columns = batch.columns().to_vec();
    columns[idx] = batch.column(idx + 1).clone();
    let wrong = RecordBatch::try_new(batch.schema(), columns).unwrap();
    let err = success::from_batch(&wrong).unwrap_err();
    assert!(err.to_string().contains("40 candidates, and 84"), "{err}");
}

#[test]
fn rollouts_and_executions_read_back() {
    let rollouts: Vec<_> = rollouts::Verdict::ALL
        .into_iter()
        .map(|verdict| rollouts::Rollout {
            candidate_id: verdict.as_str().to_owned(),
            generator: "cgf".to_owned(),
            verdict,
            cost_n: 65,
            saved_n: 125,
            lift_m: 0.15,
            slip_m: 0.001,
            displacement_m: 0.002,
            penetration_m: 0.0005,
            contacts_n: 4,
            smoothness: rollouts::Smoothness {
                paper: variations(1.0),
                released: variations(10.0),
                robust: variations(100.0),
            },
        })
        .collect();
    let batch = rollouts::to_batch(&rollouts).unwrap();
    assert_eq!(rollouts::from_batch(&batch).unwrap(), rollouts);

    let executions: Vec<_> = executions::Outcome::ALL
        .into_iter()
        .map(|outcome| executions::Execution {
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
        })
        .collect();
    let batch = executions::to_batch(&executions).unwrap();
    assert_eq!(executions::from_batch(&batch).unwrap(), executions);
}

#[test]
fn trials_read_back_and_add_up() {
    let trials = vec![trials::Trials {
        object: "can".to_owned(),
        cell: "lab".to_owned(),
        simulated: false,
        gap: String::new(),
        // Succeeded, failed, rejected, aborted, stopped, unknown.
        outcomes_n: [11, 4, 5, 3, 7, 2],
    }];
    assert_eq!((trials[0].trials_n(), trials[0].successes_n()), (20, 11));
    let [low, high] = trials[0].interval();
    assert!(low < 0.55 && 0.55 < high && trials[0].rate() == 0.55);
    let batch = trials::to_batch(&trials).unwrap();
    assert_eq!(trials::from_batch(&batch).unwrap(), trials);
}

#[test]
fn refuses_numbers_that_are_not_finite() {
    let mut broken = trajectory();
    broken.steps[0].q_rad[1] = f64::NAN;
    let refused = trajectories::to_batch(&broken).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `q_rad` holds a number that is not finite in row 0"
    );
}

#[test]
fn refuses_another_schema_and_the_wrong_number_of_joints() {
    let batch = trajectories::to_batch(&trajectory()).unwrap();
    let refused = rollouts::from_batch(&batch).unwrap_err();
    assert!(matches!(refused, SchemaError::Version { .. }), "{refused}");

    let mut broken = trajectory();
    broken.steps[0].q_rad.push(0.0);
    let batch = trajectories::to_batch(&broken).unwrap();
    let refused = trajectories::from_batch("a", &batch).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `q_rad`: 3 joint positions, expected 2"
    );
}

#[test]
fn every_number_has_a_unit_and_every_column_a_meaning() {
    let schemas = [
        objects::schema(),
        demonstrations::schema(),
        trajectories::schema(&joints(), &trajectory().keypoints, &trajectory().tips),
        candidates::schema(&joints()),
        rollouts::schema(),
        sampling::schema(),
        success::schema(),
        executions::schema(),
        training::schema(),
        reconstruction::schema(&joints()),
        latents::schema(),
    ];
    for schema in schemas {
        assert!(schema.metadata()["schema"].contains('/'));
        for field in schema.fields() {
            assert!(
                !field.metadata()["description"].is_empty(),
                "{}",
                field.name()
            );
            let holds_numbers = format!("{}", field.data_type()).contains("64");
            assert_eq!(
                holds_numbers,
                field.metadata().contains_key("unit"),
                "{}",
                field.name()
            );
        }
    }
}

#[test]
fn what_shows_a_training_reads_back() {
    let rows: Vec<_> = [(1, "training"), (1, "held_out"), (2, "training")]
        .map(|(epoch, split)| training::Row {
            epoch,
            split: split.to_owned(),
            learning_rate: 1e-3,
            total: 2.0,
            q: 3.0,
            translation: 4.0,
            origins_m2: 5.0,
            rotations: 6.0,
            kl_nats: 7.0,
            contact_m2: 8.0,
            penetration_m2: 2e-5,
        })
        .into();
    let batch = training::to_batch(&rows).unwrap();
    assert_eq!(training::from_batch(&batch).unwrap(), rows);
    assert_eq!(batch.schema().as_ref(), &training::schema());

    let row = reconstruction::Row {
        sequence: "a".to_owned(),
        object: "can".to_owned(),
        split: "unseen".to_owned(),
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
    let rows = vec![row.clone(), row.clone()];
    let batch = reconstruction::to_batch(&joints(), &rows).unwrap();
    let read = reconstruction::from_batch(&batch).unwrap();
    assert_eq!(read, (joints(), rows));
    assert_eq!(batch.schema().as_ref(), &reconstruction::schema(&joints()));
    let short = reconstruction::Row {
        joint_errors_rad: vec![0.5],
        ..row
    };
    let batch = reconstruction::to_batch(&joints(), &[short]).unwrap();
    let err = reconstruction::from_batch(&batch).unwrap_err();
    assert!(err.to_string().contains("1 numbers for 2 joints"), "{err}");

    let rows: Vec<_> = [false, true]
        .map(|active| latents::Row {
            dimension: i64::from(active),
            kl_nats: 0.5,
            mean_deviation: 0.25,
            deviation_mean: 0.75,
            active,
        })
        .into();
    let batch = latents::to_batch(&rows).unwrap();
    assert_eq!(latents::from_batch(&batch).unwrap(), rows);
    assert_eq!(batch.schema().as_ref(), &latents::schema());
    let endless = latents::Row {
        kl_nats: f64::INFINITY,
        ..rows[0].clone()
    };
    assert!(latents::to_batch(&[endless]).is_err());
}
