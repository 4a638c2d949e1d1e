//! Collision shapes as balls: what a distance field can answer for.

mod lining;

use nalgebra::{Point3, Vector3};

use crate::{Collision, RobotModel, Shape};

/// Radius of the balls that line a box, in meters: what they cut off its edges, at most
/// (√3 − 1) of it or 2 mm at a corner, lies within the softness of a finger pad.
const LINING_RADIUS_M: f64 = 0.003;

/// Largest distance between neighboring balls, in meters.
const SPACING_M: f64 = 0.011;

/// A ball fixed to a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball {
    /// Center in the link's frame, in meters.
    pub center_in_link: Point3<f64>,
    /// Radius in meters.
    pub radius_m: f64,
}

/// Returns about how many balls [`fill`] makes of a collision shape: at most twice as many of a
/// primitive, and of a body with many small sides one for each corner of each triangle.
pub fn count(collision: &Collision) -> f64 {
    let along = |half: f64| 1.0 + (2.0 * half.max(0.0) / SPACING_M).ceil();
    match &collision.shape {
        Shape::Sphere { .. } => 1.0,
        Shape::Capsule { half_length_m, .. } => along(*half_length_m),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => along(half_length_m - radius_m).max(along(radius_m - half_length_m).powi(2)),
        Shape::Box { half_extents_m } => {
            let radius = LINING_RADIUS_M.min(half_extents_m.min());
            let ns = half_extents_m.map(|half| along(half - radius));
            let inner = ns.map(|n| (n - 2.0).max(0.0));
            ns.product() - inner.product()
        }
        Shape::Convex(body) => lining::count(body),
    }
}

/// Returns balls inside the collision shape that reach its surface about everywhere.
///
/// Their number and the time that it takes grow with the shape: see [`count`].
pub fn fill(collision: &Collision) -> Vec<Ball> {
    let place = |center: Vector3<f64>, radius_m: f64| Ball {
        center_in_link: collision.link_from_shape * Point3::from(center),
        radius_m,
    };
    match &collision.shape {
        Shape::Sphere { radius_m } => vec![place(Vector3::zeros(), *radius_m)],
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => line(*half_length_m)
            .into_iter()
            .map(|z| place(Vector3::z() * z, *radius_m))
            .collect(),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => {
            if radius_m > half_length_m {
                // Flat: balls as thick as it is, out to its rim.
                return disc(radius_m - half_length_m)
                    .into_iter()
                    .map(|[x, y]| place(Vector3::new(x, y, 0.0), *half_length_m))
                    .collect();
            }
            line(half_length_m - radius_m)
                .into_iter()
                .map(|z| place(Vector3::z() * z, *radius_m))
                .collect()
        }
        Shape::Box { half_extents_m } => {
            let radius = LINING_RADIUS_M.min(half_extents_m.min());
            let inner = half_extents_m.map(|half| half - radius);
            let [xs, ys, zs] = [line(inner.x), line(inner.y), line(inner.z)];
            let is_end = |at: f64, half: f64| (at.abs() - half).abs() < 1e-12;
            let mut balls = Vec::new();
            for &x in &xs {
                for &y in &ys {
                    for &z in &zs {
                        // Those inside the lining can touch nothing before it does.
                        if is_end(x, inner.x) || is_end(y, inner.y) || is_end(z, inner.z) {
                            balls.push(place(Vector3::new(x, y, z), radius));
                        }
                    }
                }
            }
            balls
        }
        Shape::Convex(body) => {
            let (centers, radius_m) = lining::of(body);
            let balls = centers.into_iter().map(|center| place(center, radius_m));
            balls.collect()
        }
    }
}

/// Returns evenly spaced places from `-half` to `half`, ends included, [`SPACING_M`] apart at most.
fn line(half: f64) -> Vec<f64> {
    if half <= 0.0 {
        return vec![0.0];
    }
    let mut n: u32 = 1;
    while 2.0 * half / f64::from(n) > SPACING_M {
        n += 1;
    }
    (0..=n)
        .map(|i| half * (2.0 * f64::from(i) / f64::from(n) - 1.0))
        .collect()
}

