//! A robot hand by a configuration file of dex-retargeting.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use dex_retargeting::{Config, Follower, ObjectiveKind, Problem, ProblemError};
use pyo3::prelude::*;
use self_cell::self_cell;

use crate::error::{failed, wrong};

self_cell!(
    /// A follower with what it works on.
    struct Live {
        owner: Arc<Problem>,
        #[not_covariant]
        dependent: Follower,
    }
);

/// A robot hand that follows by an objective of dex-retargeting.
pub(crate) struct LibraryHand {
    pub(crate) problem: Arc<Problem>,
    live: Mutex<Live>,
}

impl LibraryHand {
    /// Says whether a path is that of such a file: all others are TOML or URDFs.
    pub(crate) fn is_configured_by(path: &Path) -> bool {
        let extension = path.extension().and_then(|extension| extension.to_str());
        extension.is_some_and(|extension| ["yml", "yaml"].contains(&extension))
    }

    /// Loads a configuration, and the URDF that it names in a folder: its own unless another is given.
    pub(crate) fn load(
        path: &Path,
        urdf_folder: Option<&Path>,
        limit_slack: f64,
    ) -> PyResult<Self> {
        let text = fs::read_to_string(path).map_err(|err| {
            wrong(
                format!("cannot read the configuration `{}`: {err}", path.display()),
                "pass the path of a YAML file of dex-retargeting",
            )
        })?;
        let of_file =
            |err: String| format!("cannot use the configuration `{}`: {err}", path.display());
        let config: Config = text.parse().map_err(|err: dex_retargeting::ConfigError| {
            let hint = err.hint().unwrap_or_default();
            wrong(of_file(err.to_string()), &hint)
        })?;
        let folder = urdf_folder.or_else(|| path.parent());
        let urdf_path = folder.map_or_else(PathBuf::new, Path::to_path_buf);
        let urdf_path = urdf_path.join(&config.urdf_path);
        let urdf = fs::read_to_string(&urdf_path).map_err(|err| {
            wrong(
                format!("cannot read the URDF `{}`: {err}", urdf_path.display()),
                "pass `urdf_folder`, the folder in which `urdf_path` of the configuration is: \
                 `robots/hands` of dex-urdf for those that dex-retargeting ships",
            )
        })?;
        let problem = Problem::new(&config, &urdf);
        let problem = problem.and_then(|problem| problem.with_limit_slack(limit_slack));
        let problem = problem.map_err(|err| {
            let hint = err.hint();
            failed(&err, hint)
        })?;
        let problem = Arc::new(problem);
        let live = Live::new(Arc::clone(&problem), |problem| Follower::new(problem));
        Ok(Self {
            problem,
            live: Mutex::new(live),
        })
    }

    /// Calls `with` with the follower; after a panic in another thread it is as it was left.
    pub(crate) fn with<R>(&self, with: impl FnOnce(&mut Follower<'_>) -> R) -> R {
        let mut live: MutexGuard<'_, Live> =
            self.live.lock().unwrap_or_else(PoisonError::into_inner);
        live.with_dependent_mut(|_, follower| with(follower))
    }

    /// Returns the size of the robot hand relative to the person's.
    pub(crate) fn scale(&self) -> f64 {
        match self.problem.objective().kind {
            ObjectiveKind::Position { .. } => 1.0,
            ObjectiveKind::Vector { scale, .. } | ObjectiveKind::DexPilot { scale, .. } => scale,
        }
    }

    /// Returns the numbers of the landmarks that are followed, as the library has them.
    pub(crate) fn landmarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match &self.problem.objective().kind {
            ObjectiveKind::Position { links } => {
                let landmarks: Vec<usize> = links.iter().map(|&(_, landmark)| landmark).collect();
                landmarks.into_pyobject(py)
            }
            ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
                let ends = [0, 1].map(|end| -> Vec<usize> {
                    vectors.iter().map(|vector| vector.landmarks[end]).collect()
                });
                ends.to_vec().into_pyobject(py)
            }
        }
    }
}

/// Returns the exception for a frame or a recording that cannot be retargeted.
pub(crate) fn refused(err: &ProblemError, of: &str) -> PyErr {
    let remedy = "check that landmarks are in meters and times in seconds, later from step to step";
    let hint = err.hint().unwrap_or_else(|| remedy.to_owned());
    wrong(format!("{of}{}", dataflow::with_causes(err)), &hint)
}
