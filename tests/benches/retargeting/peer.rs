//! The peer, `dex_retargeting`, in a Python process that is asked chunk by chunk.

use std::{
    io::{BufRead, BufReader, Write},
    process::{Child, ChildStdin, ChildStdout, Stdio},
};

use serde_json::{Value, json};
use stage_retarget::solver::{Posture, Target};

use crate::{
    problem::{Problem, posture},
    python,
};

/// The running peer.
pub(crate) struct Peer {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Peer {
    /// Starts the peer on a problem; an error says why it cannot be.
    pub(crate) fn start(problem: &Problem) -> Result<Self, String> {
        let script = "retargeting/dex_retargeting_frames.py";
        let mut process = python::start(script, &[], 1, Stdio::null())?;
        let mut peer = Self {
            input: process.stdin.take().unwrap(),
            output: BufReader::new(process.stdout.take().unwrap()),
            process,
        };
        peer.say(&json!({ "urdf": problem.urdf, "links": problem.links }));
        let said = peer.answer();
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
            return Ok(peer);
        }
        Err(format!(
            "`{}` has no `dex_retargeting`, or one with other joints",
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
            .map(|frame| frame.iter().map(|target| target.at.coords.into()).collect())
            .collect();
        self.say(&json!(frames));
        let said = self.answer();
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

    fn say(&mut self, value: &Value) {
        // It fails where the process has ended; the answer is then missing.
        let _ = writeln!(self.input, "{value}");
        let _ = self.input.flush();
    }

    fn answer(&mut self) -> Value {
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or(Value::Null)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
