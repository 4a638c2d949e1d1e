//! The peer, `dex_retargeting`, in a Python process that is asked chunk by chunk.

use posture::{Posture, Target};
use serde_json::{Value, json};

use crate::{
    problem::{Problem, posture},
    python::{self, Script},
};

/// The running peer.
pub(crate) struct Peer {
    script: Script,
}

impl Peer {
    /// Starts the peer on a problem; an error says why it cannot be.
    pub(crate) fn start(problem: &Problem) -> Result<Self, String> {
        let script = "retargeting/dex_retargeting_frames.py";
        let mut script = Script::start(&python::name(), script, &[], 1)?;
        let about = json!({ "urdf": problem.urdf, "links": problem.links });
        let said: Value = serde_json::from_str(&script.ask(&about.to_string())?).unwrap();
        let names: Vec<&str> = said["joints"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        let ours: Vec<&str> = problem
            .joints
            .iter()
            .map(|&j| problem.model.joints()[j].name.as_str())
            .collect();
        if names.get(6..) == Some(&ours[..]) {
            return Ok(Self { script });
        }
        Err(format!(
            "the `dex_retargeting` of `{}` has other joints, {names:?}: \
             `pip install -r tests/benches/requirements.txt`",
            python::name().display()
        ))
    }

    /// Retargets frames after those asked before, and returns each frame's thread CPU time in
    /// microseconds and answer.
    pub(crate) fn retarget(
        &mut self,
        problem: &Problem,
        frames: &[Vec<Target>],
    ) -> Vec<(f64, Posture)> {
        let frames: Vec<Vec<[f64; 3]>> = frames
            .iter()
            .map(|frame| {
                frame
                    .iter()
                    .map(|target| target.point_in_object.coords.into())
                    .collect()
            })
            .collect();
        let said = self.script.ask_again(&json!(frames).to_string());
        let said: Value = serde_json::from_str(&said).unwrap();
        let numbers = |value: &Value| -> Vec<f64> {
            value
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(Value::as_f64)
                .collect()
        };
        let seconds = numbers(&said["seconds"]);
        let answers = said["coordinates"].as_array().unwrap();
        seconds
            .into_iter()
            .zip(answers)
            .map(|(s, answer)| (s * 1e6, posture(&numbers(answer), &problem.joints)))
            .collect()
    }
}
