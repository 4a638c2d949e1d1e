//! Fitting a hand to a way of taking an object: damped least squares over the wrist's pose and the
//! joints.

use geometry::NearestPoint;
use nalgebra::{DMatrix, DVector, Point3, UnitQuaternion, Vector3};
use spatial::{Object, Pose, RestingPose};

use crate::{
    approach::Approach,
    body::{Body, height_m},
    hand::{DOF, FINGERS, Hand, Joints, clamped, point},
};

/// A hand at an object, in the object's frame.
#[derive(Debug, Clone)]
pub(crate) struct FittedHand {
    pub(crate) object_from_hand: Pose<Object, Hand>,
    pub(crate) q: Joints,
}

/// Unknowns: three of translation, three of rotation, then the joints.
const UNKNOWNS: usize = 6 + DOF;
/// Rounds of the fit.
const ROUNDS: usize = 30;
/// Flesh may give by this much, in meters.
const SOFT_M: f64 = 0.0005;
/// Room between flesh and table, in meters.
const ABOVE_TABLE_M: f64 = 0.004;
/// Least height of the wrist and of a point on the forearm, in meters.
const WRIST_HEIGHT_M: f64 = 0.045;
/// Angle by which the knuckles are opened before the fit, in radians.
const OPEN_RAD: f64 = 0.3;
/// Coordinate x of the point on the forearm in the hand's frame, in meters.
const FOREARM_M: f64 = -0.12;

/// The sum of squares and its derivatives.
struct System {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    cost: f64,
}

impl System {
    fn new() -> Self {
        Self {
            normal: DMatrix::zeros(UNKNOWNS, UNKNOWNS),
            gradient: DVector::zeros(UNKNOWNS),
            cost: 0.0,
        }
    }

    /// Adds a squared residual with its derivative.
    fn add(&mut self, residual: f64, row: &DVector<f64>) {
        self.cost += residual * residual;
        self.gradient.axpy(residual, row, 1.0);
        self.normal.ger(1.0, row, row, 1.0);
    }
}

/// Fits a hand: pads on their targets and against the surface, flesh out of object and table,
/// joints in their ranges and near the approach's posture.
pub(crate) fn fit(body: &Body, rest: &RestingPose, hand: &Hand, approach: &Approach) -> FittedHand {
    let fit = Fit {
        body,
        rest,
        hand,
        approach,
    };
    // Start open, so that the fingers close from outside.
    let mut open = approach.posture;
    for knuckle in [0, 5, 8, 11, 14] {
        open[knuckle] -= OPEN_RAD;
    }
    let mut best = FittedHand {
        object_from_hand: approach.object_from_hand,
        q: clamped(&open),
    };
    let mut system = fit.system(&best);
    let mut damping = 1e-2;
    for _ in 0..ROUNDS {
        let mut damped = system.normal.clone();
        for idx in 0..UNKNOWNS {
            damped[(idx, idx)] += damping * (damped[(idx, idx)] + 1e-3);
        }
        let Some(step) = damped
            .cholesky()
            .map(|factor| factor.solve(&-&system.gradient))
        else {
            break;
        };
        let next = moved(&best, &step);
        let next_system = fit.system(&next);
        if next_system.cost < system.cost {
            let gain = (system.cost - next_system.cost) / system.cost;
            (best, system) = (next, next_system);
            damping = (damping * 0.4).max(1e-6);
            if gain < 1e-4 {
                break;
            }
        } else {
            damping *= 6.0;
            if damping > 1e4 {
                break;
            }
        }
    }
    best
}

/// Takes a step: translation and rotation about the wrist in the object's axes, then joints.
fn moved(placed: &FittedHand, step: &DVector<f64>) -> FittedHand {
    let shift = Vector3::new(step[0], step[1], step[2]);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
    let old = &placed.object_from_hand;
    FittedHand {
        object_from_hand: Pose::from_parts(
            old.translation.vector + shift,
            UnitQuaternion::new_normalize((turn * old.rotation).into_inner()),
        ),
        q: clamped(&std::array::from_fn(|idx| placed.q[idx] + step[6 + idx])),
    }
}

/// Points of a placed hand, and how they move with the unknowns.
struct PlacedPoints {
    /// The hand's points and then one on the forearm, in the hand's frame, in meters.
    in_hand: Vec<Point3<f64>>,
    /// The same in the object's frame.
    in_object: Vec<Point3<f64>>,
    /// For each joint, the hand's points in its frame after a nudge of the joint.
    nudged: Vec<Vec<Point3<f64>>>,
    rotation: UnitQuaternion<f64>,
    wrist: Vector3<f64>,
}

/// Nudge of a joint for a difference quotient, in radians.
const NUDGE_RAD: f64 = 1e-6;

impl PlacedPoints {
    fn new(hand: &Hand, at: &FittedHand) -> Self {
        let mut in_hand = hand.points(&at.q);
        in_hand.push(Point3::new(FOREARM_M, 0.0, 0.0));
        let nudged = (0..DOF).map(|idx| {
            let mut q = at.q;
            q[idx] += NUDGE_RAD;
            hand.points(&q)
        });
        Self {
            nudged: nudged.collect(),
            in_object: in_hand.iter().map(|&p| at.object_from_hand * p).collect(),
            in_hand,
            rotation: at.object_from_hand.rotation,
            wrist: at.object_from_hand.translation.vector,
        }
    }

