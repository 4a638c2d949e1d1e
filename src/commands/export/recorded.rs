//! A motion as it was measured, from its recording.

use dataflow::{Artifact, Diagnostic};
use formats::{Episode, EpisodeStep, FormatError};
use lake::recording;
use robot::RobotModel;
use stage_report::RecordedMotion;

use super::gather::joints;
use crate::outcome::CommandError;

/// Returns the recorded motion of a candidate, if it was recorded: with an arm where the recording has one, and
/// the pose of the hand's root link as the palm's.
///
/// # Errors
///
/// Fails if the recording is damaged, or is of a robot without the hand.
pub(super) fn episode(
    artifact: &Artifact,
    candidate: &str,
    object: &str,
    hand: &RobotModel,
) -> Result<Option<Episode>, CommandError> {
    let Some(path) = artifact.file(&format!("{candidate}.mcap")) else {
        return Ok(None);
    };
    let motion = RecordedMotion::read(candidate, &recording::read(path)?, None)
        .map_err(CommandError::with_hint(Diagnostic::hint))?;
    let palm = hand
        .links()
        .first()
        .and_then(|root| motion.robot.link(&root.name));
    let palm = palm.ok_or_else(|| {
        CommandError::usage(
            format!(
                "the recording of `{candidate}` is of a robot without the hand `{}`",
                hand.name()
            ),
            "name the hand of the recording with `--hand`",
        )
    })?;
    let steps = motion.moments.into_iter().map(|moment| {
        let root_from_links = motion.robot.link_poses(|joint| moment.q[joint]);
        EpisodeStep {
            time_s: moment.time_s,
            table_from_palm: (moment.table_from_root * root_from_links[palm]).reinterpret(),
            table_from_object: moment.table_from_object,
            q: moment.q,
            q_command: moment.q_command,
        }
    });
    let joints = joints(&motion.robot.joint_names(), &motion.robot);
    let episode = Episode::new(candidate, object, &joints, &steps.collect::<Vec<_>>());
    Ok(Some(
        episode.map_err(CommandError::with_hint(FormatError::hint))?,
    ))
}
