//! The dataset's Parquet files.

use std::{collections::BTreeMap, sync::Arc};

use arrow_array::{
    ArrayRef, BooleanArray, FixedSizeListArray, Float32Array, Float64Array, Int64Array, ListArray,
    RecordBatch, StringArray,
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use parquet::{
    arrow::ArrowWriter,
    basic::{Compression, ZstdLevel},
    file::properties::WriterProperties,
};
use serde_json::json;

use crate::{
    FormatError,
    lerobot::{Feature, Frame, Recorded, stats::Stats},
};

/// Converts a count; none in memory exceeds `i64::MAX`.
fn count(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

/// Columns with their names.
type Columns = Vec<(String, ArrayRef)>;

/// The frames, one row group for each episode.
pub(super) fn frames(
    recorded: &[Recorded<'_>],
    features: &[Feature],
    fps: u32,
) -> Result<Vec<u8>, FormatError> {
    const FILE: &str = "data/chunk-000/file-000.parquet";
    let mut first = 0_i64;
    let batches = (0_i64..).zip(recorded).map(|(episode, one)| {
        let n = one.frames.len();
        let mut columns: Columns = Vec::new();
        for (name, names, numbers) in features {
            columns.push((
                (*name).to_owned(),
                vectors(&one.frames, names.len(), *numbers)?,
            ));
        }
        let from = |from: i64| Arc::new(Int64Array::from_iter_values((from..).take(n)));
        let same = |of: i64| Arc::new(Int64Array::from(vec![of; n]));
        columns.push(("timestamp".to_owned(), Arc::new(timestamps(n, fps))));
        columns.push(("frame_index".to_owned(), from(0)));
        columns.push(("episode_index".to_owned(), same(episode)));
        columns.push(("index".to_owned(), from(first)));
        columns.push(("task_index".to_owned(), same(count(one.task))));
        let done = (1..=n)
            .map(|frame| Some(frame == n))
            .collect::<BooleanArray>();
        columns.push(("next.done".to_owned(), Arc::new(done)));
        first += count(n);
        RecordBatch::try_from_iter_with_nullable(not_null(columns))
    });
    let batches = batches.collect::<Result<Vec<_>, ArrowError>>();
    parquet(FILE, &batches.map_err(FormatError::encode(FILE))?)
}

/// The episodes: where their frames are, what they are about, and their statistics.
pub(super) fn episodes(
    recorded: &[Recorded<'_>],
    features: &[Feature],
    fps: u32,
) -> Result<Vec<u8>, FormatError> {
    const FILE: &str = "meta/episodes/chunk-000/file-000.parquet";
    let lengths: Vec<i64> = recorded.iter().map(|one| count(one.frames.len())).collect();
    let ends: Vec<i64> = lengths
        .iter()
        .scan(0, |end, length| {
            *end += length;
            Some(*end)
        })
        .collect();
    let starts = ends.iter().zip(&lengths).map(|(end, length)| end - length);
    let zeros = || Arc::new(Int64Array::from(vec![0; lengths.len()])) as ArrayRef;
    let text = |of: fn(&Recorded<'_>) -> String| {
        Arc::new(StringArray::from_iter_values(recorded.iter().map(of))) as ArrayRef
    };
    let tasks = recorded.iter().map(|one| super::task(one.episode.object()));
    let mut columns: Columns = vec![
        (
            "episode_index".to_owned(),
            Arc::new(Int64Array::from_iter_values((0..).take(lengths.len()))),
        ),
        (
            "tasks".to_owned(),
            lists(
                Arc::new(StringArray::from_iter_values(tasks)),
                vec![1; lengths.len()],
            ),
        ),
        ("name".to_owned(), text(|one| one.episode.name().to_owned())),
        (
            "object".to_owned(),
            text(|one| one.episode.object().to_owned()),
        ),
        (
            "outcome".to_owned(),
            text(|one| one.episode.outcome().unwrap_or_default().to_owned()),
        ),
        (
            "length".to_owned(),
            Arc::new(Int64Array::from(lengths.clone())),
        ),
        ("data/chunk_index".to_owned(), zeros()),
        ("data/file_index".to_owned(), zeros()),
        (
            "dataset_from_index".to_owned(),
            Arc::new(Int64Array::from_iter_values(starts)),
        ),
        (
            "dataset_to_index".to_owned(),
            Arc::new(Int64Array::from(ends)),
        ),
        ("meta/episodes/chunk_index".to_owned(), zeros()),
        ("meta/episodes/file_index".to_owned(), zeros()),
    ];
    let by_episode = recorded
        .chunks(1)
        .map(|one| Stats::of(one, features, fps).0);
    columns.extend(statistics(&by_episode.collect::<Vec<_>>()));
    let batch = RecordBatch::try_from_iter_with_nullable(not_null(columns));
    parquet(FILE, &[batch.map_err(FormatError::encode(FILE))?])
}

/// A column for each statistic of each feature, from the statistics of each episode.
fn statistics(by_episode: &[Vec<super::stats::FeatureStats>]) -> Columns {
    let mut columns = Columns::new();
    let Some(first) = by_episode.first() else {
        return columns;
    };
    for (idx, feature) in first.iter().enumerate() {
        for (at, (statistic, _)) in feature.numbers().into_iter().enumerate() {
            let of = by_episode.iter().map(|all| all[idx].numbers()[at].1);
            let numbers = of.clone().flatten().copied();
            let list = lists(
                Arc::new(Float64Array::from_iter_values(numbers)),
                of.map(Vec::len).collect(),
            );
            columns.push((format!("stats/{}/{statistic}", feature.name), list));
        }
        let counts = by_episode.iter().map(|all| count(all[idx].frames_n));
        let counts = Arc::new(Int64Array::from_iter_values(counts));
        columns.push((
            format!("stats/{}/count", feature.name),
            lists(counts, vec![1; by_episode.len()]),
        ));
    }
    columns
}

/// The tasks, as pandas writes a table whose index is the task: `lerobot` looks its text up in the index.
pub(super) fn tasks(tasks: &BTreeMap<String, usize>) -> Result<Vec<u8>, FormatError> {
    const FILE: &str = "meta/tasks.parquet";
    let mut in_order: Vec<(&String, &usize)> = tasks.iter().collect();
    in_order.sort_by_key(|(_, number)| **number);
    let numbers = in_order.iter().map(|(_, number)| count(**number));
    let columns: [ArrayRef; 2] = [
        Arc::new(Int64Array::from_iter_values(numbers)),
        Arc::new(StringArray::from_iter_values(
            in_order.iter().map(|(task, _)| task),
        )),
    ];
    let column = |name: &str, pandas: &str, numpy: &str| json!({"name": name, "field_name": name, "pandas_type": pandas, "numpy_type": numpy, "metadata": null});
    let pandas = json!({
        "index_columns": ["task"],
        "column_indexes": [
            {"name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object", "metadata": {"encoding": "UTF-8"}}
        ],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": "21.0.0"},
        "pandas_version": "2.0.0",
    });
    let fields = vec![
        Field::new("task_index", DataType::Int64, false),
        Field::new("task", DataType::Utf8, false),
    ];
    let schema =
        Schema::new(fields).with_metadata([("pandas".to_owned(), pandas.to_string())].into());
    let batch = RecordBatch::try_new(Arc::new(schema), columns.to_vec());
    parquet(FILE, &[batch.map_err(FormatError::encode(FILE))?])
}

fn not_null(columns: Columns) -> impl Iterator<Item = (String, ArrayRef, bool)> {
    columns
        .into_iter()
        .map(|(name, column)| (name, column, false))
}

/// The times of frames; the loader wants them in 32 bits.
fn timestamps(n: usize, fps: u32) -> Float32Array {
    let times = (0..n).map(|frame| frame as f64 / f64::from(fps));
    Float32Array::from(super::singles(times))
}

/// A column of vectors of one length.
fn vectors(
    frames: &[Frame],
    length: usize,
    numbers: fn(&Frame) -> &[f32],
) -> Result<ArrayRef, ArrowError> {
    let values = frames.iter().flat_map(numbers).copied();
    let values = Arc::new(Float32Array::from_iter_values(values));
    let item = Arc::new(Field::new("item", DataType::Float32, true));
    // Joints of a hand are far fewer than 2³¹.
    let length = i32::try_from(length).unwrap_or(i32::MAX);
    Ok(Arc::new(FixedSizeListArray::try_new(
        item, length, values, None,
    )?))
}

/// A column of lists of these lengths.
fn lists(values: ArrayRef, lengths: Vec<usize>) -> ArrayRef {
    let item = Arc::new(Field::new("item", values.data_type().clone(), true));
    Arc::new(ListArray::new(
        item,
        OffsetBuffer::from_lengths(lengths),
        values,
        None,
    ))
}

/// Encodes a table, each batch as a row group.
fn parquet(file: &str, batches: &[RecordBatch]) -> Result<Vec<u8>, FormatError> {
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_created_by(concat!("pipeline ", env!("CARGO_PKG_VERSION")).to_owned())
        .build();
    let first = batches.first().ok_or(FormatError::Empty)?;
    let mut bytes = Vec::new();
    let writer = ArrowWriter::try_new(&mut bytes, first.schema(), Some(properties));
    let written = writer.and_then(|mut writer| {
        for batch in batches {
            writer.write(batch)?;
            writer.flush()?;
        }
        writer.close()
    });
    written.map_err(FormatError::encode(file))?;
    Ok(bytes)
}