    /// Returns the derivative of a point's coordinate along a direction in the object's frame.
    fn row(&self, idx: usize, direction: &Vector3<f64>) -> DVector<f64> {
        let mut row = DVector::zeros(UNKNOWNS);
        let turning = (self.in_object[idx].coords - self.wrist).cross(direction);
        for axis in 0..3 {
            row[axis] = direction[axis];
            row[3 + axis] = turning[axis];
        }
        let in_hand = self.rotation.inverse() * direction;
        for (joint, moved) in self.nudged.iter().enumerate() {
            row[6 + joint] = moved.get(idx).map_or(0.0, |moved| {
                (moved - self.in_hand[idx]).dot(&in_hand) / NUDGE_RAD
            });
        }
        row
    }
}

/// What a hand is fitted to.
struct Fit<'a> {
    body: &'a Body,
    rest: &'a RestingPose,
    hand: &'a Hand,
    approach: &'a Approach,
}

impl Fit<'_> {
    /// Assembles the residuals of a placed hand.
    fn system(&self, at: &FittedHand) -> System {
        let points = PlacedPoints::new(self.hand, at);
        let mut system = System::new();
        for (finger, target) in self.approach.targets.iter().enumerate() {
            if let Some(target) = target {
                self.add_touch(&mut system, &points, finger, target);
            }
        }
        self.add_clearance(&mut system, &points);
        near_posture(&mut system, self.approach, &at.q);
        let approach_rotation = self.approach.object_from_hand.rotation;
        let off = (points.rotation * approach_rotation.inverse()).scaled_axis();
        for axis in 0..3 {
            system.add(off[axis] / 0.7, &unit(3 + axis, 1.0 / 0.7));
        }
        system
    }

    /// Adds the residuals that bring a finger's pad to its target, with the skin on the surface.
    fn add_touch(
        &self,
        system: &mut System,
        points: &PlacedPoints,
        finger: usize,
        target: &NearestPoint,
    ) {
        let share = if finger == FINGERS - 1 { 0.5 } else { 1.0 };
        let (pad, skin) = (point::PADS + finger, point::SKIN + finger);
        let [pad_in_object, skin_in_object] = [pad, skin].map(|idx| points.in_object[idx]);
        let radius = self.hand.pad_radius_m(finger);
        let nearest = same_side(
            self.body.surface.signed_distance(&pad_in_object),
            target,
            &pad_in_object,
        );
        // The pad touches the surface, to a millimeter.
        let weight = share / 0.0008;
        system.add(
            (nearest.distance_m - radius) * weight,
            &(points.row(pad, &nearest.normal) * weight),
        );
        // The pad is near its target.
        let place = target.point + target.normal * radius;
        let weight = share / if finger == 0 { 0.010 } else { 0.014 };
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let off = (pad_in_object - place).dot(&axis);
            system.add(off * weight, &(points.row(pad, &axis) * weight));
        }
        // The skin faces the surface.
        let weight = share * 1.2;
        for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
            let off = ((skin_in_object - pad_in_object) / radius + nearest.normal).dot(&axis);
            system.add(
                off * weight,
                &((points.row(skin, &axis) - points.row(pad, &axis)) * (weight / radius)),
            );
        }
    }

    /// Adds the residuals that keep flesh out of object and table, and wrist and forearm above it.
    fn add_clearance(&self, system: &mut System, points: &PlacedPoints) {
        let up = self.rest.up_in_object.into_inner();
        let forearm = points.in_object.len() - 1;
        for (idx, &radius) in self.hand.radii_m().iter().enumerate() {
            let idx = point::FLESH + idx;
            let place = &points.in_object[idx];
            let nearest = self.body.surface.signed_distance(place);
            let inside = radius - SOFT_M - nearest.distance_m;
            if inside > 0.0 {
                let weight = 1.0 / 0.0008;
                system.add(
                    inside * weight,
                    &(points.row(idx, &nearest.normal) * -weight),
                );
            }
            let sunk = radius + ABOVE_TABLE_M - height_m(self.rest, place);
            if sunk > 0.0 {
                let weight = 1.0 / 0.001;
                system.add(sunk * weight, &(points.row(idx, &up) * -weight));
            }
        }
        for idx in [0, forearm] {
            let sunk = WRIST_HEIGHT_M - height_m(self.rest, &points.in_object[idx]);
            if sunk > 0.0 {
                let weight = 1.0 / 0.008;
                system.add(sunk * weight, &(points.row(idx, &up) * -weight));
            }
        }
    }
}

/// Returns the nearest surface point, or the target's plane where the pad is on the other side of a
/// thin wall than its target.
fn same_side(nearest: NearestPoint, target: &NearestPoint, pad: &Point3<f64>) -> NearestPoint {
    if nearest.normal.dot(&target.normal) > 0.0 {
        return nearest;
    }
    let distance_m = (pad - target.point).dot(&target.normal);
    NearestPoint {
        distance_m,
        ..*target
    }
}

/// Adds the residuals that keep the joints natural: near the posture, and neighboring fingers
/// alike.
fn near_posture(system: &mut System, approach: &Approach, q: &Joints) {
    for (joint, &angle) in q.iter().enumerate() {
        system.add(
            (angle - approach.posture[joint]) / 0.7,
            &unit(6 + joint, 1.0 / 0.7),
        );
    }
    for (a, b) in [(5, 8), (8, 11), (11, 14), (6, 9), (9, 12), (12, 15)] {
        let weight = 1.0 / 0.35;
        let row = unit(6 + a, weight) - unit(6 + b, weight);
        system.add((q[a] - q[b]) * weight, &row);
    }
}

fn unit(idx: usize, value: f64) -> DVector<f64> {
    let mut row = DVector::zeros(UNKNOWNS);
    row[idx] = value;
    row
}
