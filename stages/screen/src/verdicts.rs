//! All candidates of one object through physics.

use std::{
    collections::BTreeSet,
    fmt::Display,
    sync::atomic::{AtomicUsize, Ordering},
};

use motion::{HandState, Motion};
use nalgebra::{Translation3, Vector3};
use rayon::prelude::*;
use robot::RobotModel;
use schemas::{
    candidates::{Candidate, Candidates},
    objects::Object,
    rollouts::{self, ExecutedSmoothness, Verdict},
};
use simulation::{ObjectShape, Rollout, SceneConfig, SettledScene, SimulationError, TraceMode};
use spatial::{Object as InObject, Pose, RestingPose, Table};

use crate::{ScreenConfig, pose_noise::pose_noise_m, smoothness::smoothness};

/// The candidates of an object, and how it lies in them.
pub(crate) struct Screening<'a> {
    config: &'a ScreenConfig,
    candidates: &'a Candidates,
    model: &'a RobotModel,
    shape: ObjectShape,
    /// Extent of the object along its axes, in meters.
    extent_m: Vector3<f64>,
    seed: u64,
    /// The resting poses of the object.
    poses: Vec<Pose<Table, InObject>>,
    /// The resting pose of each candidate.
    pose_of: Vec<usize>,
}

/// One settled scene per resting pose of the object; nothing for a pose that no candidate needs, or in which the
/// object does not come to rest.
pub(crate) struct Scenes(Vec<Option<SettledScene>>);

impl<'a> Screening<'a> {
    /// Takes an object and its candidates; `seed` draws the pose noise.
    pub(crate) fn new(
        config: &'a ScreenConfig,
        model: &'a RobotModel,
        object: &Object,
        candidates: &'a Candidates,
        seed: u64,
    ) -> Self {
        let mut poses: Vec<Pose<Table, InObject>> = Vec::new();
        let mut pose_of = Vec::with_capacity(candidates.candidates.len());
        for candidate in &candidates.candidates {
            let pose = candidate.table_from_object;
            let known = poses.iter().position(|other| *other == pose);
            pose_of.push(known.unwrap_or_else(|| {
                poses.push(pose);
                poses.len() - 1
            }));
        }
        Self {
            config,
            candidates,
            model,
            shape: ObjectShape::from_artifact(object),
            extent_m: extent_m(object),
            seed,
            poses,
            pose_of,
        }
    }

    /// Builds the scenes of all candidates. Fails if the object comes to rest in none of them.
    pub(crate) fn build_scenes(&self) -> Result<Scenes, SimulationError> {
        let all: Vec<usize> = (0..self.pose_of.len()).collect();
        let scenes = self.scenes(&self.config.scene, &all)?;
        if !all.is_empty() && scenes.0.iter().all(Option::is_none) {
            return Err(SimulationError::Unsettled);
        }
        Ok(scenes)
    }

    /// Builds the scenes of some candidates.
    pub(crate) fn scenes(
        &self,
        scene: &SceneConfig,
        candidates: &[usize],
    ) -> Result<Scenes, SimulationError> {
        let needed: BTreeSet<usize> = candidates.iter().map(|&idx| self.pose_of[idx]).collect();
        let poses = self.poses.par_iter().enumerate();
        let templates = poses.map(|(idx, pose)| {
            if !needed.contains(&idx) {
                return Ok(None);
            }
            feasible(SettledScene::new(
                scene,
                self.model,
                &self.shape,
                &RestingPose::of(pose),
            ))
        });
        templates.collect::<Result<_, _>>().map(Scenes)
    }

    /// Judges all candidates, in their order, and says how much processor time that took, in seconds; `progress` is
    /// told the share that is done.
    pub(crate) fn judge(
        &self,
        scenes: &Scenes,
        progress: impl Fn(f64) + Sync,
    ) -> Result<(Vec<rollouts::Rollout>, f64), SimulationError> {
        let total = self.candidates.candidates.len();
        let done = AtomicUsize::new(0);
        let judged: Vec<(rollouts::Rollout, f64)> = (0..total)
            .into_par_iter()
            .map(|idx| {
                let candidate = self.candidate(idx);
                let (rollout, cpu_s) =
                    cpu_time::measured(|| self.rollout(scenes, idx, TraceMode::Nothing));
                let row = feasible(rollout.and_then(|rollout| self.row(candidate, &rollout)))?;
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f64 / total as f64);
                Ok((row.unwrap_or_else(|| infeasible(candidate)), cpu_s))
            })
            .collect::<Result<_, SimulationError>>()?;
        let cpu_s = judged.iter().map(|(_, cpu_s)| cpu_s).sum();
        Ok((judged.into_iter().map(|(row, _)| row).collect(), cpu_s))
    }

    /// Returns the verdicts on some candidates, in their order, with the simulated control steps of each.
    pub(crate) fn verdicts(
        &self,
        scenes: &Scenes,
        candidates: &[usize],
    ) -> Result<Vec<(Verdict, u32)>, SimulationError> {
        let verdicts = candidates.par_iter().map(|&idx| {
            let rollout = feasible(self.rollout(scenes, idx, TraceMode::Nothing))?;
            Ok(rollout.map_or((Verdict::Infeasible, 0), |rollout| {
                (self.config.verdict(&rollout), rollout.control_steps_n)
            }))
        });
        verdicts.collect()
    }

    /// Returns a candidate.
    pub(crate) fn candidate(&self, idx: usize) -> &Candidate {
        &self.candidates.candidates[idx]
    }

    /// Carries out one candidate.
    pub(crate) fn rollout(
        &self,
        scenes: &Scenes,
        idx: usize,
        record: TraceMode,
    ) -> Result<Rollout, SimulationError> {
        let settled = scenes.0[self.pose_of[idx]].as_ref();
        let settled = settled.ok_or(SimulationError::Unsettled)?;
        let motion = self.motion(idx, self.candidate(idx))?;
        settled.rollout(&motion, &self.config.protocol, record)
    }

    /// Returns a candidate's motion with the joints in the hand's order.
    fn in_order(&self, candidate: &Candidate) -> Result<Motion<InObject>, SimulationError> {
        let joints = self.model.joint_names();
        candidate.motion.reordered(&joints).map_err(motion_error)
    }

    /// Returns the same, shifted by the pose noise.
    fn motion(
        &self,
        idx: usize,
        candidate: &Candidate,
    ) -> Result<Motion<InObject>, SimulationError> {
        let scale = self.config.pose_noise;
        let noise_m = Translation3::from(if scale > 0.0 {
            pose_noise_m(&(self.extent_m * scale), self.seed, idx)
        } else {
            Vector3::zeros()
        });
        Ok(self.in_order(candidate)?.shifted(&noise_m))
    }
}

