//! Motions of a hand that are to grasp an object.

use std::{path::PathBuf, sync::Arc};

use dataflow::Digest;
use motion::{HandRates, Motion, Step};
use pyo3::{
    prelude::*,
    types::{PyAny, PySlice},
};
use schemas::{
    Table as _,
    candidates::{Candidate, DrawSource, Origin},
};
use spatial::{Pose, Table};

use crate::{
    arrays::{self, Array, Rows, array, vector},
    error::{self, failed, wrong},
    hand::Hand,
    object::Object,
};

/// Generator name of motions that the caller made.
const GENERATOR: &str = "given";

/// Motions of a hand that are to grasp an object, each in the object's frame; the last step of a motion is its grasp.
///
/// Made of arrays: `times` `(steps,)` in seconds, increasing from 0, two at least; `palm` `(n, steps, 4, 4)`, poses of the
/// hand's root link in the object's frame; `q` `(n, steps, dof)`, joint positions in the order of `joint_names`, in
/// radians (meters if prismatic); of one motion the axis of `n` may be left out. `table_from_object` `(4, 4)` or
/// `(n, 4, 4)` are poses of the object as it stands on the table, whose top is at z = 0; the first of
/// `object.resting_poses` if it is None. Velocities and accelerations follow by differences.
///
/// Physics takes the path of a motion, and the time of its reach from the protocol (`reach_s` of the stage `screen`): a
/// motion that is faster or slower on the same path has the same verdict.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Candidates {
    pub(crate) motions: schemas::candidates::Candidates,
    /// Of the object for which they were made in this process; unknown of those from a lake.
    object: Option<Digest>,
}

#[pymethods]
impl Candidates {
    /// Takes motions to an object.
    #[new]
    #[pyo3(signature = (object, joint_names, times, palm, q, *, table_from_object=None))]
    fn new(
        py: Python<'_>,
        object: &Object,
        joint_names: Vec<String>,
        times: &Bound<'_, PyAny>,
        palm: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        table_from_object: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let times = Rows::read("times", times, &[])?;
        let steps = times.len();
        if !times.is_batch || steps < 2 || times.row(0)[0] != 0.0 {
            return Err(wrong(
                "`times` are no steps of a motion".to_owned(),
                "pass an array (steps,) of two times or more, increasing from 0",
            ));
        }
        let palm = Rows::read("palm", palm, &[steps, 4, 4])?;
        let q = Rows::read("q", q, &[steps, joint_names.len()])?;
        palm.check_as_many("palm", &q, "q")?;
        let placed = placed(object, palm.len(), table_from_object)?;
        let joints: Arc<[String]> = joint_names.into();
        let motion = |(number, placed): (usize, Pose<Table, spatial::Object>)| {
            let step = |step: usize| {
                let matrix = &palm.row(number)[16 * step..][..16];
                let dof = joints.len();
                Ok(Step {
                    time_s: times.row(step)[0],
                    frame_from_palm: arrays::pose("palm", matrix)?,
                    q_rad: q.row(number)[dof * step..][..dof].to_vec(),
                    rates: (),
                })
            };
            let steps = (0..steps).map(step).collect::<PyResult<Vec<_>>>()?;
            let motion = Motion::of_joints(Arc::clone(&joints), steps);
            let motion = motion.and_then(|motion| motion.differentiated());
            let motion = motion.map_err(|err| {
                let hint = "pass times that increase, and numbers of the size of a hand";
                failed(&err, Some(hint.to_owned()))
            })?;
            Ok(given(
                &object.stored.name,
                number,
                placed,
                Vec::new(),
                motion,
            ))
        };
        let numbered = placed.into_iter().enumerate();
        let candidates = py.detach(|| numbered.map(motion).collect::<PyResult<_>>())?;
        let motions = schemas::candidates::Candidates {
            object: object.stored.name.clone(),
            candidates,
            joints: Arc::clone(&joints),
        };
        Ok(Self::from(motions).of(object))
    }

    /// Name of the object.
    #[getter]
    fn object(&self) -> &str {
        &self.motions.object
    }

