//! An arm and a hand that ROS 2 controllers move.

use std::time::Duration;

use cell::{
    CellError, CellRobot, EncodedGoal, Ending, Goal, Machine, MachineDescription, MonitoredMotion,
    PalmTrajectory, Rejection, RejectionCode, Report, Ros2Node, Sample, UncheckedReport,
};
use robot::Joint;
use schemas::executions::Outcome;
use spatial::{Object, Pose, Table};

use crate::{
    config::Config,
    controllers::Controllers,
    executing::ExecutingMotion,
    measurements::Measurements,
    path::{JointPath, POINT_S, start_error},
};

/// An arm and a hand on ROS 2.
pub(crate) struct Ros2Machine {
    pub(crate) config: Config,
    pub(crate) robot: CellRobot,
    pub(crate) measurements: Measurements,
    pub(crate) controllers: Controllers,
    _node: Ros2Node,
}

impl Ros2Machine {
    /// Connects to the router and opens the topics.
    pub(crate) fn new(config: Config) -> Result<Self, String> {
        let robot = config.load()?;
        let said = |err: CellError| cell::with_causes(&err);
        let wait = Duration::from_secs(10);
        let node = Ros2Node::connect(&config.router, (config.domain, "grasp_cell"), wait);
        let node = node.map_err(said)?;
        Ok(Self {
            measurements: Measurements::new(&node, &config, &robot).map_err(said)?,
            controllers: Controllers::new(&node, &config, &robot).map_err(said)?,
            robot,
            config,
            _node: node,
        })
    }

    /// Returns the checks before any goal, by name, each with what is wrong.
    pub(crate) fn readiness(&self) -> [(&'static str, Result<(), String>); 5] {
        let (seen, max_age_s) = (&self.measurements, self.config.max_age_s);
        [
            ("joint states", seen.check_fresh(max_age_s)),
            ("clock", seen.check_clock()),
            ("stillness", seen.check_still(max_age_s)),
            ("controllers", self.controllers.check()),
            ("object", self.check_object_heard()),
        ]
    }

    /// Returns whether all of these checks pass.
    pub(crate) fn is_ready(&self) -> bool {
        self.readiness().iter().all(|(_, found)| found.is_ok())
    }

    /// Returns the joints with their positions, a line each; none before all were heard.
    pub(crate) fn positions(&self) -> Vec<String> {
        let q = self.measurements.positions().unwrap_or_default();
        let joints = self.robot.joints().zip(q);
        joints
            .map(|(joint, q)| format!("       {} at {q:.4} rad", joint.name))
            .collect()
    }

    /// Returns the positions of a goal's joints, in its order: the arm's, the hand's.
    pub(crate) fn measured(&self, tracks: [&[String]; 2]) -> Option<[Vec<f64>; 2]> {
        let (names, q) = (self.robot.joint_names(), self.measurements.positions()?);
        let of = |track: &[String]| {
            let places = track.iter().map(|name| {
                let place = names.iter().position(|own| own == name)?;
                q.get(place).copied()
            });
            places.collect::<Option<Vec<f64>>>()
        };
        Some([of(tracks[0])?, of(tracks[1])?])
    }

    /// Checks that the robot is where the goal begins.
    fn check_start(&self, goal: &Goal) -> Result<(), Rejection> {
        let busy = |reason: String| Rejection::new(RejectionCode::Busy, reason);
        let PalmTrajectory::Arm(arm) = &goal.carrier else {
            let reason = "the goal moves no arm".to_owned();
            return Err(Rejection::new(RejectionCode::Joints, reason));
        };
        let tracks = [arm.clone(), goal.hand.clone()];
        let measured = self.measured([&arm.joints, &goal.hand.joints]);
        let measured = measured.ok_or_else(|| busy("not all joints were heard".to_owned()))?;
        let off_rad = start_error(&tracks, measured.each_ref().map(Vec::as_slice));
        let off_rad = off_rad.unwrap_or(f64::INFINITY);
        let tolerance = self
            .config
            .start_tolerance_rad
            .min(goal.start_tolerance_rad);
        if off_rad <= tolerance {
            return Ok(());
        }
        let rows = tracks
            .iter()
            .filter_map(|track| Some((track, track.points.first()?)));
        let first = rows.flat_map(|(track, row)| {
            let both = track.joints.iter().zip(&row.q_rad);
            both.map(|(name, q)| format!("{name} {q:.4}"))
        });
        Err(busy(format!(
            "a joint is {off_rad:.3} rad from the first row, more than {tolerance}; move the robot there: {}",
            first.collect::<Vec<_>>().join(", ")
        )))
    }

    /// Checks that a brake at the goal's highest speed is within the machine's deceleration.
    fn check_brake(&self, goal: &Goal) -> Result<(), Rejection> {
        let PalmTrajectory::Arm(arm) = &goal.carrier else {
            return Ok(());
        };
        let brake_s = self.config.brake_s;
        for (part, controller, track) in [
            ("arm", &self.config.arm, arm),
            ("hand", &self.config.hand, &goal.hand),
        ] {
            let most = controller.deceleration_rad_per_s2;
            let needed = JointPath::brake_deceleration(track, brake_s);
            if needed > most {
                return Err(Rejection::new(
                    RejectionCode::Limits,
                    format!(
                        "to brake in {brake_s} s the {part} would decelerate at {needed:.1} rad/s², more than \
                         {most}: slow the motion, or raise `brake_s`"
                    ),
                ));
            }
        }
        Ok(())
    }

    /// Checks that the object's pose was heard a moment ago, where something measures it.
    fn check_object_heard(&self) -> Result<(), String> {
        let Some(topic) = &self.config.object else {
            return Ok(());
        };
        match self.measurements.object() {
            Some((age_s, _)) if age_s <= topic.max_age_s => Ok(()),
            _ => Err(format!(
                "no pose in the frame `{}` is heard on `{}`",
                topic.frame, topic.pose
            )),
        }
    }

    /// Checks that the object lies where the goal has it.
    fn check_object(&self, goal: &Goal) -> Result<(), Rejection> {
        let object = self.config.object.as_ref().zip(self.measurements.object());
        let Some((topic, (_, there))) = object else {
            return Ok(());
        };
        let expected = goal.table_from_object.translation.vector;
        let off_m = (there.translation.vector - expected).norm();
        if off_m > topic.max_off_m {
            let most = topic.max_off_m;
            let reason = format!(
                "the object lies {off_m:.3} m from where the goal has it, more than {most} m"
            );
            return Err(Rejection::new(RejectionCode::Object, reason));
        }
        Ok(())
    }

    /// Returns a measurement: with the latest positions, in the machine's order, and the object where it is
    /// `unmeasured` if nothing measures it.
    pub(crate) fn sample(
        &self,
        time_s: f64,
        commanded: Option<Vec<f64>>,
        unmeasured: Pose<Table, Object>,
    ) -> Option<Sample> {
        let q_rad = self.measurements.positions()?;
        // The arm's joints come after the hand's.
        let arm_q = q_rad.get(self.robot.hand_joints().len()..)?;
        let object = self.measurements.object();
        Some(Sample {
            time_s,
            table_from_palm: self.robot.palm(arm_q)?,
            table_from_object: object.map_or(unmeasured, |(_, pose)| pose),
            q_command_rad: commanded.unwrap_or_else(|| q_rad.clone()),
            q_rad,
        })
    }

    /// Returns whether the object rose as the goal wants it, as far as it was measured.
    fn judge(&self, goal: &Goal, lift_m: f64) -> (Outcome, String) {
        if self.config.object.is_none() {
            let message = "executed; nothing measures the object".to_owned();
            return (Outcome::Unknown, message);
        }
        match self.check_object_heard() {
            Ok(()) => {
                let is_held = lift_m >= goal.grasp.lifted_m;
                let outcome = if is_held {
                    Outcome::Succeeded
                } else {
                    Outcome::Failed
                };
                (outcome, format!("the object rose {lift_m:.3} m"))
            }
            Err(why) => (Outcome::Unknown, format!("executed; at the end {why}")),
        }
    }
}

impl Machine for Ros2Machine {
    fn description(&self) -> MachineDescription {
        MachineDescription {
            simulated: self.config.simulated,
            robot: self.robot.digest().to_owned(),
            joints: self.robot.joint_names(),
            controllers: self.robot.controllers(POINT_S),
            palm: None,
            table_from_base: self.robot.table_from_base(),
            gap: "ROS 2 controllers; poses of palm and object as far as they are measured"
                .to_owned(),
            silence: Some(Duration::from_secs_f64(self.config.silence_s)),
        }
    }

