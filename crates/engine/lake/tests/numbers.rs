//! Every finite number comes back from the lake bit for bit, wherever it was written.

use std::{collections::BTreeMap, sync::Arc};

use arrow_array::{ArrayRef, Float64Array, RecordBatch, cast::AsArray, types::Float64Type};
use dataflow::{
    Artifact, Fingerprint, NodeName, NodeRecord, Origin, OutputFingerprint, OutputRecord, Record,
    RecordOutcome, RunRecord, RunStatus, StageRecord, Store, UnitName, UnitRef,
};
use lake::{Lake, table};
use serde_json::json;

/// Numbers that decimal parsers get wrong, and random ones: of any bits, and of a few digits as
/// people write them.
fn numbers() -> Vec<f64> {
    let mut numbers = vec![
        0.0,
        -0.0,
        5e-324,
        f64::MIN_POSITIVE,
        f64::MAX,
        f64::MIN,
        f64::EPSILON,
        9_007_199_254_740_992.0,
        0.233_333_333_333_333_34,
        0.1 + 0.2,
    ];
    let mut reader = blake3::Hasher::new().update(b"numbers").finalize_xof();
    let mut drawn = || {
        let mut bytes = [0; 8];
        reader.fill(&mut bytes);
        u64::from_le_bytes(bytes)
    };
    for _ in 0..500 {
        numbers.push(f64::from_bits(drawn()));
        numbers.push((drawn() >> 11) as f64 / (1_u64 << 53) as f64);
        numbers.push((drawn() % 100_000) as f64 / 30_000.0);
    }
    numbers.retain(|number| number.is_finite());
    numbers
}

fn bits(numbers: impl IntoIterator<Item = f64>) -> Vec<u64> {
    numbers.into_iter().map(f64::to_bits).collect()
}

/// The numbers keyed by names that sort in their order.
fn by_name(numbers: &[f64]) -> BTreeMap<String, f64> {
    let named = numbers.iter().enumerate();
    named
        .map(|(idx, &number)| (format!("n{idx:05}"), number))
        .collect()
}

fn column(file: std::path::PathBuf, name: &str) -> Vec<u64> {
    let artifact = Artifact {
        key: "all".parse().unwrap(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(table::FILE.to_owned(), file)]),
    };
    let batch = table::read_batch(&artifact).unwrap();
    let values = batch.column_by_name(name).unwrap();
    bits(
        values
            .as_primitive::<Float64Type>()
            .values()
            .iter()
            .copied(),
    )
}

#[test]
fn every_number_comes_back_from_records_runs_caches_and_tables() {
    let folder = tempfile::tempdir().unwrap();
    let numbers = numbers();
    let expected = bits(numbers.clone());
    let config = json!({"list": numbers, "named": by_name(&numbers)});
    let node = NodeName::parse("made.values").unwrap();
    let fingerprint = Fingerprint {
        recipe: Arc::new(OutputFingerprint {
            kind: "make".to_owned(),
            output: "values".parse().unwrap(),
            code: BTreeMap::new(),
            config: config.clone(),
            schema: "values/1".to_owned(),
        }),
        stage: "made".parse().unwrap(),
        partition: "all".parse().unwrap(),
        inputs: BTreeMap::new(),
        files: BTreeMap::new(),
        facts: BTreeMap::new(),
        seed: u64::MAX,
    };
    let digest = fingerprint.digest();

    let lake = Lake::open(folder.path());
    let name = UnitName::new(&node, &fingerprint.partition);
    lake.enter("own").unwrap();
    let making = lake.begin(&digest, &name, &|_| {}).unwrap();
    let values: ArrayRef = Arc::new(Float64Array::from(numbers.clone()));
    let batch = RecordBatch::try_from_iter([("value", values)]).unwrap();
    table::write_batch(making.folder(), &batch).unwrap();
    let outcome = RecordOutcome::Made {
        files: BTreeMap::new(),
        labels: BTreeMap::new(),
        metrics: by_name(&numbers),
        provisional: false,
    };
    let kept = making.commit(Record {
        fingerprint: fingerprint.clone(),
        outcome,
    });
    let kept = Arc::new(kept.unwrap().outcome);
    let unit = UnitRef {
        node: node.clone(),
        partition: "all".parse().unwrap(),
        fingerprint: digest,
        made_now: true,
    };
    let run = RunRecord {
        pipeline: "own".to_owned(),
        origin: Origin::default(),
        seed: u64::MAX,
        stages: BTreeMap::from([(
            node.stage.clone(),
            StageRecord {
                kind: "make".to_owned(),
                config,
                inputs: BTreeMap::new(),
            },
        )]),
        outputs: vec![OutputRecord {
            node: node.clone(),
            partition: "part".to_owned(),
        }],
        nodes: vec![NodeRecord {
            node,
            description: "made".to_owned(),
            published: false,
            n_made_now: 1,
            n_made: 1,
            n_skipped: 0,
            n_filtered: 0,
            metrics: by_name(&numbers),
            seconds: 0.233_333_333_333_333_34,
        }],
        units: vec![unit.clone()],
        status: RunStatus::Finished,
        seconds: 0.1 + 0.2,
    };
    let units = [(unit, kept)];
    let number = lake.begin_run(&run).unwrap();
    lake.settle("own", Some(&units)).unwrap();
    lake.end_run(number, &run, &units).unwrap();
    drop(lake);

    // As in another process, without cached state.
    let lake = Lake::open(folder.path());
    let record = lake
        .record(&digest)
        .unwrap()
        .expect("its recipe is read back");
    assert_eq!(record.fingerprint.digest(), digest);
    let metrics = |outcome: &RecordOutcome| match outcome {
        RecordOutcome::Made { metrics, .. } => bits(metrics.values().copied()),
        other => panic!("{other:?}"),
    };
    assert_eq!(metrics(&record.outcome), expected);
    let again = lake.run(number).unwrap().record;
    let text = |run: &RunRecord| serde_json::to_string(run).unwrap();
    assert_eq!(text(&again), text(&run));
    lake.enter("own").unwrap();
    let newest = lake.lookup(&digest).unwrap().unwrap();
    assert_eq!(metrics(&newest), expected);
    let RecordOutcome::Made { files, .. } = &*newest else {
        panic!("it was made");
    };
    assert_eq!(column(lake.file(&files[table::FILE]), "value"), expected);
    let table = |name: &str| lake.history_table(name).unwrap()[&number].clone();
    assert_eq!(column(table("metrics"), "value"), expected);
    assert_eq!(column(table("runs"), "seconds"), bits([run.seconds]));
    let verified = lake.verify(&|_, _| {}).unwrap();
    assert_eq!(verified.faults, []);
}