    /// The names of the joints, in the order of `q`.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.motions.joints.to_vec()
    }

    /// The names of the motions.
    #[getter]
    fn names(&self) -> Vec<&str> {
        let all = self.motions.candidates.iter();
        all.map(|one| one.candidate_id.as_str()).collect()
    }

    /// Times of the steps `(n, steps)`, in seconds.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[], |step| vec![step.time_s])
    }

    /// Poses of the root link in the object's frame `(n, steps, 4, 4)`.
    #[getter]
    fn palm<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[4, 4], |step| {
            arrays::pose_matrix(&step.frame_from_palm).to_vec()
        })
    }

    /// Joint positions `(n, steps, dof)`, in radians (meters if prismatic).
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.joints(py, |step| &step.q_rad)
    }

    /// Joint velocities `(n, steps, dof)`, in rad/s (m/s).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.joints(py, |step| &step.rates.joints.velocity)
    }

    /// Joint accelerations `(n, steps, dof)`, in rad/s² (m/s²).
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.joints(py, |step| &step.rates.joints.acceleration)
    }

    /// Velocities of the root link `(n, steps, 6)`: linear in m/s, then angular in rad/s, along the object's axes.
    #[getter]
    fn palm_velocity<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[6], |step| six(&step.rates.palm_velocity))
    }

    /// Accelerations of the root link `(n, steps, 6)`: linear in m/s², then angular in rad/s², along the object's axes.
    #[getter]
    fn palm_acceleration<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[6], |step| six(&step.rates.palm_acceleration))
    }

    /// Poses of the object on the table `(n, 4, 4)`.
    #[getter]
    fn table_from_object<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        arrays::poses(
            py,
            self.motions
                .candidates
                .iter()
                .map(|one| one.table_from_object),
        )
    }

    /// Latent codes `(n, latent)`; of no width for motions that were not drawn from a function.
    #[getter]
    fn codes<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let all = &self.motions.candidates;
        let width = all.first().map_or(0, |one| one.latent.len());
        let codes: Vec<f64> = all.iter().flat_map(|one| one.latent.clone()).collect();
        array(py, &codes, Some(all.len()), &[width])
    }

    /// Residuals of the refinement `(n,)`, in square meters: the smaller, the better; nan of a motion that was not
    /// refined.
    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let residuals = self.motions.candidates.iter().map(|one| one.residual_m2);
        let residuals = residuals.map(|known| known.unwrap_or(f64::NAN));
        vector(py, &residuals.collect::<Vec<_>>())
    }

    /// Writes one motion as an animated scene, a binary glTF file: the hand, the object and the table.
    #[pyo3(signature = (path, hand, object, number=0))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn export_glb(
        &self,
        py: Python<'_>,
        path: PathBuf,
        hand: &Hand,
        object: &Object,
        number: isize,
    ) -> PyResult<()> {
        self.check_object(object)?;
        let candidate = &self.motions.candidates[self.place(number)?];
        py.detach(|| {
            let model = &hand.loaded.model;
            let shown =
                stage_report::of_candidate(candidate, &self.motions.joints, &object.stored, model);
            let bytes = shown.and_then(|shown| shown.to_glb(&candidate.candidate_id, usize::MAX));
            let bytes = bytes.map_err(|err| failed(&err, dataflow::Diagnostic::hint(&err)))?;
            error::write(&path, &bytes)
        })
    }

    fn __len__(&self) -> usize {
        self.motions.candidates.len()
    }

    /// One motion, by its number, or some, by a slice, a sequence of numbers, or a mask `(n,)` of truths.
    fn __getitem__(&self, which: &Bound<'_, PyAny>) -> PyResult<Self> {
        let n = self.motions.candidates.len();
        let chosen: Vec<isize> = if let Ok(slice) = which.cast::<PySlice>() {
            let range = slice.indices(n.cast_signed())?;
            let number = |place: usize| range.start + place.cast_signed() * range.step;
            (0..range.slicelength).map(number).collect()
        } else {
            numbers(which, n)?
        };
        let places = chosen.into_iter().map(|number| self.place(number));
        let chosen = places.map(|place| Ok(self.motions.candidates[place?].clone()));
        Ok(Self {
            motions: schemas::candidates::Candidates {
                object: self.motions.object.clone(),
                joints: Arc::clone(&self.motions.joints),
                candidates: chosen.collect::<PyResult<_>>()?,
            },
            object: self.object,
        })
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Candidates, {} motions to {:?}>",
            self.motions.candidates.len(),
            self.motions.object
        )
    }
}

impl From<schemas::candidates::Candidates> for Candidates {
    fn from(motions: schemas::candidates::Candidates) -> Self {
        Self {
            motions,
            object: None,
        }
    }
}

impl Candidates {
    /// Notes that they were made for this object.
    pub(crate) fn of(self, object: &Object) -> Self {
        Self {
            object: Some(object.digest),
            ..self
        }
    }

    /// Takes what a stage made, as its readers find it in a lake: stored rotations differ in their last bits.
    pub(crate) fn stored(made: schemas::candidates::Candidates) -> PyResult<Self> {
        if made.candidates.is_empty() {
            return Ok(made.into());
        }
        let batch = made.to_batch();
        let read = batch
            .and_then(|batch| schemas::candidates::Candidates::from_batch(&made.object, &batch));
        read.map(Self::from).map_err(|err| failed(&err, None))
    }

    /// Returns the place of the motion of a number; negative ones count from the end.
    fn place(&self, number: isize) -> PyResult<usize> {
        let n = self.motions.candidates.len();
        let place = match usize::try_from(number) {
            Ok(place) => Some(place),
            Err(_) => n.checked_sub(number.unsigned_abs()),
        };
        place.filter(|&place| place < n).ok_or_else(|| {
            pyo3::exceptions::PyIndexError::new_err(format!("there is no motion {number} of {n}"))
        })
    }

