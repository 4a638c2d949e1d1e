//! The cell's messages as another implementation reads them: the Python package `zenoh-ros2-sdk`, which
//! speaks to `rmw_zenoh` and has definitions and hashes of its own.

use std::{
    env,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, Command, Stdio},
};

use schemas::executions::Outcome;

use crate::lab::{Lab, SOUND, execute, goal};

/// A process that ends with the test.
struct Ending(Child);

impl Drop for Ending {
    fn drop(&mut self) {
        let _gone = self.0.kill();
        let _gone = self.0.wait();
    }
}

/// The Python to use, if it has the package.
fn python() -> Option<String> {
    let python = env::var("PIPELINE_PYTHON").ok()?;
    let import = "import zenoh_ros2_sdk, rosbags";
    let has = Command::new(&python).args(["-c", import]).status();
    has.is_ok_and(|status| status.success()).then_some(python)
}

#[test]
fn another_implementation_reads_the_commands_and_its_pose_of_the_object_is_read() {
    let Some(python) = python() else {
        println!("skipped: `PIPELINE_PYTHON` names no Python with `zenoh-ros2-sdk`");
        return;
    };
    let lab = Lab::new();
    let _emulated = lab.emulate_joints(SOUND);
    let (_, port) = lab.endpoint().rsplit_once(':').unwrap();
    let object = lab.config.object.as_ref().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ros2_cell/wire.py");
    let mut other = Command::new(python)
        .arg("-B")
        .arg(script)
        .args([port, &lab.config.arm.node])
        .args([&lab.config.hand.node, &object.pose])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map(Ending)
        .unwrap();
    let mut lines = BufReader::new(other.0.stdout.take().unwrap()).lines();
    assert_eq!(lines.next().unwrap().unwrap(), "ready");
    let _cell = lab.serve();
    // It is refused unless the pose is heard.
    let report = execute(&lab.connect(), &goal(&lab, 1));
    assert_eq!(report.outcome, Outcome::Failed, "{}", report.message);
    other.0.stdin.take().unwrap().write_all(b"\n").unwrap();
    let said: Vec<String> = lines.map(Result::unwrap).collect();
    for joint in ["joint1", "ah_joint00"] {
        let heard = said
            .iter()
            .filter(|line| line.starts_with(&format!("heard {joint} ")));
        assert!(heard.clone().count() > 20, "{said:?}");
        // Thirty steps: times rise, every point is whole, the last one rests.
        assert!(
            heard
                .clone()
                .all(|line| line.ends_with(" 31 True True True")),
            "{said:?}"
        );
    }
    for (topic, kind) in [
        (
            format!("{}/joint_trajectory", lab.config.arm.node),
            "trajectory_msgs/msg/JointTrajectory",
        ),
        (
            lab.config.arm.joint_states.clone(),
            "sensor_msgs/msg/JointState",
        ),
    ] {
        assert!(said.contains(&format!("topic {topic} {kind}")), "{said:?}");
    }
}
