//! Verdicts of rollouts from their steps.

use schemas::rollouts::{Measures, Verdict};
use spatial::{Object, Palm, Pose, Table};

use crate::{
    config::{KnockedUntil, Protocol},
    contact::{self, Touch},
    protocols::{Criteria, exceeds},
    script::{Command, Phase, Script, steps},
    settings::MAX_DELAY_S,
    settled_scene::SettledScene,
    shortcuts::Shortcuts,
    units::meters,
    world::World,
};

/// Speed (m/s, rad/s) that only a failed simulation exceeds in this scene; the engine lets nothing be faster
/// than 400 m/s, or turn by more than an eighth of a turn in a step (196 rad/s in 4 ms).
pub(crate) const IMPLAUSIBLE_SPEED: f64 = 300.0;
/// Distance in meters from the table's origin beyond which the object is lost.
const IMPLAUSIBLE_DISTANCE_M: f64 = 10.0;
/// Time at the end of the hold over which slip and contact are judged, in seconds.
const FINAL_WINDOW_S: f64 = 0.5;
/// Share of the final window's steps in which a link must press to count as in contact.
const TOUCHING_SHARE: f64 = 0.5;
/// Time for which the palm may be loaded by too much: impacts are shorter.
const OVERLOADED_S: f64 = 0.1;
/// Time at rest in the hand after which a held object has settled, in seconds.
const SETTLED_S: f64 = 0.3;
/// Fingers at rest have received the last command.
const _: () = assert!(SETTLED_S > MAX_DELAY_S, "delayed fingers still close");
/// Largest motion in the hand that counts as rest, in meters and radians, and as a share of the motion
/// that is a slip.
const SETTLED_M: f64 = 2e-4;
const SETTLED_RAD: f64 = 4e-3;
const SETTLED_SHARE: f64 = 0.1;

/// Follows a rollout and ends it as soon as its verdict is known.
pub(crate) struct Judge<'a> {
    protocol: &'a Protocol,
    /// The limits by which it judges.
    criteria: Criteria,
    /// The settled object.
    table_from_object_at_start: Pose<Table, Object>,
    rise_m: f64,
    displacement_m: Option<f64>,
    penetration_m: Option<f64>,
    /// The object's pose in the palm frame, from the end of the lift on.
    palm_from_object_held: Vec<Pose<Palm, Object>>,
    /// The object's pose in the palm frame after the latest step.
    last_palm_from_object: Pose<Palm, Object>,
    /// Control steps of the squeeze in which the fingers still close, because their commands arrive late.
    closing_left: usize,
    lift_left: usize,
    hold_left: usize,
    window: usize,
    control_s: f64,
    /// Steps of the final window until now.
    window_n: usize,
    /// Those of them in which each body of the hand pressed.
    pressed: Vec<usize>,
    /// Latest control steps in a row in which the palm was loaded by too much.
    overloaded_n: usize,
    /// The object's pose in the palm frame when the pulling began.
    palm_from_object_at_pull: Option<Pose<Palm, Object>>,
    shortcuts: Shortcuts,
    rest: Option<Resting>,
    /// Links that pressed throughout, if the rollout ended early because the object had settled.
    settled: Option<usize>,
}

/// The period for which the object has not moved in the hand.
struct Resting {
    palm_from_object: Pose<Palm, Object>,
    steps: usize,
    /// For each body of the hand, whether it has pressed throughout.
    pressing: Vec<bool>,
}

impl<'a> Judge<'a> {
    pub(crate) fn new(
        settled: &SettledScene,
        protocol: &'a Protocol,
        script: &Script,
        shortcuts: Shortcuts,
    ) -> Self {
        let count = |phase: Phase| script.commands.iter().filter(|c| c.phase == phase).count();
        let hold_left = count(Phase::Hold) + count(Phase::Pull);
        let scene = &settled.scene;
        let rises_only = protocol.published().shakes.is_none();
        // A hand that still closes or is shaken may touch a lost object again.
        let shortcuts = Shortcuts {
            lost: shortcuts.lost && scene.drive.delay_s <= protocol.pause_s && rises_only,
            settled: shortcuts.settled && rises_only,
            ..shortcuts
        };
        Self {
            protocol,
            criteria: protocol.criteria(),
            table_from_object_at_start: settled.table_from_object(),
            rise_m: 0.0,
            displacement_m: None,
            penetration_m: None,
            palm_from_object_held: Vec::new(),
            last_palm_from_object: Pose::identity(),
            closing_left: scene.delay_control_steps(),
            lift_left: count(Phase::Lift),
            hold_left,
            window: steps(FINAL_WINDOW_S, scene).clamp(1, hold_left.max(1)),
            control_s: scene.control_step_s(),
            window_n: 0,
            pressed: vec![0; settled.hand.body_count()],
            overloaded_n: 0,
            palm_from_object_at_pull: None,
            shortcuts,
            rest: None,
            settled: None,
        }
    }

