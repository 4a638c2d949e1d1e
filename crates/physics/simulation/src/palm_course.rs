//! A palm that its drives carry along its path.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use robot::{DynamicsModel, WrongDof};
use spatial::{Object, Palm, Pose};

use crate::{
    config::{PalmDriveConfig, SceneConfig},
    desired::Desired,
    script::{Command, Phase, Script},
};

/// Coordinates of the palm: its position, and its rotation vector from where it starts.
const DIMENSIONS: usize = 6;

/// Path of a driven palm, from the start of a script to its lift.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PalmCourse {
    /// Pose at the end of each physics step, in the frame of the object as it lay.
    poses: Vec<Pose<Object, Palm>>,
    steps_per_control: usize,
}

impl PalmCourse {
    /// Moves the palm along a script: six drives with the torque law of the fingers', which carry the hand's mass, and
    /// its mean moment of inertia about the palm's origin as the hand is at the start.
    ///
    /// # Errors
    ///
    /// Fails if the script's commands do not have as many joints as the hand.
    pub(crate) fn new(
        drive: &PalmDriveConfig,
        script: &Script,
        scene: &SceneConfig,
        hand: &DynamicsModel,
    ) -> Result<Self, WrongDof> {
        let start = script.start.hand.frame_from_palm;
        let driven = script.commands.iter().take_while(|c| c.phase < Phase::Lift);
        let mut course: Vec<[f64; DIMENSIONS]> = Vec::new();
        for command in [&script.start].into_iter().chain(driven) {
            course.push(coordinates(&start, command, course.last()));
        }
        let positions: Vec<&[f64]> = course.iter().map(<[f64; DIMENSIONS]>::as_slice).collect();
        let desired = Desired::of_course(&positions, scene);
        let inertia = hand.free_mass_matrix(&script.start.hand.q_rad)?;
        let inertia_kg_m2 = (3..DIMENSIONS)
            .map(|axis| inertia[(axis, axis)])
            .sum::<f64>()
            / 3.0;
        let axes = axis_drives(drive, hand.mass_kg(), inertia_kg_m2);

        let (step_s, per_control) = (scene.time_step_s, scene.steps_per_control as usize);
        let mut axis_states = course.first().map_or([[0.0; 2]; DIMENSIONS], |first| {
            std::array::from_fn(|axis| [first[axis], 0.0])
        });
        let steps_n = (course.len() - 1) * per_control;
        let mut poses = Vec::with_capacity(steps_n);
        for step in 0..steps_n {
            let within_s = (step % per_control) as f64 * step_s;
            let Some(setpoint) = desired.during(step / per_control, within_s, step_s) else {
                break;
            };
            for (axis, (state, drive)) in axis_states.iter_mut().zip(&axes).enumerate() {
                let feedforward = setpoint.acceleration.as_ref();
                *state = drive.integrate(
                    *state,
                    setpoint.q[axis],
                    setpoint.velocity[axis],
                    feedforward.map_or(0.0, |acceleration| acceleration[axis]),
                    step_s,
                );
            }
            poses.push(pose(&start, &axis_states.map(|[position, _]| position)));
        }
        Ok(Self {
            poses,
            steps_per_control: per_control,
        })
    }

    /// Number of control steps after which the palm stays where it is, but for being carried.
    pub(crate) fn control_step_count(&self) -> usize {
        self.poses.len() / self.steps_per_control
    }

    /// Returns the pose at the end of a physics step that belongs to at most the control step `last`.
    pub(crate) fn pose(&self, step: usize, last: usize) -> Option<&Pose<Object, Palm>> {
        let end = (last + 1) * self.steps_per_control;
        self.poses.get(step.min(end.saturating_sub(1)))
    }
}

/// Returns the coordinates of a commanded palm; of equal rotation vectors, the one that is nearest to those before.
fn coordinates(
    start: &Pose<Object, Palm>,
    command: &Command,
    before: Option<&[f64; DIMENSIONS]>,
) -> [f64; DIMENSIONS] {
    let palm = &command.hand.frame_from_palm;
    let position = palm.translation.vector;
    let mut turn = (start.rotation.inverse() * palm.rotation).scaled_axis();
    let angle = turn.norm();
    if let (Some(&[_, _, _, x, y, z]), true) = (before, angle > 0.0) {
        let axis = turn / angle;
        let turns = ((axis.dot(&Vector3::new(x, y, z)) - angle) / TAU).round();
        turn += axis * TAU * turns;
    }
    [position.x, position.y, position.z, turn.x, turn.y, turn.z]
}