    fn check(&self, goal: &Goal) -> Result<(), Rejection> {
        self.robot.check(goal, |_| true)?;
        self.check_brake(goal)?;
        for (what, found) in self.readiness() {
            let not_ready = |why| Rejection::new(RejectionCode::Busy, format!("{what}: {why}"));
            found.map_err(not_ready)?;
        }
        self.check_object(goal)?;
        self.check_start(goal)
    }

    fn measure(&self) -> Option<Sample> {
        self.measurements.check_fresh(self.config.max_age_s).ok()?;
        self.sample(0.0, None, Pose::identity())
    }

    fn execute(
        &self,
        goal: &Goal,
        encoded: &EncodedGoal,
        motion: &mut MonitoredMotion<'_>,
    ) -> Report {
        let joints = goal.joint_names();
        let report = |outcome: Outcome, message: String, lift_m: f64, samples: Vec<Sample>| {
            let ending = Ending {
                outcome,
                message,
                lift_m,
            };
            Report::of_motion(&encoded.goal_id, joints.clone(), ending, samples)
        };
        let Some(mut executing) = ExecutingMotion::new(self, goal) else {
            let message = "the joints were lost before anything moved".to_owned();
            return report(Outcome::Aborted, message, 0.0, Vec::new());
        };
        let still_moving = executing.run(goal, motion);
        let lift_m = executing.lift_m();
        let (outcome, message) = match (&executing.aborted, still_moving) {
            (None, _) => self.judge(goal, lift_m),
            (Some(abort), None) => (abort.outcome, abort.message.clone()),
            (Some(abort), Some(why)) => (
                Outcome::Unknown,
                format!(
                    "{}; {why} after the brake: press the emergency stop",
                    abort.message
                ),
            ),
        };
        let done = report(outcome, message, lift_m, executing.samples);
        // What contradicts the goal or itself is not claimed.
        let all: Vec<Joint> = self.robot.joints().cloned().collect();
        let checked = UncheckedReport::from_bytes(&done.to_bytes()).map_err(|err| err.to_string());
        let id = &encoded.goal_id;
        let checked =
            checked.and_then(|it| it.check(id, goal, &all).map_err(|err| err.to_string()));
        checked.unwrap_or_else(|why| {
            let message = format!("{}; but {why}", done.message);
            report(Outcome::Unknown, message, 0.0, Vec::new())
        })
    }
}