    /// Processes the state after a command; returns the verdict once it is certain.
    pub(crate) fn observe(
        &mut self,
        settled: &SettledScene,
        world: &World,
        command: &Command,
    ) -> Option<Verdict> {
        let table_from_object = settled.table_from_object_in(world);
        if implausible(settled, world, &table_from_object) {
            return Some(Verdict::Diverged);
        }
        self.rise_m =
            table_from_object.translation.z - self.table_from_object_at_start.translation.z;
        let table_from_palm = settled.hand.table_from_palm(world);
        let palm_from_object = table_from_palm.inv_mul(&table_from_object);
        let before = self.last_palm_from_object;
        self.last_palm_from_object = palm_from_object;
        if self.is_overloaded(settled, world) {
            return Some(Verdict::Overloaded);
        }
        if self.is_displaced(&table_from_object, command) {
            let touch = self.measure_touch(settled, world);
            return Some(self.failed_grasp(settled, &touch));
        }
        match command.phase {
            Phase::Reach | Phase::Close => self.before_squeeze(&table_from_object),
            Phase::Squeeze if self.closing_left > 0 => {
                self.closing_left -= 1;
                self.before_squeeze(&table_from_object)
            }
            Phase::Squeeze => match self.protocol.strict.knocked_until {
                KnockedUntil::Squeeze => None,
                KnockedUntil::Lift => self.knocked_over(&table_from_object),
            },
            Phase::Lift => {
                let touch = self.measure_touch(settled, world);
                self.lift_left = self.lift_left.saturating_sub(1);
                if self.lift_left == 0 {
                    self.palm_from_object_held.push(self.last_palm_from_object);
                } else if !(self.is_low() && self.is_lost(settled, world, &touch)) {
                    return None;
                }
                self.is_low().then_some(Verdict::NotGrasped)
            }
            Phase::Hold => {
                let touch = self.measure_touch(settled, world);
                self.palm_from_object_held.push(self.last_palm_from_object);
                self.count_pressing(&touch);
                if self.is_low() || self.will_be_dropped(settled, world, &touch) {
                    return Some(Verdict::Dropped);
                }
                self.has_settled(settled, &palm_from_object, touch)
                    .then_some(Verdict::Held)
            }
            Phase::Pull => {
                let touch = self.measure_touch(settled, world);
                self.palm_from_object_held.push(self.last_palm_from_object);
                self.count_pressing(&touch);
                let from = *self.palm_from_object_at_pull.get_or_insert_with(|| {
                    if self.protocol.published().displacement_from_start {
                        table_from_palm.inv_mul(&self.table_from_object_at_start)
                    } else {
                        before
                    }
                });
                let away = from.inv_mul(&palm_from_object);
                let limits = &self.protocol.pull;
                let max_rotation_rad = self.criteria.max_rotation_rad;
                if away.translation.vector.norm() <= limits.max_displacement_m
                    && max_rotation_rad.is_none_or(|most| away.rotation.angle() <= most)
                {
                    return None;
                }
                Some(self.failed_grasp(settled, &touch))
            }
        }
    }

    /// Whether the object is too far from where it lay, moved as the palm was.
    fn is_displaced(&self, table_from_object: &Pose<Table, Object>, command: &Command) -> bool {
        let Some(most) = self.protocol.published().displacement else {
            return false;
        };
        let judged = match command.phase {
            Phase::Reach | Phase::Close | Phase::Pull => false,
            Phase::Squeeze | Phase::Lift => most.always,
            Phase::Hold => most.always || self.hold_left <= 1,
        };
        if !judged {
            return false;
        }
        let place = self.table_from_object_at_start.translation.vector + command.carried_in_table_m;
        let moved_m = (table_from_object.translation.vector - place).norm();
        let turned_rad = table_from_object
            .rotation
            .angle_to(&self.table_from_object_at_start.rotation);
        moved_m > most.max_m || turned_rad > most.max_rad
    }

    /// Returns the verdict on a failed grasp whose object moved too far: in the fingers, or out of them.
    fn failed_grasp(&self, settled: &SettledScene, touch: &Touch) -> Verdict {
        let links = indices(&touch.bodies);
        if !links.is_empty() && self.is_grasped(settled, &links) {
            Verdict::Slipped
        } else {
            Verdict::Dropped
        }
    }

