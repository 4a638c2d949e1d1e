//! Control of one motion: search, execute the first action, shift, until the fingertips are there.

use std::sync::Arc;

use motion::{HandState, Motion, MotionError, Step};
use nalgebra::Point3;
use rand::Rng;
use robot::RobotModel;
use simulation::{Episode, EpisodeState, SettledScene, SimulationError};
use spatial::Object;

use crate::{
    actions::{Actions, Speeds},
    cross_entropy::CrossEntropy,
    tips::{Fingertips, distance_m, mean_distance_m},
};

/// Parameters of control.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlOptions {
    /// The search for the next actions.
    pub method: CrossEntropy,
    /// Actions of a sequence, one per control step.
    pub horizon: usize,
    /// Share of the shifted mean with which the next search starts, from 0 to 1.
    pub memory: f64,
    /// Greatest speeds of a command.
    pub speeds: Speeds,
    /// Cost of a meter between the fingertips and the grasp's, as one vector, for each control step (1/m).
    pub tip_weight_per_m: f64,
    /// Cost of a meter by which the object is moved, for each control step (1/m).
    pub object_weight_per_m: f64,
    /// Cost of a meter by which the commanded hand is below the table, for each control step (1/m).
    pub table_weight_per_m: f64,
    /// Mean distance of the fingertips from the grasp's at which control ends, in meters.
    pub tip_tolerance_m: f64,
    /// Duration of a control step of the scenes, in seconds.
    pub control_step_s: f64,
    /// Control steps of a motion.
    pub steps_n: usize,
}

/// Controls one hand.
pub struct Controller<'a> {
    hand: &'a RobotModel,
    tips: &'a Fingertips,
    joints: Vec<String>,
    options: ControlOptions,
    actions: Actions,
}

/// A commanded motion, and its cost.
#[derive(Debug, Clone)]
pub struct ControlledMotion {
    /// The commands in the object's frame, with the hand's joints, on the clock of the motion that was given.
    pub motion: Motion<Object>,
    /// Control steps simulated by the searches.
    pub searched_n: u64,
    /// Control steps executed until the fingertips were there, or to the end.
    pub executed_n: u64,
    /// Whether the fingertips came to the grasp's.
    pub reached: bool,
    /// Distances from the grasp, and cost, at the start.
    pub first: GoalDistance,
    /// The same at the end, with the last command held to the end of the motion.
    pub last: GoalDistance,
}

/// Distances of a hand and an object from the grasp, and their cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoalDistance {
    /// Cost of a control step that ends here.
    pub cost: f64,
    /// Mean distance of the fingertips from the grasp's, in meters.
    pub tip_error_m: f64,
    /// Displacement of the object, in meters.
    pub object_moved_m: f64,
}

/// The grasp as a goal.
struct Goal {
    tips: Vec<Point3<f64>>,
    object: Point3<f64>,
}

/// Why a motion could not be controlled.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Its steps form no motion of the hand.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// It cannot be simulated.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
}

impl<'a> Controller<'a> {
    /// Takes a hand and its fingertips.
    pub fn new(hand: &'a RobotModel, tips: &'a Fingertips, options: ControlOptions) -> Self {
        Self {
            hand,
            tips,
            joints: hand.joint_names(),
            options,
            actions: Actions::new(hand, &options.speeds, options.control_step_s),
        }
    }

    /// Controls the hand from the first step of a motion to the fingertips of its last, in a scene of the hand.
    ///
    /// # Errors
    ///
    /// Fails if the motion is not one of the hand, or steps are so near in time that rates are not finite.
    pub fn control(
        &self,
        scene: &SettledScene,
        given: &Motion<Object>,
        rng: &mut impl Rng,
    ) -> Result<ControlledMotion, ControlError> {
        let given = given.reordered(&self.joints)?;
        let start = HandState::from(given.first());
        let grasp = given.grasp();
        let table_from_palm = scene.table_from_estimate() * grasp.frame_from_palm;
        let goal = Goal {
            tips: self.tips.places(self.hand, &table_from_palm, &grasp.q_rad),
            object: scene.table_from_object().translation.vector.into(),
        };
        let mut episode = scene.begin(&start)?;
        let first = self.distance_to_grasp(&goal, &scene.observe(&episode));
        let ControlOptions {
            horizon,
            memory,
            tip_tolerance_m,
            steps_n,
            ..
        } = self.options;
        let mut mean = vec![0.0; self.actions.len() * horizon];
        let mut commands = vec![start];
        let (mut searched_n, mut executed_n) = (0, 0);
        let mut distance = first;
        let mut reached = first.tip_error_m < tip_tolerance_m;
        while !reached && commands.len() <= steps_n {
            let before = commands[commands.len() - 1].clone();
            let cost = |plan: &[f64]| {
                let (cost, simulated_n) = self.cost(scene, &episode, &goal, &before, plan);
                searched_n += simulated_n;
                cost
            };
            mean = self.options.method.minimize(mean, cost, rng);
            let command = self.actions.command(&before, &mean[..self.actions.len()]);
            let advanced = scene.advance(&mut episode, &command);
            executed_n += 1;
            commands.push(command);
            if advanced.is_err() {
                // Screened, it diverges again, and is a row of its own.
                break;
            }
            distance = self.distance_to_grasp(&goal, &scene.observe(&episode));
            reached = distance.tip_error_m < tip_tolerance_m;
            // The next search starts where this one left off; its last action is repeated.
            mean.drain(..self.actions.len());
            let kept_n = mean.len();
            mean.extend_from_within(kept_n.saturating_sub(self.actions.len())..);
            mean.resize(self.actions.len() * horizon, 0.0);
            for number in &mut mean {
                *number *= memory;
            }
        }
        // The last command is held to the end of the motion.
        let last_command = commands[commands.len() - 1].clone();
        while commands.len() <= steps_n {
            if scene.advance(&mut episode, &last_command).is_ok() {
                distance = self.distance_to_grasp(&goal, &scene.observe(&episode));
            }
            commands.push(last_command.clone());
        }
        Ok(ControlledMotion {
            motion: on_clock(&given, &commands)?,
            searched_n,
            executed_n,
            reached,
            first,
            last: distance,
        })
    }

