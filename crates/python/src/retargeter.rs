//! Retargeting: a person's landmarks to a robot hand's postures, one step at a time or a whole motion.

use std::{path::PathBuf, sync::Arc};

use dex_retargeting::{Followed, Showing};
use posture::{Environment, KEYPOINTS, Posture};
use pyo3::{
    prelude::*,
    types::{PyAny, PyDict},
};
use rayon::prelude::*;
use retargeting::LandmarkStep;
use spatial::RestingPose;

use crate::{
    arrays::{Array, Rows, array, pose_matrix, vector},
    error::wrong,
    library_hand::{self, LibraryHand},
    motions::Motion,
    object::Object,
    own_hand::{self, OwnHand},
    threads::{Cancellation, in_threads},
};

/// Coordinates of a landmark.
const AXES: usize = 3;
const LANDMARKS: &str = "pass 21 landmarks in meters: the wrist; thumb, index, middle, ring and little finger, four \
                         each from base to tip";

/// How a robot hand follows.
enum Following {
    /// By the objective of the stage `retarget`.
    Own(Box<OwnHand>),
    /// By one of dex-retargeting.
    Library(LibraryHand),
}

/// A robot hand that follows a person's: one step at a time, or a whole motion.
///
/// `hand` is a hand's file (TOML, as in `data/hands`). A URDF alone is enough for a try: points that follow are
/// proposed. `options` are those of the stage `retarget` (`pipeline stages retarget`), as a dict.
///
/// With an `object` the hand keeps clear of it and of the table, and fingertips that touch are drawn to its surface, as
/// in the stage: landmarks are then in the object's frame, and `table_from_object` `(4, 4)` is its pose on the table,
/// whose top is at z = 0; the first of its resting poses if it is None. Without one nothing is kept clear of.
///
/// Landmarks are an array `(21, 3)` in meters: the wrist; thumb, index, middle, ring and little finger, four each from
/// base to tip, as `MediaPipe` orders them. Their frame is any right-handed one that stays the same, such as the
/// camera's; all poses are in it. They are scaled about the wrist by the hand's `scale` before they are followed. A
/// right robot hand (`side`) follows a left hand's mirror image: negate one coordinate of its landmarks.
///
/// `hand` may be a configuration file of dex-retargeting (`.yml`), unchanged: `position`, `vector` or `dexpilot`,
/// solved to the minimum of the library's objective. `urdf_folder` is where its `urdf_path` is, by default the file's
/// own folder. A hand without `add_dummy_free_joint` stands still at the origin, and landmarks are along the axes of
/// its root link: those of the library's detector, z from the wrist to the middle finger. Every step starts from the
/// one before, the first in the middle of the joints' ranges, and `low_pass_alpha` filters the answers, as in the
/// library. Positions stay within the URDF's limits, of joints that mimic none; the library's may leave them by 1e-3,
/// as those by `limit_slack=1e-3` may (radians, or meters if prismatic).
///
/// Each stream needs a `Retargeter` of its own, since a step starts from the one before. It cannot be pickled: make one
/// in each process.
#[pyclass(frozen, module = "pipeline")]
pub(crate) struct Retargeter(Following);