/// Returns places on a disc about the origin, on its rim and in rings inside it, about
/// [`SPACING_M`] apart at most.
fn disc(radius: f64) -> Vec<[f64; 2]> {
    let mut places = Vec::new();
    for ring in line(radius).into_iter().filter(|&ring| ring >= 0.0) {
        // As many as on a line as long as the ring, whose last place is its first one.
        let around = line(std::f64::consts::PI * ring);
        let n = around.len().saturating_sub(1).max(1);
        for at in around.iter().take(n) {
            let (sine, cosine) = if ring > 0.0 {
                (at / ring).sin_cos()
            } else {
                (0.0, 1.0)
            };
            places.push([ring * cosine, ring * sine]);
        }
    }
    places
}

/// Maximum number of balls in one group.
const GROUP: usize = 12;
/// Maximum number of balls of a hand: those of all sides of a box of one meter, three times.
pub const MAX_BALLS: f64 = 150_000.0;

/// Neighboring balls of one link.
#[derive(Debug, Clone, PartialEq)]
pub struct Cluster {
    /// Which of the hand's links they are fixed to.
    pub link: usize,
    /// A ball about all of them.
    pub around: Ball,
    /// The balls.
    pub balls: Vec<Ball>,
}

/// A hand's collision shapes are far larger than a hand's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TooLarge {
    /// Name of the link with whose shapes they come to be so.
    pub link: String,
}

/// Checks that a hand's collision shapes can be filled with balls.
///
/// # Errors
///
/// Fails if they are so large that more than [`MAX_BALLS`] would be made.
pub fn check(hand: &RobotModel) -> Result<(), TooLarge> {
    let mut n_balls = 0.0;
    for body in hand.links() {
        n_balls += body.collisions.iter().map(count).sum::<f64>();
        if n_balls > MAX_BALLS {
            return Err(TooLarge {
                link: body.name.clone(),
            });
        }
    }
    Ok(())
}

/// Fills all collision shapes of a hand with balls, link after link.
///
/// # Errors
///
/// Fails as [`check`] does.
pub fn clusters(hand: &RobotModel) -> Result<Vec<Cluster>, TooLarge> {
    check(hand)?;
    let mut all = Vec::new();
    for (link, body) in hand.links().iter().enumerate() {
        let balls: Vec<Ball> = body.collisions.iter().flat_map(fill).collect();
        all.extend(groups(balls).into_iter().filter_map(|balls| {
            Some(Cluster {
                link,
                around: enclosing(&balls)?,
                balls,
            })
        }));
    }
    Ok(all)
}

