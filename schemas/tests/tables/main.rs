//! Tables read back equal; a violation of a schema is refused; a changed column is a new version.

mod filled;
mod snapshots;

use std::{fmt::Debug, sync::Arc};

use arrow_array::{
    ArrayRef, Float64Array, Int64Array, ListArray, RecordBatch, StringArray,
    cast::AsArray,
    types::{Float64Type, Int64Type},
};
use arrow_schema::{DataType, Field, FieldRef, Schema};
use schemas::{
    SchemaError, Table,
    candidates::{Candidates, DrawSource},
    draws::{Draw, Draws, Refusal},
    latents::{self, Latents},
    rates::SuccessRates,
    reconstruction::{self, Reconstruction},
    rollouts::{Rollouts, Verdict},
    sampling::{SampleMeasures, Sampling},
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
fn every_draw_is_a_row_and_a_candidate_is_one_that_was_kept() {
    let candidates = filled::candidates();
    let batch = candidates.to_batch().unwrap();
    let words = |batch: &RecordBatch, name: &str| -> Vec<String> {
        let column = batch.column_by_name(name).unwrap().as_string::<i32>();
        column.iter().map(|word| word.unwrap().to_owned()).collect()
    };
    assert_eq!(words(&batch, "candidate_id"), ["can-0", "can-1"]);
    let draws = filled::draws().to_batch().unwrap();
    assert_eq!(
        words(&draws, "candidate_id"),
        ["can-0", "can-1", "can-1", "can-1", "can-1"]
    );
    assert_eq!(
        words(&draws, "refused"),
        ["", "object", "", "table", "motion"]
    );

    // A generator without draws has one for each candidate.
    let each: Draws = candidates.candidates.iter().map(Draw::kept).collect();
    assert_eq!(Draw::of_candidates(&batch).unwrap(), each);
    // In older versions refused draws are rows among the candidates.
    let mut older = candidates.clone();
    older.candidates[0].candidate_id = "can-1".to_owned();
    let older = older.to_batch().unwrap();
    let schema = older.schema();
    let refused: ArrayRef = Arc::new(StringArray::from(vec!["table", ""]));
    let fields = schema.fields().iter().cloned();
    let field = Arc::new(Field::new("refused", DataType::Utf8, false));
    let fields: Vec<FieldRef> = fields.chain([field]).collect();
    let mut metadata = schema.metadata().clone();
    metadata.insert("schema".to_owned(), "candidates/5".to_owned());
    let schema = Arc::new(Schema::new_with_metadata(fields, metadata));
    let columns = older.columns().iter().cloned().chain([refused]).collect();
    let older = RecordBatch::try_new(schema, columns).unwrap();
    let kept = Candidates::from_batch("can", &older).unwrap().candidates;
    assert_eq!(kept, candidates.candidates[1..]);
    let draws = Draw::of_candidates(&older).unwrap();
    let refusals: Vec<Option<Refusal>> = draws.iter().map(|draw| draw.refused).collect();
    assert_eq!(refusals, [Some(Refusal::Table), None]);
    // Without training, objects have no split.
    let mut untrained = candidates;
    for candidate in &mut untrained.candidates {
        candidate.source = DrawSource {
            object_split: None,
            ..candidate.source.clone()
        };
    }
    let batch = untrained.to_batch().unwrap();
    assert_eq!(Candidates::from_batch("can", &batch).unwrap(), untrained);
}

#[test]
fn a_joint_outside_its_limits_is_told_apart() {
    let motions = filled::sampling();
    let within: Vec<bool> = motions.iter().map(SampleMeasures::within_limits).collect();
    assert_eq!(within, [true, false]);
}

#[test]
fn a_zero_of_the_version_before_is_null_where_nothing_was_measured() {
    let (success, sampling, rates) = (filled::success(), filled::sampling(), filled::rates());
    let rollouts = filled::rollouts();
    for older in ["rollouts/6", "rollouts/7"] {
        let before = of_version_before(&rollouts.to_batch().unwrap(), older);
        assert_eq!(Rollouts::from_batch("can", &before).unwrap(), rollouts);
    }
    let before = of_version_before(&success.to_batch().unwrap(), "success/5");
    assert_eq!(Successes::from_batch("all", &before).unwrap(), success);
    let before = of_version_before(&sampling.to_batch().unwrap(), "sampling/1");
    assert_eq!(Sampling::from_batch("can", &before).unwrap(), sampling);
    // A mean rate of 0 is most often one that was measured.
    let before = of_version_before(&rates.to_batch().unwrap(), "rates/2");
    let read = SuccessRates::from_batch("all", &before).unwrap();
    assert_eq!(read[0], rates[0]);
    assert_eq!(read[1].by_candidate(), Some([0.0; 3]));
}

/// Returns the table with 0 for null, and this version.
fn of_version_before(batch: &RecordBatch, version: &str) -> RecordBatch {
    let without_null = |column: &ArrayRef| match column.as_primitive_opt::<Float64Type>() {
        Some(numbers) => {
            let numbers = numbers.iter().map(Option::unwrap_or_default);
            Arc::new(Float64Array::from_iter_values(numbers)) as ArrayRef
        }
        None => match column.as_primitive_opt::<Int64Type>() {
            Some(counts) => {
                let counts = counts.iter().map(Option::unwrap_or_default);
                Arc::new(Int64Array::from_iter_values(counts)) as ArrayRef
            }
            None => Arc::clone(column),
        },
    };
    let mut metadata = batch.schema().metadata().clone();
    metadata.insert("schema".to_owned(), version.to_owned());
    let schema = Schema::new_with_metadata(batch.schema().fields().clone(), metadata);
    let columns = batch.columns().iter().map(without_null).collect();
    RecordBatch::try_new(Arc::new(schema), columns).unwrap()
}

#[test]
fn successes_add_up() {
    let rows = filled::success();
    let totals = rows.iter().map(|row| row.verdicts.total_count());
    assert_eq!(totals.collect::<Vec<_>>(), [105, 65]);
    let per_success = rows.iter().map(Success::control_steps_per_success);
    assert_eq!(per_success.collect::<Vec<_>>(), [Some(25.0), None]);
    assert_eq!(rows[0].verdicts.count(Verdict::Table), 3);

    // Counts that do not add up are refused.
    let batch = rows.to_batch().unwrap();
    let idx = batch.schema().index_of("candidates_n").unwrap();
    let mut columns = batch.columns().to_vec();
    columns[idx] = batch.column(idx + 1).clone();
    let wrong = RecordBatch::try_new(batch.schema(), columns).unwrap();
    let err = Successes::from_batch("all", &wrong).unwrap_err();
    assert!(
        err.to_string().contains("40, and 105 by how they ended"),
        "{err}"
    );
}

#[test]
fn trials_add_up() {
    let outcomes = &filled::trials()[0].outcomes;
    assert_eq!((outcomes.total_count(), outcomes.success_count()), (20, 11));
    let [low, high] = outcomes.interval();
    assert!(low < 0.55 && 0.55 < high && outcomes.rate() == Some(0.55));
}

#[test]
fn refuses_numbers_that_are_not_finite() {
    let mut broken = filled::trajectory();
    broken.tracking[1].tip_errors_m[0] = f64::NAN;
    let refused = broken.to_batch().unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `tip_errors_m` holds a number that is not finite in row 1"
    );
    let endless = latents::LatentDimension {
        kl_nats: f64::INFINITY,
        ..filled::latents()[0].clone()
    };
    assert!(Latents::to_batch(&vec![endless]).is_err());
}

