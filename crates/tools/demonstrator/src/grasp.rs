//! Choosing a grasp: draw ways to take the object, fit the hand to the best, judge, keep one.

use nalgebra::{Point3, SVector, Vector3};
use rand_chacha::ChaCha8Rng;
use spatial::RestingPose;

use crate::{
    approach::{self, Approach},
    body::{Body, height_m},
    fit::{FittedHand, fit},
    hand::{FINGERS, Hand, point},
    objects::GraspPlacement,
};

/// A hand that holds an object, in the object's frame.
#[derive(Debug, Clone)]
pub(crate) struct Grasp {
    pub(crate) placed: FittedHand,
    /// From the hand to the object, unit.
    pub(crate) toward: Vector3<f64>,
    /// Its quality.
    pub(crate) quality: Quality,
}

/// Quality of a grasp: gaps, depths and balance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quality {
    /// Gap between each finger's skin and the surface, in meters; negative where flesh is pressed.
    pub(crate) gaps_m: [f64; FINGERS],
    /// Deepest flesh below the surface, in meters.
    pub(crate) penetration_m: f64,
    /// Lowest flesh above the table, in meters.
    pub(crate) clearance_m: f64,
    /// Force and torque left over, as a share of the thumb's force, when thumb and three fingers
    /// squeeze and lift as well as they can.
    pub(crate) imbalance: f64,
    /// Lower is better.
    pub(crate) cost: f64,
}

/// A finger touches when its gap is smaller, in meters.
pub(crate) const TOUCHING_M: f64 = 0.003;
/// Deepest flesh below the surface of a good grasp, in meters.
pub(crate) const MAX_DEPTH_M: f64 = 0.0025;
/// Largest force and torque left over in a good grasp.
const MAX_IMBALANCE: f64 = 0.25;

impl Quality {
    /// Says whether the thumb and two fingers touch, flesh is neither too deep in the object nor in
    /// the table, and the contacts can hold it.
    pub(crate) fn is_good(&self) -> bool {
        let [thumb, fingers @ ..] = self.gaps_m;
        let touching = fingers.iter().filter(|gap| gap.abs() < TOUCHING_M).count();
        thumb.abs() < TOUCHING_M
            && touching >= 2
            && self.penetration_m < MAX_DEPTH_M
            && self.clearance_m > 0.0
            && self.imbalance < MAX_IMBALANCE
    }
}

