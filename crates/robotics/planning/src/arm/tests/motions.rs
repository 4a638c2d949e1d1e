//! Motions for an arm: such as its joints make, and straight ones.

use std::f64::consts::{PI, TAU};

use motion::{HandRates, Step};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use robot::{Link, distance_bounds};
use spatial::{Base, Object, Pose, Table, Twist};

use super::{Arm, hand};
use crate::fixture::MotionOnTable;

const DURATION_S: f64 = 1.0;
const STEPS: usize = 41;

/// A motion of the arm's six joints, each a swing about its middle.
#[derive(Debug, Clone)]
pub(super) struct JointPath {
    joints: Vec<[f64; 4]>,
    fingers: f64,
}

/// Properties of the joint motion that a palm motion was made from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Given {
    /// The joints stay well inside their limits and away from singularities, also on the lift.
    pub(super) is_free: bool,
    /// At the grasp they meet nothing.
    pub(super) can_grasp: bool,
    /// And they stay away from the table, themselves and the hand.
    pub(super) is_clear: bool,
}

/// Motions in the arm's reach, most of them above the table and clear of it.
pub(super) fn joint_paths() -> impl Strategy<Value = JointPath> {
    let swing = |low: f64, high: f64| {
        (low..high, 0.0..0.5_f64, 0.1..0.7_f64, 0.0..TAU)
            .prop_map(|(middle, amplitude, hz, phase)| [middle, amplitude, hz, phase])
    };
    let joints = (
        swing(-3.0, 3.0),
        swing(-1.2, 0.9),
        swing(-2.6, -0.9),
        swing(-3.5, 3.5),
        swing(-1.2, 2.6),
        swing(-3.5, 3.5),
    );
    (joints, 0.3..0.7_f64).prop_map(|((a, b, c, d, e, f), fingers)| JointPath {
        joints: vec![a, b, c, d, e, f],
        fingers,
    })
}

impl JointPath {
    pub(super) fn q(&self, time_s: f64) -> Vec<f64> {
        self.order(0, time_s)
    }

    fn order(&self, order: usize, time_s: f64) -> Vec<f64> {
        let joints = self.joints.iter();
        joints
            .map(|&[middle, amplitude, hz, phase]| {
                let speed = TAU * hz;
                let (sin, cos) = (speed * time_s + phase).sin_cos();
                [
                    middle + amplitude * sin,
                    amplitude * speed * cos,
                    -amplitude * speed * speed * sin,
                ][order]
            })
            .collect()
    }

    /// Returns the motion of the palm for an object at the place that the arm's options give, and the
    /// properties of the joint motion that it was made from.
    pub(super) fn motion(&self, arm: &Arm) -> (MotionOnTable, Given) {
        let table_from_object = Isometry3::from_parts(
            Translation3::new(0.1, -0.2, 0.05),
            UnitQuaternion::from_euler_angles(0.3, -0.5, 1.0),
        );
        let [x, y] = arm.config.object_m;
        let standing: Pose<Table, Object> =
            Pose::new(Translation3::new(x, y, 0.05) * table_from_object.rotation);
        let object_from_base = (arm.base_from_table * standing).inverse();
        let hand = hand();
        let fingers: Vec<f64> = hand
            .joints()
            .iter()
            .map(|joint| joint.lower + self.fingers * (joint.upper - joint.lower))
            .collect();
        let step = |idx: usize| {
            let time_s = DURATION_S * idx as f64 / (STEPS - 1) as f64;
            let state = arm.chain.state(&self.q(time_s)).unwrap();
            let velocity = self.order(1, time_s);
            let bend = state.twist(&self.order(2, time_s)) + state.bias_acceleration(&velocity);
            let turn = |twist: Twist<Base>| twist.expressed_in(&object_from_base);
            Step {
                time_s,
                frame_from_palm: object_from_base * state.base_from_palm,
                q_rad: fingers.clone(),
                rates: HandRates {
                    palm_velocity: turn(state.twist(&velocity)),
                    palm_acceleration: turn(bend),
                    ..HandRates::zero(16)
                },
            }
        };
        let drawn = MotionOnTable {
            joints: hand.joint_names(),
            steps: (0..STEPS).map(step).collect(),
            table_from_object: Pose::<Table, Object>::new(table_from_object),
        };
        (drawn, self.fares(arm, &fingers))
    }

