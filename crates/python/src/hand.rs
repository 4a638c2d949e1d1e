//! Hands: motions refined and judged.

use std::path::{PathBuf, absolute};

use dataflow::Diagnostic;
use planning::{ArmSetup, Planner, PlannerConfig};
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use rayon::prelude::*;
use robot_meshes::HandMismatch;
use screening::Judgment;
use serde_json::json;
use simulation::{SimulationError, TraceMode};
use stage_dispatch::DispatchConfig;
use stage_refine::{RefineConfig, Refinement, RefusedDraws};
use stage_report::ObjectMesh;
use stage_screen::ScreenConfig;

use crate::{
    arrays::{Array, Rows, corners, count, vector, vectors},
    candidates::Candidates,
    error::{failed, wrong},
    object::{Object, seed_of},
    options, own_hand,
    plan::Plan,
    rollouts::{Rollout, Rollouts},
    threads::in_threads,
};

/// The stage whose verdicts [`Hand::screen`] gives.
const SCREEN: &str = "screen";
/// The stage whose plans [`Hand::plan`] gives.
const DISPATCH: &str = "dispatch";

/// A robot hand that grasps: `path` is a hand's file (TOML, as in `data/hands`).
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Hand {
    pub(crate) path: PathBuf,
    urdf: PathBuf,
    pub(crate) loaded: posture::Hand,
}

