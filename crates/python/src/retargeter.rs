//! Retargeting: a person's landmarks to a robot hand's postures, one step at a time or a whole motion.

use std::{
    path::PathBuf,
    sync::{Mutex, MutexGuard, PoisonError},
};

use dataflow::Diagnostic;
use hand_files::HandFile;
use options::Options;
use posture::{Environment, Hand, HandTable, KEYPOINTS};
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use rayon::prelude::*;
use retargeting::{LandmarkStep, LiveRetargeting, RetargetingConfig, RetargetingError, retarget};
use self_cell::self_cell;

use crate::{
    arrays::{Array, Rows, array, pose_matrix, vector},
    error::{failed, wrong},
    threads::in_threads,
};

/// Coordinates of a landmark.
const AXES: usize = 3;
const LANDMARKS: &str = "pass 21 landmarks in meters: the wrist; thumb, index, middle, ring and little finger, four \
                         each from base to tip";

/// What a live follower works on.
struct Work {
    hand: Hand,
    environment: Environment,
    config: RetargetingConfig,
}

self_cell!(
    /// A live follower with what it works on.
    struct Live {
        owner: Work,
        #[not_covariant]
        dependent: LiveRetargeting,
    }
);

/// A robot hand that follows a person's: one step at a time, or a whole motion.
///
/// `hand` is a hand's file (TOML, as in `data/hands`), or a URDF alone, for which the points are proposed. `options` are
/// those of the stage `retarget` (`pipeline stages retarget`), as a dict. There is no object and no table: the hand is
/// in the air. Landmarks are an array `(21, 3)` in meters: the wrist; thumb, index, middle, ring and little finger, four
/// each from base to tip. Threads may share it; each `step` waits for the one before.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Retargeter {
    live: Mutex<Live>,
    hand: Hand,
    config: RetargetingConfig,
}

#[pymethods]
impl Retargeter {
    /// Loads a hand.
    #[new]
    #[pyo3(signature = (hand, *, options=None))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn new(hand: PathBuf, options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let hand = load(&hand)?;
        let config = config(options)?;
        let work = Work {
            hand: hand.clone(),
            environment: Environment::empty(),
            config: config.clone(),
        };
        let live = Live::try_new(work, |work| {
            LiveRetargeting::new(&work.hand, &work.environment, &work.config)
        });
        Ok(Self {
            live: Mutex::new(live.map_err(|err| refused(&err))?),
            hand,
            config,
        })
    }

    /// The names of the joints, in the order of every `q`.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.hand.model.joint_names()
    }

    /// Least positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.hand.model.joints().iter();
        vector(py, &joints.map(|joint| joint.lower).collect::<Vec<_>>())
    }

    /// Greatest positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let joints = self.hand.model.joints().iter();
        vector(py, &joints.map(|joint| joint.upper).collect::<Vec<_>>())
    }

    /// The posture for the landmarks of one step, `(21, 3)`: `q`, `palm`, `error`.
    ///
    /// `q` `(dof,)` are the joint positions, within their limits; `palm` `(4, 4)` is the pose of the root link in the frame of
    /// the landmarks; `error` is the root mean square distance of the followed points from their landmarks, in meters. The
    /// search starts from the step before, and afresh at the first step.
    fn step<'py>(
        &self,
        py: Python<'py>,
        landmarks: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>, f64)> {
        let rows = Rows::read("landmarks", landmarks, &[KEYPOINTS, AXES])?;
        if rows.is_batch {
            return Err(wrong(
                "`landmarks` is a batch".to_owned(),
                "pass one step, or call `retarget`",
            ));
        }
        let keypoints_m = keypoints(rows.row(0))?;
        let found = self
            .live()
            .with_dependent_mut(|_, live| live.step(&keypoints_m));
        let found = found.map_err(|err| refused(&err))?;
        let pose = pose_matrix(&found.posture.root.pose());
        let dof = found.posture.q.len();
        Ok((
            array(py, &found.posture.q, None, &[dof])?,
            array(py, &pose, None, &[4, 4])?,
            found.tracking.keypoint_error_m(),
        ))
    }

    /// Forgets the steps so far: the next one is searched afresh.
    fn reset(&self) {
        self.live().with_dependent_mut(|_, live| live.reset());
    }

    /// Retargets a recording: `times` `(n,)` in seconds, increasing, and `landmarks` `(n, 21, 3)`.
    ///
    /// The last step is taken for the grasp, from which the others are solved backward.
    fn retarget<'py>(
        &self,
        py: Python<'py>,
        times: &Bound<'py, PyAny>,
        landmarks: &Bound<'py, PyAny>,
    ) -> PyResult<Motion> {
        let mut motions = self.retargeted(py, vec![steps(times, landmarks)?])?;
        // Of one recording there is one motion.
        Ok(motions.remove(0))
    }

    /// Retargets recordings, pairs of times and landmarks as those of `retarget`, in all threads.
    fn retarget_all(&self, py: Python<'_>, recordings: &Bound<'_, PyAny>) -> PyResult<Vec<Motion>> {
        let pairs: PyResult<Vec<(Bound<'_, PyAny>, Bound<'_, PyAny>)>> = recordings.extract();
        let pairs = pairs.map_err(|err| {
            wrong(
                format!("`recordings` is no list of pairs: {err}"),
                "pass pairs `(times, landmarks)`, each as those of `retarget`",
            )
        })?;
        let pairs = pairs.iter();
        let recordings: PyResult<Vec<_>> = pairs
            .map(|(times, landmarks)| steps(times, landmarks))
            .collect();
        self.retargeted(py, recordings?)
    }

    fn __repr__(&self) -> String {
        let model = &self.hand.model;
        format!(
            "<pipeline.Retargeter {:?}, {} joints>",
            model.name(),
            model.dof()
        )
    }
}

