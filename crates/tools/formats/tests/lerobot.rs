//! A dataset is read back with the poses, joints, times, names and units that were exported: by Parquet alone,
//! and by `lerobot`'s own loader, where `PIPELINE_PYTHON` names a Python that has it.

mod motions;

use std::fs::File;

use arrow_array::{
    Array, BooleanArray, FixedSizeListArray, Float32Array, Int64Array, ListArray, RecordBatch,
    StringArray, cast::AsArray, types::Float32Type,
};
use formats::{EpisodeStep, Export, to_lerobot};
use motions::{ask, assert_near, episodes, joints, python, write};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

const FPS: u32 = 40;
const DATA: &str = "data/chunk-000/file-000.parquet";
const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";

/// The frames' steps: those of each motion at each 40th of a second, to the first at or after its end.
fn expected() -> Vec<Vec<EpisodeStep>> {
    let frames = |episode: &formats::Episode| {
        let n = (episode.duration_s() * f64::from(FPS)).ceil();
        let mut times = (0_u32..).map(f64::from).take_while(|&frame| frame <= n);
        times
            .by_ref()
            .map(|frame| episode.at(frame / f64::from(FPS)))
            .collect()
    };
    episodes().iter().map(frames).collect()
}

fn export() -> Export {
    to_lerobot(&episodes(), FPS, "allegro_right").unwrap()
}

/// The row groups of a file, which is written to a folder of this name.
fn batches(export: &Export, file: &str, folder: &str) -> Vec<RecordBatch> {
    let file = File::open(write(export, folder).join(file)).unwrap();
    let reader = ParquetRecordBatchReaderBuilder::try_new(file).unwrap();
    reader.build().unwrap().map(Result::unwrap).collect()
}

fn bytes(export: &Export, file: &str) -> Vec<u8> {
    export.files[file].clone()
}

