//! A recording in one call from Python, beside the same call in Rust.

use std::{fs, time::Instant};

use dex_retargeting::{Config, Problem, Showing};
use retargeting::LandmarkStep;
use serde_json::json;

use crate::{
    limits::Limits,
    problem::{folder, landmarks, landmarks_file},
    python::{self, Script},
};

/// A configuration as dex-retargeting has them, of its objective `position`.
const CONFIG: &str = "retargeting:
  type: position
  urdf_path: allegro_hand_right.urdf
  target_link_names: [link_15.0_tip, link_3.0_tip, link_7.0_tip, link_11.0_tip, link_14.0, link_2.0, link_6.0, link_10.0]
  target_link_human_indices: [4, 8, 12, 16, 2, 6, 10, 14]
  add_dummy_free_joint: true
  low_pass_alpha: 1
";
/// Times that each side retargets the recording, in turn.
const TURNS: usize = 30;
/// How many times as long Python may take.
const MOST: f64 = 1.3;

/// Times both sides; an error says what is missing.
pub(crate) fn race(limits: &mut Limits) -> Result<(), String> {
    let recording = landmarks_file()?;
    let frames = landmarks(&recording)?;
    let urdfs = folder("PIPELINE_REAL_DATA")?.join("urdf");
    let folder = tempfile::tempdir().map_err(|err| err.to_string())?;
    let file = folder.path().join("allegro.yml");
    fs::write(&file, CONFIG).map_err(|err| err.to_string())?;
    let config: Config = CONFIG.parse().map_err(|err| format!("{err}"))?;
    let urdf = fs::read_to_string(urdfs.join(&config.urdf_path)).map_err(|err| err.to_string())?;
    let problem = Problem::new(&config, &urdf).map_err(|err| err.to_string())?;
    let steps = frames.iter().enumerate();
    let steps: Vec<LandmarkStep> = steps
        .map(|(idx, keypoints_m)| LandmarkStep {
            time_s: idx as f64 / 30.0,
            keypoints_m: *keypoints_m,
        })
        .collect();
    let mut script = Script::start(&python::name(), "retargeting/batch.py", &[], 1)?;
    let about = json!({ "hand": file, "urdfs": urdfs, "landmarks": recording });
    script.ask(&about.to_string())?;
    let [mut ours, mut pythons] = [f64::INFINITY; 2];
    for _ in 0..TURNS {
        let started = Instant::now();
        let found = dex_retargeting::retarget(&problem, &steps, Showing::AsTheyAre);
        ours = ours.min(started.elapsed().as_secs_f64());
        found.map_err(|err| err.to_string())?;
        let took = script.ask_again("again");
        let took: f64 = took
            .parse()
            .map_err(|err| format!("the script said `{took}`: {err}"))?;
        pythons = pythons.min(took);
    }
    let us = |seconds: f64| 1e6 * seconds / steps.len() as f64;
    println!(
        "\na recording in one call, us a frame: {:.2} in Rust, {:.2} from Python",
        us(ours),
        us(pythons)
    );
    limits.keep("a call from Python over Rust", pythons / ours, ..=MOST);
    Ok(())
}
