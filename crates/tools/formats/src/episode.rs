//! A motion of a hand and an object, as it is exported.

use std::{collections::BTreeSet, sync::Arc};

use motion::{Motion, Step};
use spatial::{Object, Palm, Pose, Table};

use crate::FormatError;

/// The unit of a joint's position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Of joints that turn.
    Radian,
    /// Of prismatic joints.
    Meter,
}

impl Unit {
    /// Returns its symbol.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Radian => "rad",
            Self::Meter => "m",
        }
    }
}

/// A joint of the hand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Joint {
    /// Its name in the URDF.
    pub name: String,
    /// The unit of its position.
    pub unit: Unit,
}

/// One step of an episode: hand and object at a time.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeStep {
    /// Seconds; the first step's may be any.
    pub time_s: f64,
    /// Pose of the palm.
    pub table_from_palm: Pose<Table, Palm>,
    /// Pose of the object.
    pub table_from_object: Pose<Table, Object>,
    /// Joint positions, in the order of the joints.
    pub q: Vec<f64>,
    /// Commanded joint positions, if they are known.
    pub q_command: Option<Vec<f64>>,
}

/// A motion of a hand and an object over time.
#[derive(Debug, Clone)]
pub struct Episode {
    name: String,
    object: String,
    outcome: Option<String>,
    joints: Arc<[Joint]>,
    hand: Motion<Table, ()>,
    /// The object's poses, as those of a hand without joints.
    object_poses: Motion<Table, ()>,
    /// The hand with its commanded joint positions.
    command: Option<Motion<Table, ()>>,
}

impl Episode {
    /// Creates an episode from its steps in time order.
    ///
    /// # Errors
    ///
    /// Fails if there is no step, times do not increase, a number is not finite, a step has more or
    /// fewer positions than there are joints, or some steps alone have commands.
    pub fn new(
        name: &str,
        object: &str,
        joints: &[Joint],
        steps: &[EpisodeStep],
    ) -> Result<Self, FormatError> {
        let first_s = steps.first().map_or(0.0, |step| step.time_s);
        let motion_step = |step: &EpisodeStep, q: &[f64]| Step {
            time_s: step.time_s - first_s,
            frame_from_palm: step.table_from_palm,
            q_rad: q.to_vec(),
            rates: (),
        };
        let names: Vec<&str> = joints.iter().map(|joint| joint.name.as_str()).collect();
        let motion = |steps: Vec<Step<Table, ()>>, joints: &[&str]| {
            Motion::new(joints, steps).map_err(|source| FormatError::Motion {
                name: name.to_owned(),
                source,
            })
        };
        let hand = steps.iter().map(|step| motion_step(step, &step.q));
        let commands = steps.iter().filter_map(|step| {
            let q = step.q_command.as_ref()?;
            Some(motion_step(step, q))
        });
        let commands: Vec<_> = commands.collect();
        if !commands.is_empty() && commands.len() < steps.len() {
            return Err(FormatError::Commands {
                name: name.to_owned(),
            });
        }
        let objects = steps.iter().map(|step| Step {
            frame_from_palm: step.table_from_object.reinterpret(),
            ..motion_step(step, &[])
        });
        Ok(Self {
            hand: motion(hand.collect(), &names)?,
            object_poses: motion(objects.collect(), &[])?,
            command: match commands {
                commands if commands.is_empty() => None,
                commands => Some(motion(commands, &names)?),
            },
            name: name.to_owned(),
            object: object.to_owned(),
            outcome: None,
            joints: joints.into(),
        })
    }

    /// Returns the episode with how it ended, e.g. `held`.
    #[must_use]
    pub fn with_outcome(self, outcome: &str) -> Self {
        Self {
            outcome: Some(outcome.to_owned()),
            ..self
        }
    }

    /// Returns its name, e.g. that of its candidate.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the object's name.
    pub fn object(&self) -> &str {
        &self.object
    }

    /// Returns how it ended, if it was executed.
    pub fn outcome(&self) -> Option<&str> {
        self.outcome.as_deref()
    }

    /// Returns the hand's joints, in the order of the steps' positions.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Returns the duration in seconds.
    pub fn duration_s(&self) -> f64 {
        self.hand.duration_s()
    }

    /// Returns whether commanded positions are known.
    pub fn has_commands(&self) -> bool {
        self.command.is_some()
    }

    /// Returns the steps, with their times in seconds since the first.
    pub fn steps(&self) -> impl Iterator<Item = EpisodeStep> {
        let steps = self.hand.steps().iter().zip(self.object_poses.steps());
        steps.enumerate().map(|(idx, (hand, object))| {
            let command = self.command.as_ref().map(|motion| &motion.steps()[idx]);
            EpisodeStep {
                time_s: hand.time_s,
                table_from_palm: hand.frame_from_palm,
                table_from_object: object.frame_from_palm.reinterpret(),
                q: hand.q_rad.clone(),
                q_command: command.map(|step| step.q_rad.clone()),
            }
        })
    }

