//! The pose that fits what is seen.

use std::f64::consts::TAU;

use completion::Observation;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use spatial::{Object, Pose, RestingPose, Table, World};

use crate::{
    Ambiguous, Freedom, KnownShape, RegistrationError, RegistrationOptions,
    fit::{Fit, Placed},
};

/// Yaws from which each resting orientation starts.
const YAWS: u32 = 24;
/// The fits from all starts, from the better ones, and from the best different ones.
const ALL: Round = Round {
    seen_n: 80,
    points_n: 100,
    steps: 5,
    scales_m: [0.03, 0.015],
};
const BETTER: Round = Round {
    seen_n: 150,
    points_n: 200,
    steps: 8,
    scales_m: [0.015, 0.008],
};
const BEST: Round = Round {
    seen_n: 600,
    points_n: 600,
    steps: 20,
    scales_m: [0.01, 0.006],
};
/// Number of the better poses, and of the best different ones.
const BETTER_N: usize = 64;
const BEST_N: usize = 8;

/// A fit of poses, each by as many steps.
struct Round {
    /// Most seen points and points of the surface that are looked at.
    seen_n: usize,
    points_n: usize,
    steps: u32,
    /// Scales of the loss in meters, from the first step to the last one: of what is far from its place first.
    scales_m: [f64; 2],
}

impl Round {
    fn fit<'a>(&self, shape: &'a KnownShape, observation: &'a Observation) -> Fit<'a> {
        Fit::of(shape, observation, self.seen_n, self.points_n)
    }

    /// Returns the scales of the steps, by equal factors.
    fn scales_m(&self) -> impl Iterator<Item = f64> + use<> {
        let ([first, last], steps) = (self.scales_m, self.steps);
        let share = move |step: u32| f64::from(step) / f64::from(steps.saturating_sub(1).max(1));
        (0..steps).map(move |step| first * (last / first).powf(share(step)))
    }

    /// Returns the poses after the steps along the table, the best one first.
    fn moved(&self, fit: &Fit<'_>, starts: impl Iterator<Item = Placed>) -> Vec<Placed> {
        let moved = starts.map(|start| fit.moved(&start, self.scales_m(), Freedom::Table));
        sorted(fit, moved, self.scales_m[1])
    }
}

/// Sorts poses by their residual.
fn sorted(fit: &Fit<'_>, poses: impl Iterator<Item = Placed>, scale_m: f64) -> Vec<Placed> {
    let mut poses: Vec<(f64, Placed)> = poses
        .map(|placed| (fit.residual_m(&placed.table_from_object, scale_m), placed))
        .collect();
    poses.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    poses.into_iter().map(|(_, placed)| placed).collect()
}

/// How well a pose fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// What is least for the best pose, in meters: the root of the mean squares of the seen points' distances from the
    /// surface and of the surface's depths in free space, errors above 6 mm counting little more.
    pub residual_m: f64,
    /// Root mean square distance of the explained points from the surface, in meters.
    pub distance_m: f64,
    /// Share of the seen points that are near the surface.
    pub explained_share: f64,
    /// Share of the surface that lies where a camera saw free space.
    pub free_share: f64,
}

/// A pose of an object, and how well it fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedPose {
    /// The pose, in the world of the views.
    pub world_from_object: Pose<World, Object>,
    /// How well it fits.
    pub score: Score,
}

/// Where an object is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// The pose that fits best.
    pub best: FittedPose,
    /// How the object rests in it.
    pub rest: RestingPose,
    /// The best pose of those in which the surface lies elsewhere, with the root mean square distance between the two
    /// surfaces in meters; nothing if every start has led to the same surface.
    pub runner_up: Option<(FittedPose, f64)>,
}

/// Finds the pose of an object of known shape.
///
/// # Errors
///
/// Fails if no pose fits, or two different ones fit alike.
pub fn register(
    shape: &KnownShape,
    observation: &Observation,
    options: &RegistrationOptions,
) -> Result<Registration, RegistrationError> {
    let fine = BEST.fit(shape, observation);
    let mut fitted = BEST.moved(&fine, coarse_poses(shape, observation, options).into_iter());
    if options.freedom == Freedom::All {
        let last_m = BEST.scales_m[1];
        let steps = std::iter::repeat_n(last_m, BEST.steps as usize);
        let moved = fitted.iter();
        let moved = moved.map(|placed| fine.moved(placed, steps.clone(), Freedom::All));
        fitted = sorted(&fine, moved, last_m);
    }
    let (best, others) = fitted.split_first().ok_or(RegistrationError::NoRest)?;
    let apart_m = |other: &Placed| shape.apart_m(&best.table_from_object, &other.table_from_object);
    let mut others = others.iter().map(|other| (other, apart_m(other)));
    let runner_up = others.find(|&(_, apart_m)| apart_m > options.different_m);
    let world_from_table: Pose<World, Table> = observation.world_from_object.reinterpret();
    let fitted = |placed: &Placed| FittedPose {
        world_from_object: world_from_table * placed.table_from_object,
        score: score(&fine, &placed.table_from_object, options),
    };
    let found = Registration {
        rest: RestingPose::of(&best.table_from_object),
        best: fitted(best),
        runner_up: runner_up.map(|(other, apart_m)| (fitted(other), apart_m)),
    };
    found.check(options)?;
    Ok(found)
}

