//! All candidates of one object through physics.

use std::{
    collections::BTreeSet,
    fmt::Display,
    sync::atomic::{AtomicUsize, Ordering},
};

use motion::Motion;
use nalgebra::{Translation3, Vector3};
use rayon::prelude::*;
use robot::RobotModel;
use schemas::{
    candidates::{Candidate, Candidates},
    objects::Object,
    rollouts::{self, Smoothness, Verdict},
};
use simulation::{ObjectShape, Record, Rollout, SceneConfig, SimulationError, Template};
use spatial::{Object as InObject, Pose, Rest, Table};

use crate::{ScreenConfig, pose_noise::pose_noise_m, smoothness::smoothness};

/// One settled scene per resting pose of the object.
pub(crate) struct Screening<'a> {
    config: &'a ScreenConfig,
    candidates: &'a Candidates,
    model: &'a RobotModel,
    /// How far the object reaches along its axes, in meters.
    extent_m: Vector3<f64>,
    seed: u64,
    /// Nothing for a pose in which the object does not come to rest.
    templates: Vec<Option<Template>>,
    /// The template of each candidate.
    template_of: Vec<usize>,
    /// The resting pose of each template.
    poses: Vec<Pose<Table, InObject>>,
    shape: ObjectShape,
}

impl<'a> Screening<'a> {
    /// Builds the scenes; `seed` draws the pose noise. Fails if the object comes to rest in none of them.
    pub(crate) fn new(
        config: &'a ScreenConfig,
        model: &'a RobotModel,
        object: &Object,
        candidates: &'a Candidates,
        seed: u64,
    ) -> Result<Self, SimulationError> {
        let mut poses: Vec<Pose<Table, InObject>> = Vec::new();
        let mut template_of = Vec::with_capacity(candidates.candidates.len());
        for candidate in &candidates.candidates {
            let pose = candidate.table_from_object;
            let known = poses.iter().position(|other| *other == pose);
            template_of.push(known.unwrap_or_else(|| {
                poses.push(pose);
                poses.len() - 1
            }));
        }
        let shape = ObjectShape::from_artifact(object);
        let template = |pose| template(&config.scene, model, &shape, pose);
        let templates: Vec<Option<Template>> =
            poses.par_iter().map(template).collect::<Result<_, _>>()?;
        if !templates.is_empty() && templates.iter().all(Option::is_none) {
            return Err(SimulationError::Unsettled);
        }
        Ok(Self {
            config,
            candidates,
            model,
            extent_m: extent_m(object),
            seed,
            templates,
            template_of,
            poses,
            shape,
        })
    }

    /// Judges all candidates, in their order; `progress` is told the share that is done.
    pub(crate) fn judge(
        &self,
        progress: impl Fn(f64) + Sync,
    ) -> Result<Vec<rollouts::Rollout>, SimulationError> {
        let total = self.candidates.candidates.len();
        let done = AtomicUsize::new(0);
        (0..total)
            .into_par_iter()
            .map(|idx| {
                let candidate = &self.candidates.candidates[idx];
                let rollout = self.rollout(idx, Record::Nothing);
                let row = feasible(rollout.and_then(|rollout| self.row(candidate, &rollout)))?;
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(done as f64 / total as f64);
                Ok(row.unwrap_or_else(|| infeasible(candidate)))
            })
            .collect()
    }

    /// Returns a candidate.
    pub(crate) fn candidate(&self, idx: usize) -> &Candidate {
        &self.candidates.candidates[idx]
    }

    /// Carries out one candidate.
    pub(crate) fn rollout(&self, idx: usize, record: Record) -> Result<Rollout, SimulationError> {
        self.rollout_in(&self.templates, idx, record)
    }

    /// Carries out some candidates in another scene; returns the verdict and the simulated control steps of
    /// each.
    pub(crate) fn retried(
        &self,
        scene: &SceneConfig,
        candidates: &[usize],
    ) -> Result<Vec<(Verdict, u32)>, SimulationError> {
        let needed: BTreeSet<usize> = candidates
            .iter()
            .map(|&idx| self.template_of[idx])
            .collect();
        let poses = self.poses.par_iter().enumerate();
        let templates = poses.map(|(idx, pose)| {
            if needed.contains(&idx) {
                template(scene, self.model, &self.shape, pose)
            } else {
                Ok(None)
            }
        });
        let templates: Vec<Option<Template>> = templates.collect::<Result<_, _>>()?;
        let tried = candidates.par_iter().map(|&idx| {
            let rollout = feasible(self.rollout_in(&templates, idx, Record::Nothing))?;
            Ok(match rollout {
                Some(rollout) => (self.verdict(&rollout), rollout.cost_n),
                None => (Verdict::Infeasible, 0),
            })
        });
        tried.collect()
    }

