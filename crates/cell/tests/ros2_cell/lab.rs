//! A router, an arm and a hand at it, and a cell that drives them.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use cell::{
    CellClient, CellRobot, CellServer, Goal, GoalResult, Grasp, JointPoint, JointRates, JointTrack,
    PalmTrajectory, Patience, Report, Router, ServerConfig, ServiceConfig, State, Terms,
    robot_digest, subscribe,
};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use robot::{Joint, RobotModel};
use spatial::Pose;
use tempfile::TempDir;

use crate::{
    config::Config,
    emulated::{Behavior, Emulated},
    machine::Ros2Machine,
};

pub(crate) const SOON: Duration = Duration::from_secs(20);
/// As patient as [`SOON`].
pub(crate) const PATIENT: Patience = Patience {
    answer: SOON,
    result: SOON,
};
pub(crate) const SOUND: [Behavior; 2] = [Behavior::Sound; 2];
/// The shipped description of a cell.
const SHIPPED: &str = include_str!("../../examples/ros2_cell/xarm6_allegro.toml");
const ARM: &str = include_str!("../../../../data/robots/xarm6_allegro.urdf");
const HAND: &str = include_str!("../../../../data/robots/allegro_right.urdf");
/// The arm's joints at the start of the goal, where the hand points down.
const ABOVE: [f64; 6] = [0.0, -0.6, -0.6, 0.0, 1.2, 0.0];
/// Rotations of the first joint in the reach, and of the second in the lift, in radians.
const TURN_RAD: f64 = 0.5;
const LIFT_RAD: f64 = 0.3;
/// Height of the object, in meters.
pub(crate) const OBJECT_Z_M: f64 = 0.05;

pub(crate) struct Lab {
    router: Router,
    pub(crate) config: Config,
    folder: TempDir,
}

impl Lab {
    /// Returns a lab with the shipped cell: its limits fit emulated joints, and the way to the start may
    /// have any length.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let router = Router::start("tcp/127.0.0.1:0", None).unwrap();
        let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/robots");
        let path = folder.path().join("shipped.toml");
        lake::write_atomic(&path, SHIPPED.as_bytes()).unwrap();
        let mut config = Config::read(&path).unwrap();
        router.endpoint().clone_into(&mut config.router);
        config.journal = folder.path().join("journal");
        config.robot = robots.join("xarm6_allegro.urdf");
        config.hand_urdf = robots.join("allegro_right.urdf");
        config.start_tolerance_rad = 7.0;
        config.approach_rad_per_s = 3.0;
        // A busy machine delays messages and heartbeats.
        config.max_age_s = 2.0;
        config.silence_s = 2.0;
        config.arm.deceleration_rad_per_s2 = 200.0;
        config.hand.deceleration_rad_per_s2 = 200.0;
        Self {
            router,
            config,
            folder,
        }
    }

    pub(crate) fn robot(&self) -> CellRobot {
        self.config.load().unwrap()
    }

    /// Starts controllers whose joints are at the goal's start, and publishes measurements of the
    /// object.
    pub(crate) fn emulate(&self, behaviors: [Behavior; 2]) -> Emulated {
        let emulated = self.emulate_joints(behaviors);
        emulated.put_object(OBJECT_Z_M);
        emulated
    }

    /// As [`Lab::emulate`], but nothing measures the object.
    pub(crate) fn emulate_joints(&self, behaviors: [Behavior; 2]) -> Emulated {
        let open = RobotModel::from_urdf(HAND).unwrap().mid_range();
        let start = [ABOVE.to_vec(), open];
        Emulated::start(&self.config, &self.robot(), behaviors, start).unwrap()
    }

    /// Starts the cell in this process, once the machine is ready.
    pub(crate) fn serve(&self) -> CellServer {
        let machine = Arc::new(Ros2Machine::new(self.config.clone()).unwrap());
        wait_until(|| machine.is_ready());
        assert_eq!(machine.positions().len(), joints().len());
        let server = ServerConfig {
            name: self.config.cell.clone(),
            listen: String::new(),
            service: ServiceConfig {
                journal: Some(self.config.journal.clone()),
                real_time: true,
                router: Some(self.config.router.clone()),
                ..ServiceConfig::default()
            },
        };
        CellServer::start(server, machine).unwrap()
    }

    /// Starts the cell as the program that the README starts.
    pub(crate) fn serve_apart(&self, faults: &[&str]) -> Program {
        let path = self.folder.path().join("cell.toml");
        lake::write_atomic(&path, self.text().as_bytes()).unwrap();
        let mut program = Command::new(example());
        program.arg("serve").arg(&path);
        for fault in faults {
            program.args(["--fault", fault]);
        }
        Program::start(program)
    }

    /// The cell's description as a file has it.
    fn text(&self) -> String {
        let config = &self.config;
        let mut file: toml_edit::DocumentMut = SHIPPED.parse().unwrap();
        let path = |path: &PathBuf| toml_edit::value(path.to_str().unwrap());
        file["router"] = toml_edit::value(&config.router);
        file["journal"] = path(&config.journal);
        file["robot"] = path(&config.robot);
        file["hand_urdf"] = path(&config.hand_urdf);
        file["start_tolerance_rad"] = toml_edit::value(config.start_tolerance_rad);
        file["approach_rad_per_s"] = toml_edit::value(config.approach_rad_per_s);
        file["max_age_s"] = toml_edit::value(config.max_age_s);
        file["silence_s"] = toml_edit::value(config.silence_s);
        for part in ["arm", "hand"] {
            file[part]["deceleration_rad_per_s2"] = toml_edit::value(200.0);
        }
        file.to_string()
    }

    pub(crate) fn connect(&self) -> CellClient {
        CellClient::connect(self.router.endpoint(), &self.config.cell, SOON).unwrap()
    }

    /// Calls `see` with each state that the cell publishes, until it returns true.
    pub(crate) fn watch(&self, mut see: impl FnMut(&State) -> bool) {
        let key = format!("cgf/cell/{}/state", self.config.cell);
        let (_session, states) = subscribe(self.router.endpoint(), &key, SOON).unwrap();
        let until = Instant::now() + SOON;
        while let Ok(Some(sample)) = states.recv_timeout(SOON) {
            assert!(Instant::now() < until, "what is waited for does not come");
            let states = State::from_bytes(&sample.payload().to_bytes()).unwrap();
            if states.iter().any(&mut see) {
                return;
            }
        }
        panic!("the cell published nothing more");
    }

    /// Waits until the middle of a goal's reach, where the arm is fast.
    pub(crate) fn wait_for_motion(&self, goal: &Goal) {
        let id = goal.encode().goal_id;
        self.watch(|state| state.goal_id == id && (0.3..0.8).contains(&state.sample.time_s));
    }

    pub(crate) fn endpoint(&self) -> &str {
        self.router.endpoint()
    }
}

