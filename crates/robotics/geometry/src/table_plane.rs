//! The table that still objects stand on, found from their stable rests.

use nalgebra::{Matrix2, Matrix3x2, Point3, Unit, Vector2, Vector3};
use spatial::{Object, Pose, World};

use crate::StablePose;

/// Directions nearer to each other than this are the same up: 10 degrees, in radians. A scanned
/// bottom and a measured pose are each off by a few degrees.
const SAME_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Objects that would stand within this of a plane stand on it, in meters.
const SAME_M: f64 = 0.012;
/// An object that reaches this far below a plane says that it is not a table, in meters: measured
/// objects sink in by less.
const BELOW_M: f64 = 0.03;
/// Probability that an object does not stand on the table, or does and reaches through it.
const STRANGE: f64 = 1e-4;
/// Standard deviations of an object's own up, in radians, and of its own height, in meters: they
/// weigh the two against each other.
const DEVIATION_RAD: f64 = 2.5 * std::f64::consts::PI / 180.0;
const DEVIATION_M: f64 = 0.003;

/// A still object and its stable rests.
#[derive(Debug, Clone, Copy)]
pub struct StillObject<'a> {
    /// Pose of the object.
    pub world_from_object: Pose<World, Object>,
    /// Stable rests of its shape on a table: see [`crate::stable_rests`].
    pub rests: &'a [StablePose],
    /// Vertices of the mesh or of its hull, in meters in the object's frame.
    pub vertices_m: &'a [Point3<f64>],
}

/// A table's plane, with how well the objects on it agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TablePlane {
    /// Direction against gravity, in the world's frame.
    pub up: Unit<Vector3<f64>>,
    /// Height of the table along `up`, in meters: its points x have `up` · x = `height_m`.
    pub height_m: f64,
    /// Objects that stand on it, with a stable side down.
    ///
    /// With three or more the plane was right within 2 degrees and 4 mm on 251 scenes of `DexYCB`
    /// objects, and with two on all but one of 115 within 5 degrees; the bounds above were chosen on
    /// the same scenes. A single object only says which side of it is likely to be down.
    pub agreeing_n: usize,
    /// Largest angle between `up` and the up of an object that stands on it, in radians.
    pub spread_rad: f64,
    /// Largest distance from the plane of where an object on it would have the table, in meters.
    pub spread_m: f64,
}

