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
    objects::Handling,
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
    let up = rest.up_in_object.into_inner();
    let side = hand.side();
    let rim = body.kind.handling == Handling::Rim;
    let elevation = if rim {
        between(rng, [0.95, 1.45])
    } else {
        between(rng, [0.0, 1.5])
    };
    let azimuth = between(rng, [0.0, TAU]);
    let back = horizontal(rest, azimuth).into_inner() * elevation.cos() + up * elevation.sin();
    let (center, across, reach_m) = if rim {
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
    let thumb_side = toward.cross(&-across) * side.sign();

    let line = |finger: usize| center + thumb_side * BESIDE_M[finger];
    let thumb = body.trace(&(line(0) - across * reach_m), &across, 2.0 * reach_m)?;
    let finger = |idx: usize| body.trace(&(line(idx) + across * reach_m), &-across, 2.0 * reach_m);
    let middle = finger(2)?;
    let index = finger(1)?;
    let width = (middle.point - thumb.point).dot(&across);
    if !GRASPABLE_M.contains(&width) {
        return None;
    }
    let facing = |at: &NearestPoint, way: &Vector3<f64>| at.normal.dot(way);
    if facing(&thumb, &-across) < 0.75
        || facing(&middle, &across) < 0.75
        || facing(&index, &across) < 0.6
    {
        return None;
    }
    let usable =
        |at: &NearestPoint| facing(at, &across) > 0.5 && (at.point - middle.point).norm() < 0.06;
    let fourth = finger(3).filter(usable);
    let little = finger(4).filter(usable);
    let targets = [Some(thumb), Some(index), Some(middle), fourth, little];
    let grip = nalgebra::center(&thumb.point, &middle.point);

    let mut cost = 0.3 * normal(rng).abs();
    let fingers = [Some(index), Some(middle), fourth];
    for at in fingers.iter().flatten() {
        cost += 2.0 * (1.0 - facing(at, &across));
    }
    cost += 4.0 * (1.0 - facing(&thumb, &-across)) + if fourth.is_none() { 1.0 } else { 0.0 };
    let offset = body.center - grip;
    let lever = offset - across * across.dot(&offset);
    cost += if rim { 0.0 } else { lever.norm() / 0.010 };
    cost += (width - WIDE_M).max(0.0) / 0.008;
    for at in targets.iter().flatten() {
        cost += (0.016 - height_m(rest, &at.point)).max(0.0) / 0.004;
    }
    // How far the object reaches into the palm, and how near the table the palm is.
    let depth = body
        .trace(&(grip + back * 0.3), &toward, 0.3)
        .map_or(0.0, |at| (at.point - grip).dot(&back));
    cost += (depth - 0.045).max(0.0) / 0.006;
    let palm = grip + back * 0.055;
    let lowest = [0.03, -0.045].map(|beside| height_m(rest, &(palm + thumb_side * beside)));
    cost += (0.025 - lowest[0].min(lowest[1])).max(0.0) / 0.005;

    let tilt = if rim {
        between(rng, [0.1, 0.8])
    } else {
        between(rng, [-0.1, 0.7])
    };
    let rotation = rotation_from_axes(&across, &back)?
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt);
    let [x, y, z] = GRIP_IN_HAND_M;
    let in_hand = Vector3::new(x, y * side.sign(), z);
    let curl = 1.0 - (width / 0.1).min(1.0);
    Some(Approach {
        toward,
        targets,
        object_from_hand: Pose::from_parts(grip.coords - rotation * in_hand, rotation),
        posture: posture_deg(
            [0.0, 0.0, 12.0, 18.0],
            [0.0, 32.0 + 30.0 * curl, 30.0 + 20.0 * curl],
        ),
        cost,
    })
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
