//! Collision shapes as spheres, whose distances a distance field can give.

mod lining;

use nalgebra::{Point3, Vector3};

use crate::{Collision, RobotModel, Shape};

/// Radius of the spheres that line a box, in meters: the part that they cut off its edges, at most
/// (√3 − 1) of it or 2 mm at a corner, lies within the softness of a finger pad.
const LINING_RADIUS_M: f64 = 0.003;

/// Largest distance between neighboring spheres, in meters.
const SPACING_M: f64 = 0.011;

/// A sphere fixed to a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CollisionSphere {
    /// Center in the link's frame, in meters.
    pub center_in_link: Point3<f64>,
    /// Radius in meters.
    pub radius_m: f64,
}

/// Estimates the number of spheres that [`fill`] makes of a collision shape: at most twice as many of
/// a primitive, and of a body with many small sides one for each corner of each triangle.
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

/// Returns spheres inside the collision shape that reach its surface about everywhere.
///
/// Their number and the time that it takes grow with the shape: see [`count`].
pub fn fill(collision: &Collision) -> Vec<CollisionSphere> {
    let place = |center: Vector3<f64>, radius_m: f64| CollisionSphere {
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
                // Flat: spheres as thick as it is, out to its rim.
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
            let mut spheres = Vec::new();
            for &x in &xs {
                for &y in &ys {
                    for &z in &zs {
                        // Those inside the lining can touch nothing before it does.
                        if is_end(x, inner.x) || is_end(y, inner.y) || is_end(z, inner.z) {
                            spheres.push(place(Vector3::new(x, y, z), radius));
                        }
                    }
                }
            }
            spheres
        }
        Shape::Convex(body) => {
            let (centers, radius_m) = lining::of(body);
            let spheres = centers.into_iter().map(|center| place(center, radius_m));
            spheres.collect()
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

/// Maximum number of spheres in one group.
const GROUP: usize = 12;
/// Maximum number of spheres of a hand: those of all sides of a box of one meter, three times.
pub const MAX_SPHERES: f64 = 150_000.0;

/// Factor on the radius of the sphere about a cluster where its distance is read off a field: it allows for the
/// interpolation's slope above 1.
pub const SLACK: f64 = 1.1;

/// Neighboring spheres of one link.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereCluster {
    /// Index of the hand's link that they are fixed to.
    pub link: usize,
    /// A sphere about all of them.
    pub around: CollisionSphere,
    /// The spheres.
    pub spheres: Vec<CollisionSphere>,
}

/// A hand's collision shapes are far larger than a hand's.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the collision shapes up to link `{link}` need more than {MAX_SPHERES} spheres")]
pub struct TooLarge {
    /// Name of the link at whose shapes the maximum number of spheres is exceeded.
    pub link: String,
}

/// Checks that a hand's collision shapes can be filled with spheres.
///
/// # Errors
///
/// Fails if they are so large that more than [`MAX_SPHERES`] would be made.
pub fn check(hand: &RobotModel) -> Result<(), TooLarge> {
    let mut n_spheres = 0.0;
    for body in hand.links() {
        n_spheres += body.collisions.iter().map(count).sum::<f64>();
        if n_spheres > MAX_SPHERES {
            return Err(TooLarge {
                link: body.name.clone(),
            });
        }
    }
    Ok(())
}

/// Fills all collision shapes of a hand with spheres, link after link.
///
/// # Errors
///
/// Fails as [`check`] does.
pub fn clusters(hand: &RobotModel) -> Result<Vec<SphereCluster>, TooLarge> {
    check(hand)?;
    let mut all = Vec::new();
    for (link, body) in hand.links().iter().enumerate() {
        let spheres: Vec<CollisionSphere> = body.collisions.iter().flat_map(fill).collect();
        all.extend(groups(spheres).into_iter().filter_map(|spheres| {
            Some(SphereCluster {
                link,
                around: enclosing(&spheres)?,
                spheres,
            })
        }));
    }
    Ok(all)
}

/// Parts spheres into groups of neighbors.
pub fn groups(mut spheres: Vec<CollisionSphere>) -> Vec<Vec<CollisionSphere>> {
    if spheres.len() <= GROUP {
        return vec![spheres];
    }
    let centers = || spheres.iter().map(|sphere| sphere.center_in_link.coords);
    let low = centers().fold(Vector3::repeat(f64::INFINITY), |a, b| a.inf(&b));
    let high = centers().fold(Vector3::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
    let longest = (high - low).imax();
    spheres.sort_by(|a, b| a.center_in_link[longest].total_cmp(&b.center_in_link[longest]));
    let rest = spheres.split_off(spheres.len() / 2);
    let mut all = groups(spheres);
    all.extend(groups(rest));
    all
}

/// Returns a sphere about all of these, not much larger than need be; `None` if there are none.
pub fn enclosing(spheres: &[CollisionSphere]) -> Option<CollisionSphere> {
    let centers = || spheres.iter().map(|sphere| sphere.center_in_link.coords);
    let low = centers().reduce(|a, b| a.inf(&b))?;
    let high = centers().reduce(|a, b| a.sup(&b))?;
    let center_in_link = Point3::from((low + high) / 2.0);
    let reach = |sphere: &CollisionSphere| {
        (sphere.center_in_link - center_in_link).norm() + sphere.radius_m
    };
    Some(CollisionSphere {
        center_in_link,
        radius_m: spheres.iter().map(reach).fold(0.0, f64::max),
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
        let spheres = fill(&collision);
        let mut top = f64::MIN;
        for sphere in &spheres {
            let center = sphere.center_in_link - Vector3::new(0.0, 0.0, 0.027);
            for (at, half) in center.iter().zip(half.iter()) {
                assert!(at.abs() + sphere.radius_m < half + 1e-12);
            }
            top = top.max(sphere.center_in_link.z + sphere.radius_m);
        }
        assert!((top - 0.054).abs() < 1e-12, "{top}");
        assert!((20..100).contains(&spheres.len()), "{}", spheres.len());
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
        let spheres = fill(&collision);
        for sphere in &spheres {
            let across = sphere.center_in_link.coords.xy().norm() + sphere.radius_m;
            assert!(across < radius_m + 1e-12, "{sphere:?}");
            assert!(sphere.center_in_link.z.abs() + sphere.radius_m < half_length_m + 1e-12);
        }
        // A point that comes from any side at half height meets a sphere within about a millimeter.
        for turn in 0..360 {
            let (sine, cosine) = f64::from(turn).to_radians().sin_cos();
            let at = Point3::new(radius_m * cosine, radius_m * sine, 0.0);
            let gap = spheres
                .iter()
                .map(|sphere| (sphere.center_in_link - at).norm() - sphere.radius_m)
                .fold(f64::MAX, f64::min);
            assert!(gap < 0.002, "{gap} m at {turn} degrees");
        }
        // A point from above does, too.
        for share in 0..10 {
            let at = Point3::new(0.0, radius_m * f64::from(share) / 10.0, half_length_m);
            let gap = spheres
                .iter()
                .map(|sphere| (sphere.center_in_link - at).norm() - sphere.radius_m)
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
        let sphere = |x: f64, radius_m: f64| CollisionSphere {
            center_in_link: Point3::new(x, 0.0, 0.01),
            radius_m,
        };
        let around =
            enclosing(&[sphere(0.0, 0.01), sphere(0.04, 0.02), sphere(0.01, 0.0)]).unwrap();
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
        let spheres = fill(&collision);
        let groups = groups(spheres.clone());
        assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), spheres.len());
        assert!(
            spheres
                .iter()
                .all(|sphere| groups.iter().flatten().any(|one| one == sphere))
        );
        for group in &groups {
            assert!(group.len() <= GROUP);
            assert!(enclosing(group).unwrap().radius_m < 0.04);
        }
    }
}
