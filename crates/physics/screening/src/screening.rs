//! All motions of one object through physics.

use std::{
    collections::BTreeSet,
    fmt::Display,
    sync::atomic::{AtomicUsize, Ordering},
};

use motion::{HandState, Motion, Smoothness, smoothness};
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;
use robot::RobotModel;
use simulation::{
    Measures, ObjectShape, Protocol, Rollout, SceneConfig, SettledScene, SimulationError,
    TraceMode, Verdict,
};
use spatial::{Object, Pose, RestingPose, Table};

use crate::pose_error::{PoseError, pose_noise_m};

/// Conditions under which motions are screened.
#[derive(Debug, Clone, Copy)]
pub struct ScreeningOptions<'a> {
    /// The physical scene.
    pub scene: &'a SceneConfig,
    /// Execution of a motion and its conditions of success.
    pub protocol: &'a Protocol,
    /// Deepest that the hand may be in an object that it holds, in meters; deeper is [`Verdict::TooDeep`].
    pub max_penetration_m: f64,
    /// Deepest that fingers that touch each other and the palm may be in each other and in the palm, in meters; deeper
    /// is [`Verdict::TooDeep`].
    pub max_finger_penetration_m: f64,
    /// Standard deviation of the noise on the object's position, along each axis as a share of the object's extent; 0
    /// for none.
    pub pose_noise: f64,
    /// Error of the object's estimated pose, in a direction of its own for each motion.
    pub pose_error: PoseError,
    /// Seed of the pose noise, the pose errors and of the errors of [`Screening::trials`].
    pub seed: u64,
}

impl ScreeningOptions<'_> {
    /// Returns the verdict on a rollout: physics alone lets a hand hold an object by being inside it, or inside itself.
    pub fn verdict(&self, rollout: &Rollout) -> Verdict {
        let Measures {
            penetration_m,
            finger_penetration_m,
            ..
        } = rollout.measures;
        let is_too_deep = penetration_m > Some(self.max_penetration_m)
            || finger_penetration_m > Some(self.max_finger_penetration_m);
        match rollout.verdict {
            Verdict::Held if is_too_deep => Verdict::TooDeep,
            verdict => verdict,
        }
    }
}

/// A motion of the hand, and how the object lies in it.
#[derive(Debug, Clone, Copy)]
pub struct PlacedMotion<'a> {
    /// Pose of the object on the table.
    pub table_from_object: Pose<Table, Object>,
    /// The hand in the object's frame, its joints in any order; the last step is the grasp.
    pub motion: &'a Motion<Object>,
}

/// What was found of a motion that the hand can execute.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgment {
    /// Success, or the reason for failure.
    pub verdict: Verdict,
    /// What the simulation measured.
    pub measures: Measures,
    /// Smoothness of the motion as given, without pose noise or error.
    pub smoothness: Smoothness,
    /// Smoothness as executed over the control steps of the reach; none unless the reach was simulated to its end.
    pub executed: Option<Smoothness>,
}

/// A hand, an object and the motions of that hand that are to grasp it.
pub struct Screening<'a> {
    pub(crate) options: ScreeningOptions<'a>,
    hand: &'a RobotModel,
    shape: ObjectShape,
    /// Extent of the object along its axes, in meters.
    extent_m: Vector3<f64>,
    motions: Vec<PlacedMotion<'a>>,
    /// The resting poses of the object.
    poses: Vec<Pose<Table, Object>>,
    /// The resting pose of each motion.
    pose_of: Vec<usize>,
}

/// One settled scene per resting pose of the object; nothing for a pose that no motion needs, or in which the
/// object does not come to rest.
pub struct Scenes(Vec<Option<SettledScene>>);

impl<'a> Screening<'a> {
    /// Takes a hand, an object with points of its surface in its own frame, in meters, and motions. Motions are named
    /// by their index from here on.
    pub fn new(
        options: ScreeningOptions<'a>,
        hand: &'a RobotModel,
        (shape, points_m): (ObjectShape, &[[f64; 3]]),
        motions: Vec<PlacedMotion<'a>>,
    ) -> Self {
        let mut poses: Vec<Pose<Table, Object>> = Vec::new();
        let mut pose_of = Vec::with_capacity(motions.len());
        for PlacedMotion {
            table_from_object, ..
        } in &motions
        {
            let known = poses.iter().position(|other| other == table_from_object);
            pose_of.push(known.unwrap_or_else(|| {
                poses.push(*table_from_object);
                poses.len() - 1
            }));
        }
        Self {
            options,
            hand,
            shape,
            extent_m: extent_m(points_m),
            motions,
            poses,
            pose_of,
        }
    }