    /// Returns the properties of the joint motion, from a hundred times and the lift.
    fn fares(&self, arm: &Arm, fingers: &[f64]) -> Given {
        /// More than requested, as places in between may be worse.
        const SLACK_M: f64 = 0.02;
        let mut given = Given {
            is_free: true,
            can_grasp: true,
            is_clear: true,
        };
        let mut positions: Vec<Vec<f64>> = (0..=100)
            .map(|k| self.q(DURATION_S * f64::from(k) / 100.0))
            .collect();
        let q_grasp = self.q(DURATION_S);
        let mut q = q_grasp.clone();
        let grasp = arm.chain.state(&q).unwrap().base_from_palm;
        for k in 0..=20 {
            let up = Translation3::new(0.0, 0.0, 0.05 * f64::from(k) / 20.0);
            let found = arm.chain.inverse_kinematics(&Pose::new(up * *grasp), &q);
            match found.filter(|q| super::is_within_limits(arm, q)) {
                Some(found) => q = found,
                None => given.is_free = false,
            }
            positions.push(q.clone());
        }
        given.can_grasp = arm
            .clearance
            .is_clear(&arm.links(&q_grasp, fingers).unwrap(), 0.0);
        for q in positions {
            let inside = arm
                .joints()
                .iter()
                .zip(&q)
                .all(|(joint, q)| *q > joint.lower + 0.02 && *q < joint.upper - 0.02);
            let singular = arm.chain.state(&q).unwrap().min_singular_value();
            given.is_free &= inside && singular > 1.5 * arm.config.min_singular_value;
            let links = arm.links(&q, fingers).unwrap();
            given.is_clear &= arm.clearance.is_clear(&links, SLACK_M);
        }
        given.is_clear &= given.is_free;
        given
    }
}

impl super::Clearance {
    /// Whether shapes keep farther by this from each other and from the plane z = 0 than they have to.
    fn is_clear(&self, links: &[Pose<Base, Link>], slack_m: f64) -> bool {
        let at = |idx: usize| self.shape_at(idx, links);
        let pairs = self.pairs().iter().all(|pair| {
            let ((at_a, a), (at_b, b)) = (at(pair.first), at(pair.second));
            distance_bounds((&at_a, &a), (&at_b, &b)).at_least_m >= pair.least_m + slack_m
        });
        pairs
            && self.above().iter().all(|&idx| {
                let (at, shape) = at(idx);
                shape.lowest_m(&at, &Vector3::z()) >= 0.005 + slack_m
            })
    }
}

/// A motion through poses in the frame of the table with its origin at the object's place, at rest at
/// each; the object lies at (0, 0, 0.04).
fn through(poses: &[Isometry3<f64>]) -> MotionOnTable {
    let table_from_object = Isometry3::translation(0.0, 0.0, 0.04);
    let fingers = hand().mid_range();
    let step = |(idx, pose): (usize, &Isometry3<f64>)| Step {
        time_s: 0.1 * idx as f64,
        frame_from_palm: Pose::new(table_from_object.inverse() * pose),
        q_rad: fingers.clone(),
        rates: HandRates::zero(16),
    };
    MotionOnTable {
        joints: hand().joint_names(),
        steps: poses.iter().enumerate().map(step).collect(),
        table_from_object: Pose::new(table_from_object),
    }
}

fn line(from: [f64; 3], to: [f64; 3], rotation: UnitQuaternion<f64>) -> Vec<Isometry3<f64>> {
    let [from, to] = [from, to].map(Vector3::from);
    (0..=10)
        .map(|k| {
            let at = from.lerp(&to, f64::from(k) / 10.0);
            Isometry3::from_parts(Translation3::from(at), rotation)
        })
        .collect()
}

/// The palm on a line, given from the object's origin, with the fingers down; the object lies at
/// `object` in the table's frame.
pub(super) fn straight(from: [f64; 3], to: [f64; 3], object: [f64; 3]) -> MotionOnTable {
    let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), PI);
    let mut drawn = through(&line(from, to, down));
    let table_from_object = Isometry3::translation(object[0], object[1], object[2]);
    let own = Isometry3::translation(0.0, 0.0, 0.04);
    for step in &mut drawn.steps {
        step.frame_from_palm = Pose::new(own * *step.frame_from_palm);
    }
    drawn.table_from_object = Pose::new(table_from_object);
    drawn
}

/// The palm on a line, relative to the object's place, with the fingers level and away from the base.
pub(super) fn level(from: [f64; 3], to: [f64; 3]) -> MotionOnTable {
    let ahead = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.5 * PI);
    through(&line(from, to, ahead))
}

/// The fingers down, and the palm turned about the vertical by so many turns.
pub(super) fn wound(turns: f64) -> MotionOnTable {
    let down = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), PI);
    let poses: Vec<Isometry3<f64>> = (0..=20)
        .map(|k| {
            let turn = TAU * turns * f64::from(k) / 20.0;
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
            Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.35), turn * down)
        })
        .collect();
    through(&poses)
}