impl Retargeter {
    /// The live follower; after a panic in another thread it is as it was left, and the next step searches from there.
    fn live(&self) -> MutexGuard<'_, Live> {
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Retargets recordings, several at once.
    fn retargeted(
        &self,
        py: Python<'_>,
        recordings: Vec<Vec<LandmarkStep>>,
    ) -> PyResult<Vec<Motion>> {
        let (hand, config) = (&self.hand, &self.config);
        let one = |steps: Vec<LandmarkStep>| retarget(hand, &Environment::empty(), config, &steps);
        let found: Result<Vec<_>, RetargetingError> =
            in_threads(py, || recordings.into_par_iter().map(one).collect())?;
        let found = found.map_err(|err| refused(&err))?;
        found
            .into_iter()
            .enumerate()
            .map(|(idx, retargeted)| match retargeted {
                Some(retargeted) => Ok(Motion(retargeted)),
                None => Err(wrong(
                    format!("recording {idx} has no steps"),
                    "pass one step at least",
                )),
            })
            .collect()
    }
}

/// A retargeted motion: arrays over its steps.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Motion(retargeting::Retargeted);

#[pymethods]
impl Motion {
    /// The names of the joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.0.motion.joints().to_vec()
    }

    /// Times of the steps `(n,)`, in seconds.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[], |step| vec![step.time_s])
    }

    /// Joint positions `(n, dof)`, in radians (meters if prismatic).
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[self.0.motion.joints().len()], |step| {
            step.q_rad.clone()
        })
    }

    /// Joint velocities `(n, dof)`, in rad/s (m/s).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let dof = self.0.motion.joints().len();
        self.steps(py, &[dof], |step| step.rates.joints.velocity.clone())
    }

    /// Poses of the root link in the frame of the landmarks `(n, 4, 4)`.
    #[getter]
    fn palm<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        self.steps(py, &[4, 4], |step| {
            pose_matrix(&step.frame_from_palm).to_vec()
        })
    }

    /// Root mean square distances of the followed points from their landmarks `(n,)`, in meters.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let errors = self
            .0
            .tracking
            .iter()
            .map(retargeting::Tracking::keypoint_error_m);
        vector(py, &errors.collect::<Vec<_>>())
    }

    fn __len__(&self) -> usize {
        self.0.motion.steps().len()
    }

    fn __repr__(&self) -> String {
        format!(
            "<pipeline.Motion, {} steps of {} joints>",
            self.0.motion.steps().len(),
            self.0.motion.joints().len()
        )
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
        let steps = self.0.motion.steps();
        let numbers: Vec<f64> = steps.iter().flat_map(of).collect();
        array(py, &numbers, Some(steps.len()), row)
    }
}

/// Loads a hand from its file, or from a URDF alone, for which points are proposed.
fn load(path: &std::path::Path) -> PyResult<Hand> {
    let urdf = hand_files::urdf_of(path).map_err(|err| failed(&err, err.hint()))?;
    if urdf != path {
        return hand_files::load(&urdf, path).map_err(|err| failed(&err, err.hint()));
    }
    let model = robot_meshes::load(&urdf)
        .map_err(|err| failed(&err, err.hint()))?
        .model;
    let file = HandFile::proposed(&model, &urdf).ok_or_else(|| {
        wrong(
            format!("`{}` has too few fingers and links to propose a hand's file from", urdf.display()),
            "write a hand's file that names the points; `pipeline new` makes examples in `data/hands`",
        )
    })?;
    hand_of(model, &file.table)
}

fn hand_of(model: robot::RobotModel, table: &HandTable) -> PyResult<Hand> {
    Hand::check(&model)
        .and_then(|()| Hand::new(model, table))
        .map_err(|err| failed(&err, err.hint()))
}

/// Reads options: those of the stage `retarget`.
fn config(options: Option<&Bound<'_, PyDict>>) -> PyResult<RetargetingConfig> {
    let Some(options) = options else {
        return Ok(RetargetingConfig::default());
    };
    let unusable = |problem: String| {
        wrong(
            format!("`options` cannot be used: {problem}"),
            "`pipeline stages retarget` lists the options with their units",
        )
    };
    let json = options.py().import("json")?;
    let text = json.call_method1("dumps", (options,));
    let text: String = text.map_err(|err| unusable(err.to_string()))?.extract()?;
    let config: RetargetingConfig =
        serde_json::from_str(&text).map_err(|err| unusable(err.to_string()))?;
    match config.faults().first() {
        Some(fault) => Err(unusable(fault.to_string())),
        None => Ok(config),
    }
}

/// Reads the landmarks of a step.
fn keypoints(row: &[f64]) -> PyResult<[[f64; AXES]; KEYPOINTS]> {
    let (points, _) = row.as_chunks::<AXES>();
    points
        .try_into()
        .map_err(|_other_length| wrong(format!("there are {} landmarks", points.len()), LANDMARKS))
}

/// Reads a recording: its times in seconds, and landmarks at each.
fn steps(times: &Bound<'_, PyAny>, landmarks: &Bound<'_, PyAny>) -> PyResult<Vec<LandmarkStep>> {
    let times = Rows::read("times", times, &[])?;
    let landmarks = Rows::read("landmarks", landmarks, &[KEYPOINTS, AXES])?;
    times.check_as_many("times", &landmarks, "landmarks")?;
    (0..times.len())
        .map(|idx| {
            Ok(LandmarkStep {
                time_s: times.row(idx)[0],
                keypoints_m: keypoints(landmarks.row(idx))?,
            })
        })
        .collect()
}

fn refused(err: &RetargetingError) -> PyErr {
    failed(err, err.hint())
}