/// Parts balls into groups of neighbors.
pub fn groups(mut balls: Vec<Ball>) -> Vec<Vec<Ball>> {
    if balls.len() <= GROUP {
        return vec![balls];
    }
    let centers = || balls.iter().map(|ball| ball.center_in_link.coords);
    let low = centers().fold(Vector3::repeat(f64::INFINITY), |a, b| a.inf(&b));
    let high = centers().fold(Vector3::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
    let longest = (high - low).imax();
    balls.sort_by(|a, b| a.center_in_link[longest].total_cmp(&b.center_in_link[longest]));
    let rest = balls.split_off(balls.len() / 2);
    let mut all = groups(balls);
    all.extend(groups(rest));
    all
}

/// Returns a ball about all of these, not much larger than need be; `None` if there are none.
pub fn enclosing(balls: &[Ball]) -> Option<Ball> {
    let low = balls
        .iter()
        .map(|ball| ball.center_in_link.coords)
        .reduce(|a, b| a.inf(&b))?;
    let high = balls
        .iter()
        .map(|ball| ball.center_in_link.coords)
        .reduce(|a, b| a.sup(&b))?;
    let center_in_link = Point3::from((low + high) / 2.0);
    let reach = |ball: &Ball| (ball.center_in_link - center_in_link).norm() + ball.radius_m;
    Some(Ball {
        center_in_link,
        radius_m: balls.iter().map(reach).fold(0.0, f64::max),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use spatial::Pose;

    use super::*;

    #[test]
    fn balls_line_a_box_from_inside() {
        let half = Vector3::new(0.0098, 0.01375, 0.027);
        let collision = Collision {
            link_from_shape: Pose::new(Isometry3::translation(0.0, 0.0, 0.027)),
            shape: Shape::Box {
                half_extents_m: half,
            },
        };
        let balls = fill(&collision);
        let mut top = f64::MIN;
        for ball in &balls {
            let center = ball.center_in_link - Vector3::new(0.0, 0.0, 0.027);
            for (at, half) in center.iter().zip(half.iter()) {
                assert!(at.abs() + ball.radius_m < half + 1e-12);
            }
            top = top.max(ball.center_in_link.z + ball.radius_m);
        }
        assert!((top - 0.054).abs() < 1e-12, "{top}");
        assert!((20..100).contains(&balls.len()), "{}", balls.len());
    }

    #[test]
    fn balls_fill_a_flat_cylinder_out_to_its_rim() {
        let (radius_m, half_length_m) = (0.045, 0.01);
        let collision = Collision {
            link_from_shape: Pose::identity(),
            shape: Shape::Cylinder {
                radius_m,
                half_length_m,
            },
        };
        let balls = fill(&collision);
        for ball in &balls {
            let across = ball.center_in_link.coords.xy().norm() + ball.radius_m;
            assert!(across < radius_m + 1e-12, "{ball:?}");
            assert!(ball.center_in_link.z.abs() + ball.radius_m < half_length_m + 1e-12);
        }
        // Whatever comes in from any side at half height is met within a millimeter or so.
        for turn in 0..360 {
            let (sine, cosine) = f64::from(turn).to_radians().sin_cos();
            let at = Point3::new(radius_m * cosine, radius_m * sine, 0.0);
            let gap = balls
                .iter()
                .map(|ball| (ball.center_in_link - at).norm() - ball.radius_m)
                .fold(f64::MAX, f64::min);
            assert!(gap < 0.002, "{gap} m at {turn} degrees");
        }
        // And what comes from above, too.
        for share in 0..10 {
            let at = Point3::new(0.0, radius_m * f64::from(share) / 10.0, half_length_m);
            let gap = balls
                .iter()
                .map(|ball| (ball.center_in_link - at).norm() - ball.radius_m)
                .fold(f64::MAX, f64::min);
            assert!(gap < 0.004, "{gap} m at {share}");
        }
    }

    #[test]
    fn ball_count_is_known_beforehand() {
        let half = |x: f64, y: f64, z: f64| Shape::Box {
            half_extents_m: Vector3::new(x, y, z),
        };
        let cylinder = |radius_m, half_length_m| Shape::Cylinder {
            radius_m,
            half_length_m,
        };
        let capsule = Shape::Capsule {
            radius_m: 0.01,
            half_length_m: 0.2,
        };
        for shape in [
            half(0.02, 0.056, 0.0475),
            half(0.5, 0.5, 0.01),
            half(0.001, 0.001, 0.3),
            cylinder(0.2, 0.01),
            cylinder(0.01, 0.3),
            capsule,
            Shape::Sphere { radius_m: 0.3 },
        ] {
            let collision = Collision {
                link_from_shape: Pose::identity(),
                shape: shape.clone(),
            };
            let (made, foretold) = (fill(&collision).len() as f64, count(&collision));
            assert!(
                made <= foretold && foretold <= 2.0 * made + 10.0,
                "{made}, not {foretold}: {shape:?}"
            );
        }
    }

    #[test]
    fn a_ball_encloses_the_others() {
        let ball = |x: f64, radius_m: f64| Ball {
            center_in_link: Point3::new(x, 0.0, 0.01),
            radius_m,
        };
        let around = enclosing(&[ball(0.0, 0.01), ball(0.04, 0.02), ball(0.01, 0.0)]).unwrap();
        assert_eq!((around.center_in_link.x, around.radius_m), (0.02, 0.04));
        assert_eq!(enclosing(&[]), None);
    }

    #[test]
    fn groups_hold_every_ball_once_and_are_small() {
        let collision = Collision {
            link_from_shape: Pose::identity(),
            shape: Shape::Box {
                half_extents_m: Vector3::new(0.02, 0.056, 0.0475),
            },
        };
        let balls = fill(&collision);
        let groups = groups(balls.clone());
        assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), balls.len());
        assert!(
            balls
                .iter()
                .all(|ball| groups.iter().flatten().any(|one| one == ball))
        );
        for group in &groups {
            assert!(group.len() <= GROUP);
            assert!(enclosing(group).unwrap().radius_m < 0.04);
        }
    }
}