/// Reverses [`coordinates`].
fn pose(start: &Pose<Object, Palm>, coordinates: &[f64; DIMENSIONS]) -> Pose<Object, Palm> {
    let &[x, y, z, turn_x, turn_y, turn_z] = coordinates;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(turn_x, turn_y, turn_z));
    Pose::from_parts([x, y, z], start.rotation * turn)
}

/// The drive of one coordinate, in meters, newtons and kilograms, or in radians, newton meters and kg m².
#[derive(Debug, Clone, Copy, PartialEq)]
struct AxisDrive {
    stiffness: f64,
    damping: f64,
    limit: f64,
    inertia: f64,
}

/// Returns the drives of all coordinates.
fn axis_drives(
    drive: &PalmDriveConfig,
    mass_kg: f64,
    inertia_kg_m2: f64,
) -> [AxisDrive; DIMENSIONS] {
    let translation = AxisDrive {
        stiffness: drive.stiffness_n_per_m,
        damping: drive.damping_ns_per_m,
        limit: drive.force_limit_n,
        inertia: mass_kg,
    };
    let rotation = AxisDrive {
        stiffness: drive.stiffness_nm_per_rad,
        damping: drive.damping_nms_per_rad,
        limit: drive.torque_limit_nm,
        inertia: inertia_kg_m2,
    };
    [
        translation,
        translation,
        translation,
        rotation,
        rotation,
        rotation,
    ]
}

impl AxisDrive {
    /// Returns position and velocity one physics step later, by implicit Euler: the effort is that at the step's end,
    /// within its limit, with the desired acceleration as feedforward.
    fn integrate(
        &self,
        [position, velocity]: [f64; 2],
        desired_position: f64,
        desired_velocity: f64,
        desired_acceleration: f64,
        step_s: f64,
    ) -> [f64; 2] {
        let effort = self.stiffness * (desired_position - position)
            + self.damping * desired_velocity
            + self.inertia * desired_acceleration;
        let opposing = self.damping + self.stiffness * step_s;
        let free = (self.inertia * velocity + step_s * effort) / (self.inertia + step_s * opposing);
        let most = step_s * self.limit / self.inertia;
        let velocity = velocity + (free - velocity).clamp(-most, most);
        [position + step_s * velocity, velocity]
    }
}

#[cfg(test)]
mod tests {
    use motion::{Motion, Step};
    use robot::RobotModel;

    use super::*;
    use crate::{
        config::{ControllerKind, Protocol},
        fixture,
    };

    /// A palm with one finger.
    const HAND: &str = r#"<robot name="h">
        <link name="palm"><inertial><mass value="1"/>
          <inertia ixx="2e-3" ixy="0" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial></link>
        <link name="finger"><inertial><mass value="0.1"/>
          <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
        <joint name="j" type="revolute"><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
      </robot>"#;
    const N: u32 = 40;
    const SPEED_M_PER_S: f64 = 0.5;

    fn hand() -> RobotModel {
        RobotModel::from_urdf(HAND).unwrap()
    }

    /// A hand that goes along x and turns about z, each at constant speed.
    fn course(controller: ControllerKind, drive: PalmDriveConfig) -> (PalmCourse, Script) {
        let mut scene = fixture::scene();
        scene.drive.controller = controller;
        let hand = hand();
        let protocol = Protocol {
            reach_s: f64::from(N) * scene.control_step_s(),
            ..serde_json::from_str(r#"{"flexion_joints": []}"#).unwrap()
        };
        let step = |step: u32| {
            let time_s = f64::from(step) * scene.control_step_s();
            let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * time_s);
            Step {
                time_s,
                frame_from_palm: Pose::from_parts([SPEED_M_PER_S * time_s, 0.0, 0.3], turn),
                q_rad: vec![0.0; hand.dof()],
                rates: (),
            }
        };
        let motion = Motion::new(&hand.joint_names(), (0..=N).map(step).collect()).unwrap();
        let script = Script::new(&motion, &protocol, &scene, &hand).unwrap();
        let course = driven(&script, &scene, &hand, drive);
        (course, script)
    }

    fn driven(
        script: &Script,
        scene: &SceneConfig,
        hand: &RobotModel,
        drive: PalmDriveConfig,
    ) -> PalmCourse {
        PalmCourse::new(&drive, script, scene, &DynamicsModel::new(hand)).unwrap()
    }

    /// Returns the lags of the palm's position and orientation behind their command late in the reach, in meters and
    /// radians.
    fn lag(controller: ControllerKind) -> [f64; 2] {
        let (course, script) = course(controller, PalmDriveConfig::default());
        let step = 30;
        let reached = course.pose((step + 1) * course.steps_per_control - 1, step);
        let commanded = script.commands[step].hand.frame_from_palm;
        let behind = reached.unwrap().inverse() * commanded;
        [behind.translation.vector.norm(), behind.rotation.angle()]
    }

