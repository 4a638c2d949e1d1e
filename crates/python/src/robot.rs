//! Robots: kinematics and dynamics over batches.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use pyo3::{prelude::*, types::PyAny};
use rayon::prelude::*;
use robot::{Chain, DynamicsModel, FreeRootState, JointMotion, RobotModel, WrongDof};
use spatial::{Base, Palm, Pose};

use crate::{
    arrays::{self, Array, Rows, array, pose_matrix, reserved, vector},
    error::{failed, wrong},
    threads::in_threads,
};

/// Rows below which a batch is computed by the thread that calls.
const SMALL_BATCH: usize = 64;
const URDF: &str =
    "pass the path of a URDF; convert xacro with `xacro hand.urdf.xacro > hand.urdf`";

/// A robot read from its URDF: kinematics and dynamics, of one posture or of a batch.
///
/// Joint positions `q` are an array `(dof,)` or `(n, dof)` in the order of `joint_names`, in radians (meters if
/// prismatic); a batch gives a result with an axis of `n` first. Joints that mimic others move with them and have no
/// position. Frames are those of links; the root is the link that no joint moves. Limits are not checked.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Robot {
    model: RobotModel,
    dynamics: DynamicsModel,
}

#[pymethods]
impl Robot {
    /// Reads the URDF at a path; meshes are not opened.
    #[new]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn new(urdf: PathBuf) -> PyResult<Self> {
        let bytes = std::fs::read(&urdf).map_err(|err| {
            wrong(
                format!("cannot read the URDF `{}`: {err}", urdf.display()),
                URDF,
            )
        })?;
        Self::of(&bytes)
    }

    /// Reads a robot from the text of its URDF.
    #[staticmethod]
    fn from_text(urdf: &str) -> PyResult<Self> {
        Self::of(urdf.as_bytes())
    }

    /// The name of the robot.
    #[getter]
    fn name(&self) -> &str {
        self.model.name()
    }

    /// The names of the independent movable joints, in the order of every `q`.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.model.joint_names()
    }

    /// The names of the links, parents first.
    #[getter]
    fn link_names(&self) -> Vec<&str> {
        let links = self.model.links().iter();
        links.map(|link| link.name.as_str()).collect()
    }

    /// Least positions of the joints `(dof,)`, in radians (meters if prismatic); -inf if continuous.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.model.joints().iter();
        vector(py, &joints.map(|joint| joint.lower).collect::<Vec<_>>())
    }

    /// Greatest positions of the joints `(dof,)`, in radians (meters if prismatic); inf if continuous.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.model.joints().iter();
        vector(py, &joints.map(|joint| joint.upper).collect::<Vec<_>>())
    }

    /// Mass of all links, in kilograms.
    #[getter]
    fn mass(&self) -> f64 {
        self.dynamics.mass_kg()
    }

    /// Poses of links in the root's frame: `(links, 4, 4)`, or `(n, links, 4, 4)` for a batch.
    ///
    /// `links` names them; all, in the order of `link_names`, if it is None.
    #[pyo3(signature = (q, links=None))]
    fn forward_kinematics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        links: Option<Vec<String>>,
    ) -> PyResult<Array<'py>> {
        let chosen = match links {
            None => (0..self.model.links().len()).collect(),
            Some(names) => self.links(&names)?,
        };
        let row = [chosen.len(), 4, 4];
        self.over(py, q, &row, |q| {
            let poses = self.model.forward_kinematics::<Palm>(q)?;
            Ok(chosen
                .iter()
                .flat_map(|&link| pose_matrix(&poses[link]))
                .collect())
        })
    }

    /// Geometric Jacobian of a point fixed to a link: `(6, dof)`, or `(n, 6, dof)` for a batch.
    ///
    /// Velocity of the point in meters, then angular velocity in radians, per radian (or meter) of each joint, along the
    /// axes of the root. `point` `(3,)` is in the link's frame, in meters; its origin if it is None.
    #[pyo3(signature = (q, link, point=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        link: &str,
        point: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py>> {
        let link = self.link(link)?;
        let point = point.map(|point| three("point", point)).transpose()?;
        let point = Point3::from(point.unwrap_or_default());
        self.over(py, q, &[6, self.model.dof()], |q| {
            let poses = self.model.forward_kinematics::<Palm>(q)?;
            let point_in_root = poses[link] * point;
            let jacobian = self.model.geometric_jacobian(&poses, link, &point_in_root);
            Ok(jacobian.transpose().as_slice().to_vec())
        })
    }

    /// Joint positions within the limits with which a link is at a pose in the root's frame; None if none is found.
    ///
    /// `pose` is a matrix `(4, 4)`, reached within 1e-10 m and rad. The search starts from `near` `(dof,)`, the middle of
    /// the limits if it is None. If that leads to no solution, 64 other starts are tried, and the nearest solution is
    /// returned. Joints that do not move the link keep their positions in `near`, within their limits. A link that fewer
    /// than six joints move reaches few poses.
    #[pyo3(signature = (pose, link, near=None))]
    fn inverse_kinematics<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
        link: &str,
        near: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Option<Array<'py>>> {
        self.link(link)?;
        let base_from_end: Pose<Base, Palm> =
            arrays::pose("pose", &Rows::one("pose", pose, &[4, 4])?)?;
        let chain = Chain::to_link(&self.model, link).map_err(|err| failed(&err, err.hint()))?;
        let mut whole = self.model.mid_range();
        if let Some(near) = near {
            whole = Rows::one("near", near, &[self.model.dof()])?;
            for (q, joint) in whole.iter_mut().zip(self.model.joints()) {
                *q = joint.clamp(*q);
            }
        }
        let near: Vec<f64> = chain.joints().iter().map(|&joint| whole[joint]).collect();
        let best = py.detach(|| chain.solution_near(&base_from_end, &near));
        best.map(|best| {
            for (&joint, q) in chain.joints().iter().zip(best) {
                whole[joint] = q;
            }
            vector(py, &whole)
        })
        .transpose()
    }

    /// Torques of the joints in Nm (forces in N if prismatic): `(dof,)`, or `(n, dof)` for a batch.
    ///
    /// `velocity` and `acceleration` have the shape of `q`, in rad/s and rad/s² (m/s, m/s²), and are zero if they are None.
    /// `gravity` `(3,)` is in the root's frame, in m/s²; 9.81 against its z axis if it is None. The root is held; friction
    /// and rotors are not part of the model.
    #[pyo3(signature = (q, velocity=None, acceleration=None, gravity=None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        velocity: Option<&Bound<'py, PyAny>>,
        acceleration: Option<&Bound<'py, PyAny>>,
        gravity: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py>> {
        let q = self.row("q", q)?;
        let other = |name: &str, rows: Option<&Bound<'py, PyAny>>| {
            let rows = rows.map(|rows| self.row(name, rows)).transpose()?;
            if let Some(rows) = &rows {
                q.check_as_many("q", rows, name)?;
            }
            PyResult::Ok(rows)
        };
        let velocity = other("velocity", velocity)?;
        let acceleration = other("acceleration", acceleration)?;
        let gravity = gravity
            .map(|gravity| three("gravity", gravity))
            .transpose()?;
        let gravity = Vector3::from(gravity.unwrap_or([0.0, 0.0, -9.81]));
        let still = vec![0.0; self.model.dof()];
        let root = FreeRootState::still(Pose::identity());
        batch(py, &q, &[self.model.dof()], |idx| {
            let of = |rows: &'_ Option<Rows>| match rows {
                Some(rows) => rows.row(idx).to_vec(),
                None => still.clone(),
            };
            let (velocity, acceleration) = (of(&velocity), of(&acceleration));
            let motion = JointMotion {
                q: q.row(idx),
                velocity: &velocity,
                acceleration: &acceleration,
            };
            let efforts = self.dynamics.inverse_dynamics(&root, &motion, &gravity)?;
            Ok(efforts.joints.as_slice().to_vec())
        })
    }

    /// Mass matrix of the robot with its root held: `(dof, dof)`, or `(n, dof, dof)` for a batch, in kg m².
    fn mass_matrix<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        let dof = self.model.dof();
        self.over(py, q, &[dof, dof], |q| {
            Ok(self
                .dynamics
                .mass_matrix(q)?
                .transpose()
                .as_slice()
                .to_vec())
        })
    }

    /// Center of mass in the root's frame: `(3,)`, or `(n, 3)` for a batch, in meters.
    fn center_of_mass<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        self.over(py, q, &[3], |q| {
            Ok(self.dynamics.center_of_mass(q)?.coords.as_slice().to_vec())
        })
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Robot {:?}, {} joints, {} links>",
            self.model.name(),
            self.model.dof(),
            self.model.links().len()
        )
    }
}