    /// Returns the step at a time in seconds since the first: between two steps, positions linear and
    /// rotations on the shortest arc; after the last, that of the last.
    pub fn at(&self, time_s: f64) -> EpisodeStep {
        let hand = self.hand.at(time_s);
        let object = self.object_poses.at(time_s);
        EpisodeStep {
            time_s,
            table_from_palm: hand.frame_from_palm,
            table_from_object: object.frame_from_palm.reinterpret(),
            q: hand.q_rad,
            q_command: self.command.as_ref().map(|motion| motion.at(time_s).q_rad),
        }
    }

    /// Returns the step after a fraction in 0..=1 of the duration.
    pub(crate) fn at_fraction(&self, fraction: f64) -> EpisodeStep {
        self.at(self.duration_s() * fraction)
    }
}

/// Checks that motions can be in one file.
///
/// # Errors
///
/// Fails if there is none, if two have one name, or if their joints differ.
pub(crate) fn check_together(episodes: &[Episode]) -> Result<&Episode, FormatError> {
    let first = episodes.first().ok_or(FormatError::Empty)?;
    let mut names = BTreeSet::new();
    for episode in episodes {
        if episode.joints != first.joints {
            return Err(FormatError::Joints {
                name: episode.name.clone(),
                first: first.name.clone(),
            });
        }
        if !names.insert(episode.name.as_str()) {
            return Err(FormatError::Twice {
                name: episode.name.clone(),
            });
        }
    }
    Ok(first)
}

/// Names of a pose's numbers, of the body `of`, with their units last; a quaternion's have none.
pub(crate) fn pose_names(of: &str) -> [String; 7] {
    ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"].map(|number| format!("{of}_{number}"))
}

/// Names of the joints' numbers with their units last.
pub(crate) fn joint_names(joints: &[Joint]) -> Vec<String> {
    let names = joints.iter();
    names
        .map(|joint| format!("{}_{}", joint.name, joint.unit.symbol()))
        .collect()
}

/// Says how many motions have no commands at the times of their positions, if there are any.
pub(crate) fn without_commands(episodes: &[Episode]) -> Option<String> {
    let without = episodes.iter().filter(|episode| !episode.has_commands());
    let (n, all) = (without.count(), episodes.len());
    (n > 0).then(|| {
        format!("commands: {n} of {all} motions have none at the times of their positions")
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// A step of a hand with two joints that turns and comes down on a still object.
    pub(crate) fn step(time_s: f64) -> EpisodeStep {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, -0.4, 0.3) * time_s);
        EpisodeStep {
            time_s,
            table_from_palm: Pose::from_parts([0.1, -0.02, 0.3 - 0.1 * time_s], turn),
            table_from_object: Pose::from_parts([0.0, 0.0, 0.05], UnitQuaternion::identity()),
            q: vec![0.4 * time_s, 0.01 * time_s],
            q_command: None,
        }
    }

    pub(crate) fn joints() -> [Joint; 2] {
        [("knuckle", Unit::Radian), ("slide", Unit::Meter)].map(|(name, unit)| Joint {
            name: name.to_owned(),
            unit,
        })
    }

    pub(crate) fn episode(name: &str, times_s: &[f64]) -> Episode {
        let steps = times_s.iter().map(|&time_s| step(time_s));
        Episode::new(name, "025_mug", &joints(), &steps.collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn times_count_from_the_first_moment() {
        let late = episode("a", &[5.0, 6.0]);
        let times: Vec<f64> = late.steps().map(|step| step.time_s).collect();
        assert_eq!(times, [0.0, 1.0]);
        assert_eq!(late.at(0.0).q, step(5.0).q);
    }

    #[test]
    fn refuses_what_is_no_motion() {
        let refused =
            |steps: Vec<EpisodeStep>| Episode::new("a", "o", &joints(), &steps).unwrap_err();
        assert!(matches!(refused(vec![]), FormatError::Motion { .. }));
        assert!(matches!(
            refused(vec![step(1.0), step(1.0)]),
            FormatError::Motion { .. }
        ));
        let commanded = EpisodeStep {
            q_command: Some(vec![0.0, 0.0]),
            ..step(1.0)
        };
        assert!(matches!(
            refused(vec![step(0.0), commanded]),
            FormatError::Commands { .. }
        ));
    }

    #[test]
    fn motions_of_one_name_or_of_other_joints_are_not_together() {
        let one = episode("a", &[0.0, 1.0]);
        let twice = check_together(&[one.clone(), one.clone()]).unwrap_err();
        assert!(matches!(twice, FormatError::Twice { .. }));
        let steps = vec![EpisodeStep {
            q: vec![0.0],
            ..step(0.0)
        }];
        let other = Episode::new("b", "o", &joints()[..1], &steps).unwrap();
        let mixed = check_together(&[one, other]).unwrap_err();
        assert!(matches!(mixed, FormatError::Joints { .. }));
        assert!(matches!(
            check_together(&[]).unwrap_err(),
            FormatError::Empty
        ));
    }
}
