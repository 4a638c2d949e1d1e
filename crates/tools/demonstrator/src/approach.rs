//! Ways to grasp an object: opposed contacts for thumb and fingers, and an approach direction.

use std::f64::consts::TAU;

use geometry::NearestPoint;
use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spatial::{Object, Pose, RestingPose};

use crate::{
    body::{Body, height_m, horizontal},
    hand::{FINGERS, Hand, Joints, Side, posture_deg, rotation_from_axes},
    noise::{between, normal, normal3},
    objects::GraspPlacement,
};

/// A way to take an object, before the hand is fitted to it.
#[derive(Debug, Clone)]
pub(crate) struct Approach {
    /// From the hand to the object, object frame, unit.
    pub(crate) toward: Vector3<f64>,
    /// Contact point of each finger's pad; `None` where the object does not reach.
    pub(crate) targets: [Option<NearestPoint>; FINGERS],
    /// The hand's pose from which the fit starts.
    pub(crate) object_from_hand: Pose<Object, Hand>,
    /// The posture from which the fit starts.
    pub(crate) posture: Joints,
    /// Lower is more promising.
    pub(crate) cost: f64,
}

/// Offset of each finger's line from the middle finger's, towards the thumb's side, in meters.
const BESIDE_M: [f64; FINGERS] = [0.006, 0.022, 0.0, -0.020, -0.038];
/// Widths that a hand can span, in meters.
const GRASPABLE_M: std::ops::Range<f64> = 0.002..0.108;
/// Wider than this is uncomfortable, in meters.
const WIDE_M: f64 = 0.075;
/// Position of the grasped part in the frame of a right hand, in meters.
const GRIP_IN_HAND_M: [f64; 3] = [0.082, 0.004, -0.060];

/// Draws one way to take an object; `None` if thumb and fingers would not oppose each other.
pub(crate) fn draw(
    body: &Body,
    rest: &RestingPose,
    hand: &Hand,
    rng: &mut ChaCha8Rng,
) -> Option<Approach> {
    let side = hand.side();
    let contacts = Opposition::draw(body, rest, side, rng)?.contacts(body)?;
    let cost = contacts.cost(body, rest, rng);
    let Opposition { across, back, .. } = contacts.opposition;
    let tilt = if is_at_rim(body) {
        between(rng, [0.1, 0.8])
    } else {
        between(rng, [-0.1, 0.7])
    };
    let rotation = rotation_from_axes(&across, &back)?
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt);
    let [x, y, z] = GRIP_IN_HAND_M;
    let in_hand = Vector3::new(x, y * side.sign(), z);
    let curl = 1.0 - (contacts.width_m() / 0.1).min(1.0);
    let grip = contacts.grip();
    Some(Approach {
        toward: -back,
        targets: contacts.targets(),
        object_from_hand: Pose::from_parts(grip.coords - rotation * in_hand, rotation),
        posture: posture_deg(
            [0.0, 0.0, 12.0, 18.0],
            [0.0, 32.0 + 30.0 * curl, 30.0 + 20.0 * curl],
        ),
        cost,
    })
}

fn is_at_rim(body: &Body) -> bool {
    body.kind.handling == GraspPlacement::Rim
}

/// Says how much a surface faces a unit direction: 1 if it faces it fully.
fn facing(at: &NearestPoint, way: &Vector3<f64>) -> f64 {
    at.normal.dot(way)
}

/// The line on which thumb and middle finger oppose each other, in the object frame.
struct Opposition {
    center: Point3<f64>,
    /// From thumb to fingers, unit.
    across: Vector3<f64>,
    /// From the object to the hand, unit, perpendicular to `across`.
    back: Vector3<f64>,
    /// From the little finger to the index finger, unit.
    thumb_side: Vector3<f64>,
    /// Distance from the center at which a finger comes in, in meters.
    reach_m: f64,
}

impl Opposition {
    /// Draws an opposition; `None` if the object has no place for it.
    fn draw(body: &Body, rest: &RestingPose, side: Side, rng: &mut ChaCha8Rng) -> Option<Self> {
        let up = rest.up_in_object.into_inner();
        let elevation = if is_at_rim(body) {
            between(rng, [0.95, 1.45])
        } else {
            between(rng, [0.0, 1.5])
        };
        let azimuth = between(rng, [0.0, TAU]);
        let back = horizontal(rest, azimuth).into_inner() * elevation.cos() + up * elevation.sin();
        let (center, across, reach_m) = if is_at_rim(body) {
            rim_place(body, rest, &back, rng)?
        } else {
            let center = body.center + normal3(rng) * 0.014;
            (
                center,
                turned(&up, &back, elevation, side, rng)?,
                body.radius_m + 0.05,
            )
        };
        // Make the way in perpendicular to the opposition.
        let back = (back - across * across.dot(&back)).try_normalize(1e-6)?;
        let toward = -back;
        Some(Self {
            center,
            across,
            back,
            thumb_side: toward.cross(&-across) * side.sign(),
            reach_m,
        })
    }