fn column<'a, A: Array + 'static>(batch: &'a RecordBatch, name: &str) -> &'a A {
    batch
        .column_by_name(name)
        .unwrap()
        .as_any()
        .downcast_ref()
        .unwrap()
}

fn state(step: &EpisodeStep) -> Vec<f64> {
    [step.table_from_palm.to_array().to_vec(), step.q.clone()].concat()
}

/// The action of a frame: the next one's palm, the command of this one or the next one's joints.
fn action(steps: &[EpisodeStep], idx: usize) -> Vec<f64> {
    let next = steps.get(idx + 1).unwrap_or(&steps[idx]);
    let joints = steps[idx].q_command.as_ref().unwrap_or(&next.q);
    [next.table_from_palm.to_array().to_vec(), joints.clone()].concat()
}

#[test]
fn parquet_has_the_frames_that_were_exported() {
    let export = export();
    let data = batches(&export, DATA, "frames");
    let data = arrow_select::concat::concat_batches(&data[0].schema(), &data).unwrap();
    let numbers = |name: &str, row: usize| {
        let row = column::<FixedSizeListArray>(&data, name).value(row);
        let row: &Float32Array = row.as_primitive::<Float32Type>();
        serde_json::json!(row.values().iter().copied().collect::<Vec<f32>>())
    };
    let mut row = 0;
    for (episode, steps) in expected().iter().enumerate() {
        for (frame, step) in steps.iter().enumerate() {
            assert_near(&numbers("observation.state", row), state(step));
            let object = step.table_from_object.to_array();
            assert_near(&numbers("observation.environment_state", row), object);
            assert_near(&numbers("action", row), action(steps, frame));
            let time_s = f64::from(column::<Float32Array>(&data, "timestamp").value(row));
            assert!((time_s - step.time_s).abs() < 1e-6);
            let number =
                |name| usize::try_from(column::<Int64Array>(&data, name).value(row)).unwrap();
            assert_eq!(number("frame_index"), frame);
            assert_eq!((number("episode_index"), number("index")), (episode, row));
            assert_eq!(number("task_index"), usize::from(episode == 2));
            let done = column::<BooleanArray>(&data, "next.done").value(row);
            assert_eq!(done, frame + 1 == steps.len());
            row += 1;
        }
    }
    assert_eq!(data.num_rows(), row);
}

#[test]
fn metadata_says_where_frames_are_and_what_numbers_mean() {
    let export = export();
    let lengths: Vec<i64> = expected()
        .iter()
        .map(|steps| i64::try_from(steps.len()).unwrap())
        .collect();
    let about = &batches(&export, EPISODES, "episodes")[0];
    let number = |name| column::<Int64Array>(about, name).values().to_vec();
    assert_eq!(number("length"), lengths);
    assert_eq!(
        number("dataset_from_index"),
        [0, lengths[0], lengths[0] + lengths[1]]
    );
    assert_eq!(number("dataset_to_index")[2], lengths.iter().sum::<i64>());
    let text = |name, row| column::<StringArray>(about, name).value(row).to_owned();
    assert_eq!(
        (text("name", 1), text("outcome", 0)),
        ("025_mug-00001".to_owned(), "slipped".to_owned())
    );
    let tasks = column::<ListArray>(about, "tasks").value(2);
    assert_eq!(tasks.as_string::<i32>().value(0), "grasp 004_sugar_box");

    let info: Value = serde_json::from_slice(&bytes(&export, "meta/info.json")).unwrap();
    assert_eq!(
        (&info["fps"], &info["total_episodes"]),
        (&FPS.into(), &3.into())
    );
    let state = &info["features"]["observation.state"];
    let names: Vec<String> = serde_json::from_value(state["names"].clone()).unwrap();
    let joints = joints()
        .into_iter()
        .map(|joint| format!("{}_rad", joint.name));
    assert_eq!(names[..4], ["palm_x_m", "palm_y_m", "palm_z_m", "palm_qx"]);
    assert_eq!(names[7..], joints.collect::<Vec<_>>());
    assert_eq!(state["info"]["units"][2], "m");
    assert_eq!(state["info"]["units"][7], "rad");

    let statistics: Value = serde_json::from_slice(&bytes(&export, "meta/stats.json")).unwrap();
    assert_eq!(
        statistics["action"]["count"][0],
        lengths.iter().sum::<i64>()
    );
    let lowest = expected()
        .iter()
        .flatten()
        .map(|step| step.q[0])
        .fold(9.0, f64::min);
    let found = statistics["observation.state"]["min"][7].as_f64().unwrap();
    assert!((found - lowest).abs() < 1e-6);
}

#[test]
fn equal_motions_give_equal_bytes() {
    assert_eq!(export(), export());
}

#[test]
fn lerobot_loads_what_was_exported() {
    let Some(python) = python(&["lerobot.datasets.lerobot_dataset"]) else {
        return;
    };
    let folder = write(&export(), "lerobot");
    let loaded = ask(&python, "load_lerobot.py", &[&folder]);
    let expected = expected();
    let frames = loaded["frames"].as_array().unwrap();
    assert_eq!(frames.len(), expected.iter().map(Vec::len).sum::<usize>());
    assert_eq!(
        (&loaded["fps"], &loaded["episodes"]),
        (&FPS.into(), &3.into())
    );
    let mut frames = frames.iter();
    for (episode, steps) in expected.iter().enumerate() {
        for (frame, (step, loaded)) in steps.iter().zip(frames.by_ref()).enumerate() {
            assert_near(&loaded["observation.state"], state(step));
            assert_near(&loaded["action"], action(steps, frame));
            assert_near(
                &loaded["observation.environment_state"],
                step.table_from_object.to_array(),
            );
            let time_s = loaded["timestamp"].as_f64().unwrap();
            assert!((time_s - step.time_s).abs() < 1e-6);
            assert_eq!(loaded["episode_index"], episode);
            let task = if episode == 2 {
                "grasp 004_sugar_box"
            } else {
                "grasp 025_mug"
            };
            assert_eq!(loaded["task"], task);
        }
    }
    let features = &loaded["features"]["observation.state"];
    assert_eq!(features["names"][7], format!("{}_rad", joints()[0].name));
    assert_eq!(features["info"]["units"][0], "m");
    // A window over the end of an episode is padded, not taken from the next one.
    assert_eq!(
        loaded["window_is_pad"],
        serde_json::json!([false, false, true])
    );
}
