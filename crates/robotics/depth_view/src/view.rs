//! An image of depths and its camera.

use nalgebra::{Point3, Vector3};
use spatial::{Camera, Pose, World};

/// Size and intrinsics of a rectified image, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Pixels of a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Focal length along x and y.
    pub focal: [f64; 2],
    /// The principal point: the pixel that looks along z.
    pub center: [f64; 2],
}

impl Intrinsics {
    /// Returns those of an image with this horizontal field of view, in radians, with square pixels.
    pub fn of_field(width: usize, height: usize, field_rad: f64) -> Self {
        let focal = 0.5 * width as f64 / (0.5 * field_rad).tan();
        Self {
            width,
            height,
            focal: [focal; 2],
            center: [width, height].map(|side| 0.5 * (side as f64 - 1.0)),
        }
    }

    /// Number of pixels.
    pub fn pixels_n(&self) -> usize {
        self.width * self.height
    }

    /// Returns the direction of a pixel, with a z of 1.
    pub fn direction(&self, x: f64, y: f64) -> Vector3<f64> {
        Vector3::new(
            (x - self.center[0]) / self.focal[0],
            (y - self.center[1]) / self.focal[1],
            1.0,
        )
    }

    /// Returns the pixel coordinates of a point in the camera's frame; `None` behind the camera.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<[f64; 2]> {
        (point_in_camera.z > 1e-6).then(|| {
            [
                self.focal[0] * point_in_camera.x / point_in_camera.z + self.center[0],
                self.focal[1] * point_in_camera.y / point_in_camera.z + self.center[1],
            ]
        })
    }

    /// Returns the index of the pixel with these coordinates; `None` outside of the image.
    pub fn pixel(&self, [x, y]: [f64; 2]) -> Option<usize> {
        let within = |at: f64, n: usize| {
            let at = at.round();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "checked against the image's side"
            )]
            (at >= 0.0 && at < n as f64).then_some(at as usize)
        };
        Some(within(y, self.height)? * self.width + within(x, self.width)?)
    }

    /// Says whether a pixel of a mask is at the image's border, so that a part of what the mask shows may be out of view.
    pub fn is_cut_off(&self, mask: &[bool]) -> bool {
        (0..mask.len()).any(|pixel| {
            let (x, y) = self.coordinates(pixel);
            mask[pixel] && (x == 0 || y == 0 || x + 1 == self.width || y + 1 == self.height)
        })
    }

    /// Returns the coordinates of a pixel by its index.
    pub fn coordinates(&self, pixel: usize) -> (usize, usize) {
        (pixel % self.width, pixel / self.width)
    }
}

/// What one camera saw: depths, and which pixels are the object's.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthView {
    /// The image's size and intrinsics.
    pub intrinsics: Intrinsics,
    /// Pose of the camera, as it is known.
    pub world_from_camera: Pose<World, Camera>,
    /// Depths along the camera's z row by row, in meters; 0 where none was measured.
    pub depth_m: Vec<f64>,
    /// The pixels of the object.
    pub mask: Vec<bool>,
}

impl DepthView {
    /// Returns the point that a pixel shows, in the camera's frame; `None` without a depth.
    pub fn point_in_camera(&self, pixel: usize) -> Option<Point3<f64>> {
        let depth_m = self.depth_m[pixel];
        let (x, y) = self.intrinsics.coordinates(pixel);
        (depth_m > 0.0).then(|| (self.intrinsics.direction(x as f64, y as f64) * depth_m).into())
    }

    /// Returns the pixels within `radius` columns and rows of a pixel, itself included, row by row.
    pub(crate) fn around(&self, pixel: usize, radius: usize) -> impl Iterator<Item = usize> {
        let Intrinsics { width, height, .. } = self.intrinsics;
        let (x, y) = self.intrinsics.coordinates(pixel);
        let span = move |at: usize, n: usize| at.saturating_sub(radius)..(at + radius + 1).min(n);
        span(y, height).flat_map(move |row| span(x, width).map(move |column| row * width + column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_found_again_by_its_point() {
        let view = DepthView {
            intrinsics: Intrinsics::of_field(40, 30, 1.2),
            world_from_camera: Pose::identity(),
            depth_m: (0..1200).map(|k| 0.4 + 1e-4 * f64::from(k)).collect(),
            mask: vec![true; 1200],
        };
        for pixel in 0..1200 {
            let point = view.point_in_camera(pixel).unwrap();
            let found = view.intrinsics.project(&point).unwrap();
            assert_eq!(view.intrinsics.pixel(found), Some(pixel));
        }
        assert_eq!(view.intrinsics.project(&Point3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(view.intrinsics.pixel([-0.6, 3.0]), None);
        assert_eq!(view.around(0, 1).collect::<Vec<_>>(), [0, 1, 40, 41]);
    }
}