    /// Returns the cost of a sequence of actions from a state, and the control steps simulated for it.
    fn cost(
        &self,
        scene: &SettledScene,
        from: &Episode,
        goal: &Goal,
        before: &HandState<Object>,
        plan: &[f64],
    ) -> (f64, u64) {
        let mut episode = from.fork();
        let mut command = before.clone();
        let (mut cost, mut steps_n) = (0.0, 0);
        for action in plan.chunks_exact(self.actions.len()) {
            command = self.actions.command(&command, action);
            steps_n += 1;
            if scene.advance(&mut episode, &command).is_err() {
                return (f64::INFINITY, steps_n);
            }
            cost += self.distance_to_grasp(goal, &scene.observe(&episode)).cost
                + self.options.table_weight_per_m * scene.below_table_m(&command);
        }
        (cost, steps_n)
    }

    /// Returns the distances of a state from the goal, and their cost.
    fn distance_to_grasp(&self, goal: &Goal, state: &EpisodeState) -> GoalDistance {
        let tips = self
            .tips
            .places(self.hand, &state.table_from_palm, &state.q);
        let object: Point3<f64> = state.table_from_object.translation.vector.into();
        let object_moved_m = (object - goal.object).norm();
        let options = self.options;
        GoalDistance {
            cost: options.tip_weight_per_m * distance_m(&tips, &goal.tips)
                + options.object_weight_per_m * object_moved_m,
            tip_error_m: mean_distance_m(&tips, &goal.tips),
            object_moved_m,
        }
    }
}

