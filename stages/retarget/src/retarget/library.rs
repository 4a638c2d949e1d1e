//! Trajectories by an objective of dex-retargeting.
//!
//! A hand without `add_dummy_free_joint` is shown the landmarks along the person's wrist, as the library's detector
//! shows them, and its palm goes along with that wrist; a free one starts there.

use std::{fs, path::Path};

use dex_retargeting::{Config, Problem, ProblemError, Showing};
use posture::{Environment, Hand, HandTable};
use retargeting::{LandmarkStep, Retargeted, RetargetingConfig, tracking};

use crate::RetargetError;

/// Name of the configuration file among the files of a unit.
pub(super) const FILE: &str = "dex_retargeting";

/// Returns what a configuration file asks of a hand.
pub(super) fn problem(path: &Path, hand: &Hand, urdf: &str) -> Result<Problem, RetargetError> {
    let text = fs::read_to_string(path).map_err(|source| RetargetError::ReadConfiguration {
        path: path.to_owned(),
        source,
    })?;
    let config: Config = text
        .parse()
        .map_err(|source| RetargetError::Configuration {
            path: path.to_owned(),
            source,
        })?;
    let problem = Problem::new(&config, urdf).map_err(|source| of_hand(path, source))?;
    if problem.model().joint_names() != hand.model.joint_names() {
        return Err(RetargetError::OtherJoints {
            path: path.to_owned(),
        });
    }
    Ok(problem)
}

/// A demonstration for a hand.
pub(super) struct Shown<'a> {
    pub(super) hand: &'a Hand,
    pub(super) table: &'a HandTable,
    pub(super) environment: &'a Environment,
    pub(super) config: &'a RetargetingConfig,
    pub(super) steps: &'a [LandmarkStep],
}

/// Retargets a demonstration; `None` of no step, a reason if its landmarks or times cannot be followed.
///
/// Errors in `tracking` are those of the hand's own points; the error at the grasp is that of what the configuration
/// follows.
pub(super) fn retarget(
    problem: &Problem,
    path: &Path,
    shown: &Shown<'_>,
) -> Result<Result<Option<Retargeted>, String>, RetargetError> {
    let along = Showing::AlongTheWrist(shown.table.side);
    let sequence = match dex_retargeting::retarget(problem, shown.steps, along) {
        Ok(Some(sequence)) => sequence,
        Ok(None) => return Ok(Ok(None)),
        Err(err @ (ProblemError::Motion(_) | ProblemError::NoWrist { .. })) => {
            return Ok(Err(err.to_string()));
        }
        Err(source) => return Err(of_hand(path, source)),
    };
    let errors = sequence.errors_m.last().map_or(&[][..], Vec::as_slice);
    let squares: f64 = errors.iter().map(|error| error * error).sum();
    let motion = sequence.motion;
    Ok(Ok(Some(Retargeted {
        tracking: tracking(
            shown.hand,
            shown.environment,
            shown.config,
            shown.steps,
            &motion,
        )?,
        grasp_keypoint_error_m: (squares / errors.len().max(1) as f64).sqrt(),
        restarts_n: 0,
        iterations_n: sequence.iterations_n,
        motion,
    })))
}

fn of_hand(path: &Path, source: ProblemError) -> RetargetError {
    RetargetError::ConfiguredHand {
        path: path.to_owned(),
        source: Box::new(source),
    }
}