#[pymethods]
impl Retargeter {
    /// Loads a hand.
    #[new]
    #[pyo3(signature = (
        hand, *, options=None, object=None, table_from_object=None, urdf_folder=None, limit_slack=None
    ))]
    #[expect(
        clippy::needless_pass_by_value,
        reason = "Python's paths become owned ones"
    )]
    fn new(
        py: Python<'_>,
        hand: PathBuf,
        options: Option<&Bound<'_, PyDict>>,
        object: Option<&Object>,
        table_from_object: Option<&Bound<'_, PyAny>>,
        urdf_folder: Option<PathBuf>,
        limit_slack: Option<f64>,
    ) -> PyResult<Self> {
        if LibraryHand::is_configured_by(&hand) {
            if options.is_some() || object.is_some() || table_from_object.is_some() {
                return Err(wrong(
                    "`options`, `object` and `table_from_object` are for the stage's own objective, not for \
                     dex-retargeting's"
                        .to_owned(),
                    "edit the keys of the YAML file instead, or pass a hand's file (TOML)",
                ));
            }
            let loaded =
                LibraryHand::load(&hand, urdf_folder.as_deref(), limit_slack.unwrap_or(0.0))?;
            return Ok(Self(Following::Library(loaded)));
        }
        if urdf_folder.is_some() || limit_slack.is_some() {
            return Err(wrong(
                "`urdf_folder` and `limit_slack` are for configurations of dex-retargeting (`.yml`)".to_owned(),
                "leave them out: a hand's file names its URDF relative to itself",
            ));
        }
        let environment = environment(py, object, table_from_object)?;
        let loaded = OwnHand::load(&hand, options, environment)?;
        Ok(Self(Following::Own(Box::new(loaded))))
    }

    /// Side of the robot hand, "right" or "left": that of the person's hand which it can follow; `None` by a
    /// configuration of dex-retargeting, which does not say.
    #[getter]
    fn side(&self) -> Option<&'static str> {
        match &self.0 {
            Following::Own(own) => Some(own.side.as_str()),
            Following::Library(_) => None,
        }
    }

    /// Size of the robot hand relative to the person's, by which landmarks are scaled about the wrist.
    #[getter]
    fn scale(&self) -> f64 {
        match &self.0 {
            Following::Own(own) => own.hand.scale,
            Following::Library(library) => library.scale(),
        }
    }

    /// Numbers of the landmarks that are followed by a configuration of dex-retargeting: a list, or of vectors two,
    /// where they begin and where they end; `None` otherwise.
    #[getter]
    fn target_link_human_indices<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        match &self.0 {
            Following::Own(_) => Ok(None),
            Following::Library(library) => library.landmarks(py).map(Some),
        }
    }

    /// The names of the joints, in the order of every `q`. Joints that mimic others move with them and have no
    /// position.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.model().joint_names()
    }

    /// Least positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let limits = self.limits();
        vector(py, &limits.map(|(lower, _)| lower).collect::<Vec<_>>())
    }

    /// Greatest positions of the joints `(dof,)`, in radians (meters if prismatic).
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let limits = self.limits();
        vector(py, &limits.map(|(_, upper)| upper).collect::<Vec<_>>())
    }

    /// The posture for the landmarks of one step, `(21, 3)`: `q`, `palm`, `error`.
    ///
    /// `q` `(dof,)` are the joint positions, within their limits. `palm` `(4, 4)` is the pose of the root link in the
    /// landmarks' frame. `error` is the root mean square distance of the followed points from their scaled landmarks,
    /// in meters; where it is large, the landmarks are wrong or out of reach, and the command is better not sent. By a
    /// configuration of dex-retargeting it is that of the followed points or vectors, before the filter.
    ///
    /// The search starts from the step before and stays near it; the first step is searched afresh, which takes some
    /// milliseconds, and so is one that is followed far worse than those before. Speeds are not limited.
    fn step<'py>(
        &self,
        py: Python<'py>,
        landmarks: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>, f64)> {
        let keypoints_m = keypoints(&Rows::one("landmarks", landmarks, &[KEYPOINTS, AXES])?)?;
        match &self.0 {
            Following::Own(own) => {
                let found = own.with(|live| live.step(&keypoints_m));
                let found = found.map_err(|err| own_hand::refused(&err, ""))?;
                posture(py, &found.posture, found.tracking.keypoint_error_m())
            }
            Following::Library(library) => library.with(|live| {
                let found = live.step(&keypoints_m);
                let found: Followed<'_> = found.map_err(|err| library_hand::refused(&err, ""))?;
                posture(py, found.posture, found.error_m)
            }),
        }
    }

    /// The posture for the reference value of dex-retargeting at one step: `q`, `palm`, `error`, as those of `step`.
    ///
    /// `reference` `(n, 3)` are points for the links of `position`, and otherwise vectors at the person's size,
    /// `landmarks[indices[1]] - landmarks[indices[0]]` with `indices = target_link_human_indices`, in meters.
    fn step_reference<'py>(
        &self,
        py: Python<'py>,
        reference: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>, f64)> {
        let Following::Library(library) = &self.0 else {
            return Err(wrong(
                "a hand's own file has no reference value".to_owned(),
                "call `step` with landmarks, or load a configuration of dex-retargeting",
            ));
        };
        let n = library.problem.objective().reference_count();
        let numbers = Rows::one("reference", reference, &[n, AXES])?;
        library.with(|live| {
            let found = live.step_reference(numbers.as_chunks::<AXES>().0);
            let found = found.map_err(|err| library_hand::refused(&err, ""))?;
            posture(py, found.posture, found.error_m)
        })
    }

    /// Forgets the steps so far: the next one is searched afresh.
    #[expect(
        clippy::redundant_closure_for_method_calls,
        reason = "the methods themselves are not general enough"
    )]
    fn reset(&self) {
        match &self.0 {
            Following::Own(own) => own.with(|live| live.reset()),
            Following::Library(library) => library.with(|live| live.reset()),
        }
    }

    /// Retargets a recording: `times` `(n,)` in seconds, increasing, and `landmarks` `(n, 21, 3)`.
    ///
    /// The last step is taken for the grasp: it is solved first, then the step before it, and so on. By a
    /// configuration of dex-retargeting the first step is solved first, as in a loop of `step` after `reset`.
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
        let model = self.model();
        format!(
            "<pipeline.Retargeter {:?}, {} joints>",
            model.name(),
            model.dof()
        )
    }
}

