//! The table that an image shows.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{DepthView, ViewError};

/// Pixels that are looked at: enough for a plane, few enough to be fast.
const PIXELS: usize = 4000;
/// Planes that are tried.
const TRIES: usize = 200;
/// Points nearer to a plane than this lie on it, in meters at a depth of 1 m; it grows with the square of the depth, as a
/// stereo camera's errors do, from a least distance.
const NEAR_M: f64 = 0.008;
/// The least and the greatest such distance, in meters: a room behind the table is no part of it.
const NEAR_BOUNDS_M: [f64; 2] = [0.002, 0.012];
/// Least share of the pixels that lie on the table, in percent.
const LEAST_SHARE: f64 = 20.0;

/// A table's plane in the world's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TablePlane {
    /// Direction against gravity, toward the camera's side.
    pub up: Unit<Vector3<f64>>,
    /// Its points x have `up` · x = `height_m`.
    pub height_m: f64,
}

impl TablePlane {
    /// Returns how far a point is above the table, in meters.
    pub fn above_m(&self, point_in_world: &Point3<f64>) -> f64 {
        self.up.dot(&point_in_world.coords) - self.height_m
    }
}

/// Returns the plane on which most of the pixels lie that are not the object's, by random sample consensus (Fischler and
/// Bolles, 1981) and least squares.
///
/// # Errors
///
/// Fails if there are few depths, or no plane has a fifth of them.
pub fn table_plane(view: &DepthView) -> Result<TablePlane, ViewError> {
    let around: Vec<usize> = (0..view.depth_m.len())
        .filter(|&pixel| view.depth_m[pixel] > 0.0 && !view.mask[pixel])
        .collect();
    let step = around.len().div_ceil(PIXELS).max(1);
    let points: Vec<Point3<f64>> = around
        .iter()
        .step_by(step)
        .filter_map(|&pixel| view.point_in_camera(pixel))
        .collect();
    if points.len() < 50 {
        return Err(ViewError::FewDepths {
            found: around.len(),
            least: 50,
        });
    }
    // The draws are part of the algorithm: equal images have equal tables.
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let mut best: (usize, Option<Plane>) = (0, None);
    for _ in 0..TRIES {
        let corners = [0; 3].map(|_| points[random.random_range(0..points.len())]);
        let Some(plane) = Plane::through(&corners) else {
            continue;
        };
        let n = points.iter().filter(|&point| plane.holds(point)).count();
        if n > best.0 {
            best = (n, Some(plane));
        }
    }
    let (mut n, Some(mut plane)) = best else {
        return Err(ViewError::NoTable {
            share: 0.0,
            least: LEAST_SHARE,
        });
    };
    for _ in 0..3 {
        let on: Vec<Point3<f64>> = points.iter().filter(|&p| plane.holds(p)).copied().collect();
        let Some(fitted) = Plane::fitted(&on) else {
            break;
        };
        let held_n = points.iter().filter(|&point| fitted.holds(point)).count();
        if held_n < n {
            break;
        }
        (n, plane) = (held_n, fitted);
    }
    let share = 100.0 * n as f64 / points.len() as f64;
    if share < LEAST_SHARE {
        return Err(ViewError::NoTable {
            share,
            least: LEAST_SHARE,
        });
    }
    Ok(plane.in_world(view))
}

/// A plane in the camera's frame: points x with `normal` · x = `offset_m`.
struct Plane {
    normal: Unit<Vector3<f64>>,
    offset_m: f64,
}

impl Plane {
    fn through([a, b, c]: &[Point3<f64>; 3]) -> Option<Self> {
        let normal = Unit::try_new((b - a).cross(&(c - a)), 1e-6)?;
        Some(Self {
            normal,
            offset_m: normal.dot(&a.coords),
        })
    }

