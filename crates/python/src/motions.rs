//! Motions as arrays.

use pyo3::prelude::*;

use crate::arrays::{Array, array, pose_matrix, vector};

/// A retargeted motion: arrays over its steps.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Motion {
    motion: ::motion::Motion<spatial::Object>,
    /// Root mean square distance at each step, in meters.
    errors_m: Vec<f64>,
}

#[pymethods]
impl Motion {
    /// The names of the joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.motion.joints().to_vec()
    }

    /// Times of the steps `(n,)`, in seconds.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[], |step| vec![step.time_s])
    }

    /// Joint positions `(n, dof)`, in radians (meters if prismatic).
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[self.motion.joints().len()], |step| step.q_rad.clone())
    }

    /// Joint velocities `(n, dof)`, in rad/s (m/s).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let dof = self.motion.joints().len();
        self.steps(py, &[dof], |step| step.rates.joints.velocity.clone())
    }

    /// Poses of the root link in the frame of the landmarks `(n, 4, 4)`.
    #[getter]
    fn palm<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[4, 4], |step| {
            pose_matrix(&step.frame_from_palm).to_vec()
        })
    }

    /// Root mean square distances of the followed points from their scaled landmarks `(n,)`, in meters.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        vector(py, &self.errors_m)
    }

    fn __len__(&self) -> usize {
        self.motion.steps().len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Motion, {} steps of {} joints>",
            self.motion.steps().len(),
            self.motion.joints().len()
        )
    }
}

impl From<retargeting::Retargeted> for Motion {
    fn from(retargeted: retargeting::Retargeted) -> Self {
        let errors = retargeted.tracking.iter();
        Self {
            errors_m: errors
                .map(retargeting::Tracking::keypoint_error_m)
                .collect(),
            motion: retargeted.motion,
        }
    }
}

impl From<dex_retargeting::Sequence> for Motion {
    fn from(sequence: dex_retargeting::Sequence) -> Self {
        let mean = |errors: &Vec<f64>| {
            let squares: f64 = errors.iter().map(|error| error * error).sum();
            (squares / errors.len().max(1) as f64).sqrt()
        };
        Self {
            errors_m: sequence.errors_m.iter().map(mean).collect(),
            motion: sequence.motion,
        }
    }
}

impl Motion {
    /// Makes an array of what each step has.
    fn steps<'py>(
        &self,
        py: Python<'py>,
        row: &[usize],
        of: impl Fn(&motion::Step<spatial::Object>) -> Vec<f64>,
    ) -> PyResult<Array<'py>> {
        let steps = self.motion.steps();
        let numbers: Vec<f64> = steps.iter().flat_map(of).collect();
        array(py, &numbers, Some(steps.len()), row)
    }
}
