//! The peer's algorithm, `NLopt`'s SLSQP, on our kinematics: cost of the algorithm without Python.

use std::{cell::RefCell, f64::consts::TAU};

use nalgebra::{Point3, Vector3};
use posture::{NoTerms, Posture, RootPose, Smoothness, Solver, Task};
use slsqp::{StopTols, minimize};

use crate::problem::{MOTION_WEIGHT, Problem};

/// Tolerance at which the peer stops: a smaller change of its value, in its own unit.
const VALUE_TOLERANCE: f64 = 1e-5;
/// The peer's bounds of the root: meters, then radians.
const ROOT_BOUNDS: [f64; 2] = [5.0, TAU];

/// Postures tried at most; the peer sets no such limit, and neither comes near.
const MAX_EVALUATIONS: usize = 1000;

/// A constraint beside the bounds; there is none.
type Constraint = fn(&[f64], Option<&mut [f64]>, &mut ()) -> f64;

/// Value that the objective returns to the minimizer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Value {
    /// As the peer does: the value leaves the motion out, while the gradient has it.
    AsThePeer,
    /// The value whose gradient is given.
    Whole,
}

/// Retargets one frame from `before` and returns the answer.
pub(crate) fn retarget(
    problem: &Problem,
    solver: &RefCell<Solver<'_>>,
    frame: usize,
    before: &Posture,
    value: Value,
) -> Posture {
    let n_root = 6;
    let points = vec![Point3::origin(); problem.links.len()];
    let task = Task {
        targets: &problem.targets[frame],
        loss: Problem::loss(),
        vectors: None,
        smoothness: Some(Smoothness {
            points: &points,
            point_weight: 0.0,
            posture: before,
            joint_weight: MOTION_WEIGHT,
            root_weight: MOTION_WEIGHT,
        }),
        prior: None,
    };
    let start = unknowns(before);
    let ignored = RefCell::new(vec![0.0; start.len()]);
    let objective = |x: &[f64], gradient: Option<&mut [f64]>, (): &mut ()| {
        let posture = posture_of(x);
        let mut solver = solver.borrow_mut();
        let mut ignored = ignored.borrow_mut();
        let gradient = gradient.unwrap_or(&mut ignored);
        let whole = solver
            .gradient(&task, &posture, &mut NoTerms, gradient)
            .unwrap();
        match value {
            Value::Whole => whole,
            Value::AsThePeer => {
                let motion: f64 = x
                    .iter()
                    .zip(&start)
                    .map(|(x, start)| (x - start).powi(2))
                    .sum();
                whole - MOTION_WEIGHT * motion
            }
        }
    };
    let joints = problem
        .model
        .joints()
        .iter()
        .map(|joint| (joint.lower, joint.upper));
    let root = (0..n_root).map(|i| (-ROOT_BOUNDS[i / 3], ROOT_BOUNDS[i / 3]));
    let bounds: Vec<(f64, f64)> = root.chain(joints).collect();
    let tolerances = StopTols {
        ftol_abs: VALUE_TOLERANCE,
        ..StopTols::default()
    };
    let no_constraints: [Constraint; 0] = [];
    let found = minimize(
        objective,
        &start,
        &bounds,
        &no_constraints,
        (),
        MAX_EVALUATIONS,
        Some(tolerances),
    );
    // It fails where rounding keeps it from going on, and is then as near as it gets.
    let x = found.map_or_else(|(_, x, _)| x, |(_, x, _)| x);
    posture_of(&x)
}

fn unknowns(posture: &Posture) -> Vec<f64> {
    let (along, angles) = (posture.root.translation(), posture.root.angles());
    along
        .iter()
        .chain(angles.iter())
        .chain(&posture.q)
        .copied()
        .collect()
}

fn posture_of(x: &[f64]) -> Posture {
    let part = |at: usize| Vector3::from_column_slice(&x[at..at + 3]);
    Posture {
        root: RootPose::from_angles(part(0), part(3)),
        q: x[6..].to_vec(),
    }
}
