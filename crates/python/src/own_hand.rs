//! A robot hand by its own file, with the objective of the stage `retarget`.

use std::{
    path::Path,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use dataflow::{Diagnostic, with_causes};
use hand_files::HandFile;
use posture::{Environment, Hand};
use pyo3::{prelude::*, types::PyDict};
use retargeting::{LiveRetargeting, RetargetingConfig, RetargetingError};
use schemas::demonstrations::Side;
use self_cell::self_cell;
use serde_json::json;
use stage_retarget::RetargetConfig;

use crate::{
    error::{failed, wrong},
    options,
};

/// What a live follower works on.
struct Work {
    hand: Hand,
    environment: Arc<Environment>,
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

/// A robot hand that follows by the objective of the stage `retarget`.
pub(crate) struct OwnHand {
    pub(crate) hand: Hand,
    pub(crate) environment: Arc<Environment>,
    pub(crate) side: Side,
    pub(crate) config: RetargetingConfig,
    live: Mutex<Live>,
}

impl OwnHand {
    /// Loads a hand from its file or its URDF alone, with options of the stage, to move among these things.
    pub(crate) fn load(
        path: &Path,
        options: Option<&Bound<'_, PyDict>>,
        environment: Environment,
    ) -> PyResult<Self> {
        let (hand, side) = load(path)?;
        // The hand is given, whatever its file.
        let hands = ["hand", "hand_table"].map(|file| (file, json!("")));
        let config: RetargetConfig = options::read("retarget", options, None, &hands)?;
        let config = config.retargeting;
        let environment = Arc::new(environment);
        let work = Work {
            hand: hand.clone(),
            environment: Arc::clone(&environment),
            config: config.clone(),
        };
        let live = Live::try_new(work, |work| {
            LiveRetargeting::new(&work.hand, &work.environment, &work.config)
        });
        Ok(Self {
            live: Mutex::new(live.map_err(|err| refused(&err, ""))?),
            hand,
            environment,
            side,
            config,
        })
    }

    /// Calls `with` with the follower; after a panic in another thread it is as it was left, and the next step searches
    /// from there.
    pub(crate) fn with<R>(&self, with: impl FnOnce(&mut LiveRetargeting<'_>) -> R) -> R {
        let mut live: MutexGuard<'_, Live> =
            self.live.lock().unwrap_or_else(PoisonError::into_inner);
        live.with_dependent_mut(|_, follower| with(follower))
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

/// Returns the exception for a motion that cannot be retargeted.
pub(crate) fn refused(err: &RetargetingError, of: &str) -> PyErr {
    let remedy = "check that landmarks are in meters and times in seconds, later from step to step";
    let hint = err.hint().unwrap_or_else(|| remedy.to_owned());
    wrong(format!("{of}{}", with_causes(err)), &hint)
}
