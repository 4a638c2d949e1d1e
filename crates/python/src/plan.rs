//! Commands of a robot's controllers for motions.

use motion::{JointTrack, PalmTrajectory};
use planning::{Infeasible, PlannedMotion};
use pyo3::prelude::*;

use crate::{
    arrays::{self, Array, array, vector},
    error::wrong,
};

/// A motion as the commands of a robot's controllers, from rest to rest, or why the robot cannot execute it.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Plan(pub(crate) Result<PlannedMotion, Infeasible>);

#[pymethods]
impl Plan {
    /// Why the motion is infeasible, or None.
    #[getter]
    fn reason(&self) -> Option<String> {
        self.0.as_ref().err().map(ToString::to_string)
    }

    /// Pose of the object on the table `(4, 4)`; for an arm, where the arm grasps it.
    #[getter]
    fn table_from_object<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let pose = arrays::pose_matrix(&self.planned()?.table_from_object);
        array(py, &pose, None, &[4, 4])
    }

    /// The names of the fingers' joints.
    #[getter]
    fn finger_names(&self) -> PyResult<Vec<String>> {
        Ok(self.planned()?.fingers.joints.clone())
    }

    /// Times of the fingers' commands `(n,)`, in seconds.
    #[getter]
    fn finger_times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        times(py, &self.planned()?.fingers)
    }

    /// Positions of the fingers' joints `(n, dof)`, in radians (meters if prismatic).
    #[getter]
    fn finger_q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        positions(py, &self.planned()?.fingers)
    }

    /// The names of the arm's joints, from base to hand.
    #[getter]
    fn arm_names(&self) -> PyResult<Vec<String>> {
        Ok(self.arm()?.joints.clone())
    }

    /// Times of the arm's commands `(n,)`, in seconds.
    #[getter]
    fn arm_times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        times(py, self.arm()?)
    }

    /// Positions of the arm's joints `(n, dof)`, in radians.
    #[getter]
    fn arm_q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        positions(py, self.arm()?)
    }

    /// Times of the commands of a palm that no arm carries `(n,)`, in seconds.
    #[getter]
    fn palm_times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let times = self.palm()?.iter().map(|point| point.time_s);
        vector(py, &times.collect::<Vec<_>>())
    }

    /// Poses of a palm that no arm carries, in the table's frame `(n, 4, 4)`.
    #[getter]
    fn palm_poses<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let points = self.palm()?.iter();
        arrays::poses(py, points.map(|point| point.table_from_palm))
    }

    fn __repr__(&self) -> String {
        match &self.0 {
            Ok(planned) => format!("<pipeline.Plan, reach {:.2} s>", planned.grasp.reach_s),
            Err(reason) => format!("<pipeline.Plan, infeasible: {reason}>"),
        }
    }
}

impl Plan {
    fn planned(&self) -> PyResult<&PlannedMotion> {
        self.0.as_ref().map_err(|reason| {
            wrong(
                format!("the motion is infeasible: {reason}"),
                "look at `reason` first: it is None of a plan that can be executed",
            )
        })
    }

    fn arm(&self) -> PyResult<&JointTrack> {
        match &self.planned()?.carrier {
            PalmTrajectory::Arm(track) => Ok(track),
            PalmTrajectory::Palm(_) => Err(wrong(
                "no arm carries the hand".to_owned(),
                "give the options an `arm`, or take `palm_times` and `palm_poses`",
            )),
        }
    }

    fn palm(&self) -> PyResult<&[motion::PalmPoint]> {
        match &self.planned()?.carrier {
            PalmTrajectory::Palm(points) => Ok(points),
            PalmTrajectory::Arm(_) => Err(wrong(
                "an arm carries the hand".to_owned(),
                "take `arm_times` and `arm_q`",
            )),
        }
    }
}

fn times<'py>(py: Python<'py>, track: &JointTrack) -> PyResult<Array<'py>> {
    let times = track.points.iter().map(|point| point.time_s);
    vector(py, &times.collect::<Vec<_>>())
}

fn positions<'py>(py: Python<'py>, track: &JointTrack) -> PyResult<Array<'py>> {
    let points = &track.points;
    let numbers: Vec<f64> = points
        .iter()
        .flat_map(|point| point.q_rad.clone())
        .collect();
    array(py, &numbers, Some(points.len()), &[track.joints.len()])
}