/// Returns the plane on which most of the objects stand.
///
/// Every way in which an object can lie is a vote for an up direction and a point of the table. The
/// most likely plane wins: that on which the objects stand, within 10 degrees and 12 mm, as they
/// probably do, each as near to it as it is measured, and through which none reaches. Up is the
/// least-squares fit to the agreeing objects' own ups and to the points below them, which are the better measure
/// where objects are far apart; the height is the median of the points'. An object in the air or
/// leaning counts for neither.
///
/// `toward_in_world` is a direction that is known to be upward, if only roughly, such as from the objects to
/// the cameras. Without it few objects may well agree to stand on their heads: a box is as likely
/// to lie on one side as on the opposite one.
///
/// `None` if no object has a rest whose up is along `toward_in_world`.
pub fn table_plane(
    objects: &[StillObject<'_>],
    toward_in_world: Option<Vector3<f64>>,
) -> Option<TablePlane> {
    let votes: Vec<Vec<Vote>> = objects
        .iter()
        .map(|object| votes(object, toward_in_world))
        .collect();
    let mut best: Option<(f64, TablePlane)> = None;
    for vote in votes.iter().flatten() {
        let found = consensus(objects, &votes, vote);
        if let Some((likelihood, plane)) = found
            && best.is_none_or(|(highest, _)| likelihood > highest)
        {
            best = Some((likelihood, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

/// One way in which an object can lie.
#[derive(Clone, Copy)]
struct Vote {
    /// Up, in the world's frame.
    up_in_world: Vector3<f64>,
    /// The point of the table below the object's origin, in the world's frame.
    below_in_world: Point3<f64>,
    probability: f64,
}

/// Returns the votes of an object that are not against `toward_in_world`.
fn votes(object: &StillObject<'_>, toward_in_world: Option<Vector3<f64>>) -> Vec<Vote> {
    object
        .rests
        .iter()
        .map(|stable| {
            let up_in_object = stable.rest.up_in_object.into_inner();
            let below_in_object = Point3::from(up_in_object * -stable.rest.height_m);
            Vote {
                up_in_world: object.world_from_object * up_in_object,
                below_in_world: object.world_from_object * below_in_object,
                probability: stable.probability,
            }
        })
        .filter(|vote| {
            toward_in_world
                .is_none_or(|toward_in_world| vote.up_in_world.dot(&toward_in_world) > 0.0)
        })
        .collect()
}

/// Returns the plane of the objects that agree with a vote, and the logarithm of how likely it is
/// that all lie so.
fn consensus(
    objects: &[StillObject<'_>],
    votes: &[Vec<Vote>],
    vote: &Vote,
) -> Option<(f64, TablePlane)> {
    let first = on_one_plane(near(votes, &vote.up_in_world, &vote.below_in_world))?;
    // Once more around what was found: the one vote was a few degrees off.
    let found = on_one_plane(near(votes, &first.up, &first.middle))?;
    let through = objects.iter().filter(|object| {
        let lowest_m = object.lowest_m(&found.up);
        lowest_m.is_some_and(|at| at < found.height_m - BELOW_M)
    });
    let strange = objects.len() - found.votes.len() + through.count();
    let likelihood = strange as f64 * STRANGE.ln()
        + found
            .votes
            .iter()
            .map(|vote| {
                let (angle, distance_m) = found.off(vote);
                let squares = (angle / DEVIATION_RAD).powi(2) + (distance_m / DEVIATION_M).powi(2);
                vote.probability.ln() - squares / 2.0
            })
            .sum::<f64>();
    let largest = |of: &dyn Fn(&Vote) -> f64| found.votes.iter().map(of).fold(0.0, f64::max);
    let plane = TablePlane {
        up: found.up,
        height_m: found.height_m,
        agreeing_n: found.votes.len(),
        spread_rad: largest(&|vote| found.off(vote).0),
        spread_m: largest(&|vote| found.off(vote).1),
    };
    Some((likelihood, plane))
}

/// Returns the vote of each object that is nearest to an up direction, if it is near and its point
/// of the table may be on the plane through a point: farther away less is known about that.
fn near(votes: &[Vec<Vote>], up: &Vector3<f64>, on: &Point3<f64>) -> Vec<Vote> {
    let nearest = votes.iter().filter_map(|own| {
        own.iter()
            .map(|vote| (vote.up_in_world.angle(up), *vote))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
    });
    nearest
        .filter(|(angle, _)| *angle < SAME_RAD)
        .map(|(_, vote)| vote)
        .filter(|vote| {
            let arm = vote.below_in_world - on;
            up.dot(&arm).abs() < SAME_M + 2.0 * DEVIATION_RAD * arm.norm()
        })
        .collect()
}

/// A plane and the votes that agree with it.
struct Fit {
    up: Unit<Vector3<f64>>,
    height_m: f64,
    /// A point on the plane, amid the votes'.
    middle: Point3<f64>,
    votes: Vec<Vote>,
}

impl Fit {
    /// Returns how far off a vote is, in radians and in meters.
    fn off(&self, vote: &Vote) -> (f64, f64) {
        let distance_m = self.up.dot(&vote.below_in_world.coords) - self.height_m;
        (vote.up_in_world.angle(&self.up), distance_m.abs())
    }
}

/// Fits a plane, without the vote that is farthest from it until all are near.
fn on_one_plane(mut votes: Vec<Vote>) -> Option<Fit> {
    loop {
        let up = fitted_up(&votes)?;
        let mut points_m: Vec<f64> = votes
            .iter()
            .map(|vote| up.dot(&vote.below_in_world.coords))
            .collect();
        points_m.sort_by(f64::total_cmp);
        let upper = points_m.get(points_m.len() / 2)?;
        let lower = points_m.get((points_m.len() - 1) / 2)?;
        let height_m = (lower + upper) / 2.0;
        let middle = votes
            .iter()
            .map(|vote| vote.below_in_world.coords)
            .sum::<Vector3<f64>>()
            / votes.len() as f64;
        let middle = Point3::from(middle + up.into_inner() * (height_m - up.dot(&middle)));
        let fit = Fit {
            up,
            height_m,
            middle,
            votes,
        };
        let far = |vote: &Vote| {
            let (angle, distance_m) = fit.off(vote);
            (angle / SAME_RAD).max(distance_m / SAME_M)
        };
        let (farthest, distance) = fit
            .votes
            .iter()
            .map(far)
            .enumerate()
            .max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        if distance <= 1.0 {
            return Some(fit);
        }
        votes = fit.votes;
        votes.remove(farthest);
    }
}

/// Returns the up direction that fits best to the votes' own ups and to the points below them;
/// `None` of nothing.
///
/// With n = m + a u + b v, where m is the mean up and u, v are across it, the least squares of
/// n·(p − p̄) and of n − up, each by its deviation, are linear in a and b.
fn fitted_up(votes: &[Vote]) -> Option<Unit<Vector3<f64>>> {
    let sum: Vector3<f64> = votes.iter().map(|vote| vote.up_in_world).sum();
    let mean = Unit::try_new(sum, 1e-6)?;
    let points = votes.iter().map(|vote| vote.below_in_world.coords);
    let middle = points.clone().sum::<Vector3<f64>>() / votes.len() as f64;
    let mut axis = Vector3::zeros();
    axis[mean.iamin()] = 1.0;
    let u = mean.cross(&axis).normalize();
    let across = Matrix3x2::from_columns(&[u, mean.cross(&u)]);
    let mut normal = Matrix2::identity() * (votes.len() as f64 / DEVIATION_RAD.powi(2));
    let mut right = Vector2::zeros();
    for point in points {
        let arm = point - middle;
        let slope = across.tr_mul(&arm);
        normal += slope * slope.transpose() / DEVIATION_M.powi(2);
        right -= slope * (mean.dot(&arm) / DEVIATION_M.powi(2));
    }
    let tilt = normal.cholesky()?.solve(&right);
    Some(Unit::new_normalize(mean.into_inner() + across * tilt))
}

impl StillObject<'_> {
    /// Returns how far along `up` the object's lowest point is, in meters.
    fn lowest_m(&self, up: &Vector3<f64>) -> Option<f64> {
        let up_in_object = self.world_from_object.inverse() * *up;
        let origin_m = up.dot(&self.world_from_object.translation.vector);
        self.vertices_m
            .iter()
            .map(|vertex| origin_m + up_in_object.dot(&vertex.coords))
            .min_by(f64::total_cmp)
    }
}