impl Retargeter {
    fn model(&self) -> &robot::RobotModel {
        match &self.0 {
            Following::Own(own) => &own.hand.model,
            Following::Library(library) => library.problem.model(),
        }
    }

    /// Returns the range of each joint.
    fn limits(&self) -> Box<dyn Iterator<Item = (f64, f64)> + '_> {
        match &self.0 {
            Following::Own(own) => {
                let joints = own.hand.model.joints().iter();
                Box::new(joints.map(|joint| (joint.lower, joint.upper)))
            }
            Following::Library(library) => Box::new(library.problem.limits().iter().copied()),
        }
    }

    /// Retargets recordings, several at once.
    fn retargeted(
        &self,
        py: Python<'_>,
        recordings: Vec<Vec<LandmarkStep>>,
    ) -> PyResult<Vec<Motion>> {
        match &self.0 {
            Following::Own(own) => {
                let run = |steps: &[LandmarkStep]| {
                    retargeting::retarget(&own.hand, &own.environment, &own.config, steps)
                };
                motions(retarget_each(py, recordings, run)?, own_hand::refused)
            }
            Following::Library(library) => {
                let run = |steps: &[LandmarkStep]| {
                    dex_retargeting::retarget(&library.problem, steps, Showing::AsTheyAre)
                };
                motions(retarget_each(py, recordings, run)?, library_hand::refused)
            }
        }
    }
}

/// Returns what the hand moves among: an object on the table, or nothing.
fn environment(
    py: Python<'_>,
    object: Option<&Object>,
    table_from_object: Option<&Bound<'_, PyAny>>,
) -> PyResult<Environment> {
    let Some(object) = object else {
        return match table_from_object {
            None => Ok(Environment::empty()),
            Some(_) => Err(wrong(
                "`table_from_object` is the pose of no object".to_owned(),
                "pass `object` too",
            )),
        };
    };
    let placed = object.placed(table_from_object)?;
    let field = Arc::clone(object.field(py)?);
    Ok(Environment::new(field, RestingPose::of(&placed)))
}

/// Runs recordings in all threads, until the computation is given up.
fn retarget_each<T: Send>(
    py: Python<'_>,
    recordings: Vec<Vec<LandmarkStep>>,
    run: impl Fn(&[LandmarkStep]) -> T + Sync + Send,
) -> PyResult<Vec<T>> {
    in_threads(py, |cancellation: &Cancellation| {
        let recordings = recordings.into_par_iter();
        let running = recordings.take_any_while(|_| !cancellation.is_asked());
        running.map(|steps| run(&steps)).collect()
    })
}

/// Returns motions, or the exception for the first recording that cannot be retargeted.
fn motions<T: Into<Motion>, E>(
    found: Vec<Result<Option<T>, E>>,
    refused: impl Fn(&E, &str) -> PyErr,
) -> PyResult<Vec<Motion>> {
    let n = found.len();
    let of = |idx: usize| match n {
        1 => String::new(),
        _ => format!("recording {idx}: "),
    };
    found
        .into_iter()
        .enumerate()
        .map(|(idx, retargeted)| match retargeted {
            Ok(Some(retargeted)) => Ok(retargeted.into()),
            Ok(None) => Err(wrong(
                format!("{}there are no steps", of(idx)),
                "pass one step at least",
            )),
            Err(err) => Err(refused(&err, &of(idx))),
        })
        .collect()
}

/// Returns a posture as arrays, with its error in meters.
fn posture<'py>(
    py: Python<'py>,
    posture: &Posture,
    error_m: f64,
) -> PyResult<(Array<'py>, Array<'py>, f64)> {
    let pose = pose_matrix(&posture.root.pose());
    Ok((
        array(py, &posture.q, None, &[posture.q.len()])?,
        array(py, &pose, None, &[4, 4])?,
        error_m,
    ))
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