    /// Builds the scenes of all motions.
    ///
    /// # Errors
    ///
    /// Fails if the hand, the object or the options cannot be simulated, or the object comes to rest in no pose.
    pub fn build_scenes(&self) -> Result<Scenes, SimulationError> {
        let all: Vec<usize> = (0..self.pose_of.len()).collect();
        let scenes = self.scenes(self.options.scene, &all)?;
        if !all.is_empty() && scenes.0.iter().all(Option::is_none) {
            return Err(SimulationError::Unsettled);
        }
        Ok(scenes)
    }

    /// Builds the scenes of the motions of these indices.
    ///
    /// # Errors
    ///
    /// Fails if the hand, the object or the scene cannot be simulated.
    ///
    /// # Panics
    ///
    /// Panics if there is no motion of an index, as everything does that takes one.
    pub fn scenes(
        &self,
        scene: &SceneConfig,
        motions: &[usize],
    ) -> Result<Scenes, SimulationError> {
        let needed: BTreeSet<usize> = motions.iter().map(|&idx| self.pose_of[idx]).collect();
        let poses = self.poses.par_iter().enumerate();
        let templates = poses.map(|(idx, pose)| {
            if !needed.contains(&idx) {
                return Ok(None);
            }
            feasible(SettledScene::new(
                scene,
                self.hand,
                &self.shape,
                &RestingPose::of(pose),
            ))
        });
        templates.collect::<Result<_, _>>().map(Scenes)
    }

    /// Judges all motions, in their order, on all threads, and says how much processor time that took, in seconds;
    /// `progress` is told the share that is done. Nothing is found of a motion that the hand cannot execute, or in
    /// which the object does not come to rest as it lies in it: it is [`Verdict::Infeasible`].
    ///
    /// # Errors
    ///
    /// Fails if the protocol names a joint that the hand lacks.
    pub fn judge(
        &self,
        scenes: &Scenes,
        progress: impl Fn(f64) + Sync,
    ) -> Result<(Vec<Option<Judgment>>, f64), SimulationError> {
        let total = self.motions.len();
        let done = AtomicUsize::new(0);
        let judged: Vec<(Option<Judgment>, f64)> = (0..total)
            .into_par_iter()
            .map(|idx| {
                let (rollout, cpu_s) =
                    cpu_time::measured(|| self.rollout(scenes, idx, TraceMode::Nothing));
                let found = self.found(idx, rollout)?;
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f64 / total as f64);
                Ok((found, cpu_s))
            })
            .collect::<Result<_, SimulationError>>()?;
        let cpu_s = judged.iter().map(|(_, cpu_s)| cpu_s).sum();
        Ok((judged.into_iter().map(|(found, _)| found).collect(), cpu_s))
    }

    /// Judges one motion, as [`Self::judge`] does.
    ///
    /// # Errors
    ///
    /// Fails as that does.
    ///
    /// # Panics
    ///
    /// Panics if there is no motion of this index.
    pub fn judge_one(
        &self,
        scenes: &Scenes,
        idx: usize,
    ) -> Result<Option<Judgment>, SimulationError> {
        self.found(idx, self.rollout(scenes, idx, TraceMode::Nothing))
    }

    /// Returns the verdicts on the motions of these indices, in their order, with the simulated control steps of each.
    ///
    /// # Errors
    ///
    /// Fails if the protocol names a joint that the hand lacks.
    ///
    /// # Panics
    ///
    /// Panics if there is no motion of an index.
    pub fn verdicts(
        &self,
        scenes: &Scenes,
        motions: &[usize],
    ) -> Result<Vec<(Verdict, u32)>, SimulationError> {
        let verdicts = motions.par_iter().map(|&idx| {
            let rollout = feasible(self.rollout(scenes, idx, TraceMode::Nothing))?;
            Ok(rollout.map_or((Verdict::Infeasible, 0), |rollout| {
                (
                    self.options.verdict(&rollout),
                    rollout.measures.control_steps_n,
                )
            }))
        });
        verdicts.collect()
    }

    /// Executes one motion, with its pose noise and error. Equal arguments give an equal rollout, alone or among
    /// others.
    ///
    /// # Errors
    ///
    /// Fails if the motion is not one of the hand, if the object does not come to rest as it lies in it, or if the
    /// protocol names a joint that the hand lacks.
    pub fn rollout(
        &self,
        scenes: &Scenes,
        idx: usize,
        record: TraceMode,
    ) -> Result<Rollout, SimulationError> {
        let settled = scenes.0[self.pose_of[idx]].as_ref();
        let settled = settled.ok_or(SimulationError::Unsettled)?;
        let motion = self.in_order(idx)?.moved(&self.pose_offset(idx));
        settled.rollout(&motion, self.options.protocol, record)
    }

    /// Returns what is found of a motion by its rollout; nothing if the motion is at fault that there is none.
    fn found(
        &self,
        idx: usize,
        rollout: Result<Rollout, SimulationError>,
    ) -> Result<Option<Judgment>, SimulationError> {
        feasible(rollout.and_then(|rollout| self.judgment(idx, &rollout)))
    }

    fn judgment(&self, idx: usize, rollout: &Rollout) -> Result<Judgment, SimulationError> {
        let motion = self.in_order(idx)?;
        let drawn: Vec<HandState<_>> = motion.steps().iter().map(HandState::from).collect();
        let measured = |steps: &[HandState<_>]| smoothness(steps, self.hand).map_err(motion_error);
        let has_reached = !rollout.executed.is_empty();
        let executed = has_reached.then(|| measured(&rollout.executed));
        Ok(Judgment {
            verdict: self.options.verdict(rollout),
            measures: rollout.measures,
            smoothness: measured(&drawn)?,
            executed: executed.transpose()?,
        })
    }

    /// Returns a motion with the joints in the hand's order.
    fn in_order(&self, idx: usize) -> Result<Motion<Object>, SimulationError> {
        let joints = self.hand.joint_names();
        let motion = self.motions[idx].motion;
        motion.reordered(&joints).map_err(motion_error)
    }

    /// Returns how far a motion is off in the object's frame, by pose noise and error.
    fn pose_offset(&self, idx: usize) -> Pose<Object, Object> {
        let ScreeningOptions {
            pose_noise,
            pose_error,
            seed,
            ..
        } = self.options;
        let lying = &self.poses[self.pose_of[idx]];
        let error = pose_error.draw(lying, seed, idx);
        if pose_noise > 0.0 {
            let noise_m = pose_noise_m(&(self.extent_m * pose_noise), seed, idx);
            Pose::from_parts(noise_m, UnitQuaternion::identity()) * error
        } else {
            error
        }
    }
}

