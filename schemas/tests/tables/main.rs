//! What is written reads back equal; what breaks a schema is refused; a changed column is a new version.

mod filled;
mod snapshots;

use std::fmt::Debug;

use arrow_array::RecordBatch;
use schemas::{
    SchemaError, Table,
    candidates::Candidates,
    latents::{self, Latents},
    reconstruction::{self, Reconstruction},
    rollouts::{Rollouts, Verdict},
    sampling::Sampled,
    success::{Success, Successes},
    trajectories::Trajectory,
};

use crate::filled::EachTable;

#[test]
fn every_table_reads_back() {
    struct ReadBack;
    impl EachTable for ReadBack {
        fn table<T: Table + PartialEq + Debug>(&self, key: &str, table: &T) {
            let batch = table.to_batch().unwrap();
            assert_eq!(T::from_batch(key, &batch).unwrap(), *table);
            assert_eq!(batch.schema().fields(), T::schema().fields());
        }
    }
    filled::each(&ReadBack);
}

#[test]
fn a_joint_outside_its_limits_is_told_apart() {
    let motions = filled::sampling();
    let within: Vec<bool> = motions.iter().map(Sampled::within_limits).collect();
    assert_eq!(within, [true, false]);
}

#[test]
fn successes_add_up() {
    let rows = filled::success();
    let of_rows = |number: fn(&Success) -> i64| rows.iter().map(number).collect::<Vec<_>>();
    assert_eq!(of_rows(Success::candidates_n), [94, 54]);
    let per_success = rows.iter().map(Success::control_steps_per_success);
    assert_eq!(per_success.collect::<Vec<_>>(), [25.0, 0.0]);
    assert_eq!(rows[0].count(Verdict::Table), 3);

    // Counts that do not add up are another's.
    let batch = rows.to_batch().unwrap();
    let idx = batch.schema().index_of("candidates_n").unwrap();
    let mut columns = batch.columns().to_vec();
    columns[idx] = batch.column(idx + 1).clone();
    let wrong = RecordBatch::try_new(batch.schema(), columns).unwrap();
    let err = Successes::from_batch("all", &wrong).unwrap_err();
    assert!(err.to_string().contains("40 candidates, and 94"), "{err}");
}

#[test]
fn trials_add_up() {
    let trials = filled::trials();
    assert_eq!((trials[0].trials_n(), trials[0].successes_n()), (20, 11));
    let [low, high] = trials[0].interval();
    assert!(low < 0.55 && 0.55 < high && trials[0].rate() == 0.55);
}

#[test]
fn refuses_numbers_that_are_not_finite() {
    let mut broken = filled::trajectory();
    broken.steps[0].hand.q_rad[1] = f64::NAN;
    let refused = broken.to_batch().unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `q_rad` holds a number that is not finite in row 0"
    );
    let endless = latents::Row {
        kl_nats: f64::INFINITY,
        ..filled::latents()[0].clone()
    };
    assert!(Latents::to_batch(&vec![endless]).is_err());
}

#[test]
fn refuses_another_schema() {
    let batch = filled::trajectory().to_batch().unwrap();
    let refused = Rollouts::from_batch("a", &batch).unwrap_err();
    assert!(matches!(refused, SchemaError::Version { .. }), "{refused}");
}

#[test]
fn refuses_lists_that_do_not_fit_the_joints_or_the_steps() {
    let mut broken = filled::trajectory();
    broken.steps[0].hand.q_rad.push(0.0);
    let batch = broken.to_batch().unwrap();
    let refused = Trajectory::from_batch("a", &batch).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `q_rad`: 3 joint positions, expected 2"
    );

    let mut broken = filled::candidates();
    broken.joints.push("joint_2".to_owned());
    let batch = broken.to_batch().unwrap();
    assert!(Candidates::from_batch("can", &batch).is_err());

    let mut broken = filled::reconstruction();
    broken.rows[1] = reconstruction::Row {
        joint_errors_rad: vec![0.5],
        ..broken.rows[1].clone()
    };
    let batch = broken.to_batch().unwrap();
    let refused = Reconstruction::from_batch("cgf", &batch).unwrap_err();
    assert!(
        refused.to_string().contains("joint_errors_rad"),
        "{refused}"
    );
}

#[test]
fn every_number_has_a_unit_and_every_column_a_meaning() {
    struct Documented;
    impl EachTable for Documented {
        fn table<T: Table + PartialEq + Debug>(&self, _key: &str, _table: &T) {
            let schema = T::schema();
            assert_eq!(schema.metadata()["schema"], T::VERSION);
            for field in schema.fields() {
                let name = format!("{}.{}", T::NAME, field.name());
                assert!(!field.metadata()["description"].is_empty(), "{name}");
                let holds_numbers = field.data_type().to_string().contains("64");
                let has_unit = field.metadata().contains_key("unit");
                assert_eq!(holds_numbers, has_unit, "{name}");
            }
        }
    }
    filled::each(&Documented);
}