/// Returns grasps of an object, best first; those that are not good are left out.
pub(crate) fn grasps(
    body: &Body,
    rest: &RestingPose,
    hand: &Hand,
    draws: usize,
    tries: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<Grasp> {
    let mut approaches: Vec<Approach> = (0..draws)
        .filter_map(|_| approach::draw(body, rest, hand, rng))
        .collect();
    approaches.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    approaches.truncate(tries);
    let mut grasps: Vec<Grasp> = approaches
        .iter()
        .map(|approach| {
            let placed = fit(body, rest, hand, approach);
            let quality = judge(body, rest, hand, &placed, approach.cost);
            Grasp {
                placed,
                toward: approach.toward,
                quality,
            }
        })
        .filter(|grasp| grasp.quality.is_good())
        .collect();
    grasps.sort_by(|a, b| a.quality.cost.total_cmp(&b.quality.cost));
    grasps
}

/// Judges a hand at an object.
fn judge(
    body: &Body,
    rest: &RestingPose,
    hand: &Hand,
    placed: &FittedHand,
    approach_cost: f64,
) -> Quality {
    let points = hand.points_in(&placed.object_from_hand, &placed.q);
    let mut gaps_m = [0.0; FINGERS];
    let mut contacts = Vec::new();
    for (finger, gap) in gaps_m.iter_mut().enumerate() {
        let pad = points[point::PADS + finger];
        let skin = points[point::SKIN + finger];
        let radius = hand.pad_radius_m(finger);
        let nearest = body.surface.signed_distance(&pad);
        *gap = nearest.distance_m - radius;
        // A pad that does not face the surface touches with its side: not a contact to count on.
        let facing = -(skin - pad).dot(&nearest.normal) / radius;
        if facing < 0.5 {
            *gap = gap.abs().max(0.006);
        } else if gap.abs() < TOUCHING_M && finger < FINGERS - 1 {
            contacts.push((finger, nearest.point, -nearest.normal));
        }
    }
    let (mut penetration_m, mut clearance_m) = (f64::MIN, f64::MAX);
    for (radius, flesh) in hand.radii_m().iter().zip(points.iter().skip(point::FLESH)) {
        penetration_m = penetration_m.max(radius - body.surface.signed_distance(flesh).distance_m);
        clearance_m = clearance_m.min(height_m(rest, flesh) - radius);
    }
    let lift = if body.kind.handling == GraspPlacement::Rim {
        0.0
    } else {
        0.3
    };
    let imbalance = imbalance(
        &contacts,
        &body.center,
        &(rest.up_in_object.into_inner() * lift),
    );
    let missing: f64 = gaps_m
        .iter()
        .take(FINGERS - 1)
        .map(|gap| (gap.abs() / 0.003).min(3.0))
        .sum();
    let low = (LARGER_CLEARANCE_M - larger_clearance_m(rest, hand, placed)).max(0.0);
    let cost = missing
        + (low / 0.008).min(2.0)
        + 2.0 * (penetration_m / 0.002).max(0.0)
        + (0.006 - clearance_m).max(0.0) / 0.002
        + 15.0 * imbalance
        + 0.35 * approach_cost;
    Quality {
        gaps_m,
        penetration_m,
        clearance_m,
        imbalance,
        cost,
    }
}

/// Imbalance when the thumb does not touch: worse than any grasp.
const NO_THUMB: f64 = 9.0;
/// Maximum size of the hand that learns from the grasp, relative to the person's.
const LARGER: f64 = 1.2;
/// The corners of such a hand's palm in the hand's frame, in meters.
const LARGER_PALM_M: [[f64; 3]; 8] = [
    [0.0, -0.057, -0.02],
    [0.0, -0.057, 0.02],
    [0.0, 0.057, -0.02],
    [0.0, 0.057, 0.02],
    [0.095, -0.057, -0.02],
    [0.095, -0.057, 0.02],
    [0.095, 0.057, -0.02],
    [0.095, 0.057, 0.02],
];
/// Angle by which such a hand opens each joint before it closes, in radians.
const OPENING_RAD: f64 = 0.3;
/// Half the thickness of its fingertips, in meters.
const TIP_RADIUS_M: f64 = 0.012;
/// Room that its fingertips should have above the table, in meters.
const LARGER_CLEARANCE_M: f64 = 0.006;

/// Returns how high palm and fingertips of a larger hand with the same wrist stay above the table,
/// open and closed, in meters: recordings are made to be learned from by robot hands.
fn larger_clearance_m(rest: &RestingPose, hand: &Hand, placed: &FittedHand) -> f64 {
    let mut open = placed.q;
    for joint in [2, 3, 5, 6, 8, 9, 11, 12] {
        open[joint] -= OPENING_RAD;
    }
    let mut lowest = f64::MAX;
    for corner in LARGER_PALM_M {
        let corner = placed.object_from_hand * Point3::from(corner);
        lowest = lowest.min(height_m(rest, &corner));
    }
    for q in [placed.q, open] {
        let points = hand.points(&q);
        for tip in TIPS {
            let larger = placed.object_from_hand * Point3::from(points[tip].coords * LARGER);
            lowest = lowest.min(height_m(rest, &larger) - TIP_RADIUS_M);
        }
    }
    lowest
}

/// Landmarks at the tips of thumb, index, middle and ring finger.
const TIPS: [usize; 4] = [4, 8, 12, 16];

/// Edges of a friction cone.
const EDGES: usize = 6;
/// Friction assumed, below the object's real one.
const FRICTION: f64 = 0.7;
/// Torques are divided by this length, in meters.
const LEVER_M: f64 = 0.04;

/// Returns the residual when contacts push within their friction cones, the thumb with force
/// one, to balance each other and a load: the length of force and scaled torque.
fn imbalance(
    contacts: &[(usize, Point3<f64>, Vector3<f64>)],
    center: &Point3<f64>,
    load: &Vector3<f64>,
) -> f64 {
    let wrench = |at: &Point3<f64>, force: &Vector3<f64>| {
        let torque = (at - center).cross(force) / LEVER_M;
        SVector::<f64, 6>::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
    };
    // The load: the contacts must lift.
    let mut target = SVector::<f64, 6>::new(load.x, load.y, load.z, 0.0, 0.0, 0.0);
    let mut edges: Vec<SVector<f64, 6>> = Vec::new();
    let mut thumb_pushes = false;
    for &(finger, at, inward) in contacts {
        if finger == 0 {
            thumb_pushes = true;
            target -= wrench(&at, &inward);
        }
        let aside = if inward.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let u = inward.cross(&aside).normalize();
        let v = inward.cross(&u);
        for edge in 0..EDGES {
            let (sin, cos) = (std::f64::consts::TAU * edge as f64 / EDGES as f64).sin_cos();
            let slip = (u * cos + v * sin) * FRICTION;
            // The thumb's normal force is fixed to one; only its friction is free.
            edges.push(if finger == 0 {
                wrench(&at, &slip)
            } else {
                wrench(&at, &(inward + slip))
            });
        }
    }
    if !thumb_pushes {
        return NO_THUMB;
    }
    // Non-negative least squares, one push after another.
    let mut pushes = vec![0.0; edges.len()];
    let mut residual = -target;
    for _ in 0..60 {
        for (push, edge) in pushes.iter_mut().zip(&edges) {
            let next =
                (*push - edge.dot(&residual) / edge.norm_squared().max(1e-9)).clamp(0.0, 1.0);
            residual += edge * (next - *push);
            *push = next;
        }
    }
    residual.norm()
}