/// The cell as a process, which ends with the test.
pub(crate) struct Program(Child);

impl Program {
    fn start(mut program: Command) -> Self {
        let mut child = program.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        said.read_line(&mut line).unwrap();
        assert!(!line.is_empty(), "the cell did not start");
        Self(child)
    }

    /// Ends it at once, as a crash does.
    pub(crate) fn kill(&mut self) {
        let _gone = self.0.kill();
        let _gone = self.0.wait();
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The built example, which is not part of this test: `cargo test` builds both.
fn example() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let program = test.parent().unwrap().join("../examples/ros2_cell");
    let hint = "build it first: `cargo build --release -p cell --example ros2_cell`";
    assert!(
        fs::exists(&program).unwrap(),
        "no `{}`; {hint}",
        program.display()
    );
    program
}

/// Waits until something holds.
pub(crate) fn wait_until(mut holds: impl FnMut() -> bool) {
    for _ in 0..2000 {
        if holds() {
            return;
        }
        thread::sleep(Duration::from_millis(10));
    }
    panic!("it does not come to hold within {SOON:?}");
}

/// Turns the arm, closes the fingers, and lifts; number `attempt` of its kind.
pub(crate) fn goal(lab: &Lab, attempt: u32) -> Goal {
    let still = |time_s: f64, q: &[f64]| JointPoint {
        time_s,
        q_rad: q.to_vec(),
        rates: JointRates::zero(q.len()),
    };
    let hand = RobotModel::from_urdf(HAND).unwrap();
    let (open, robot) = (hand.mid_range(), lab.robot());
    let closed: Vec<f64> = open.iter().map(|q| q + 0.3).collect();
    let mut beside = ABOVE;
    beside[0] += TURN_RAD;
    // The direction that lifts.
    let lifted = [LIFT_RAD, -LIFT_RAD].map(|lift_rad| {
        let mut lifted = beside;
        lifted[1] += lift_rad;
        lifted
    });
    let height = |q: &[f64; 6]| robot.palm(q).unwrap().translation.z;
    let lifted = lifted.iter().max_by(|a, b| height(a).total_cmp(&height(b)));
    let mut grasp: simulation::Protocol =
        serde_json::from_str(include_str!("../../examples/grasp.json")).unwrap();
    grasp.hold_s = 0.5;
    grasp.lifted_m = 0.03;
    // Not quite normalized: the cell that parses the goal must keep the id of its bytes.
    let turn = UnitQuaternion::new_unchecked(Quaternion::new(1.0 + 1e-9, 0.0, 0.0, 0.0));
    let object = Isometry3::from_parts(Translation3::new(0.0, 0.0, OBJECT_Z_M), turn);
    Goal {
        candidate_id: "box-0001".to_owned(),
        object: "box".to_owned(),
        robot: robot_digest(ARM),
        attempt,
        resumed: 0,
        table_from_object: Pose::new(object),
        start_tolerance_rad: 7.0,
        grasp: Grasp::try_from(&grasp).unwrap(),
        // The reach ends at 0.8 s, the lift goes from 1.4 s to 1.8 s.
        carrier: PalmTrajectory::Arm(JointTrack {
            joints: (1..=6).map(|joint| format!("joint{joint}")).collect(),
            points: vec![
                still(0.0, &ABOVE),
                still(0.8, &beside),
                still(1.4, &beside),
                still(1.8, lifted.unwrap()),
            ],
        }),
        hand: JointTrack {
            joints: hand.joint_names(),
            points: vec![still(0.0, &open), still(0.6, &open), still(0.8, &closed)],
        },
    }
}

/// All joints of the robot.
pub(crate) fn joints() -> Vec<Joint> {
    RobotModel::from_urdf(ARM).unwrap().joints().to_vec()
}

/// Executes a goal to its end.
pub(crate) fn execute(client: &CellClient, goal: &Goal) -> Report {
    match send(client, goal, PATIENT) {
        GoalResult::Report(report) | GoalResult::EarlierReport(report) => report,
        other => panic!("{other:?}"),
    }
}

/// Sends a goal to a cell that may move something real.
pub(crate) fn send(client: &CellClient, goal: &Goal, patience: Patience) -> GoalResult {
    let terms = Terms::new(client.capabilities(SOON).unwrap(), true);
    let sent = client.execute(goal, &terms, &joints(), patience, &());
    sent.unwrap()
}