    /// Finds where thumb and fingers meet the object; `None` if they would not oppose each other.
    fn contacts(self, body: &Body) -> Option<Contacts> {
        let Self {
            across, reach_m, ..
        } = self;
        let line = |finger: usize| self.center + self.thumb_side * BESIDE_M[finger];
        let thumb = body.trace(&(line(0) - across * reach_m), &across, 2.0 * reach_m)?;
        let finger =
            |idx: usize| body.trace(&(line(idx) + across * reach_m), &-across, 2.0 * reach_m);
        let middle = finger(2)?;
        let index = finger(1)?;
        if facing(&thumb, &-across) < 0.75
            || facing(&middle, &across) < 0.75
            || facing(&index, &across) < 0.6
        {
            return None;
        }
        let usable = |at: &NearestPoint| {
            facing(at, &across) > 0.5 && (at.point - middle.point).norm() < 0.06
        };
        let contacts = Contacts {
            thumb,
            index,
            middle,
            fourth: finger(3).filter(usable),
            little: finger(4).filter(usable),
            opposition: self,
        };
        GRASPABLE_M
            .contains(&contacts.width_m())
            .then_some(contacts)
    }
}

/// Points at which thumb and fingers meet the object.
struct Contacts {
    opposition: Opposition,
    thumb: NearestPoint,
    index: NearestPoint,
    middle: NearestPoint,
    fourth: Option<NearestPoint>,
    little: Option<NearestPoint>,
}

impl Contacts {
    /// Returns the contact point of each finger, the thumb first.
    fn targets(&self) -> [Option<NearestPoint>; FINGERS] {
        let [thumb, index, middle] = [self.thumb, self.index, self.middle].map(Some);
        [thumb, index, middle, self.fourth, self.little]
    }

    /// Returns the width that the hand spans, in meters.
    fn width_m(&self) -> f64 {
        let span = self.middle.point - self.thumb.point;
        span.dot(&self.opposition.across)
    }

    /// Returns the middle between thumb and middle finger.
    fn grip(&self) -> Point3<f64> {
        nalgebra::center(&self.thumb.point, &self.middle.point)
    }

    /// Returns the cost of a grasp with these contacts, with a random share: lower is more promising.
    fn cost(&self, body: &Body, rest: &RestingPose, rng: &mut ChaCha8Rng) -> f64 {
        let Opposition {
            across,
            back,
            thumb_side,
            ..
        } = self.opposition;
        let grip = self.grip();
        let mut cost = 0.3 * normal(rng).abs();
        let fingers = [Some(self.index), Some(self.middle), self.fourth];
        for at in fingers.iter().flatten() {
            cost += 2.0 * (1.0 - facing(at, &across));
        }
        let lacks_fourth = if self.fourth.is_none() { 1.0 } else { 0.0 };
        cost += 4.0 * (1.0 - facing(&self.thumb, &-across)) + lacks_fourth;
        if !is_at_rim(body) {
            let offset = body.center - grip;
            let lever = offset - across * across.dot(&offset);
            cost += lever.norm() / 0.010;
        }
        cost += (self.width_m() - WIDE_M).max(0.0) / 0.008;
        for at in self.targets().iter().flatten() {
            cost += (0.016 - height_m(rest, &at.point)).max(0.0) / 0.004;
        }
        // How far the object reaches into the palm, and how near the table the palm is.
        let depth = body
            .trace(&(grip + back * 0.3), &-back, 0.3)
            .map_or(0.0, |at| (at.point - grip).dot(&back));
        cost += (depth - 0.045).max(0.0) / 0.006;
        let palm = grip + back * 0.055;
        let lowest = [0.03, -0.045].map(|beside| height_m(rest, &(palm + thumb_side * beside)));
        cost + (0.025 - lowest[0].min(lowest[1])).max(0.0) / 0.005
    }
}

/// Draws the direction from thumb to fingers for a hand that comes from `back`: thumb up where it
/// comes from the side, any way where it comes from above.
fn turned(
    up: &Vector3<f64>,
    back: &Vector3<f64>,
    elevation: f64,
    side: Side,
    rng: &mut ChaCha8Rng,
) -> Option<Vector3<f64>> {
    let thumb_side = (up - back * back.dot(up)).try_normalize(1e-6)?;
    let across = (thumb_side * side.sign()).cross(back);
    let free = ((elevation - 0.5) / 0.5).clamp(0.0, 1.0);
    let roll = normal(rng).clamp(-2.0, 2.0) * 0.12 + free * between(rng, [-0.5 * TAU, 0.5 * TAU]);
    Some(Rotation3::new(back * roll) * across)
}

/// Draws a place on a bowl's rim: a point in the wall, the direction from thumb to fingers through
/// it, and how far to stand back to see the wall from both sides.
fn rim_place(
    body: &Body,
    rest: &RestingPose,
    back: &Vector3<f64>,
    rng: &mut ChaCha8Rng,
) -> Option<(Point3<f64>, Vector3<f64>, f64)> {
    let up = rest.up_in_object.into_inner();
    let top = body
        .mesh
        .vertices_m
        .iter()
        .map(|v| up.dot(&v.coords))
        .fold(f64::MIN, f64::max);
    // The wrist stays on the side from which the hand comes.
    let flat = (back - up * up.dot(back)).try_normalize(1e-3)?;
    let outward = Rotation3::new(up * between(rng, [-0.5, 0.5])) * flat;
    let below = between(rng, [0.010, 0.020]);
    let axis = body.center + up * (top - below - up.dot(&body.center.coords));
    let wall = body.trace(&(axis + outward * 0.2), &-outward, 0.2)?;
    // The wall leans: cross it square to its surface.
    let across = (-wall.normal).normalize();
    let inside: f64 = rng.random();
    let across = if inside < 0.5 { across } else { -across };
    Some((wall.point - wall.normal * 0.0015, across, 0.03))
}