    /// Checks that they grasp this object.
    pub(crate) fn check_object(&self, object: &Object) -> PyResult<()> {
        if self.motions.object == object.stored.name {
            if self.object.is_none_or(|made_for| made_for == object.digest) {
                return Ok(());
            }
            return Err(wrong(
                format!(
                    "the motions are to another `{}`: its mesh or mass differs",
                    self.motions.object
                ),
                "pass the object for which they were made, and give objects names of their own",
            ));
        }
        Err(wrong(
            format!(
                "the motions are to `{}`, and the object is `{}`",
                self.motions.object, object.stored.name
            ),
            "pass the object for which they were made",
        ))
    }

    /// Makes an array of a number for each joint at each step.
    fn joints<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Step<spatial::Object>) -> &Vec<f64>,
    ) -> PyResult<Array<'py>> {
        self.steps(py, &[self.motions.joints.len()], |step| of(step).clone())
    }

    /// Makes an array of what each step of each motion has.
    fn steps<'py>(
        &self,
        py: Python<'py>,
        row: &[usize],
        of: impl Fn(&Step<spatial::Object>) -> Vec<f64>,
    ) -> PyResult<Array<'py>> {
        let all = &self.motions.candidates;
        let steps = all.first().map_or(0, |one| one.motion.steps().len());
        if all.iter().any(|one| one.motion.steps().len() != steps) {
            return Err(wrong(
                "the motions have different numbers of steps, and make no array".to_owned(),
                "take one at a time, e.g. `candidates[0]`",
            ));
        }
        let every = all.iter().flat_map(|one| one.motion.steps());
        let numbers: Vec<f64> = every.flat_map(of).collect();
        let row: Vec<usize> = [steps].iter().chain(row).copied().collect();
        array(py, &numbers, Some(all.len()), &row)
    }
}

/// Reads numbers of motions: one, several, or a mask over all `n`.
fn numbers(which: &Bound<'_, PyAny>, n: usize) -> PyResult<Vec<isize>> {
    let remedy =
        "pass a number, a slice, a list of numbers, or a mask with a truth for each motion";
    let array = which.py().import("numpy")?;
    let array = array.call_method1("asarray", (which,)).map_err(|err| {
        wrong(
            format!("motions are not chosen so: {}", err.value(which.py())),
            remedy,
        )
    })?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    match (kind.as_str(), shape.as_slice()) {
        ("b", [length]) if *length == n => {
            let mask: Vec<bool> = array.call_method0("tolist")?.extract()?;
            let chosen = mask.iter().enumerate().filter(|(_, is_chosen)| **is_chosen);
            Ok(chosen.map(|(place, _)| place.cast_signed()).collect())
        }
        ("i" | "u", []) => Ok(vec![which.extract()?]),
        ("i" | "u", [_]) => array.call_method0("tolist")?.extract(),
        // An empty list has no kind of its own.
        (_, [0]) => Ok(Vec::new()),
        _ => Err(wrong(
            format!(
                "{n} motions are not chosen by an array {shape:?} of `{}`",
                array.getattr("dtype")?
            ),
            remedy,
        )),
    }
}

/// Returns a motion to an object that the caller made.
pub(crate) fn given(
    object: &str,
    number: usize,
    table_from_object: Pose<Table, spatial::Object>,
    latent: Vec<f64>,
    motion: Motion<spatial::Object, HandRates<spatial::Object>>,
) -> Candidate {
    Candidate {
        candidate_id: format!("{object}-{number:05}"),
        generator: GENERATOR.to_owned(),
        source: DrawSource {
            draw_n: 1,
            origin: Origin::Grasp,
            demonstration: String::new(),
            object_split: None,
        },
        latent,
        table_from_object,
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion,
    }
}

/// Reads the poses of the object for `n` motions.
fn placed(
    object: &Object,
    n: usize,
    given: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<Pose<Table, spatial::Object>>> {
    let name = "table_from_object";
    let Some(given) = given else {
        return Ok(vec![object.placed(None)?; n]);
    };
    let rows = Rows::read(name, given, &[4, 4])?;
    if !rows.is_batch {
        return Ok(vec![object.standing(name, rows.row(0))?; n]);
    }
    if rows.len() != n {
        return Err(wrong(
            format!("`{name}` has {} poses for {n} motions", rows.len()),
            "pass one pose for each motion, or one for all",
        ));
    }
    (0..n)
        .map(|idx| object.standing(name, rows.row(idx)))
        .collect()
}

fn six(twist: &spatial::Twist<spatial::Object>) -> Vec<f64> {
    let parts = twist.linear.iter().chain(twist.angular.iter());
    parts.copied().collect()
}