impl Robot {
    fn of(urdf: &[u8]) -> PyResult<Self> {
        let model = RobotModel::from_urdf_bytes(urdf)
            .map_err(|err| failed(&err, err.hint().or_else(|| Some(URDF.to_owned()))))?;
        let dynamics = DynamicsModel::new(&model);
        Ok(Self { model, dynamics })
    }

    fn link(&self, name: &str) -> PyResult<usize> {
        let found = self.model.require_link(name);
        found.map_err(|err| {
            failed(
                &err,
                err.hint()
                    .or_else(|| Some("`link_names` lists the links".to_owned())),
            )
        })
    }

    fn links(&self, names: &[String]) -> PyResult<Vec<usize>> {
        names.iter().map(|name| self.link(name)).collect()
    }

    /// Reads joint positions, or as many numbers of another kind.
    fn row(&self, name: &str, rows: &Bound<'_, PyAny>) -> PyResult<Rows> {
        Rows::read(name, rows, &[self.model.dof()])
    }

    /// Computes an array of the shape `row` for each row of joint positions.
    fn over<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        row: &[usize],
        compute: impl Fn(&[f64]) -> Result<Vec<f64>, WrongDof> + Send + Sync,
    ) -> PyResult<Array<'py>> {
        let q = self.row("q", q)?;
        batch(py, &q, row, |idx| compute(q.row(idx)))
    }
}

