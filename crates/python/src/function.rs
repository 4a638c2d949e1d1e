//! Continuous grasping functions.

use std::{path::PathBuf, sync::Arc};

use cgf::Cgf;
use dataflow::Diagnostic;
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use sampling::PlacedFunction;
use schemas::checkpoint;
use serde_json::{Value, json};
use stage_sample::{Drawing, SampleConfig};

use crate::{
    arrays::{Rows, count},
    candidates::{Candidates, given},
    error::{failed, wrong},
    hand::Hand,
    object::{Object, seed_of},
    options,
    threads::in_threads,
};

/// The stage whose motions [`Function::sample`] draws.
const SAMPLE: &str = "sample";

/// A continuous grasping function (Ye et al., Learning Continuous Grasping Function with a Dexterous Hand from Human
/// Demonstrations, 2023): a motion at any time, from a latent code and an object's shape.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Function(pub(crate) Cgf);

#[pymethods]
impl Function {
    /// Loads the checkpoint in a folder: `path` has `last.safetensors` and `last.json`, or the two of `epoch="best"`.
    #[staticmethod]
    #[pyo3(signature = (path, *, epoch="last"))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn load(path: PathBuf, epoch: &str) -> PyResult<Self> {
        let files = files(epoch)?;
        Self::read(&path.join(files.weights), &path.join(files.description))
    }

    /// The names of the hand's joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.0.description().joints.clone()
    }

    /// Width of a latent code.
    #[getter]
    fn latent(&self) -> usize {
        self.0.description().network.latent_dim
    }

    /// Names of the demonstrations it was trained on.
    #[getter]
    fn demonstrations(&self) -> Vec<&str> {
        let known = self.0.description().demonstrations.iter();
        let learned = known.filter(|one| one.is_learned());
        learned.map(|one| one.name.as_str()).collect()
    }

    /// Draws `n` motions to an object; without `n` as many as `options` say as `per_object`, or 64.
    ///
    /// They are those that a stage `sample` draws with the pipeline's `seed`, to the bit. `options` are that stage's, such
    /// as `steps`, `duration_s` and `spread`. `hand` is needed only for `draws` above 1, where a motion that is deep in
    /// object or table is drawn again.
    #[pyo3(signature = (object, n=None, *, seed=7, hand=None, options=None))]
    fn sample(
        &self,
        py: Python<'_>,
        object: &Object,
        n: Option<i64>,
        seed: u64,
        hand: Option<&Hand>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Candidates> {
        let file = hand.map(|hand| hand.path.clone()).unwrap_or_default();
        let n = n.map(|n| count("n", n)).transpose()?;
        let n = n.map(|n| ("per_object", json!(n)));
        let n: Vec<(&str, Value)> = n.into_iter().collect();
        let config: SampleConfig = options::read(SAMPLE, options, Some(&file), &n)?;
        if config.draws > 1 && hand.is_none() {
            return Err(wrong(
                format!("`draws` is {}, and there is no hand", config.draws),
                "pass `hand`, whose depth decides whether a motion is drawn again",
            ));
        }
        let field = match hand {
            Some(_) if config.draws > 1 => Some(Arc::clone(object.field(py)?)),
            _ => None,
        };
        let seed = seed_of(seed, SAMPLE, &object.stored.name)?;
        let drawn = in_threads(py, |cancellation| {
            let drawn = Drawing {
                config: &config,
                cgf: &self.0,
                object: &object.stored,
                shown: None,
                field: field.as_deref(),
                hand: hand.map(|hand| &hand.loaded.model),
                is_canceled: &|| cancellation.is_asked(),
            };
            let (candidates, _) = drawn.draw(seed).map_err(|err| failed(&err, err.hint()))?;
            Candidates::stored(candidates)
        })?;
        Ok(drawn?.of(object))
    }

    /// Decodes latent codes `(n, latent)` at `times` `(steps,)`, in seconds, increasing from 0 or later to the grasp at
    /// `duration`: motions to an object in its resting pose of number `rest`, with their exact first and second
    /// derivatives.
    #[pyo3(signature = (object, codes, times, *, duration=1.5, rest=0))]
    fn decode(
        &self,
        py: Python<'_>,
        object: &Object,
        codes: &Bound<'_, PyAny>,
        times: &Bound<'_, PyAny>,
        duration: f64,
        rest: i64,
    ) -> PyResult<Candidates> {
        let rest = count("rest", rest)?;
        let codes = Rows::read("codes", codes, &[self.latent()])?;
        let times = Rows::read("times", times, &[])?;
        let times_s: Vec<f64> = (0..times.len()).map(|idx| times.row(idx)[0]).collect();
        if !(duration.is_finite() && duration > 0.0) {
            return Err(wrong(
                format!("`duration` is {duration}"),
                "pass seconds above 0",
            ));
        }
        if let Some(time_s) = times_s
            .iter()
            .find(|time| !(0.0..=duration).contains(*time))
        {
            return Err(wrong(
                format!("`times` has {time_s} s, and the motion takes {duration} s"),
                "pass times from 0 to `duration`",
            ));
        }
        let rests = &object.stored.rests;
        let rest = rests.get(rest).ok_or_else(|| {
            wrong(
                format!("there is no resting pose {rest} of {}", rests.len()),
                "`object.resting_poses` has them",
            )
        })?;
        let latents: Vec<Vec<f64>> = (0..codes.len())
            .map(|idx| codes.row(idx).to_vec())
            .collect();
        let decoded = in_threads(py, |cancellation| {
            let sampled = stage_sample::sampled_object(&object.stored);
            let placed = PlacedFunction::new(&self.0, &sampled, rest.rest)?;
            let is_canceled = || cancellation.is_asked();
            placed.decode(&latents, &times_s, duration, &is_canceled)
        })?;
        let decoded = decoded.map_err(|err| {
            let hint = "pass times that increase, and codes of the size that samples have";
            failed(&err, Some(hint.to_owned()))
        })?;
        let placed = rest.rest.table_from_object();
        let motions = decoded.into_iter().zip(latents).enumerate();
        let motions = motions.map(|(number, (motion, code))| {
            given(&object.stored.name, number, placed, code, motion)
        });
        let motions = schemas::candidates::Candidates {
            object: object.stored.name.clone(),
            joints: self.joint_names().into(),
            candidates: motions.collect(),
        };
        Ok(Candidates::from(motions).of(object))
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Function, {} joints, latent {}, {} demonstrations>",
            self.joint_names().len(),
            self.latent(),
            self.demonstrations().len()
        )
    }
}

impl Function {
    /// Reads a checkpoint's two files.
    pub(crate) fn read(weights: &std::path::Path, description: &std::path::Path) -> PyResult<Self> {
        let loaded = Cgf::load(weights, description);
        loaded.map(Self).map_err(|err| {
            let hint = "pass the folder of a checkpoint, or take it from a lake: `Lake.function`";
            failed(&err, Some(hint.to_owned()))
        })
    }
}

/// Returns the names of a checkpoint's files.
pub(crate) fn files(epoch: &str) -> PyResult<checkpoint::Files> {
    match epoch {
        "last" => Ok(checkpoint::LAST),
        "best" => Ok(checkpoint::BEST),
        other => Err(wrong(
            format!("`epoch` is {other:?}"),
            "pass \"last\" or \"best\"",
        )),
    }
}