    /// Whether object and table have loaded the palm for some time by more than it may be.
    fn is_overloaded(&mut self, settled: &SettledScene, world: &World) -> bool {
        let strict = &self.protocol.strict;
        if strict.max_palm_force_n.is_none() && strict.max_palm_torque_nm.is_none() {
            return false;
        }
        let load = contact::load_on_palm(world, &settled.hand.engine_from_palm(world));
        let load = [load.force_n, load.torque_nm].map(|of| of.norm());
        let limits = [strict.max_palm_force_n, strict.max_palm_torque_nm];
        let exceeds = |(load, limit): (f64, Option<f64>)| limit.is_some_and(|limit| load > limit);
        if load.into_iter().zip(limits).any(exceeds) {
            self.overloaded_n += 1;
        } else {
            self.overloaded_n = 0;
        }
        self.overloaded_n as f64 * self.control_s >= OVERLOADED_S
    }

    /// Records the displacement of the object before the squeeze, and judges it.
    fn before_squeeze(&mut self, table_from_object: &Pose<Table, Object>) -> Option<Verdict> {
        let moved = table_from_object.translation.vector
            - self.table_from_object_at_start.translation.vector;
        self.displacement_m = Some(moved.norm());
        self.knocked_over(table_from_object)
    }

    /// Returns the verdict that the object was knocked over if it is far from its initial pose.
    fn knocked_over(&self, table_from_object: &Pose<Table, Object>) -> Option<Verdict> {
        let moved = table_from_object.translation.vector
            - self.table_from_object_at_start.translation.vector;
        let turned = table_from_object
            .rotation
            .angle_to(&self.table_from_object_at_start.rotation);
        let is_far = exceeds(moved.norm(), self.criteria.knocked_m)
            || exceeds(turned, self.criteria.knocked_rad);
        is_far.then_some(Verdict::KnockedOver)
    }

    /// Whether the object is not lifted.
    fn is_low(&self) -> bool {
        let lifted_m = self.criteria.lifted_m;
        lifted_m.is_some_and(|lifted_m| self.rise_m <= lifted_m)
    }

    /// Counts, in the final window, in how many steps each body of the hand pressed.
    fn count_pressing(&mut self, touch: &Touch) {
        if self.hold_left <= self.window {
            self.window_n += 1;
            for (count, pressed) in self.pressed.iter_mut().zip(&touch.bodies) {
                *count += usize::from(*pressed);
            }
        }
        self.hold_left = self.hold_left.saturating_sub(1);
    }

    /// Whether the whole hand is above the whole object, which does not rise: a hand that only
    /// rises will not touch it again.
    fn is_lost(&self, settled: &SettledScene, world: &World, touch: &Touch) -> bool {
        self.shortcuts.lost
            && touch.bodies.iter().all(|pressed| !pressed)
            && world.is_below(settled.object, settled.hand.bodies())
    }

    /// Whether a lost object has time to fall before contacts are counted.
    fn will_be_dropped(&self, settled: &SettledScene, world: &World, touch: &Touch) -> bool {
        self.hold_left > self.window && self.needs_contact() && self.is_lost(settled, world, touch)
    }

    /// Whether the object has rested in the hand for so long, with enough links pressing
    /// throughout, that nothing more will happen: a creep at a tenth of the speed of a slip would
    /// have been detected.
    fn has_settled(
        &mut self,
        settled: &SettledScene,
        palm_from_object: &Pose<Palm, Object>,
        touch: Touch,
    ) -> bool {
        if !self.shortcuts.settled {
            return false;
        }
        let slow = |most: f64, speed_limit: Option<f64>| {
            speed_limit.map_or(most, |limit| most.min(SETTLED_SHARE * SETTLED_S * limit))
        };
        let settled_m = slow(SETTLED_M, self.criteria.max_slip_m_per_s);
        let settled_rad = slow(SETTLED_RAD, self.criteria.max_spin_rad_per_s);
        let moved = |rest: &Resting| {
            let away = rest.palm_from_object.inv_mul(palm_from_object);
            away.translation.vector.norm() > settled_m || away.rotation.angle() > settled_rad
        };
        let rest = match self.rest.take() {
            Some(mut rest) if !moved(&rest) => {
                rest.steps += 1;
                for (pressing, pressed) in rest.pressing.iter_mut().zip(touch.bodies) {
                    *pressing &= pressed;
                }
                rest
            }
            _ => Resting {
                palm_from_object: *palm_from_object,
                steps: 0,
                pressing: touch.bodies,
            },
        };
        let links = indices(&rest.pressing);
        if !self.is_grasped(settled, &links) {
            return false;
        }
        let long_enough = rest.steps as f64 * self.control_s >= SETTLED_S;
        self.rest = Some(rest);
        if long_enough {
            self.settled = Some(links.len());
        }
        long_enough
    }

