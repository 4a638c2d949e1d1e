//! Our solver on the peer's problems and on the paper's objective.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use posture::{
    NoTerms, Posture, RootMotion, RootPose, SearchOptions, SearchOutcome, Smoothness, Solver, Task,
};
use rand::Rng;

use crate::problem::{MOTION_WEIGHT, Problem};

/// As the race is run: what is left to gain is a thousandth.
pub(crate) const FAST: SearchOptions = SearchOptions {
    relative_tolerance: 1e-3,
    min_decrease: 1e-9,
    max_iterations: 60,
    root_motion: RootMotion::Free,
};
/// Full convergence.
pub(crate) const TIGHT: SearchOptions = SearchOptions {
    relative_tolerance: 1e-12,
    min_decrease: 1e-18,
    max_iterations: 500,
    root_motion: RootMotion::Free,
};
/// Random starts of each frame for an estimate of its true minimum.
const N_STARTS: usize = 24;

/// The objective that is minimized.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Objective {
    /// The peer's: smooth-L1 and joint motion.
    Peer,
    /// The paper's: squared distances and the points' squared motion, times this λ.
    Paper(f64),
}

impl Objective {
    /// Returns the task of a frame, after a frame's posture and points.
    pub(crate) fn task<'a>(
        self,
        problem: &'a Problem,
        frame: usize,
        before: &'a Posture,
        points: &'a [Point3<f64>],
    ) -> Task<'a> {
        let (loss, point_weight, motion_weight) = match self {
            Self::Peer => (Problem::loss(), 0.0, MOTION_WEIGHT),
            Self::Paper(lambda) => (posture::Loss::Squared, lambda, 0.0),
        };
        Task {
            targets: &problem.targets[frame],
            loss,
            vectors: None,
            smoothness: Some(Smoothness {
                points,
                point_weight,
                posture: before,
                joint_weight: motion_weight,
                root_weight: motion_weight,
            }),
            prior: None,
        }
    }
}

/// Returns the positions of the points that follow at a posture.
pub(crate) fn points_at(solver: &mut Solver<'_>, n: usize, posture: &Posture) -> Vec<Point3<f64>> {
    let nothing = Task {
        targets: &[],
        loss: Problem::loss(),
        vectors: None,
        smoothness: None,
        prior: None,
    };
    solver.place(&nothing, posture, &mut NoTerms).unwrap();
    (0..n)
        .map(|point| solver.posed().point(point).unwrap())
        .collect()
}

/// Returns the least cost found from many starts: `near`, its root with random joints, and random
/// turns of it.
pub(crate) fn true_minimum(
    problem: &Problem,
    solver: &mut Solver<'_>,
    task: &Task<'_>,
    near: &[&Posture],
    rng: &mut impl Rng,
) -> f64 {
    let mut starts: Vec<Posture> = near.iter().map(|&posture| posture.clone()).collect();
    for _ in 0..N_STARTS {
        let q = problem.model.joints().iter();
        let q = q
            .map(|joint| rng.random_range(joint.lower..=joint.upper))
            .collect();
        let reach = if rng.random_bool(0.5) { 0.3 } else { 1.5 };
        let turn = Vector3::from_fn(|_, _| rng.random_range(-reach..reach));
        let root = near[0].root.pose();
        let rotation = UnitQuaternion::new(turn) * root.rotation;
        let root = Isometry3::from_parts(root.translation, rotation);
        starts.push(Posture {
            root: RootPose::from_pose(&spatial::Pose::new(root)),
            q,
        });
    }
    starts.extend(solver.initial_postures(task).unwrap());
    best_of(solver, task, starts, &TIGHT).1.cost
}

/// Minimizes from each of at least one start and returns the best posture.
pub(crate) fn best_of(
    solver: &mut Solver<'_>,
    task: &Task<'_>,
    starts: Vec<Posture>,
    options: &SearchOptions,
) -> (Posture, SearchOutcome) {
    let found = starts.into_iter().map(|mut posture| {
        let outcome = solver.minimize(task, &mut posture, options, &mut NoTerms);
        (posture, outcome.unwrap())
    });
    let best = found.min_by(|(_, a), (_, b)| a.cost.total_cmp(&b.cost));
    best.unwrap()
}
