//! What physics says of motions.

use std::{collections::BTreeMap, path::PathBuf};

use dataflow::Diagnostic;
use pyo3::prelude::*;
use robot::RobotModel;
use schemas::rollouts::{Rollout as Row, Verdict};
use simulation::TraceStep;
use stage_report::{Contact, Moment, ObjectMesh, RecordedMotion};

use crate::{
    arrays::{self, Array, array, vector, vectors},
    error::{self, failed},
};

/// Verdicts on motions, and what was measured of each.
///
/// Arrays have one number for each motion; nan is what was not measured, because the motion ended before.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Rollouts(pub(crate) Vec<Row>);

#[pymethods]
impl Rollouts {
    /// The names of the motions.
    #[getter]
    fn names(&self) -> Vec<&str> {
        self.0.iter().map(|row| row.candidate_id.as_str()).collect()
    }

    /// Whether each motion succeeds `(n,)`: the object is lifted, held to the end and still in contact.
    #[getter]
    fn success<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let held = |row: &Row| Some(f64::from(u8::from(row.verdict == Verdict::Held)));
        self.numbers(py, held)?.call_method1("astype", ("bool",))
    }

    /// The verdict on each motion: "held", or why it failed, as in the column `reason` of `rollouts`.
    #[getter]
    fn reasons(&self) -> Vec<&'static str> {
        self.0.iter().map(|row| row.verdict.as_str()).collect()
    }

    /// Rise of the object's origin at the end `(n,)`, in meters.
    #[getter]
    fn lift<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.lift_m)
    }

    /// Motion of the object in the palm's frame between lift and end `(n,)`, in meters.
    #[getter]
    fn slip<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.slip_m)
    }

    /// Motion of the object on the table before the squeeze `(n,)`, in meters.
    #[getter]
    fn displacement<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.displacement_m)
    }

    /// Deepest that the hand was in the object while it was held `(n,)`, in meters.
    #[getter]
    fn penetration<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.penetration_m)
    }

    /// Deepest that fingers were in each other or in the palm `(n,)`, in meters.
    #[getter]
    fn finger_penetration<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.finger_penetration_m)
    }

    /// Number of the hand's links in contact with the object at the end `(n,)`.
    #[getter]
    fn contacts<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.numbers(py, |row| row.measures.contacts_n.map(f64::from))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        let held = self.0.iter().filter(|row| row.verdict == Verdict::Held);
        format!(
            "<pipeline.Rollouts, {} of {} motions succeed>",
            held.count(),
            self.0.len()
        )
    }
}

impl Rollouts {
    /// Makes an array of a number for each motion.
    fn numbers<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Row) -> Option<f64>,
    ) -> PyResult<Array<'py>> {
        let numbers = self.0.iter().map(|row| of(row).unwrap_or(f64::NAN));
        vector(py, &numbers.collect::<Vec<_>>())
    }
}

/// A motion as physics executed it: arrays over its control steps, of which there are none if it was refused before
/// anything moved. Poses are in the table's frame.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Rollout {
    pub(crate) name: String,
    pub(crate) verdict: Verdict,
    pub(crate) steps: Vec<TraceStep>,
    pub(crate) hand: RobotModel,
    pub(crate) object: schemas::objects::Object,
}

#[pymethods]
impl Rollout {
    /// The verdict: "held", or why the motion failed.
    #[getter]
    fn reason(&self) -> &'static str {
        self.verdict.as_str()
    }

    /// Times of the steps `(n,)`, in seconds.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let times = self.steps.iter().map(|step| step.time_s);
        vector(py, &times.collect::<Vec<_>>())
    }

    /// Joint positions `(n, dof)`, in radians (meters if prismatic).
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.joints(py, |step| &step.q)
    }

    /// Commanded joint positions `(n, dof)`, in radians (meters if prismatic).
    #[getter]
    fn q_command<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.joints(py, |step| &step.q_command)
    }

    /// Poses of the hand's root link `(n, 4, 4)`.
    #[getter]
    fn palm<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        arrays::poses(py, self.steps.iter().map(|step| step.table_from_palm))
    }

    /// Poses of the object `(n, 4, 4)`.
    #[getter]
    fn object<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        arrays::poses(py, self.steps.iter().map(|step| step.table_from_object))
    }

    /// Contacts of the hand with the object at a step: the names of the links, the points `(m, 3)` in meters, and the
    /// forces on the object `(m, 3)` in newtons.
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        step: i64,
    ) -> PyResult<(Vec<String>, Array<'py>, Array<'py>)> {
        let n = self.steps.len();
        let step = self
            .steps
            .get(arrays::count("step", step)?)
            .ok_or_else(|| {
                pyo3::exceptions::PyIndexError::new_err(format!("there is no step {step} of {n}"))
            })?;
        let links = self.hand.links();
        let names = step.contacts.iter().filter_map(|one| links.get(one.link));
        let points: Vec<[f64; 3]> = step
            .contacts
            .iter()
            .map(|one| one.point_in_table_m.into())
            .collect();
        let forces: Vec<[f64; 3]> = step
            .contacts
            .iter()
            .map(|one| one.force_in_table_n.into())
            .collect();
        Ok((
            names.map(|link| link.name.clone()).collect(),
            vectors(py, &points)?,
            vectors(py, &forces)?,
        ))
    }

    /// Writes the motion as an animated scene, a binary glTF file: the hand, a ghost of its commands, the object, the
    /// table and the contacts.
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn export_glb(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| {
            let about = [
                ("candidate_id", self.name.as_str()),
                ("reason", self.reason()),
            ];
            let about = about.map(|(key, value)| (key.to_owned(), value.to_owned()));
            let shown = RecordedMotion {
                robot: self.hand.clone(),
                object: ObjectMesh {
                    vertices_m: self.object.vertices_m.clone(),
                    triangles: self.object.triangles.clone(),
                },
                moments: self.steps.iter().map(moment).collect(),
                about: BTreeMap::from(about),
            };
            let bytes = shown.to_glb(&self.name, usize::MAX);
            let bytes = bytes.map_err(|err| failed(&err, err.hint()))?;
            error::write(&path, &bytes)
        })
    }

    fn __len__(&self) -> usize {
        self.steps.len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Rollout of {:?}, {} steps, {}>",
            self.name,
            self.steps.len(),
            self.reason()
        )
    }
}

impl Rollout {
    /// Makes an array of a number for each joint at each step.
    fn joints<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&TraceStep) -> &Vec<f64>,
    ) -> PyResult<Array<'py>> {
        let numbers: Vec<f64> = self
            .steps
            .iter()
            .flat_map(|step| of(step).clone())
            .collect();
        array(py, &numbers, Some(self.steps.len()), &[self.hand.dof()])
    }
}

/// Returns a step as it is shown.
fn moment(step: &TraceStep) -> Moment {
    let contacts = step.contacts.iter().map(|contact| Contact {
        point_in_table_m: contact.point_in_table_m.into(),
        force_n: contact.force_in_table_n.norm(),
    });
    Moment {
        time_s: step.time_s,
        table_from_root: step.table_from_palm.reinterpret(),
        q: step.q.clone(),
        q_command: Some(step.q_command.clone()),
        table_from_object: step.table_from_object,
        contacts: contacts.collect(),
    }
}