impl Registration {
    fn check(&self, options: &RegistrationOptions) -> Result<(), RegistrationError> {
        let score = &self.best.score;
        if score.explained_share < options.least_explained_share
            || score.free_share > options.most_free_share
        {
            return Err(RegistrationError::PoorFit {
                explained: 100.0 * score.explained_share,
                least: 100.0 * options.least_explained_share,
                free: 100.0 * score.free_share,
                most: 100.0 * options.most_free_share,
            });
        }
        if let Some((other, apart_m)) = &self.runner_up
            && options.ambiguous == Ambiguous::Refuse
            && other.score.residual_m < options.ambiguous_ratio * score.residual_m
        {
            return Err(RegistrationError::Ambiguous {
                best_mm: 1e3 * score.residual_m,
                other_mm: 1e3 * other.score.residual_m,
                apart_mm: 1e3 * apart_m,
            });
        }
        Ok(())
    }
}

/// Returns the best different poses of a coarse fit from every start.
fn coarse_poses(
    shape: &KnownShape,
    observation: &Observation,
    options: &RegistrationOptions,
) -> Vec<Placed> {
    let poses = ALL.moved(&ALL.fit(shape, observation), starts(shape, observation));
    let better = poses.into_iter().take(BETTER_N);
    let poses = BETTER.moved(&BETTER.fit(shape, observation), better);
    let mut different: Vec<Placed> = Vec::new();
    for placed in poses {
        let pose = &placed.table_from_object;
        let is_new = different.iter().all(|other| {
            let apart_m = shape.apart_m(pose, &other.table_from_object);
            apart_m > options.different_m
        });
        if is_new {
            different.push(placed);
        }
        if different.len() == BEST_N {
            break;
        }
    }
    different
}

/// Returns each resting orientation at each yaw, the middle of what a camera would see of it where that of the seen points
/// is.
fn starts<'a>(
    shape: &'a KnownShape,
    observation: &'a Observation,
) -> impl Iterator<Item = Placed> + 'a {
    let eyes: Vec<Point3<f64>> = observation.eyes().collect();
    let seen = middle(observation.points.iter().copied());
    let yaws = (0..YAWS).map(|yaw| TAU * f64::from(yaw) / f64::from(YAWS));
    let turned = shape
        .rests
        .iter()
        .flat_map(move |rest| yaws.clone().map(move |yaw_rad| (*rest, yaw_rad)));
    turned.map(move |(rest, yaw_rad)| {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let yaw: Pose<Table, Table> = Pose::from_parts(Vector3::zeros(), yaw);
        let mut table_from_object = yaw * rest.table_from_object();
        // Once more from where it then is: what is seen of it depends on where it is.
        for _ in 0..2 {
            let pairs = shape.points.iter().zip(&shape.normals);
            let placed = pairs.map(|(&point, &normal)| {
                let point = table_from_object * point;
                (point, table_from_object * normal)
            });
            let facing = placed.filter(|(point, normal)| {
                let mut eyes = eyes.iter();
                eyes.any(|eye| normal.dot(&(eye - point)) > 0.0)
            });
            let off = seen - middle(facing.map(|(point, _)| point));
            table_from_object = table_from_object.translated(&Vector3::new(off.x, off.y, 0.0));
        }
        Placed {
            rest,
            table_from_object,
        }
    })
}

/// Returns the mean of points; the origin without a point.
fn middle(points: impl Iterator<Item = Point3<f64>>) -> Point3<f64> {
    let (sum, n) = points.fold((Vector3::zeros(), 0.0), |(sum, n), point| {
        (sum + point.coords, n + 1.0)
    });
    Point3::from(if n > 0.0 { sum / n } else { sum })
}

fn score(fit: &Fit<'_>, pose: &Pose<Table, Object>, options: &RegistrationOptions) -> Score {
    let distances = fit.distances_m(pose);
    let near: Vec<f64> = distances
        .filter(|distance_m| distance_m.abs() < options.explained_m)
        .collect();
    let squares = near.iter().map(|distance_m| distance_m * distance_m);
    let free_n = fit.depths_m(pose).filter(|&depth_m| depth_m > 0.0).count();
    Score {
        residual_m: fit.residual_m(pose, BEST.scales_m[1]),
        distance_m: (squares.sum::<f64>() / near.len().max(1) as f64).sqrt(),
        explained_share: near.len() as f64 / fit.seen.len().max(1) as f64,
        free_share: free_n as f64 / fit.points_n.max(1) as f64,
    }
}
