//! Retargeting: a person's landmarks to a robot hand's postures, one step at a time or a whole motion.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use dataflow::{Diagnostic, with_causes};
use hand_files::HandFile;
use options::Options;
use posture::{Environment, Hand, KEYPOINTS};
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use rayon::prelude::*;
use retargeting::{LandmarkStep, LiveRetargeting, RetargetingConfig, RetargetingError, retarget};
use schemas::demonstrations::Side;
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
/// `hand` is a hand's file (TOML, as in `data/hands`). A URDF alone is enough for a try: points that follow are proposed.
/// `options` are those of the stage `retarget` (`pipeline stages retarget`), as a dict. No object and no table are
/// known: nothing is kept clear of, and no fingertip is drawn to a surface.
///
/// Landmarks are an array `(21, 3)` in meters: the wrist; thumb, index, middle, ring and little finger, four each from
/// base to tip, as `MediaPipe` orders them. Their frame is any right-handed one that stays the same, such as the
/// camera's; all poses are in it. They are scaled about the wrist by the hand's `scale` before they are followed. A right
/// robot hand (`side`) follows a left hand's mirror image: negate one coordinate of its landmarks.
///
/// Each stream needs a `Retargeter` of its own, since a step starts from the one before. It cannot be pickled: make one
/// in each process.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Retargeter {
    live: Mutex<Live>,
    hand: Hand,
    side: Side,
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
        let (hand, side) = load(&hand)?;
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
            live: Mutex::new(live.map_err(|err| refused(&err, ""))?),
            hand,
            side,
            config,
        })
    }

    /// Side of the robot hand, "right" or "left": that of the person's hand which it can follow.
    #[getter]
    fn side(&self) -> &'static str {
        self.side.as_str()
    }

    /// Size of the robot hand relative to the person's, by which landmarks are scaled about the wrist.
    #[getter]
    fn scale(&self) -> f64 {
        self.hand.scale
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
    /// `q` `(dof,)` are the joint positions, within their limits. `palm` `(4, 4)` is the pose of the root link in the
    /// landmarks' frame. `error` is the root mean square distance of the followed points from their scaled landmarks, in
    /// meters; where it is large, the landmarks are wrong or out of reach, and the command is better not sent.
    ///
    /// The search starts from the step before and stays near it; the first step is searched afresh, which takes some
    /// milliseconds, and so is one that is followed far worse than those before. Speeds are not limited.
    fn step<'py>(
        &self,
        py: Python<'py>,
        landmarks: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>, f64)> {
        let keypoints_m = keypoints(&Rows::one("landmarks", landmarks, &[KEYPOINTS, AXES])?)?;
        let found = self
            .live()
            .with_dependent_mut(|_, live| live.step(&keypoints_m));
        let found = found.map_err(|err| refused(&err, ""))?;
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
    /// The last step is taken for the grasp: it is solved first, then the step before it, and so on.
    fn retarget<'py>(
        &self,
        py: Python<'py>,
        times: &Bound<'py, PyAny>,
        landmarks: &Bound<'py, PyAny>,
    ) -> PyResult<Motion> {
        let steps = steps(times, "times", landmarks, "landmarks")?;
        let mut motions = self.retargeted(py, vec![steps])?;
        // Of one recording there is one motion.
        Ok(motions.remove(0))
    }

    /// Retargets recordings, pairs of times and landmarks as those of `retarget`, in all threads.
    fn retarget_all(&self, py: Python<'_>, recordings: &Bound<'_, PyAny>) -> PyResult<Vec<Motion>> {
        let no_pairs = |err: PyErr| {
            wrong(
                format!("`recordings` is no sequence of pairs: {}", err.value(py)),
                "pass pairs `(times, landmarks)`, each as those of `retarget`",
            )
        };
        let recordings: PyResult<Vec<_>> = recordings
            .try_iter()
            .map_err(no_pairs)?
            .enumerate()
            .map(|(idx, pair)| {
                let parts = pair?.try_iter().map_err(no_pairs)?;
                let parts: Vec<Bound<'_, PyAny>> = parts.collect::<PyResult<_>>()?;
                let [times, landmarks] = parts.as_slice() else {
                    return Err(wrong(
                        format!("`recordings[{idx}]` has {} parts", parts.len()),
                        "pass pairs `(times, landmarks)`, each as those of `retarget`",
                    ));
                };
                let name = |part| format!("recordings[{idx}][{part}]");
                steps(times, &name(0), landmarks, &name(1))
            })
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
        let found: Vec<_> = in_threads(py, |cancellation| {
            let recordings = recordings.into_par_iter();
            let running = recordings.take_any_while(|_| !cancellation.is_asked());
            running
                .map(|steps| retarget(hand, &Environment::empty(), config, &steps))
                .collect()
        })?;
        let n = found.len();
        let of = |idx: usize| match n {
            1 => String::new(),
            _ => format!("recording {idx}: "),
        };
        found
            .into_iter()
            .enumerate()
            .map(|(idx, retargeted)| match retargeted {
                Ok(Some(retargeted)) => Ok(Motion(retargeted)),
                Ok(None) => Err(wrong(
                    format!("{}there are no steps", of(idx)),
                    "pass one step at least",
                )),
                Err(err) => Err(refused(&err, &of(idx))),
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

    /// Root mean square distances of the followed points from their scaled landmarks `(n,)`, in meters.
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

/// Loads a hand and its side from its file, or from a URDF alone, for which points are proposed.
pub(crate) fn load(path: &Path) -> PyResult<(Hand, Side)> {
    let urdf = hand_files::urdf_of(path).map_err(|err| failed(&err, err.hint()))?;
    if urdf != path {
        let side = hand_files::load_table(path).map(|table| table.side);
        let loaded = side.and_then(|side| Ok((hand_files::load(&urdf, path)?, side)));
        return loaded.map_err(|err| failed(&err, err.hint()));
    }
    let loaded = robot_meshes::load(&urdf).map_err(|err| failed(&err, err.hint()))?;
    let file = HandFile::proposed(&loaded.model, &urdf).ok_or_else(|| {
        wrong(
            format!(
                "`{}` has too few fingers and links to propose points that follow",
                urdf.display()
            ),
            "write a hand's file that names the points; `pipeline new` makes examples in `data/hands`",
        )
    })?;
    let hand = Hand::check(&loaded.model).and_then(|()| Hand::new(loaded.model, &file.table));
    let hand = hand.map_err(|err| failed(&err, err.hint()))?;
    Ok((hand, file.table.side))
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
    let strict = PyDict::new(options.py());
    strict.set_item("allow_nan", false)?;
    let text = json.call_method("dumps", (options,), Some(&strict));
    let text: String = text
        .map_err(|err| unusable(err.value(options.py()).to_string()))?
        .extract()?;
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
fn steps(
    times: &Bound<'_, PyAny>,
    its_name: &str,
    landmarks: &Bound<'_, PyAny>,
    name: &str,
) -> PyResult<Vec<LandmarkStep>> {
    let times = Rows::read(its_name, times, &[])?;
    let landmarks = Rows::read(name, landmarks, &[KEYPOINTS, AXES])?;
    times.check_as_many(its_name, &landmarks, name)?;
    (0..times.len())
        .map(|idx| {
            Ok(LandmarkStep {
                time_s: times.row(idx)[0],
                keypoints_m: keypoints(landmarks.row(idx))?,
            })
        })
        .collect()
}

/// Returns the exception for a motion that cannot be retargeted.
fn refused(err: &RetargetingError, of: &str) -> PyErr {
    let remedy = "check that landmarks are in meters and times in seconds, later from step to step";
    let hint = err.hint().unwrap_or_else(|| remedy.to_owned());
    wrong(format!("{of}{}", with_causes(err)), &hint)
}
