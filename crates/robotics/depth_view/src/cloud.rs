//! Cleaned points of an object, with their normals.

use nalgebra::{Point3, Unit, Vector3};

use crate::DepthView;

/// Columns and rows on each side of a pixel to which a plane is fitted.
const WINDOW: usize = 2;
/// Pixels whose depths differ by more than this are of different surfaces, in meters: at the closest view of a hand's
/// object, neighboring pixels on a surface seen at 75 degrees differ by less.
const SURFACE_M: f64 = 0.006;
/// Least number of pixels of a window that lie on one surface with its own.
const LEAST_NEIGHBORS: usize = 12;

/// A point of the object that an image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPoint {
    /// The pixel that shows it.
    pub pixel: usize,
    /// Where it is: on the pixel's ray, at the depth of a plane through the depths about it.
    pub point_in_world: Point3<f64>,
    /// The surface's unit normal, toward the camera.
    pub normal_in_world: Unit<Vector3<f64>>,
}

/// Returns the points of a view's object, row by row.
///
/// A pixel at the mask's border, and one whose window has few depths of its own surface, is left out: at the edge of an
/// object a camera reports depths between it and what is behind it. Depths are smoothed by the plane that fits those of a
/// window of five pixels by five.
pub fn cloud(view: &DepthView) -> Vec<SeenPoint> {
    let own: Vec<usize> = (0..view.depth_m.len())
        .filter(|&pixel| view.mask[pixel] && view.depth_m[pixel] > 0.0)
        .filter(|&pixel| view.around(pixel, 1).all(|other| view.mask[other]))
        .collect();
    own.into_iter()
        .filter_map(|pixel| seen(view, pixel))
        .collect()
}

/// Fits a plane to the depths about a pixel, as inverse depths over the pixel's coordinates: those of a plane are linear.
fn seen(view: &DepthView, pixel: usize) -> Option<SeenPoint> {
    let depth_m = view.depth_m[pixel];
    let (x, y) = view.intrinsics.coordinates(pixel);
    let near = |&other: &usize| {
        view.mask[other]
            && view.depth_m[other] > 0.0
            && (view.depth_m[other] - depth_m).abs() < SURFACE_M
    };
    let mut n = 0;
    let mut sums = nalgebra::Matrix3::zeros();
    let mut right = Vector3::zeros();
    for other in view.around(pixel, WINDOW).filter(near) {
        let (column, row) = view.intrinsics.coordinates(other);
        let at = Vector3::new(column as f64 - x as f64, row as f64 - y as f64, 1.0);
        sums += at * at.transpose();
        right += at / view.depth_m[other];
        n += 1;
    }
    if n < LEAST_NEIGHBORS {
        return None;
    }
    let plane = sums.cholesky()?.solve(&right);
    let smoothed_m = 1.0 / plane.z;
    if !(smoothed_m - depth_m).abs().is_finite() || (smoothed_m - depth_m).abs() > SURFACE_M {
        return None;
    }
    // Inverse depth a (u - x) + b (v - y) + c: the plane's points p have (normal, p) = 1.
    let [fx, fy] = view.intrinsics.focal;
    let [cx, cy] = view.intrinsics.center;
    let normal_in_camera = Vector3::new(
        plane.x * fx,
        plane.y * fy,
        plane.z + plane.x * (cx - x as f64) + plane.y * (cy - y as f64),
    );
    let point_in_camera = Point3::from(view.intrinsics.direction(x as f64, y as f64) * smoothed_m);
    let toward = -normal_in_camera * normal_in_camera.dot(&point_in_camera.coords).signum();
    Some(SeenPoint {
        pixel,
        point_in_world: view.world_from_camera * point_in_camera,
        normal_in_world: Unit::try_new(view.world_from_camera * toward, 1e-9)?,
    })
}

#[cfg(test)]
mod tests {
    use geometry::{SurfaceDistance, TriMesh};
    use spatial::Pose;

    use super::*;
    use crate::{Intrinsics, RenderedObject, StereoNoise, looking_at, render};

    #[test]
    fn points_lie_on_the_surface_and_normals_stand_on_it() {
        let mesh = TriMesh::cuboid(Point3::new(-0.05, -0.03, 0.0), Point3::new(0.05, 0.03, 0.1));
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::identity(),
        };
        let camera = looking_at(Point3::new(0.3, 0.3, 0.4), Point3::new(0.0, 0.0, 0.05));
        let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.0), &camera);
        let surface = SurfaceDistance::new(&mesh);
        let off = |view: &DepthView| {
            let points = cloud(view);
            assert!(points.len() > 2000, "{}", points.len());
            let distances = points.iter().map(|seen| {
                let nearest = surface.signed_distance(&seen.point_in_world);
                let angle = nearest.normal.angle(&seen.normal_in_world);
                (nearest.distance_m.abs(), angle)
            });
            let (distances, angles): (Vec<f64>, Vec<f64>) = distances.unzip();
            let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len() as f64;
            (mean(&distances), mean(&angles))
        };
        let (distance_m, angle_rad) = off(&rendered.view);
        assert!(
            distance_m < 1e-4 && angle_rad < 0.06,
            "{distance_m} {angle_rad}"
        );
        let noisy = StereoNoise::default().measured(&rendered, 2);
        let (distance_m, angle_rad) = off(&noisy);
        assert!(
            distance_m < 1.5e-3 && angle_rad < 0.4,
            "{distance_m} {angle_rad}"
        );
    }
}