/// Computes an array of the shape `row` for each of as many rows.
fn batch<'py>(
    py: Python<'py>,
    rows: &Rows,
    row: &[usize],
    compute: impl Fn(usize) -> Result<Vec<f64>, WrongDof> + Send + Sync,
) -> PyResult<Array<'py>> {
    let (n, width) = (rows.len(), row.iter().product::<usize>());
    let mut numbers = reserved(n.saturating_mul(width))?;
    numbers.resize(n * width, 0.0);
    let fill = |(idx, place): (usize, &mut [f64])| -> Result<(), WrongDof> {
        place.copy_from_slice(&compute(idx)?);
        Ok(())
    };
    // Of a robot without joints, a row may be of no numbers.
    let width = width.max(1);
    let filled = if n < SMALL_BATCH {
        numbers
            .chunks_exact_mut(width)
            .enumerate()
            .try_for_each(fill)
    } else {
        in_threads(py, |cancellation| {
            let places = numbers.par_chunks_exact_mut(width).enumerate();
            places
                .take_any_while(|_| !cancellation.is_asked())
                .try_for_each(fill)
        })?
    };
    filled.map_err(|err| failed(&err, None))?;
    if numbers.iter().any(|number| !number.is_finite()) {
        return Err(wrong(
            "the result is too large for a number".to_owned(),
            "check the units: radians, meters, rad/s and rad/s²",
        ));
    }
    array(py, &numbers, rows.is_batch.then_some(n), row)
}

/// Reads an argument of three numbers.
fn three(name: &str, argument: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    let numbers = Rows::one(name, argument, &[3])?;
    Ok([numbers[0], numbers[1], numbers[2]])
}