    /// Records the penetration depth of hand and object while the object is carried.
    fn measure_touch(&mut self, settled: &SettledScene, world: &World) -> Touch {
        let surface = settled.surface.as_ref();
        let touch = contact::touch(world, settled.object, surface, settled.hand.body_count());
        let deepest_m = self.penetration_m.unwrap_or(0.0).max(touch.depth_m);
        self.penetration_m = Some(deepest_m);
        touch
    }

    /// Whether a success needs the hand to touch the object at the end.
    fn needs_contact(&self) -> bool {
        self.protocol.min_links > 0 || self.protocol.strict.min_fingers > 0
    }

    /// Whether enough links and fingers are among these bodies of the hand.
    fn is_grasped(&self, settled: &SettledScene, bodies: &[usize]) -> bool {
        let fingers_n = settled.hand.finger_count(bodies.iter().copied());
        bodies.len() >= self.protocol.min_links as usize
            && fingers_n >= self.protocol.strict.min_fingers as usize
    }

    /// Judges a rollout that ran to its end.
    pub(crate) fn conclude(&self, settled: &SettledScene) -> Verdict {
        if !self.is_grasped(settled, &self.touching()) {
            return Verdict::Dropped;
        }
        let back = self
            .palm_from_object_held
            .len()
            .saturating_sub(self.window + 1);
        let away = self
            .palm_from_object_held
            .get(back)
            .map_or_else(Pose::identity, |before| {
                before.inv_mul(&self.last_palm_from_object)
            });
        let (slipped_m, turned_rad) = (away.translation.vector.norm(), away.rotation.angle());
        let seconds = self.window as f64 * self.control_s;
        let over_window = |speed_limit: Option<f64>| speed_limit.map(|limit| limit * seconds);
        if exceeds(slipped_m, over_window(self.criteria.max_slip_m_per_s))
            || exceeds(turned_rad, over_window(self.criteria.max_spin_rad_per_s))
        {
            Verdict::Slipped
        } else {
            Verdict::Held
        }
    }

    /// Returns what was measured until now, without the numbers of steps and the fingers' depth in each other.
    pub(crate) fn measures(&self) -> Measures {
        Measures {
            lift_m: finite(self.rise_m),
            slip_m: self.slip_m().and_then(finite),
            displacement_m: self.displacement_m.and_then(finite),
            penetration_m: self.penetration_m.and_then(finite),
            contacts_n: self.contact_count(),
            ..Measures::default()
        }
    }

    /// Motion of the object in the palm frame since the end of the lift, in meters.
    fn slip_m(&self) -> Option<f64> {
        self.palm_from_object_held.first().map(|lifted| {
            lifted
                .inv_mul(&self.last_palm_from_object)
                .translation
                .vector
                .norm()
        })
    }

    /// Hand links in contact with the object at the end; none before the final window.
    fn contact_count(&self) -> Option<u32> {
        let counted = || (self.window_n > 0).then(|| self.touching().len());
        let links = self.settled.or_else(counted)?;
        Some(u32::try_from(links).unwrap_or(u32::MAX))
    }

    /// Bodies of the hand in contact with the object at the end.
    fn touching(&self) -> Vec<usize> {
        let enough = TOUCHING_SHARE * self.window as f64;
        let pressed = self.pressed.iter().enumerate();
        let touching = pressed.filter(|&(_, &n)| n as f64 >= enough);
        touching.map(|(body, _)| body).collect()
    }
}

/// Returns a figure that can be stored: none if it is meaningless after a divergence.
fn finite(figure: f64) -> Option<f64> {
    figure.is_finite().then_some(figure)
}

/// Returns the indices of those that are true.
fn indices(which: &[bool]) -> Vec<usize> {
    let which = which.iter().enumerate();
    which.filter_map(|(idx, is)| is.then_some(idx)).collect()
}

/// Whether the state is physically implausible in this scene.
fn implausible(
    settled: &SettledScene,
    world: &World,
    table_from_object: &Pose<Table, Object>,
) -> bool {
    let numbers = table_from_object
        .translation
        .vector
        .iter()
        .chain(table_from_object.rotation.coords.iter());
    let finite = numbers.into_iter().all(|number| number.is_finite());
    let far = table_from_object.translation.vector.norm() > IMPLAUSIBLE_DISTANCE_M;
    let speed = world.bodies.get(settled.object).map_or(f64::NAN, |body| {
        meters(body.linvel().length()).max(f64::from(body.angvel().length()))
    });
    let slow = |speed: f64| speed <= IMPLAUSIBLE_SPEED;
    // A comparison with NaN is false, so that NaN is implausible.
    !finite || far || !slow(speed) || !slow(settled.hand.fastest(world))
}