    fn rollout_in(
        &self,
        templates: &[Option<Template>],
        idx: usize,
        record: Record,
    ) -> Result<Rollout, SimulationError> {
        let template = templates[self.template_of[idx]].as_ref();
        let template = template.ok_or(SimulationError::Unsettled)?;
        let motion = self.motion(idx, self.candidate(idx))?;
        template.rollout(&motion, &self.config.protocol, record)
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

/// Builds the scene of a resting pose; nothing if the object does not come to rest in it.
fn template(
    scene: &SceneConfig,
    model: &RobotModel,
    shape: &ObjectShape,
    pose: &Pose<Table, InObject>,
) -> Result<Option<Template>, SimulationError> {
    feasible(Template::new(scene, model, shape, &Rest::of(pose)))
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
    /// Returns the verdict on a rollout; physics alone lets a hand hold an object by being inside it.
    fn verdict(&self, rollout: &Rollout) -> Verdict {
        match rollout.verdict {
            Verdict::Held if rollout.penetration_m > self.config.max_penetration_m => {
                Verdict::TooDeep
            }
            verdict => verdict,
        }
    }

    fn row(
        &self,
        candidate: &Candidate,
        rollout: &Rollout,
    ) -> Result<rollouts::Rollout, SimulationError> {
        let motion = self.in_order(candidate)?;
        Ok(rollouts::Rollout {
            verdict: self.verdict(rollout),
            cost_n: rollout.cost_n,
            saved_n: rollout.saved_n,
            lift_m: rollout.lift_m,
            slip_m: rollout.slip_m,
            displacement_m: rollout.displacement_m,
            penetration_m: rollout.penetration_m,
            contacts_n: rollout.contacts_n,
            smoothness: smoothness(&motion, self.model).map_err(motion_error)?,
            ..infeasible(candidate)
        })
    }
}

/// Returns the row of a candidate of which nothing can be simulated.
fn infeasible(candidate: &Candidate) -> rollouts::Rollout {
    rollouts::Rollout {
        candidate_id: candidate.candidate_id.clone(),
        generator: candidate.generator.clone(),
        lineage: candidate.lineage.clone(),
        verdict: Verdict::Infeasible,
        cost_n: 0,
        saved_n: 0,
        lift_m: 0.0,
        slip_m: 0.0,
        displacement_m: 0.0,
        penetration_m: 0.0,
        contacts_n: 0,
        smoothness: Smoothness::default(),
    }
}

#[cfg(test)]
mod tests {
    use motion::{HandRates, Step};
    use nalgebra::Isometry3;
    use schemas::candidates::Lineage;

    use super::*;

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
            rates: HandRates::still(1),
        };
        Candidate {
            candidate_id: name.to_owned(),
            generator: "test".to_owned(),
            lineage: Lineage::replayed(name),
            latent: Vec::new(),
            table_from_object: Pose::new(Isometry3::translation(0.0, 0.0, 0.02)),
            limit_excess_rad: 0.0,
            depth_m: 0.0,
            motion: Motion::new(&[joint], vec![step(0.0), step(1.0)]).unwrap(),
            refused: Vec::new(),
        }
    }

    #[test]
    fn a_candidate_that_the_hand_cannot_execute_is_a_row_among_the_others() {
        let config = serde_json::json!({
            "hand": "hand.urdf",
            "scene": {"drive": {
                "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
            }},
            "protocol": {"flexion_joints": ["j"]},
        });
        let config: ScreenConfig = serde_json::from_value(config).unwrap();
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
        let screening = Screening::new(&config, &model, &cube(), &candidates, 7).unwrap();
        let rows = screening.judge(|_| {}).unwrap();
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
        assert_eq!((rows[1].cost_n, rows[1].saved_n), (0, 0));
        assert_eq!(rows[1].lineage, candidates.candidates[1].lineage);
        assert!(rows[0].cost_n > 0);
    }
}