/// Returns nothing where a motion is at fault: the hand's, or how the object lies in it.
fn feasible<T>(simulated: Result<T, SimulationError>) -> Result<Option<T>, SimulationError> {
    match simulated {
        Ok(simulated) => Ok(Some(simulated)),
        Err(SimulationError::Motion(_) | SimulationError::Unsettled) => Ok(None),
        Err(err) => Err(err),
    }
}

/// A motion that is not one of the hand.
fn motion_error(err: impl Display) -> SimulationError {
    SimulationError::Motion(err.to_string())
}

/// Returns how far an object's points reach along its axes.
fn extent_m(points_m: &[[f64; 3]]) -> Vector3<f64> {
    let points = || points_m.iter().map(|&point| Vector3::from(point));
    let most = points().reduce(|a, b| a.sup(&b)).unwrap_or_default();
    let least = points().reduce(|a, b| a.inf(&b)).unwrap_or_default();
    most - least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn a_motion_that_the_hand_cannot_execute_is_infeasible_among_the_others() {
        let (hand, scene, protocol) = (fixture::hand(), fixture::scene(), fixture::protocol());
        let options = fixture::options(&scene, &protocol);
        let [own, of_another_hand] = ["j", "k"].map(fixture::waiting);
        let motions = [&own, &of_another_hand, &own].map(fixture::placed).to_vec();
        let (shape, points_m) = fixture::cube();
        let screening = Screening::new(options, &hand, (shape, &points_m), motions);
        let (found, _) = screening
            .judge(&screening.build_scenes().unwrap(), |_| {})
            .unwrap();
        let verdicts: Vec<Option<Verdict>> = found
            .iter()
            .map(|found| found.map(|found| found.verdict))
            .collect();
        let missed = Some(Verdict::NotGrasped);
        assert_eq!(verdicts, [missed, None, missed]);
        assert!(found[0].unwrap().measures.control_steps_n > 0);
    }
}
