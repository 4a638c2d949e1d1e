//! Metadata of the dataset: `info.json`, `stats.json` and `README.md`.

use serde_json::{Map, Value, json};

use crate::lerobot::{Feature, Recorded, stats::Stats};

/// Version of the layout.
const VERSION: &str = "v3.0";

/// `meta/info.json`.
pub(super) fn info(
    recorded: &[Recorded<'_>],
    features: &[Feature],
    tasks_n: usize,
    fps: u32,
    robot_type: &str,
) -> String {
    let mut described = Map::new();
    for (name, names, _) in features {
        let feature = json!({
            "dtype": "float32", "shape": [names.len()], "names": names,
            "info": {"frame": "table", "units": names.iter().map(|name| unit(name)).collect::<Vec<_>>()},
        });
        described.insert((*name).to_owned(), feature);
    }
    let one = |dtype: &str| json!({"dtype": dtype, "shape": [1], "names": null});
    described.insert("timestamp".to_owned(), one("float32"));
    described.insert("next.done".to_owned(), one("bool"));
    for number in ["frame_index", "episode_index", "index", "task_index"] {
        described.insert(number.to_owned(), one("int64"));
    }
    let frames_n: usize = recorded.iter().map(|one| one.frames.len()).sum();
    pretty(&json!({
        "codebase_version": VERSION,
        "robot_type": robot_type,
        "total_episodes": recorded.len(),
        "total_frames": frames_n,
        "total_tasks": tasks_n,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": format!("0:{}", recorded.len())},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": null,
        "features": described,
    }))
}

/// The unit that ends a number's name; a quaternion's numbers have none.
fn unit(name: &str) -> &str {
    match name.rsplit_once('_') {
        Some((_, unit @ ("m" | "rad"))) => unit,
        _ => "1",
    }
}

/// `meta/stats.json`.
pub(super) fn stats(stats: &Stats) -> String {
    let mut all = Map::new();
    for feature in &stats.0 {
        let mut of_feature = Map::new();
        for (statistic, numbers) in feature.numbers() {
            of_feature.insert(statistic.to_owned(), json!(numbers));
        }
        of_feature.insert("count".to_owned(), json!([feature.frames_n]));
        all.insert(feature.name.to_owned(), Value::Object(of_feature));
    }
    pretty(&Value::Object(all))
}

fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}

/// `README.md`.
pub(super) fn readme(
    recorded: &[Recorded<'_>],
    fps: u32,
    robot_type: &str,
    lost: &[String],
) -> String {
    let n = recorded.len();
    let mut text = format!(
        "# Motions of {robot_type}\n\n\
         A LeRobot dataset, {VERSION}: {n} episodes at {fps} Hz, without images.\n\n\
         | feature | meaning |\n| --- | --- |\n\
         | `observation.state` | pose of the palm, then joint positions |\n\
         | `observation.environment_state` | pose of the object |\n\
         | `action` | pose of the palm in the next frame, then the joint positions commanded now or, where none were recorded, those of the next frame |\n\
         | `next.done` | whether it is the last frame |\n\n\
         Poses are in the table's frame: z up, z = 0 the surface; meters, then a quaternion `x y z w` with w ≥ 0.\n\
         The names of the numbers end in their units, m or rad.\n\
         An episode's `name`, `object` and `outcome` (empty if it was not executed) are columns of `meta/episodes`.\n\
         The last frame of an episode is at or after the motion's end, and has its last moment.\n\n\
         Not in it:\n\n"
    );
    for fact in lost {
        text += &format!("- {fact}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_end_names() {
        let names = ["palm_x_m", "palm_qw", "joint_0.0_rad", "slide_m"];
        assert_eq!(names.map(unit), ["m", "1", "rad", "m"]);
    }
}