#[test]
fn refuses_nulls() {
    let with_column = |batch: &RecordBatch, name: &str, column: ArrayRef| {
        let mut columns = batch.columns().to_vec();
        columns[batch.schema().index_of(name).unwrap()] = column;
        let schema = batch.schema();
        let fields = schema.fields().iter().zip(&columns).map(|(field, column)| {
            let field = field.as_ref().clone().with_nullable(true);
            field.with_data_type(column.data_type().clone())
        });
        let fields: Vec<Field> = fields.collect();
        let schema = Schema::new_with_metadata(fields, batch.schema().metadata().clone());
        RecordBatch::try_new(Arc::new(schema), columns).unwrap()
    };
    let batch = filled::latents().to_batch().unwrap();
    let mut numbers = vec![Some(0.5); batch.num_rows()];
    numbers[1] = None;
    let numbers = Arc::new(Float64Array::from(numbers));
    let found = Latents::from_batch("cgf", &with_column(&batch, "kl_nats", numbers));
    assert_eq!(
        found.unwrap_err().to_string(),
        "table `latents/1` has a null in column `kl_nats`, row 1"
    );
    let batch = filled::trajectory().to_batch().unwrap();
    let lists = [vec![Some(0.03)], vec![None]].map(Some);
    let lists = Arc::new(ListArray::from_iter_primitive::<Float64Type, _, _>(lists));
    let found = Trajectory::from_batch("a", &with_column(&batch, "tip_errors_m", lists));
    assert_eq!(
        found.unwrap_err().to_string(),
        "table `trajectories/2` has a null in column `tip_errors_m`, row 1"
    );
}