    #[test]
    fn pd_lags_by_damping_over_stiffness_times_the_speed_and_a_reference_does_not() {
        let drive = PalmDriveConfig::default();
        // A command is that of the end of its control step, and so half a step early.
        let early_s = fixture::scene().control_step_s() / 2.0;
        let time_s = drive.damping_ns_per_m / drive.stiffness_n_per_m - early_s;
        let [translation_m, rotation_rad] = lag(ControllerKind::Pd);
        let expected = time_s * SPEED_M_PER_S;
        assert!(
            (translation_m / expected - 1.0).abs() < 0.2,
            "{translation_m} m"
        );
        assert!(
            (rotation_rad / time_s - 1.0).abs() < 0.2,
            "{rotation_rad} rad"
        );
        let held = lag(ControllerKind::PdVelocity);
        assert!(
            2.0 * held[0] < translation_m && 2.0 * held[1] < rotation_rad,
            "{held:?}"
        );
        for controller in [
            ControllerKind::PdVelocityInterpolated,
            ControllerKind::PdFeedforward,
        ] {
            let behind = lag(controller);
            assert!(
                50.0 * behind[0] < translation_m && 50.0 * behind[1] < rotation_rad,
                "{behind:?}"
            );
        }
    }

    #[test]
    fn force_and_torque_keep_their_limits() {
        let drive = PalmDriveConfig {
            force_limit_n: 0.3,
            torque_limit_nm: 1e-4,
            ..PalmDriveConfig::default()
        };
        let (course, script) = course(ControllerKind::PdVelocityInterpolated, drive);
        let hand = DynamicsModel::new(&hand());
        let inertia = hand.free_mass_matrix(&script.start.hand.q_rad).unwrap();
        let inertia_kg_m2 = (3..6).map(|axis| inertia[(axis, axis)]).sum::<f64>() / 3.0;
        let step_s = fixture::scene().time_step_s;
        let mut most = [0.0_f64; 2];
        for three in course.poses.windows(3) {
            let acceleration = |coordinate: fn(&Pose<Object, Palm>) -> f64| {
                let [a, b, c] = [&three[0], &three[1], &three[2]].map(coordinate);
                (c - 2.0 * b + a).abs() / step_s.powi(2)
            };
            let translation = acceleration(|pose| pose.translation.vector.x);
            let rotation = acceleration(|pose| pose.rotation.scaled_axis().z);
            most[0] = most[0].max(hand.mass_kg() * translation);
            most[1] = most[1].max(inertia_kg_m2 * rotation);
        }
        assert!((most[0] / 0.3 - 1.0).abs() < 1e-3, "{} N", most[0]);
        assert!((most[1] / 1e-4 - 1.0).abs() < 1e-3, "{} Nm", most[1]);
    }

    #[test]
    fn the_palm_stops_with_the_last_command_before_the_lift() {
        let (course, script) = course(ControllerKind::Pd, PalmDriveConfig::default());
        let before_lift = |command: &&Command| command.phase < Phase::Lift;
        let n = script.commands.iter().take_while(before_lift).count();
        assert_eq!(course.control_step_count(), n);
        assert!(n > N as usize);
        let last = course.pose(usize::MAX, n - 1).unwrap();
        let off = last.inverse() * script.commands[n - 1].hand.frame_from_palm;
        assert!(off.translation.vector.norm() < 1e-4, "{off:?}");
        // An aborted motion stays where it was.
        let halted = course.pose(usize::MAX, 4);
        assert_eq!(halted, course.pose(5 * course.steps_per_control - 1, 4));
    }

    #[test]
    fn turns_go_on_beyond_half_a_turn() {
        let start = Pose::identity();
        let mut before: Option<[f64; DIMENSIONS]> = None;
        for step in 0..40 {
            let angle = 0.2 * f64::from(step);
            let command = Command {
                phase: Phase::Reach,
                hand: motion::HandState {
                    frame_from_palm: Pose::from_parts(
                        [0.0; 3],
                        UnitQuaternion::from_scaled_axis(Vector3::y() * angle),
                    ),
                    q_rad: Vec::new(),
                },
                carried_in_table_m: Vector3::zeros(),
                pull_in_table_m_per_s2: Vector3::zeros(),
            };
            let found = coordinates(&start, &command, before.as_ref());
            assert!((found[4] - angle).abs() < 1e-9, "{found:?} {angle}");
            before = Some(found);
        }
    }
}