#[pymethods]
impl Hand {
    /// Loads a hand with its meshes.
    #[new]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn new(path: PathBuf) -> PyResult<Self> {
        // The file is read again for options: from wherever the process is then.
        let path = absolute(&path).map_err(|err| failed(&err, None))?;
        let (hand, _) = own_hand::load(&path)?;
        let urdf = hand_files::urdf_of(&path).map_err(|err| failed(&err, err.hint()))?;
        Ok(Self {
            path,
            urdf,
            loaded: hand,
        })
    }

    /// The names of the joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.loaded.model.joint_names()
    }

    /// Least positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.loaded.model.joints().iter();
        vector(py, &joints.map(|joint| joint.lower).collect::<Vec<_>>())
    }

    /// Greatest positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.loaded.model.joints().iter();
        vector(py, &joints.map(|joint| joint.upper).collect::<Vec<_>>())
    }

    /// The shapes of the links at joint positions `q` `(dof,)`, in the root link's frame: vertices `(n, 3)`, and the vertices
    /// of each triangle `(m, 3)`, as `Object.vertices` and `Object.triangles`.
    fn mesh<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let q = Rows::one("q", q, &[self.loaded.model.dof()])?;
        let mesh =
            ObjectMesh::of_robot(&self.loaded.model, &q).map_err(|err| failed(&err, None))?;
        Ok((
            vectors(py, &mesh.vertices_m)?,
            corners(py, &mesh.triangles)?,
        ))
    }

    /// Moves motions out of object and table and to a grasp that balances: those of the stage `refine`, to the bit.
    ///
    /// `options` are that stage's. With `draws` above 1 so many motions of one resting pose compete, and the one with the
    /// smallest residual is kept, without physics.
    #[pyo3(signature = (object, candidates, *, options=None))]
    fn refine(
        &self,
        py: Python<'_>,
        object: &Object,
        candidates: &Candidates,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Candidates> {
        let config: RefineConfig = options::read("refine", options, Some(&self.path), &[])?;
        self.check("refine", object, candidates)?;
        let field = object.field(py)?;
        let given = candidates.motions.clone();
        let refined = in_threads(py, |cancellation| {
            Refinement {
                config: &config,
                hand: &self.loaded,
                object: &object.stored,
                field,
                is_canceled: &|| cancellation.is_asked(),
            }
            .refine(given, RefusedDraws::default())
            .map_err(|err| failed(&err, None))
            .and_then(|refined| Candidates::stored(refined.candidates))
        })?;
        Ok(refined?.of(object))
    }

    /// Judges motions in physics: the verdicts of a stage `screen` with the pipeline's `seed`, to the bit.
    ///
    /// `options` are that stage's. Each motion alone gets the same verdict. The object is set down as `table_from_object`
    /// turns it, and the reach takes the protocol's time, whatever the motion's.
    #[pyo3(signature = (object, candidates, *, seed=7, options=None))]
    fn screen(
        &self,
        py: Python<'_>,
        object: &Object,
        candidates: &Candidates,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Rollouts> {
        let config = self.screen_config(object, candidates, options)?;
        let seed = seed_of(seed, SCREEN, &object.stored.name)?;
        let all = &candidates.motions;
        let judged = in_threads(py, |cancellation| {
            let model = &self.loaded.model;
            let screening = stage_screen::screening(&config, model, &object.stored, all, seed);
            let scenes = screening.build_scenes()?;
            let numbers = (0..all.candidates.len()).into_par_iter();
            let running = numbers.take_any_while(|_| !cancellation.is_asked());
            running
                .map(|idx| screening.judge_one(&scenes, idx))
                .collect::<Result<Vec<Option<Judgment>>, SimulationError>>()
        })?;
        let judged = judged.map_err(|err| simulation_failed(&err))?;
        let protocol = config.protocol.name;
        let rows = all.candidates.iter().zip(&judged);
        let rows = rows.map(|(of, found)| stage_screen::row(of, protocol, found.as_ref()));
        Ok(Rollouts(rows.collect()))
    }

    /// Executes the motion of a number in physics as `screen` does, and returns every step of it.
    #[pyo3(signature = (object, candidates, number=0, *, seed=7, options=None))]
    fn rollout(
        &self,
        py: Python<'_>,
        object: &Object,
        candidates: &Candidates,
        number: i64,
        seed: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Rollout> {
        let number = count("number", number)?;
        let config = self.screen_config(object, candidates, options)?;
        let seed = seed_of(seed, SCREEN, &object.stored.name)?;
        let all = &candidates.motions;
        let n = all.candidates.len();
        if number >= n {
            return Err(wrong(
                format!("there is no motion {number} of {n}"),
                "pass a number below `len(candidates)`",
            ));
        }
        let executed = in_threads(py, |_| {
            let model = &self.loaded.model;
            let screening = stage_screen::screening(&config, model, &object.stored, all, seed);
            let scenes = screening.scenes(&config.scene, &[number])?;
            let rollout = screening.rollout(&scenes, number, TraceMode::Trace)?;
            let verdict = config.screening(seed).verdict(&rollout);
            Ok((rollout, verdict))
        })?;
        let (rollout, verdict) = executed.map_err(|err| simulation_failed(&err))?;
        Ok(Rollout {
            name: all.candidates[number].candidate_id.clone(),
            verdict,
            steps: rollout.trace.unwrap_or_default().steps,
            hand: self.loaded.model.clone(),
            object: object.stored.clone(),
        })
    }

    /// Plans motions as the commands of a robot's controllers, within its limits and from rest to rest: those of the stage
    /// `dispatch`.
    ///
    /// `options` are that stage's: `arm` is the arm that carries the hand; without one the palm flies freely. `object` is
    /// the one for which the motions were made.
    #[pyo3(signature = (object, candidates, *, options=None))]
    fn plan(
        &self,
        py: Python<'_>,
        object: &Object,
        candidates: &Candidates,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Vec<Plan>> {
        let simulated = [("cell", json!(stage_dispatch::SIMULATED))];
        let config: DispatchConfig =
            options::read(DISPATCH, options, Some(&self.path), &simulated)?;
        self.check(DISPATCH, object, candidates)?;
        let arm = config.arm.as_ref();
        let robot = arm.map(|arm| robot_meshes::load(&arm.robot)).transpose();
        let robot = robot.map_err(|err| failed(&err, err.hint()))?;
        let planner = Planner::new(&PlannerConfig {
            hand: &self.loaded.model,
            arm: arm.zip(robot.as_ref()).map(|(config, robot)| ArmSetup {
                config,
                robot: &robot.model,
            }),
            protocol: &config.protocol,
            limits: &config.limits,
            rates: config.rates,
        });
        let planner = planner.map_err(|err| {
            let hint = "`pipeline stages dispatch` lists the options with their units";
            failed(&err, Some(hint.to_owned()))
        })?;
        in_threads(py, |cancellation| {
            let all = candidates.motions.candidates.par_iter();
            let running = all.take_any_while(|_| !cancellation.is_asked());
            running
                .map(|one| Plan(planner.plan(&one.motion, &one.table_from_object)))
                .collect()
        })
    }

    fn __repr__(&self) -> String {
        let model = &self.loaded.model;
        format!("<pipeline.Hand {:?}, {} joints>", model.name(), model.dof())
    }
}

impl Hand {
    /// Reads the options of the screen, and checks that it can judge these motions.
    fn screen_config(
        &self,
        object: &Object,
        candidates: &Candidates,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<ScreenConfig> {
        let config: ScreenConfig = options::read(SCREEN, options, Some(&self.path), &[])?;
        self.check(SCREEN, object, candidates)?;
        Ok(config.resolved())
    }

    /// Checks that motions move this hand's joints and grasp this object.
    fn check(&self, stage: &'static str, object: &Object, candidates: &Candidates) -> PyResult<()> {
        candidates.check_object(object)?;
        let of_object = (
            candidates.motions.object.as_str(),
            &candidates.motions.joints[..],
        );
        HandMismatch::check(stage, of_object, (&self.urdf, &self.loaded.model)).map_err(|err| {
            let hint = "pass motions of this hand's joints, in any order";
            failed(&err, Some(hint.to_owned()))
        })
    }
}

/// Returns the exception for what cannot be simulated.
fn simulation_failed(err: &SimulationError) -> PyErr {
    failed(err, err.hint())
}