/// Returns commands as a motion, evenly spaced from the first time of another one to its last: the screen stretches a
/// motion to its reach, and there they are one control step apart.
fn on_clock(
    given: &Motion<Object>,
    commands: &[HandState<Object>],
) -> Result<Motion<Object>, MotionError> {
    let between_s = given.duration_s() / (commands.len() - 1).max(1) as f64;
    let first_s = given.first().time_s;
    let steps = commands.iter().enumerate().map(|(idx, command)| Step {
        time_s: first_s + between_s * idx as f64,
        frame_from_palm: command.frame_from_palm,
        q_rad: command.q_rad.clone(),
        rates: (),
    });
    Motion::of_joints(Arc::clone(given.joints()), steps.collect())?.differentiated()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use nalgebra::{Isometry3, Matrix3, Vector3};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use serde_json::json;
    use simulation::{ObjectShape, Protocol, SceneConfig, TraceMode};
    use spatial::{Pose, RestingPose};

    use super::*;

    /// A box of 0.3 kg, 6 by 6 by 10 cm, about its center.
    fn carton() -> ObjectShape {
        let half_m = [0.03, 0.03, 0.05];
        let corner = |sides: usize| {
            let side = |axis: usize| if sides >> axis & 1 == 0 { -1.0 } else { 1.0 };
            Point3::from([0, 1, 2].map(|axis: usize| half_m[axis] * side(axis)))
        };
        let corners = (0..8).map(corner);
        let (mass_kg, across) = (0.3, 0.3 * (0.06_f64.powi(2) + 0.1_f64.powi(2)) / 12.0);
        let upright = mass_kg * 0.06_f64.powi(2) / 6.0;
        ObjectShape {
            parts_m: vec![corners.collect()],
            surface: None,
            mass_kg,
            center_of_mass_m: Point3::origin(),
            inertia_kg_m2: Matrix3::from_diagonal(&Vector3::new(across, across, upright)),
        }
    }

    /// The Allegro goes from 20 cm beside the carton to 6 cm beside it, and closes a little.
    fn given(hand: &RobotModel) -> Motion<Object> {
        let step = |share: f64| Step {
            time_s: 1.5 * share,
            frame_from_palm: Pose::new(Isometry3::new(
                Vector3::new(-0.2 + 0.12 * share, 0.0, 0.12),
                Vector3::new(0.0, 0.3 * share, 0.0),
            )),
            q_rad: hand
                .mid_range()
                .iter()
                .map(|q| q * (0.5 + 0.2 * share))
                .collect(),
            rates: (),
        };
        let steps = (0..=10).map(|step_n| step(f64::from(step_n) / 10.0));
        let motion = Motion::new(&hand.joint_names(), steps.collect()).unwrap();
        motion.differentiated().unwrap()
    }

    /// Controls it at a part of the budget; returns the controlled motion, and after the screen's reach the fingertips'
    /// mean distance from the grasp and the displacement of the object, in meters.
    fn control(seed: u64) -> (ControlledMotion, [f64; 2]) {
        let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../data");
        let urdf = fs::read_to_string(format!("{data}/robots/allegro_right.urdf")).unwrap();
        let hand = RobotModel::from_urdf(&urdf).unwrap();
        let table = format!("{data}/hands/allegro_right.toml");
        let table = hand_files::load_table(table.as_ref()).unwrap();
        let tips = Fingertips::new(&hand, &table).unwrap();
        let scene = json!({"drive": {
            "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
        }});
        let scene_config: SceneConfig = serde_json::from_value(scene).unwrap();
        let protocol = json!({
            "flexion_joints": ["joint_1.0"], "reach_s": 0.4, "early_tolerance_m": 1.0,
        });
        let protocol: Protocol = serde_json::from_value(protocol).unwrap();
        let rest = RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: 0.05,
        };
        let scene = SettledScene::new(&scene_config, &hand, &carton(), &rest).unwrap();
        let options = ControlOptions {
            method: CrossEntropy {
                population: 30,
                elites: 5,
                iterations: 2,
                initial_sd: 0.2,
                min_sd: 0.05,
                smoothing: 0.1,
            },
            horizon: 3,
            memory: 0.2,
            speeds: Speeds {
                palm: 1.0,
                turn: 1.57,
                joint: 5.0,
            },
            tip_weight_per_m: 0.1,
            object_weight_per_m: 2.0,
            table_weight_per_m: 10.0,
            tip_tolerance_m: 0.01,
            control_step_s: scene_config.control_step_s(),
            steps_n: 20,
        };
        let control = Controller::new(&hand, &tips, options);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let controlled = control.control(&scene, &given(&hand), &mut rng).unwrap();
        let rollout = scene
            .rollout(&controlled.motion, &protocol, TraceMode::Trace)
            .unwrap();
        let trace = rollout.trace.unwrap();
        let end = &trace.steps[options.steps_n];
        let screened = tips.places(&hand, &end.table_from_palm, &end.q);
        let goal = given(&hand);
        let goal = goal.grasp();
        let table_from_palm = scene.table_from_estimate() * goal.frame_from_palm;
        let goal = tips.places(&hand, &table_from_palm, &goal.q_rad);
        let moved =
            end.table_from_object.translation.vector - scene.table_from_object().translation.vector;
        (
            controlled,
            [mean_distance_m(&screened, &goal), moved.norm()],
        )
    }

    #[test]
    fn the_cost_falls_and_the_screen_executes_what_was_commanded() {
        let (controlled, [tip_error_m, moved_m]) = control(5);
        let [first, last] = [controlled.first, controlled.last];
        assert!(last.cost < 0.5 * first.cost, "{first:?} {last:?}");
        assert!(
            last.tip_error_m < 0.5 * first.tip_error_m,
            "{first:?} {last:?}"
        );
        // The screen ends with the same fingertips and the same object, but for the rounding of its clock.
        assert!(
            (tip_error_m - last.tip_error_m).abs() < 1e-4,
            "{tip_error_m} {last:?}"
        );
        assert!(
            (moved_m - last.object_moved_m).abs() < 1e-4,
            "{moved_m} {last:?}"
        );
        // Twenty steps of two iterations of thirty draws of three actions, unless it was there before.
        assert_eq!(controlled.searched_n, 180 * controlled.executed_n);
        assert_eq!(controlled.motion.steps().len(), 21);
        assert!(controlled.reached || controlled.executed_n == 20);
        assert_eq!(controlled.motion.duration_s(), 1.5);
    }

    #[test]
    fn equal_seeds_give_equal_motions() {
        let [a, b, c] = [3, 3, 4].map(|seed| control(seed).0.motion);
        assert_eq!(a, b);
        assert_ne!(a, c);
    }
}
