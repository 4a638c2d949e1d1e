//! A camera that sees a mesh on a table.

use geometry::{RayCaster, TriMesh};
use nalgebra::{Isometry3, Point3, Vector3};
use spatial::{Camera, Object, Pose, World};

use crate::{DepthView, Intrinsics};

/// An object that is seen, on the table z = 0 of the world.
#[derive(Debug, Clone, Copy)]
pub struct RenderedObject<'a> {
    /// Its mesh, in its own frame.
    pub mesh: &'a TriMesh,
    /// Its pose.
    pub world_from_object: Pose<World, Object>,
}

/// A perfect image.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// The depths; the mask is that of the object.
    pub view: DepthView,
    /// Cosine of the angle between each pixel's ray and the surface's normal; 0 where nothing is seen.
    pub incidence: Vec<f64>,
}

/// Returns the pose of a camera at `eye` that looks at `target`, its image upright; straight down, its image's right is
/// the world's x.
pub fn looking_at(eye: Point3<f64>, target: Point3<f64>) -> Pose<World, Camera> {
    let forward = target - eye;
    let up = if forward.cross(&Vector3::z()).norm() > 1e-9 {
        Vector3::z()
    } else {
        Vector3::y()
    };
    // y is down in an image: the face's up is the world's down.
    Pose::new(Isometry3::face_towards(&eye, &target, &-up))
}

/// Returns the image of an object on the table, every surface opaque.
pub fn render(
    object: &RenderedObject<'_>,
    intrinsics: &Intrinsics,
    world_from_camera: &Pose<World, Camera>,
) -> Rendered {
    let object_from_camera = object.world_from_object.inv_mul(world_from_camera);
    let rays = RayCaster::new(object.mesh);
    let eye = Point3::from(object_from_camera.translation.vector);
    let camera_height_m = world_from_camera.translation.z;
    let within = pixels_of(object.mesh, intrinsics, &object_from_camera.inverse());
    let pixels_n = intrinsics.pixels_n();
    let mut rendered = Rendered {
        view: DepthView {
            intrinsics: *intrinsics,
            world_from_camera: *world_from_camera,
            depth_m: vec![0.0; pixels_n],
            mask: vec![false; pixels_n],
        },
        incidence: vec![0.0; pixels_n],
    };
    for pixel in 0..pixels_n {
        let (x, y) = intrinsics.coordinates(pixel);
        let direction = intrinsics.direction(x as f64, y as f64);
        let downward = -(world_from_camera.rotation * direction).z;
        // The direction's z is 1: distances along it are depths.
        let mut seen = (downward > 1e-9 && camera_height_m > 0.0).then(|| {
            (
                camera_height_m / downward,
                downward / direction.norm(),
                false,
            )
        });
        if within.contains(x, y)
            && let Some(hit) = rays.first_hit(&eye, &(object_from_camera.rotation * direction))
            && seen.is_none_or(|(depth_m, ..)| hit.distance < depth_m)
        {
            let along = (object_from_camera.rotation * direction).normalize();
            seen = Some((hit.distance, -along.dot(&hit.normal), true));
        }
        if let Some((depth_m, incidence, is_object)) = seen {
            rendered.view.depth_m[pixel] = depth_m;
            rendered.view.mask[pixel] = is_object;
            rendered.incidence[pixel] = incidence;
        }
    }
    rendered
}

/// A rectangle of pixel coordinates.
struct Rectangle {
    low: [f64; 2],
    high: [f64; 2],
}

impl Rectangle {
    fn contains(&self, x: usize, y: usize) -> bool {
        let within = |axis: usize, at: f64| (self.low[axis]..=self.high[axis]).contains(&at);
        within(0, x as f64) && within(1, y as f64)
    }
}

/// Returns a rectangle that holds all pixels of a mesh: all pixels if a part of it is behind the camera.
fn pixels_of(
    mesh: &TriMesh,
    intrinsics: &Intrinsics,
    camera_from_object: &Pose<Camera, Object>,
) -> Rectangle {
    let mut of = Rectangle {
        low: [f64::INFINITY; 2],
        high: [f64::NEG_INFINITY; 2],
    };
    for &vertex in &mesh.vertices_m {
        let Some(at) = intrinsics.project(&(*camera_from_object * vertex)) else {
            return Rectangle {
                low: [f64::NEG_INFINITY; 2],
                high: [f64::INFINITY; 2],
            };
        };
        for (axis, &at) in at.iter().enumerate() {
            of.low[axis] = of.low[axis].min(at - 1.0);
            of.high[axis] = of.high[axis].max(at + 1.0);
        }
    }
    of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_above_a_box_sees_its_top_and_the_table() {
        let mesh = TriMesh::cuboid(
            Point3::new(-0.0503, -0.0203, 0.0),
            Point3::new(0.0503, 0.0203, 0.1),
        );
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::identity(),
        };
        let camera = looking_at(Point3::new(0.0, 0.0, 0.6), Point3::origin());
        let intrinsics = Intrinsics {
            width: 201,
            height: 201,
            focal: [500.0, 500.0],
            center: [100.0, 100.0],
        };
        let Rendered { view, incidence } = render(&object, &intrinsics, &camera);
        for (own, found_m) in view.mask.iter().zip(&view.depth_m) {
            let depth_m = if *own { 0.5 } else { 0.6 };
            assert!((found_m - depth_m).abs() < 1e-6);
        }
        assert!(incidence.iter().all(|&cosine| cosine > 0.9));
        // The top is 100.6 mm by 40.6 mm, at 0.5 m: 101 pixels by 41.
        let seen = view.mask.iter().filter(|&&of_object| of_object).count();
        assert_eq!(seen, 101 * 41);
    }

    #[test]
    fn the_image_is_upright_and_its_right_is_on_the_right() {
        let camera = looking_at(Point3::new(1.0, 0.0, 1.0), Point3::origin());
        let in_camera = |point: Point3<f64>| camera.inverse_transform_point(&point);
        // Seen from +x, a higher point is higher in the image, where y is down; +y is on the right.
        assert!(in_camera(Point3::new(0.0, 0.0, 0.2)).y < 0.0);
        assert!(in_camera(Point3::new(0.0, 0.2, 0.0)).x > 0.0);
        assert!(in_camera(Point3::origin()).z > 1.4);
    }
}