#[test]
fn a_column_that_an_older_version_lacks_reads_as_null() {
    let batch = filled::candidates().to_batch().unwrap();
    let known = batch.schema();
    let mut kept: Vec<usize> = (0..batch.num_columns()).collect();
    kept.remove(known.index_of("residual_m2").unwrap());
    let read = |version: &str| {
        let batch = batch.project(&kept).unwrap();
        let mut metadata = known.metadata().clone();
        metadata.insert("schema".to_owned(), version.to_owned());
        let schema = Arc::new(batch.schema().as_ref().clone().with_metadata(metadata));
        let batch = RecordBatch::try_new(schema, batch.columns().to_vec()).unwrap();
        Candidates::from_batch("can", &batch)
    };
    let older = read("candidates/5").unwrap().candidates;
    assert!(older.iter().all(|one| one.residual_m2.is_none()));
    let refused = read(Candidates::VERSION).unwrap_err();
    assert!(matches!(refused, SchemaError::Column { .. }), "{refused}");
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
    broken.tracking[0].tip_errors_m.push(0.0);
    let batch = broken.to_batch().unwrap();
    let refused = Trajectory::from_batch("a", &batch).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `tip_errors_m`: 2 errors, expected 1"
    );
    broken.tracking.pop();
    assert!(broken.to_batch().is_err());

    let batch = of_three_joints(&filled::trajectory().to_batch().unwrap());
    let refused = Trajectory::from_batch("a", &batch).unwrap_err();
    assert!(matches!(refused, SchemaError::Motion { .. }), "{refused}");

    let batch = of_three_joints(&filled::candidates().to_batch().unwrap());
    let refused = Candidates::from_batch("can", &batch).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "column `q_rad`: 6 joint positions, expected 9"
    );
    let mut broken = filled::candidates();
    broken.joints = ["joint_0".to_owned()].into();
    let refused = broken.to_batch().unwrap_err();
    assert!(refused.to_string().contains("`can-0`"), "{refused}");

    let mut broken = filled::reconstruction();
    broken.rows[1] = reconstruction::ReconstructionError {
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

/// Returns the rows under the names of three joints.
fn of_three_joints(batch: &RecordBatch) -> RecordBatch {
    let schema = batch.schema().as_ref().clone();
    let mut metadata = schema.metadata().clone();
    metadata.insert("joints".to_owned(), "a,b,c".to_owned());
    let schema = Arc::new(schema.with_metadata(metadata));
    RecordBatch::try_new(schema, batch.columns().to_vec()).unwrap()
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