/// Returns nothing where a candidate is at fault: its motion, or how the object lies in it.
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
fn extent_m(object: &Object) -> Vector3<f64> {
    let points = || object.points_m.iter().map(|&point| Vector3::from(point));
    let most = points().reduce(|a, b| a.sup(&b)).unwrap_or_default();
    let least = points().reduce(|a, b| a.inf(&b)).unwrap_or_default();
    most - least
}

impl Screening<'_> {
    fn row(
        &self,
        candidate: &Candidate,
        rollout: &Rollout,
    ) -> Result<rollouts::Rollout, SimulationError> {
        let motion = self.in_order(candidate)?;
        let drawn: Vec<HandState<_>> = motion.steps().iter().map(HandState::from).collect();
        let measured = |steps: &[HandState<_>]| smoothness(steps, self.model).map_err(motion_error);
        let has_reached = !rollout.executed.is_empty();
        let executed = has_reached.then(|| measured(&rollout.executed));
        Ok(rollouts::Rollout {
            verdict: self.config.verdict(rollout),
            control_steps_n: rollout.control_steps_n,
            skipped_steps_n: rollout.skipped_steps_n,
            lift_m: rollout.lift_m,
            slip_m: rollout.slip_m,
            displacement_m: rollout.displacement_m,
            penetration_m: rollout.penetration_m,
            contacts_n: rollout.contacts_n,
            smoothness: measured(&drawn)?,
            executed: ExecutedSmoothness(executed.transpose()?),
            ..infeasible(candidate)
        })
    }
}

/// Returns the row of a candidate of which nothing can be simulated.
fn infeasible(candidate: &Candidate) -> rollouts::Rollout {
    rollouts::Rollout::unsimulated(candidate, Verdict::Infeasible)
}

#[cfg(test)]
mod tests {
    use motion::{HandRates, Step};
    use nalgebra::Isometry3;
    use schemas::candidates::DrawSource;

    use super::*;
    use crate::config;

    /// A finger that slides, as a ball.
    const HAND: &str = r#"<robot name="h"><link name="palm"/>
      <link name="tip"><inertial><mass value="0.1"/>
        <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
      <joint name="j" type="prismatic"><parent link="palm"/><child link="tip"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;

    fn cube() -> Object {
        let ends = [-0.02, 0.02];
        let points_m: Vec<[f64; 3]> = ends
            .into_iter()
            .flat_map(|x| ends.into_iter().flat_map(move |y| ends.map(|z| [x, y, z])))
            .collect();
        Object {
            name: "cube".to_owned(),
            mass_kg: 0.1,
            center_of_mass_m: [0.0; 3],
            inertia_kg_m2: [3e-5, 3e-5, 3e-5, 0.0, 0.0, 0.0],
            normals: vec![[1.0, 0.0, 0.0]; points_m.len()],
            watertight: true,
            mirror: None,
            vertices_m: points_m.clone(),
            triangles: vec![[0, 1, 2]],
            parts_m: vec![points_m.clone()],
            points_m,
            rests: Vec::new(),
        }
    }

    /// A hand of one joint that waits beside the cube.
    fn candidate(name: &str, joint: &str) -> Candidate {
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::translation(0.3, 0.0, 0.1)),
            q_rad: vec![0.0],
            rates: HandRates::zero(1),
        };
        Candidate {
            candidate_id: name.to_owned(),
            generator: "test".to_owned(),
            source: DrawSource::replayed(name),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 0.02)),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: Motion::new(&[joint], vec![step(0.0), step(1.0)]).unwrap(),
        }
    }

    #[test]
    fn a_candidate_that_the_hand_cannot_execute_is_a_row_among_the_others() {
        let config = config::fixture();
        let model = RobotModel::from_urdf(HAND).unwrap();
        let candidates = Candidates {
            object: "cube".to_owned(),
            joints: ["j".to_owned()].into(),
            candidates: vec![
                candidate("a", "j"),
                candidate("b", "k"),
                candidate("c", "j"),
            ],
        };
        let screening = Screening::new(&config, &model, &cube(), &candidates, 7);
        let (rows, _) = screening
            .judge(&screening.build_scenes().unwrap(), |_| {})
            .unwrap();
        let verdicts: Vec<(&str, Verdict)> = rows
            .iter()
            .map(|row| (row.candidate_id.as_str(), row.verdict))
            .collect();
        assert_eq!(
            verdicts,
            [
                ("a", Verdict::NotGrasped),
                ("b", Verdict::Infeasible),
                ("c", Verdict::NotGrasped),
            ]
        );
        assert_eq!((rows[1].control_steps_n, rows[1].skipped_steps_n), (0, 0));
        assert_eq!(rows[1].source, candidates.candidates[1].source);
        assert!(rows[0].control_steps_n > 0);
    }
}