    /// The plane of least squared distances.
    fn fitted(points: &[Point3<f64>]) -> Option<Self> {
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let mean = sum / points.len() as f64;
        let spread: Matrix3<f64> = points
            .iter()
            .map(|point| (point.coords - mean) * (point.coords - mean).transpose())
            .sum();
        let eigen = SymmetricEigen::new(spread);
        let normal = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .into_owned();
        let normal = Unit::try_new(normal, 1e-9)?;
        Some(Self {
            normal,
            offset_m: normal.dot(&mean),
        })
    }

    fn holds(&self, point: &Point3<f64>) -> bool {
        let near_m = (NEAR_M * point.z.powi(2)).clamp(NEAR_BOUNDS_M[0], NEAR_BOUNDS_M[1]);
        (self.normal.dot(&point.coords) - self.offset_m).abs() < near_m
    }

    fn in_world(&self, view: &DepthView) -> TablePlane {
        // The camera, its frame's origin, is above the table.
        let sign = if self.offset_m > 0.0 { -1.0 } else { 1.0 };
        let up = view.world_from_camera.rotation * (self.normal.into_inner() * sign);
        let origin = view.world_from_camera.translation.vector;
        TablePlane {
            up: Unit::new_normalize(up),
            height_m: sign * self.offset_m + up.dot(&origin),
        }
    }
}

#[cfg(test)]
mod tests {
    use geometry::TriMesh;
    use spatial::Pose;

    use super::*;
    use crate::{Intrinsics, RenderedObject, StereoNoise, looking_at, render};

    #[test]
    fn the_table_is_found_under_noise() {
        let mesh = TriMesh::cuboid(Point3::new(-0.05, -0.02, 0.0), Point3::new(0.05, 0.02, 0.1));
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::identity(),
        };
        let camera = looking_at(Point3::new(0.4, 0.2, 0.5), Point3::origin());
        let rendered = render(&object, &Intrinsics::of_field(320, 240, 1.0), &camera);
        let exact = table_plane(&rendered.view).unwrap();
        assert!(exact.up.z > 1.0 - 1e-9 && exact.height_m.abs() < 1e-6);
        let noisy = table_plane(&StereoNoise::default().measured(&rendered, 1)).unwrap();
        assert!(noisy.up.z > 0.3_f64.to_radians().cos(), "{noisy:?}");
        assert!(noisy.height_m.abs() < 0.001, "{noisy:?}");
    }

    #[test]
    fn a_room_behind_the_table_does_not_move_it() {
        let camera = looking_at(Point3::new(0.5, 0.0, 0.25), Point3::new(0.0, 0.0, 0.02));
        let mesh = TriMesh::cuboid(
            Point3::new(-0.02, -0.02, 0.0),
            Point3::new(0.02, 0.02, 0.05),
        );
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::identity(),
        };
        let mut view = render(&object, &Intrinsics::of_field(320, 240, 1.2), &camera).view;
        // The table ends a meter away, and behind it is a wall with things before it.
        for depth_m in &mut view.depth_m {
            if *depth_m <= 0.0 || *depth_m >= 1.0 {
                *depth_m = 5.0 + 2.0 * *depth_m % 1.0;
            }
        }
        let table = table_plane(&view).unwrap();
        assert!(table.up.z > 0.2_f64.to_radians().cos(), "{table:?}");
        assert!(table.height_m.abs() < 0.002, "{table:?}");
    }

    #[test]
    fn an_image_without_a_plane_has_no_table() {
        let intrinsics = Intrinsics::of_field(64, 48, 1.0);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let view = DepthView {
            intrinsics,
            world_from_camera: Pose::identity(),
            depth_m: (0..intrinsics.pixels_n())
                .map(|_| random.random_range(0.5..3.0))
                .collect(),
            mask: vec![false; intrinsics.pixels_n()],
        };
        assert!(matches!(table_plane(&view), Err(ViewError::NoTable { .. })));
        let empty = DepthView {
            depth_m: vec![0.0; intrinsics.pixels_n()],
            ..view
        };
        assert!(matches!(
            table_plane(&empty),
            Err(ViewError::FewDepths { found: 0, .. })
        ));
    }
}
