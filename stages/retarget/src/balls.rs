//! Collision shapes as balls: what a distance field can answer for.

use nalgebra::{Point3, Vector3};
use robot::{Collision, Shape};

/// Radius of the balls that line a box, in meters: what they cut off its edges, at most
/// (√3 − 1) of it or 2 mm at a corner, lies within the softness of a finger pad.
const LINING_RADIUS_M: f64 = 0.003;

/// Largest distance between neighboring balls, in meters.
const SPACING_M: f64 = 0.011;

/// A ball fixed to a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ball {
    /// Center in the link's frame, in meters.
    pub(crate) center_in_link: Point3<f64>,
    /// Radius in meters.
    pub(crate) radius_m: f64,
}

/// Returns balls inside the collision shape that reach its surface about everywhere.
pub(crate) fn fill(collision: &Collision) -> Vec<Ball> {
    let place = |center: Vector3<f64>, radius_m: f64| Ball {
        center_in_link: collision.link_from_shape * Point3::from(center),
        radius_m,
    };
    match collision.shape {
        Shape::Sphere { radius_m } => vec![place(Vector3::zeros(), radius_m)],
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => line(half_length_m)
            .into_iter()
            .map(|z| place(Vector3::z() * z, radius_m))
            .collect(),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => {
            let radius = radius_m.min(half_length_m);
            line(half_length_m - radius)
                .into_iter()
                .map(|z| place(Vector3::z() * z, radius))
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

/// Most balls in one group.
const GROUP: usize = 12;

/// Parts balls into groups of neighbors.
pub(crate) fn groups(mut balls: Vec<Ball>) -> Vec<Vec<Ball>> {
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
pub(crate) fn enclosing(balls: &[Ball]) -> Option<Ball> {
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

    use super::*;

    #[test]
    fn balls_line_a_box_from_inside() {
        let half = Vector3::new(0.0098, 0.01375, 0.027);
        let collision = Collision {
            link_from_shape: Isometry3::translation(0.0, 0.0, 0.027),
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
            link_from_shape: Isometry3::identity(),
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
