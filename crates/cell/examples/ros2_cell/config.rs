//! The file that describes a cell: its robot, its controllers, its limits.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use cell::{CellArm, CellRobot};
use robot::{Joint, RobotModel};
use serde::Deserialize;
use spatial::Pose;

use crate::path::{BRAKE_PEAK, MAX_BRAKE_S};

/// A cell on ROS 2.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    /// The cell's name for dispatchers.
    pub(crate) cell: String,
    /// Endpoint of the router that `rmw_zenoh` uses, e.g. `tcp/127.0.0.1:7447`.
    pub(crate) router: String,
    /// `ROS_DOMAIN_ID`.
    pub(crate) domain: u32,
    /// Whether no hardware moves: dispatchers then need no `--execute`.
    pub(crate) simulated: bool,
    /// Folder of the goal journal.
    pub(crate) journal: PathBuf,
    /// URDF of the arm with the hand on it, the one that dispatchers plan with.
    pub(crate) robot: PathBuf,
    /// URDF of the hand alone.
    pub(crate) hand_urdf: PathBuf,
    /// The link that is the palm.
    pub(crate) palm: String,
    /// Pose of the arm's base on the table: x y z qx qy qz qw.
    pub(crate) table_from_base: [f64; 7],
    /// Heartbeat timeout, in seconds.
    pub(crate) silence_s: f64,
    /// Duration of a brake, in seconds.
    pub(crate) brake_s: f64,
    /// Largest distance of a joint from a goal's first row, in radians; a goal may allow less.
    pub(crate) start_tolerance_rad: f64,
    /// Largest speed of a joint on the way to the first row, in rad/s.
    pub(crate) approach_rad_per_s: f64,
    /// Longest silence of joint states, in seconds.
    pub(crate) max_age_s: f64,
    /// The arm's controller.
    pub(crate) arm: Controller,
    /// The hand's controller.
    pub(crate) hand: Controller,
    /// Topic of the object's measured pose, if there is one.
    pub(crate) object: Option<ObjectTopic>,
}

/// A `joint_trajectory_controller`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Controller {
    /// Its node, e.g. `/xarm6_traj_controller`.
    pub(crate) node: String,
    /// Topic of its joints' states.
    pub(crate) joint_states: String,
    /// Names of the URDF's joints at the controller, where they differ.
    #[serde(default)]
    pub(crate) names: BTreeMap<String, String>,
    /// Largest distance of a joint from its command, in radians: fingers that press lag behind.
    pub(crate) tracking_rad: f64,
    /// Largest deceleration of a joint in a brake, in rad/s².
    pub(crate) deceleration_rad_per_s2: f64,
}

/// A topic of type `geometry_msgs/PoseStamped` with the pose of the object.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObjectTopic {
    /// The topic.
    pub(crate) pose: String,
    /// The frame of its poses, which must be the table's: z up, z = 0 the surface.
    pub(crate) frame: String,
    /// Largest distance of the object from the goal's pose, in meters.
    pub(crate) max_off_m: f64,
    /// Longest silence at the start and at the end of a motion, in seconds.
    pub(crate) max_age_s: f64,
}

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Fails with the reason if it is not a description of a cell.
    pub(crate) fn read(path: &Path) -> Result<Self, String> {
        let said = |problem: String| format!("`{}`: {problem}", path.display());
        let text = fs::read_to_string(path).map_err(|err| said(err.to_string()))?;
        let config: Self = toml_edit::de::from_str(&text).map_err(|err| said(err.to_string()))?;
        for (key, number) in config.numbers() {
            if !(number.is_finite() && number > 0.0) {
                return Err(said(format!("`{key}` is {number}, expected more than 0")));
            }
        }
        if config.brake_s > MAX_BRAKE_S {
            let brake_s = config.brake_s;
            return Err(said(format!(
                "`brake_s` is {brake_s}, expected at most {MAX_BRAKE_S}"
            )));
        }
        let needed = BRAKE_PEAK * config.approach_rad_per_s / config.brake_s;
        for controller in [&config.arm, &config.hand] {
            let most = controller.deceleration_rad_per_s2;
            if needed > most {
                return Err(said(format!(
                    "a brake on the approach decelerates at {needed:.1} rad/s², more than `deceleration_rad_per_s2`, \
                     {most}: lower `approach_rad_per_s`, or raise `brake_s`"
                )));
            }
        }
        Ok(config)
    }

    fn numbers(&self) -> Vec<(&'static str, f64)> {
        let mut numbers = vec![
            ("silence_s", self.silence_s),
            ("brake_s", self.brake_s),
            ("start_tolerance_rad", self.start_tolerance_rad),
            ("approach_rad_per_s", self.approach_rad_per_s),
            ("max_age_s", self.max_age_s),
        ];
        for controller in [&self.arm, &self.hand] {
            numbers.push(("tracking_rad", controller.tracking_rad));
            let deceleration = controller.deceleration_rad_per_s2;
            numbers.push(("deceleration_rad_per_s2", deceleration));
        }
        if let Some(object) = &self.object {
            numbers.push(("object.max_off_m", object.max_off_m));
            numbers.push(("object.max_age_s", object.max_age_s));
        }
        numbers
    }

    /// Loads the robot.
    ///
    /// # Errors
    ///
    /// Fails with the reason if a URDF cannot be used, the pose is none, or the names of the joints
    /// do not fit.
    pub(crate) fn load(&self) -> Result<CellRobot, String> {
        let read = |path: &Path| {
            let text = fs::read_to_string(path);
            text.map_err(|err| format!("`{}`: {err}", path.display()))
        };
        let hand = read(&self.hand_urdf)?;
        let place = Pose::from_array(self.table_from_base);
        let arm = CellArm {
            urdf: read(&self.robot)?,
            palm: self.palm.clone(),
            table_from_base: place.map_err(|err| format!("`table_from_base`: {err}"))?,
        };
        let model = RobotModel::from_urdf(&hand).map_err(|err| err.to_string())?;
        let robot = CellRobot::new(&hand, model, Some(&arm)).map_err(|err| err.to_string())?;
        self.arm.check_names("arm", robot.arm_joints())?;
        self.hand.check_names("hand", robot.hand_joints())?;
        Ok(robot)
    }
}

impl Controller {
    /// Returns the controller's name of a joint of the URDF.
    pub(crate) fn name_of<'a>(&'a self, joint: &'a str) -> &'a str {
        self.names.get(joint).map_or(joint, String::as_str)
    }

    /// Checks that the map names joints of the URDF, and no two of them alike.
    fn check_names(&self, part: &str, joints: &[Joint]) -> Result<(), String> {
        let unknown = self
            .names
            .keys()
            .find(|&name| joints.iter().all(|joint| joint.name != *name));
        if let Some(name) = unknown {
            return Err(format!("`{part}.names`: the {part} has no joint `{name}`"));
        }
        let mut seen = BTreeSet::new();
        let mut theirs = joints.iter().map(|joint| self.name_of(&joint.name));
        match theirs.find(|&name| !seen.insert(name)) {
            Some(name) => Err(format!("`{part}.names`: two joints are called `{name}`")),
            None => Ok(()),
        }
    }
}
