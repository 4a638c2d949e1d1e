//! A machine that is done at once: it repeats a report that physics gave once, and counts what it executes.

use std::sync::{Arc, Mutex, OnceLock};

use cell::{
    CellRobot, CellServer, EncodedGoal, Ending, Goal, Machine, MachineDescription, MonitoredMotion,
    Rejection, Report, Sample, ServerConfig, ServiceConfig, execute_offline,
};
use robot::RobotModel;

use crate::lab::{GRIPPER, LISTEN, config, cube, goal};

/// The machine, real or simulated as it says.
pub(crate) struct Instant {
    simulated: bool,
    robot: CellRobot,
    executed: Mutex<Vec<String>>,
}

impl Instant {
    pub(crate) fn new(simulated: bool) -> Arc<Self> {
        let hand = RobotModel::from_urdf(GRIPPER).unwrap();
        Arc::new(Self {
            simulated,
            robot: CellRobot::new(GRIPPER, hand, None).unwrap(),
            executed: Mutex::default(),
        })
    }

    /// Ids of the goals that it has executed, one after the other.
    pub(crate) fn executed(&self) -> Vec<String> {
        self.executed.lock().unwrap().clone()
    }

    /// Serves it as the cell `simulated`.
    pub(crate) fn serve(self: &Arc<Self>, service: ServiceConfig) -> CellServer {
        let config = ServerConfig {
            name: "simulated".to_owned(),
            listen: LISTEN.to_owned(),
            service,
        };
        CellServer::start(config, Arc::clone(self) as Arc<dyn Machine>).unwrap()
    }
}

impl Machine for Instant {
    fn description(&self) -> MachineDescription {
        MachineDescription {
            simulated: self.simulated,
            robot: self.robot.digest().to_owned(),
            joints: self.robot.joint_names(),
            controllers: self.robot.controllers(0.01),
            palm: None,
            table_from_base: None,
            gap: String::new(),
            silence: None,
        }
    }

    fn check(&self, goal: &Goal) -> Result<(), Rejection> {
        self.robot.check(goal, |object| object == "cube")
    }

    fn measure(&self) -> Option<Sample> {
        None
    }

    fn execute(
        &self,
        goal: &Goal,
        encoded: &EncodedGoal,
        _motion: &mut MonitoredMotion<'_>,
    ) -> Report {
        let id = &encoded.goal_id;
        self.executed.lock().unwrap().push(id.clone());
        let Report {
            outcome,
            message,
            lift_m,
            samples,
            ..
        } = executed_once().clone();
        let ending = Ending {
            outcome,
            message,
            lift_m,
        };
        Report::of_motion(id, goal.joint_names(), ending, samples)
    }
}

/// What physics makes of the goal of these tests.
fn executed_once() -> &'static Report {
    static REPORT: OnceLock<Report> = OnceLock::new();
    REPORT.get_or_init(|| {
        let config = config(ServiceConfig::default());
        execute_offline(&config, GRIPPER, &cube(), &goal(0.04), &mut |_| None).unwrap()
    })
}
