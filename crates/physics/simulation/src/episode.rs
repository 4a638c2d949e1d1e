//! Episode: a scene that is advanced by commands not known beforehand, and can be copied at any time.

use motion::HandState;
use nalgebra::Vector3;
use options::OptionFault;
use spatial::{Object, Palm, Pose, Table};

use crate::{
    config::Support,
    error::SimulationError,
    hand::LinkShape,
    judge::IMPLAUSIBLE_SPEED,
    settled_scene::SettledScene,
    units::meters,
    world::{Overflow, World},
};

/// A hand and an object at one time, with the complete state of physics: copies are independent and continue from
/// the same bits.
pub struct Episode {
    world: World,
}

/// Observation of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeState {
    /// Pose of the palm in the frame of the table.
    pub table_from_palm: Pose<Table, Palm>,
    /// Joint positions in radians (meters if prismatic).
    pub q: Vec<f64>,
    /// Pose of the object in the frame of the table.
    pub table_from_object: Pose<Table, Object>,
}

/// A body's numbers overflowed, or it is faster than anything can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the simulation diverged")]
pub struct Divergence;

impl SettledScene {
    /// Places the hand, at rest, beside the settled object.
    ///
    /// # Errors
    ///
    /// Fails if the command has not one position per joint, if a position is no number, if the palm is driven or yields, or if
    /// the fingers' drives look ahead or are late: their future commands are not known.
    pub fn begin(&self, start: &HandState<Object>) -> Result<Episode, SimulationError> {
        if self.scene.drive.controller.follows_motion() {
            let problem = "looks ahead, and the next command is not known: choose `pd`";
            return Err(OptionFault::new("drive.controller", problem).into());
        }
        if self.scene.palm_drive.is_some() {
            let problem =
                "needs the whole path beforehand, and the next command is not known: leave it out";
            return Err(OptionFault::new("palm_drive", problem).into());
        }
        if self.scene.palm_compliance.is_some() {
            let problem = "may end a motion as overloaded, which an episode cannot: leave it out";
            return Err(OptionFault::new("palm_compliance", problem).into());
        }
        if self.scene.delay_steps() > 0 {
            let problem = "must be 0: commands take effect at once";
            return Err(OptionFault::new("drive.delay_s", problem).into());
        }
        if start.q_rad.len() != self.model.dof() || start.q_rad.iter().any(|q| !q.is_finite()) {
            let message = format!("{:?} are not positions of its joints", start.q_rad);
            return Err(SimulationError::Motion(message));
        }
        let mut world = self.world.fork();
        let table_from_palm = self.table_from_estimate() * start.frame_from_palm;
        self.hand.place(&mut world, &table_from_palm, &start.q_rad);
        Ok(Episode { world })
    }

    /// Advances an episode of this scene by one control step, as in the reach of a rollout: `command` is the pose of
    /// the palm at its end, and the positions to which the fingers are driven during it.
    ///
    /// # Errors
    ///
    /// Fails if the simulation diverges; from then on its state is meaningless.
    pub fn advance(
        &self,
        episode: &mut Episode,
        command: &HandState<Object>,
    ) -> Result<(), Divergence> {
        let world = &mut episode.world;
        let target = self.table_from_estimate() * command.frame_from_palm;
        self.hand
            .move_palm(world, &target, self.scene.control_step_s());
        for _ in 0..self.scene.steps_per_control {
            self.hand.drive(world, &command.q_rad);
            world.step().map_err(|Overflow| Divergence)?;
            self.hand.limit_speed(world);
        }
        let object = world.bodies.get(self.object).ok_or(Divergence)?;
        let speed = meters(object.linvel().length()).max(f64::from(object.angvel().length()));
        if speed < IMPLAUSIBLE_SPEED && self.hand.fastest(world) < IMPLAUSIBLE_SPEED {
            Ok(())
        } else {
            Err(Divergence)
        }
    }

    /// Returns the depth below the table of a hand that follows a command exactly, in meters; 0 if it is above, or
    /// there is no table. The palm follows its commands even through the table.
    pub fn below_table_m(&self, command: &HandState<Object>) -> f64 {
        if self.scene.support != Support::Table {
            return 0.0;
        }
        let palm_from_links = self.model.link_poses::<Palm>(|joint| command.q_rad[joint]);
        let table_from_palm = self.table_from_estimate() * command.frame_from_palm;
        let lowest_m = |shape: &LinkShape| {
            let palm_from_link = palm_from_links[shape.of_hand.link];
            let table_from_shape = table_from_palm * palm_from_link * shape.link_from_shape;
            shape.shape.lowest_m(&table_from_shape, &Vector3::z())
        };
        -self.shapes.iter().map(lowest_m).fold(0.0, f64::min)
    }

    /// Returns the observation of an episode of this scene.
    pub fn observe(&self, episode: &Episode) -> EpisodeState {
        EpisodeState {
            table_from_palm: self.hand.table_from_palm(&episode.world),
            q: self.hand.positions(&episode.world),
            table_from_object: self.table_from_object_in(&episode.world),
        }
    }
}

impl Episode {
    /// Returns an independent copy.
    #[must_use]
    pub fn fork(&self) -> Self {
        Self {
            world: self.world.fork(),
        }
    }
}
