//! A scene that is built and settled once, and copied for each rollout.

use geometry::SurfaceDistance;
use motion::{Motion, Rates};
use nalgebra::{UnitQuaternion, Vector3};
use options::Options;
use rapier3d::prelude::{RigidBodyHandle, SharedShape};
use robot::RobotModel;
use schemas::rollouts::Verdict;
use spatial::{Object, Pose, RestingPose, Table};

use crate::{
    config::{Offset, Protocol, SceneConfig},
    error::SimulationError,
    hand::{self, HandBodies, LinkShape, link_shapes},
    object::ObjectShape,
    palm_course::PalmCourse,
    played::CommandStep,
    rejection::reject,
    rollout::{
        Rollout, StepDecision, StepObserver, TraceMode, TraceStep, WatchedRollout, run, run_watched,
    },
    script::{Script, Setpoint, steps as steps_in},
    units::meters,
    world::{Overflow, World},
};

/// Gap in meters with which the object is put above the table, so that it never starts in it.
const GAP_M: f64 = 0.0005;
/// Speeds (m/s, rad/s) below which the object rests.
const RESTING_SPEED: f64 = 0.002;
/// Consecutive physics steps below that speed after which it counts as settled.
const RESTING_STEPS: u32 = 10;

/// One object lying on a table beside one hand, settled: the start of any number of rollouts.
pub struct SettledScene {
    pub(crate) world: World,
    pub(crate) scene: SceneConfig,
    pub(crate) model: RobotModel,
    pub(crate) hand: HandBodies,
    pub(crate) object: RigidBodyHandle,
    pub(crate) shapes: Vec<LinkShape>,
    hulls: Vec<SharedShape>,
    /// The object's surface, where its parts only stand for it.
    pub(crate) surface: Option<SurfaceDistance>,
    /// Pose of the object at rest.
    table_from_object: Pose<Table, Object>,
    /// Estimated pose of the object, on which the motions are based.
    table_from_estimate: Pose<Table, Object>,
}

impl SettledScene {
    /// Builds the scene and lets the object come to rest alone on the table.
    ///
    /// # Errors
    ///
    /// Fails if the object has no mass, volume or physical inertia; if a moving part of the hand
    /// has no inertia, or the hand no shape or a mesh that was not loaded; if a setting is out of range; or
    /// if the object does not stay on the table.
    pub fn new(
        scene: &SceneConfig,
        model: &RobotModel,
        object: &ObjectShape,
        rest: &RestingPose,
    ) -> Result<Self, SimulationError> {
        check(scene)?;
        let mut world = World::of(scene);
        let table_from_object = rest.table_from_object();
        let rise_m = GAP_M - object.lowest_m(&table_from_object);
        let table_from_object = table_from_object.translated(&Vector3::new(0.0, 0.0, rise_m));
        let displaced = displace(&scene.object_offset, &table_from_object);
        let body = object.insert(&mut world, scene, &displaced)?;
        let hand = HandBodies::insert(&mut world, scene, model)?;
        let hulls = object.hulls()?;
        let table_from_object = settle(&mut world, scene, &hand, body)?;
        let table_from_estimate = undo(&scene.object_offset, &table_from_object);
        Ok(Self {
            world,
            scene: scene.clone(),
            model: model.clone(),
            hand,
            object: body,
            shapes: link_shapes(model)?,
            hulls,
            surface: object.surface.as_ref().map(SurfaceDistance::new),
            table_from_object,
            table_from_estimate,
        })
    }

    /// Returns the object's resting pose, in the table's frame.
    pub fn table_from_object(&self) -> Pose<Table, Object> {
        self.table_from_object
    }

    /// Returns the estimated pose of the object, on which the motions are based: its resting pose without
    /// [`SceneConfig::object_offset`].
    pub fn table_from_estimate(&self) -> Pose<Table, Object> {
        self.table_from_estimate
    }

    /// Executes a motion in a fresh copy of the scene and judges it.
    ///
    /// Motions refused on geometry alone cost no control step and have no trace.
    ///
    /// # Errors
    ///
    /// Fails if the motion does not fit the hand or the protocol names a joint that it lacks.
    pub fn rollout<R: Rates>(
        &self,
        motion: &Motion<Object, R>,
        protocol: &Protocol,
        record: TraceMode,
    ) -> Result<Rollout, SimulationError> {
        let script = Script::new(motion, protocol, &self.scene, &self.model)?;
        Ok(match self.refuses(&script, protocol)? {
            Some(verdict) if self.scene.shortcuts.refused => Rollout::refused(verdict, &script),
            Some(verdict) => Rollout {
                verdict,
                trace: None,
                ..run(self, &script, protocol, record)
            },
            None => run(self, &script, protocol, record),
        })
    }

    /// Executes precomputed steps to the end of their hold and judges them, with their trace; `see` is
    /// called at every step. On its request the motion is aborted and the hand stands still
    /// for `hold_s`, with `see` called then too.
    ///
    /// Only the protocol's success criteria matter: the steps define when the fingers close and the
    /// palm rises.
    ///
    /// # Errors
    ///
    /// Fails if the steps do not fit the hand, or there is no lift or no hold among them.
    pub fn execute(
        &self,
        steps: &[CommandStep],
        protocol: &Protocol,
        hold_s: f64,
        see: &mut dyn FnMut(&TraceStep) -> StepDecision,
    ) -> Result<WatchedRollout, SimulationError> {
        let script = Script::played(steps, &self.scene, &self.model)?;
        if let Some(verdict) = self.refuses(&script, protocol)? {
            return Ok(WatchedRollout {
                rollout: Rollout::refused(verdict, &script),
                aborted: false,
            });
        }
        let hold_n = u32::try_from(steps_in(hold_s, &self.scene)).unwrap_or(u32::MAX);
        let observer = Some(StepObserver { see, hold_n });
        Ok(run_watched(
            self,
            &script,
            protocol,
            TraceMode::Trace,
            observer,
        ))
    }

