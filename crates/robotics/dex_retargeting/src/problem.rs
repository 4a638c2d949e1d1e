//! A configuration on a robot.

use nalgebra::Point3;
use posture::{CompiledHand, Posture, Root, RootPose};
use robot::RobotModel;

use crate::{Config, Objective, ObjectiveKind, ProblemError};

/// What a configuration asks of a robot.
#[derive(Debug)]
pub struct Problem {
    pub(crate) model: RobotModel,
    pub(crate) hand: CompiledHand,
    pub(crate) objective: Objective,
    pub(crate) low_pass_alpha: Option<f64>,
    /// Where a stream starts: the root at the origin, each joint in the middle of its range.
    pub(crate) start: Posture,
    /// The points at the ends of each vector.
    pub(crate) vectors: Vec<[usize; 2]>,
    limits: Vec<(f64, f64)>,
    has_free_root: bool,
}

impl Problem {
    /// Returns what a configuration asks of the robot of a URDF's text.
    ///
    /// # Errors
    ///
    /// Fails if the URDF cannot be used, or has no link or joint that the configuration names.
    pub fn new(config: &Config, urdf: &str) -> Result<Self, ProblemError> {
        let alone = RobotModel::from_urdf_without_mimics(urdf)?;
        let model = if config.ignore_mimic_joint {
            alone.clone()
        } else {
            RobotModel::from_urdf(urdf)?
        };
        let (names, vectors) = ends(&config.objective.kind);
        let points = names
            .iter()
            .map(|name| Ok((model.require_link(name)?, Point3::origin())))
            .collect::<Result<Vec<_>, ProblemError>>()?;
        let limits = limits(config, &model, &alone)?;
        let root = if config.add_dummy_free_joint {
            Root::Angles
        } else {
            Root::Fixed
        };
        let hand = CompiledHand::with_vectors(&model, root, &points, &vectors)?;
        let middle = limits.iter().map(|&(lower, upper)| {
            let middle = 0.5 * (lower + upper);
            // A joint without end.
            if middle.is_finite() { middle } else { 0.0 }
        });
        Ok(Self {
            hand: hand.with_limits(&limits)?,
            objective: config.objective.clone(),
            low_pass_alpha: config.low_pass_alpha,
            start: Posture {
                root: RootPose::identity(),
                q: middle.collect(),
            },
            vectors,
            model,
            limits,
            has_free_root: config.add_dummy_free_joint,
        })
    }

    /// Returns the problem with limits of all joints that are solved for this much wider at both ends, in radians
    /// (meters if prismatic): the library's are wider by 1e-3.
    ///
    /// # Errors
    ///
    /// Fails if it is negative or not finite.
    pub fn with_limit_slack(mut self, slack: f64) -> Result<Self, ProblemError> {
        if !(slack.is_finite() && slack >= 0.0) {
            return Err(ProblemError::Slack { slack });
        }
        for (lower, upper) in &mut self.limits {
            if *lower < *upper {
                (*lower, *upper) = (*lower - slack, *upper + slack);
            }
        }
        self.hand = self.hand.with_limits(&self.limits)?;
        Ok(self)
    }

    /// Returns the robot.
    pub fn model(&self) -> &RobotModel {
        &self.model
    }

    /// Returns what is to be followed.
    pub fn objective(&self) -> &Objective {
        &self.objective
    }

    /// Returns the least and the greatest position of each joint, in radians (meters if prismatic).
    pub fn limits(&self) -> &[(f64, f64)] {
        &self.limits
    }

    /// Says whether the root link moves.
    pub fn has_free_root(&self) -> bool {
        self.has_free_root
    }
}

/// Returns the links whose origins count, and the vectors between them by their numbers.
fn ends(kind: &ObjectiveKind) -> (Vec<&str>, Vec<[usize; 2]>) {
    match kind {
        ObjectiveKind::Position { links } => {
            let names = links.iter().map(|(link, _)| link.as_str());
            (names.collect(), Vec::new())
        }
        ObjectiveKind::Vector { vectors, .. } | ObjectiveKind::DexPilot { vectors, .. } => {
            let mut names: Vec<&str> = Vec::new();
            let ends = vectors.iter().map(|vector| {
                [0, 1].map(|end| {
                    let name = vector.links[end].as_str();
                    names
                        .iter()
                        .position(|&known| known == name)
                        .unwrap_or_else(|| {
                            names.push(name);
                            names.len() - 1
                        })
                })
            });
            let ends = ends.collect();
            (names, ends)
        }
    }
}

/// Returns the range of each joint: one that is not solved for has a single position.
///
/// The library knows of no limits of joints that mimic others, and so the range is that which the joint has `alone`.
fn limits(
    config: &Config,
    model: &RobotModel,
    alone: &RobotModel,
) -> Result<Vec<(f64, f64)>, ProblemError> {
    let joints = alone.require_joints(&model.joint_names())?;
    let joints = joints.into_iter().map(|joint| &alone.joints()[joint]);
    let mut limits: Vec<(f64, f64)> = joints.map(|joint| (joint.lower, joint.upper)).collect();
    if let Some(names) = &config.target_joint_names {
        let targets = model.require_joints(names)?;
        for (joint, (lower, upper)) in limits.iter_mut().enumerate() {
            if !targets.contains(&joint) {
                let held = 0.0_f64.max(*lower).min(*upper);
                (*lower, *upper) = (held, held);
            }
        }
    }
    if !config.has_joint_limits {
        for (lower, upper) in &mut limits {
            if *lower < *upper {
                (*lower, *upper) = (-UNLIMITED, UNLIMITED);
            }
        }
    }
    Ok(limits)
}

/// Position that a joint without limits does not reach, in radians or meters: the library's.
const UNLIMITED: f64 = 1e4;