    /// Returns why a script is refused on geometry alone, if it is.
    fn refuses(
        &self,
        script: &Script,
        protocol: &Protocol,
    ) -> Result<Option<Verdict>, SimulationError> {
        reject(
            script,
            protocol,
            &self.model,
            &self.shapes,
            &self.hulls,
            self.scene.support,
            &self.table_from_estimate,
        )
    }

    /// Returns the course of a driven palm along a script; none if it follows its path exactly.
    pub(crate) fn palm_course(&self, script: &Script) -> Option<PalmCourse> {
        let drive = self.scene.palm_drive.as_ref()?;
        match PalmCourse::new(drive, script, &self.scene, self.hand.dynamics()) {
            Ok(course) => Some(course),
            Err(err) => unreachable!("the script was checked against the hand: {err}"),
        }
    }

    /// Returns the object's pose in a copy of the world.
    pub(crate) fn table_from_object_in(&self, world: &World) -> Pose<Table, Object> {
        world.table_from_body(self.object)
    }

    /// Returns the commands to palm and fingers in the rollout of a motion: their start, then one
    /// setpoint per control step to the end of the hold, whatever happens to the object.
    ///
    /// # Errors
    ///
    /// Fails if the motion does not fit the hand or the protocol names a joint that it lacks.
    pub fn setpoints<R: Rates>(
        &self,
        motion: &Motion<Object, R>,
        protocol: &Protocol,
    ) -> Result<Vec<Setpoint>, SimulationError> {
        let script = Script::new(motion, protocol, &self.scene, &self.model)?;
        Ok(std::iter::once(&script.start)
            .chain(&script.commands)
            .map(|command| command.setpoint(&self.table_from_estimate))
            .collect())
    }

    /// Returns why a motion is refused on geometry alone, if it is.
    ///
    /// # Errors
    ///
    /// Fails if the motion does not fit the hand or the protocol names a joint that it lacks.
    pub fn refusal<R: Rates>(
        &self,
        motion: &Motion<Object, R>,
        protocol: &Protocol,
    ) -> Result<Option<Verdict>, SimulationError> {
        let script = Script::new(motion, protocol, &self.scene, &self.model)?;
        self.refuses(&script, protocol)
    }
}

/// Checks that a hand can be simulated in a scene, whatever the object.
///
/// # Errors
///
/// Fails if a setting of the scene is out of range, if a moving part of the hand has no inertia, and if
/// the hand has no shape or a mesh that was not loaded.
pub fn check_hand(scene: &SceneConfig, hand: &RobotModel) -> Result<(), SimulationError> {
    check(scene)?;
    hand::check(hand, scene)
}

/// Refuses settings that cannot be simulated.
fn check(scene: &SceneConfig) -> Result<(), SimulationError> {
    let fault = scene.faults().into_iter().next();
    fault.map_or(Ok(()), |fault| Err(fault.into()))
}

/// Displaces an object on the table, turning it about the vertical through its own origin.
fn displace(offset: &Offset, table_from_object: &Pose<Table, Object>) -> Pose<Table, Object> {
    let shift = Vector3::new(offset.x_m, offset.y_m, 0.0);
    turn(table_from_object, offset.yaw_rad, shift)
}

/// Reverses [`displace`].
fn undo(offset: &Offset, table_from_object: &Pose<Table, Object>) -> Pose<Table, Object> {
    let shift = Vector3::new(-offset.x_m, -offset.y_m, 0.0);
    turn(table_from_object, -offset.yaw_rad, shift)
}

fn turn(
    table_from_object: &Pose<Table, Object>,
    yaw_rad: f64,
    shift_in_table_m: Vector3<f64>,
) -> Pose<Table, Object> {
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    Pose::from_parts(
        table_from_object.translation.vector + shift_in_table_m,
        yaw * table_from_object.rotation,
    )
}

/// Runs the world until the object rests, then zeroes its velocity and returns its pose.
fn settle(
    world: &mut World,
    scene: &SceneConfig,
    hand: &HandBodies,
    object: RigidBodyHandle,
) -> Result<Pose<Table, Object>, SimulationError> {
    let parked = hand.positions(world);
    let mut resting = 0;
    let mut time_s = 0.0;
    while time_s < scene.settle_s && resting < RESTING_STEPS {
        hand.drive(world, &parked);
        world
            .step()
            .map_err(|Overflow| SimulationError::Unsettled)?;
        time_s += scene.time_step_s;
        let Some(body) = world.bodies.get(object) else {
            return Err(SimulationError::Unsettled);
        };
        let speed = meters(body.linvel().length()).max(f64::from(body.angvel().length()));
        resting = if speed < RESTING_SPEED {
            resting + 1
        } else {
            0
        };
    }
    let Some(body) = world.bodies.get_mut(object) else {
        return Err(SimulationError::Unsettled);
    };
    body.set_linvel(rapier3d::math::Vector::ZERO, true);
    body.set_angvel(rapier3d::math::Vector::ZERO, true);
    let table_from_object: Pose<Table, Object> = world.table_from_body(object);
    let place = table_from_object.translation.vector;
    if place.iter().all(|number| number.is_finite()) && place.z > -0.5 {
        Ok(table_from_object)
    } else {
        Err(SimulationError::Unsettled)
    }
}
