//! Pictures of an object that a camera saw: its depth image, and its estimated shape from two sides.

use depth_view::{DepthView, Intrinsics, RenderedObject, looking_at, render};
use geometry::TriMesh;
use nalgebra::{Point3, Vector3};
use object_shapes::mesh_of;
use schemas::{completions::CompletedObject, objects::Object as StoredObject, views::View};
use spatial::{Camera, Object, Pose, World};

use crate::{ReportError, png::PaletteImage};

/// Pixels of a picture's rows, and number of rows.
pub(crate) const SIZE: [u32; 2] = [200, 150];
/// A point of the surface that is farther from every point that a camera saw was not seen, in meters: twice the cells over
/// which these are averaged.
pub(crate) const SEEN_M: f64 = 0.005;
/// Width of the margin about what a picture shows, as a share of its side.
const MARGIN: f64 = 0.15;
/// Brightness of a surface along which the camera looks; one that faces it has 1.
const GRAZING: f64 = 0.3;
/// Greatest elevation from which the opposite side is shown: from above it is hidden.
const MAX_ELEVATION_RAD: f64 = std::f64::consts::FRAC_PI_4;

/// Number of shades of a color.
const SHADES: u8 = 16;
/// Places in a palette: the page shows through, the image has no depth, the outline of the object's pixels, and the shades
/// of two colors.
const CLEAR: u8 = 0;
const NO_DEPTH: u8 = 1;
const OUTLINE: u8 = 2;
const FIRST: u8 = 3;
const SECOND: u8 = FIRST + SHADES;

/// The darkest and the lightest shade of a color, red, green and blue.
type Shades = [[u8; 3]; 2];
/// The object in an image, and what was seen of its surface. Orange and blue are told apart by color-blind readers.
const ORANGE: Shades = [[96, 52, 0], [255, 190, 80]];
/// The surface that was not seen.
const BLUE: Shades = [[36, 46, 66], [150, 172, 208]];
/// What is beside the object in an image.
const GRAY: Shades = [[84, 86, 90], [238, 239, 242]];

/// Pictures of one object, each a PNG file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pictures {
    /// The depth image about the object: near is light, the object is orange, and a pixel without depth is black.
    pub depth: Vec<u8>,
    /// The estimated shape as the camera would see it, and from the opposite side: what was seen is orange, the rest blue.
    pub shape: Option<[Vec<u8>; 2]>,
}

impl Pictures {
    /// Draws an object, its shape if the estimated object is given; `None` if the view has no pixel of it.
    ///
    /// # Errors
    ///
    /// Fails if the view is no image, or a picture cannot be compressed.
    pub(crate) fn draw(
        view: &View,
        completion: &CompletedObject,
        estimated: Option<&StoredObject>,
    ) -> Result<Option<Self>, ReportError> {
        let image = stored_views::image(view).map_err(|source| ReportError::View {
            name: view.view.clone(),
            source,
        })?;
        let Some(window) = Window::about_object(&image) else {
            return Ok(None);
        };
        let shape = |object: &StoredObject| -> Result<_, ReportError> {
            let shape = Shape::of(object, completion);
            let object_from_camera = completion
                .world_from_object
                .inv_mul(&view.world_from_camera);
            let camera = shape.world_from_object * object_from_camera;
            let [near, far] = shape.both_sides(&image.intrinsics, &window, &camera);
            Ok([near.to_png()?, far.to_png()?])
        };
        Ok(Some(Self {
            depth: depth_picture(&image, &window).to_png()?,
            shape: estimated.map(shape).transpose()?,
        }))
    }
}

/// Returns the smallest and the largest depth of the object, in meters.
fn object_depths_m(image: &DepthView) -> [f64; 2] {
    let own = image.depth_m.iter().zip(&image.mask);
    let own = own.filter(|&(&depth_m, &is_own)| is_own && depth_m > 0.0);
    own.fold([f64::INFINITY, 0.0], |[low, high], (&depth_m, _)| {
        [low.min(depth_m), high.max(depth_m)]
    })
}

/// The part of an image that a picture shows.
struct Window {
    /// Its corner, in pixels of the image.
    low: [f64; 2],
    /// Pixels of the image for each of the picture.
    step: f64,
}

impl Window {
    /// Returns the part about the object; `None` if no pixel shows it.
    fn about_object(image: &DepthView) -> Option<Self> {
        let own = (0..image.mask.len()).filter(|&pixel| image.mask[pixel]);
        Self::about(own.map(|pixel| {
            let (x, y) = image.intrinsics.coordinates(pixel);
            [x as f64, y as f64]
        }))
    }

    /// Returns a part about points of an image; `None` without any.
    fn about(points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let mut bounds: Option<[[f64; 2]; 2]> = None;
        for point in points {
            let [low, high] = bounds.get_or_insert([point; 2]);
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let [low, high] = bounds?;
        let size = SIZE.map(f64::from);
        let steps = [0, 1].map(|axis| (high[axis] - low[axis] + 1.0) / size[axis]);
        let step = steps[0].max(steps[1]) / (1.0 - 2.0 * MARGIN);
        let corner = |axis: usize| 0.5 * (low[axis] + high[axis] - step * size[axis]);
        Some(Self {
            low: [corner(0), corner(1)],
            step,
        })
    }

    /// Returns the coordinates in the image of a pixel of the picture.
    fn in_image(&self, x: usize, y: usize) -> [f64; 2] {
        let at = |axis: usize, n: usize| self.low[axis] + self.step * (n as f64 + 0.5);
        [at(0, x), at(1, y)]
    }

    /// Returns the intrinsics of the picture, for those of the image.
    fn intrinsics(&self, image: &Intrinsics) -> Intrinsics {
        let center = |axis: usize| (image.center[axis] - self.low[axis]) / self.step - 0.5;
        Intrinsics {
            width: SIZE[0] as usize,
            height: SIZE[1] as usize,
            focal: image.focal.map(|focal| focal / self.step),
            center: [center(0), center(1)],
        }
    }
}

/// Draws the part of an image.
fn depth_picture(image: &DepthView, window: &Window) -> PaletteImage {
    let [near_m, far_m] = object_depths_m(image);
    // What lies behind the object, half as far as it is deep, has shades too.
    let span_m = 1.5 * (far_m - near_m).max(0.01);
    let picture = window.intrinsics(&image.intrinsics);
    let source: Vec<Option<usize>> = (0..picture.pixels_n())
        .map(|pixel| {
            let (x, y) = picture.coordinates(pixel);
            image.intrinsics.pixel(window.in_image(x, y))
        })
        .collect();
    let is_own = |pixel: usize| source[pixel].is_some_and(|at| image.mask[at]);
    let is_border = |pixel: usize| {
        let (x, y) = picture.coordinates(pixel);
        let beside = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < picture.width).then(|| pixel + 1),
            (y > 0).then(|| pixel - picture.width),
            (y + 1 < picture.height).then(|| pixel + picture.width),
        ];
        is_own(pixel) && beside.into_iter().flatten().any(|other| !is_own(other))
    };
    let color = |pixel: usize| match source[pixel] {
        None => CLEAR,
        Some(_) if is_border(pixel) => OUTLINE,
        Some(at) if image.depth_m[at] <= 0.0 => NO_DEPTH,
        Some(at) => {
            let lightness = 1.0 - (image.depth_m[at] - near_m) / span_m;
            (if image.mask[at] { FIRST } else { SECOND }) + shade(lightness)
        }
    };
    PaletteImage {
        size: SIZE,
        colors: palette(ORANGE, GRAY),
        pixels: (0..source.len()).map(color).collect(),
    }
}

/// An estimated shape, in a world whose z is up and whose table is at 0.
struct Shape {
    mesh: TriMesh,
    world_from_object: Pose<World, Object>,
    /// In the object's frame.
    seen: Seen,
}

impl Shape {
    /// Returns the shape of an object as it rests.
    fn of(object: &StoredObject, completion: &CompletedObject) -> Self {
        let rest = object.rests.first();
        let world_from_object =
            rest.map(|rest| rest.rest.table_from_object().reinterpret::<World, Object>());
        Self {
            mesh: mesh_of(object),
            world_from_object: world_from_object.unwrap_or_else(Pose::identity),
            seen: Seen::of(completion),
        }
    }

    /// Draws the shape as the camera of an image would see it, and from the opposite side.
    fn both_sides(
        &self,
        image: &Intrinsics,
        window: &Window,
        camera: &Pose<World, Camera>,
    ) -> [PaletteImage; 2] {
        let near = self.seen_from(&window.intrinsics(image), camera);
        let opposite = self.opposite(camera);
        let corners = self.mesh.vertices_m.iter();
        let corners = corners.filter_map(|corner| {
            let in_camera = opposite.inverse_transform_point(&(self.world_from_object * *corner));
            image.project(&in_camera)
        });
        // A mesh without a corner has no other side.
        let other = Window::about(corners);
        let other = other.as_ref().unwrap_or(window);
        [near, self.seen_from(&other.intrinsics(image), &opposite)]
    }

    /// Returns the pose of a camera on the other side of the shape, as far away and not from above.
    fn opposite(&self, camera: &Pose<World, Camera>) -> Pose<World, Camera> {
        let (low, high) = self.mesh.bounds();
        let middle = self.world_from_object * nalgebra::center(&low, &high);
        let from_middle = camera.translation.vector - middle.coords;
        let level = Vector3::new(-from_middle.x, -from_middle.y, 0.0);
        let level = level.try_normalize(1e-6).unwrap_or_else(Vector3::x);
        let elevation_rad = (from_middle.z / from_middle.norm().max(1e-6)).asin();
        let (up, along) = elevation_rad.clamp(0.0, MAX_ELEVATION_RAD).sin_cos();
        let direction = along * level + up * Vector3::z();
        looking_at(middle + from_middle.norm() * direction, middle)
    }

    /// Draws the shape as a camera sees it.
    fn seen_from(&self, intrinsics: &Intrinsics, camera: &Pose<World, Camera>) -> PaletteImage {
        let object = RenderedObject {
            mesh: &self.mesh,
            world_from_object: self.world_from_object,
        };
        let object_from_camera = self.world_from_object.inv_mul(camera);
        let rendered = render(&object, intrinsics, camera);
        let color = |pixel: usize| {
            let point = rendered.view.point_in_camera(pixel);
            let Some(point) = point.filter(|_| rendered.view.mask[pixel]) else {
                return CLEAR;
            };
            let lightness = GRAZING + (1.0 - GRAZING) * rendered.incidence[pixel];
            let is_seen = self.seen.is_near(&(object_from_camera * point));
            (if is_seen { FIRST } else { SECOND }) + shade(lightness)
        };
        PaletteImage {
            size: SIZE,
            colors: palette(ORANGE, BLUE),
            pixels: (0..intrinsics.pixels_n()).map(color).collect(),
        }
    }
}

/// The points that cameras saw, in the order of their x.
struct Seen(Vec<Point3<f64>>);

impl Seen {
    fn of(completion: &CompletedObject) -> Self {
        let points = completion.seen_m.iter();
        Self::new(points.map(|&point| point.into()).collect())
    }

    fn new(mut points: Vec<Point3<f64>>) -> Self {
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        Self(points)
    }

    /// Says whether one of them is within [`SEEN_M`] of a point.
    fn is_near(&self, point: &Point3<f64>) -> bool {
        let first = self.0.partition_point(|seen| seen.x < point.x - SEEN_M);
        let near = self.0[first..].iter();
        near.take_while(|seen| seen.x <= point.x + SEEN_M)
            .any(|seen| (*seen - point).norm_squared() <= SEEN_M * SEEN_M)
    }
}

/// Returns the place of a shade among those of its color, by a lightness from 0 to 1.
fn shade(lightness: f64) -> u8 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the number of shades"
    )]
    let place = (lightness.clamp(0.0, 1.0) * f64::from(SHADES - 1)).round() as u8;
    place
}

/// Returns the colors of a picture, in the order of their places.
fn palette(first: Shades, second: Shades) -> Vec<[u8; 4]> {
    let mut colors = vec![[0; 4], [0, 0, 0, 255], [230, 110, 0, 255]];
    for [dark, light] in [first, second] {
        colors.extend((0..SHADES).map(|place| {
            let channel = |k: usize| {
                let share = f64::from(place) / f64::from(SHADES - 1);
                let value = f64::from(dark[k]) * (1.0 - share) + f64::from(light[k]) * share;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "between two bytes"
                )]
                let value = value.round() as u8;
                value
            };
            [channel(0), channel(1), channel(2), 255]
        }));
    }
    colors
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::png::tests::parsed;

    /// The number of pixels of a picture by their color: none, orange, blue or gray.
    fn areas(picture: &PaletteImage) -> [usize; 3] {
        let count = |places: std::ops::Range<u8>| {
            let pixels = picture.pixels.iter();
            pixels.filter(|place| places.contains(place)).count()
        };
        [0..FIRST, FIRST..SECOND, SECOND..SECOND + SHADES].map(count)
    }

    /// A box of 4 by 8 by 6 cm on the table, seen from +x and above: its front and its top.
    fn shape() -> (Shape, DepthView) {
        let mesh = TriMesh::cuboid(
            Point3::new(-0.02, -0.04, 0.0),
            Point3::new(0.02, 0.04, 0.06),
        );
        let (points, normals) = mesh.sample_surface(20_000, 1);
        let points = points.iter().zip(normals);
        let seen = points.filter(|(_, normal)| normal.x > 0.5 || normal.z > 0.5);
        let seen: Vec<Point3<f64>> = seen.map(|(point, _)| *point).collect();
        let camera = looking_at(Point3::new(0.5, 0.0, 0.3), Point3::new(0.0, 0.0, 0.03));
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::identity(),
        };
        let intrinsics = Intrinsics::of_field(160, 120, 0.9);
        let image = render(&object, &intrinsics, &camera).view;
        let shape = Shape {
            mesh,
            world_from_object: Pose::identity(),
            seen: Seen::new(seen),
        };
        (shape, image)
    }

    #[test]
    fn an_object_fills_its_picture_and_lies_in_its_middle() {
        let (_, image) = shape();
        let window = Window::about_object(&image).unwrap();
        let picture = depth_picture(&image, &window);
        let own = |pixel: &usize| (OUTLINE..SECOND).contains(&picture.pixels[*pixel]);
        let [width, height] = SIZE.map(|side| side as usize);
        let own: Vec<[usize; 2]> = (0..width * height)
            .filter(own)
            .map(|pixel| [pixel % width, pixel / width])
            .collect();
        let span = |axis: usize| {
            let at = own.iter().map(|at| at[axis]);
            (at.clone().min().unwrap(), at.max().unwrap())
        };
        // The longer side is where the margins are, and both are about the middle.
        let (left, right) = span(0);
        let (top, bottom) = span(1);
        assert!(left.abs_diff(width - 1 - right) < 4, "{left} {right}");
        assert!(top.abs_diff(height - 1 - bottom) < 4, "{top} {bottom}");
        let filled =
            ((right - left) as f64 / width as f64).max((bottom - top) as f64 / height as f64);
        assert!((filled - 0.7).abs() < 0.03, "{filled}");
        assert_eq!(parsed(&picture.to_png().unwrap()), picture);
    }

    #[test]
    fn a_pixel_without_depth_is_black_and_a_nearer_one_lighter() {
        let (_, mut image) = shape();
        let window = Window::about_object(&image).unwrap();
        let middle = (SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize;
        let place = |image: &DepthView| depth_picture(image, &window).pixels[middle];
        let whole = place(&image);
        let at = image.intrinsics.pixel(window.in_image(100, 75)).unwrap();
        image.depth_m[at] -= 0.01;
        assert!(place(&image) > whole);
        image.depth_m[at] = 0.0;
        assert_eq!(place(&image), NO_DEPTH);
        image.mask.fill(false);
        assert!(Window::about_object(&image).is_none());
    }

    #[test]
    fn what_was_seen_is_orange_and_the_far_side_is_blue() {
        let (shape, image) = shape();
        let camera = image.world_from_camera;
        let window = Window::about_object(&image).unwrap();
        let [near, far] = shape.both_sides(&image.intrinsics, &window, &camera);
        let [_, seen_n, unseen_n] = areas(&near);
        assert!(
            seen_n > 5000 && unseen_n < seen_n / 50,
            "{seen_n} {unseen_n}"
        );
        // The top is seen from both sides, the back from one.
        let [clear_n, seen_n, unseen_n] = areas(&far);
        assert!(seen_n > 1000 && unseen_n > 1000, "{seen_n} {unseen_n}");
        assert!(clear_n > 5000);
        let opposite = shape.opposite(&camera).translation.vector;
        assert!(
            (opposite - Vector3::new(-0.5, 0.0, 0.3)).norm() < 1e-9,
            "{opposite}"
        );
    }

    #[test]
    fn an_object_is_drawn_as_it_rests_whatever_its_frame() {
        let (shape, image) = shape();
        // In its own frame it lies on its side, below the origin.
        let object_from_world: Pose<Object, World> = Pose::from_parts(
            [0.1, 0.0, -0.2],
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.4),
        );
        let moved = |points: &[Point3<f64>]| {
            let points = points.iter();
            points.map(|&point| object_from_world * point).collect()
        };
        let turned = Shape {
            mesh: TriMesh {
                vertices_m: moved(&shape.mesh.vertices_m),
                triangles: shape.mesh.triangles.clone(),
            },
            world_from_object: object_from_world.inverse(),
            seen: Seen::new(moved(&shape.seen.0)),
        };
        let window = Window::about_object(&image).unwrap();
        let drawn = |shape: &Shape| {
            let sides = shape.both_sides(&image.intrinsics, &window, &image.world_from_camera);
            sides.map(|picture| areas(&picture))
        };
        for (own, turned) in drawn(&shape).iter().zip(drawn(&turned)) {
            for (area, turned) in own.iter().zip(turned) {
                assert!(area.abs_diff(turned) < 100, "{area} {turned}");
            }
        }
    }

    #[test]
    fn a_camera_from_above_has_an_opposite_side_that_is_no_more_than_45_degrees_high() {
        let (shape, _) = shape();
        for at in [Point3::new(0.0, 0.0, 0.5), Point3::new(0.01, 0.0, 0.5)] {
            let camera = looking_at(at, Point3::origin());
            let from_middle = shape.opposite(&camera).translation.vector - Vector3::z() * 0.03;
            let elevation = from_middle.z / from_middle.norm();
            assert!((elevation - MAX_ELEVATION_RAD.sin()).abs() < 1e-9);
        }
        // A camera of unknown pose may be below; the opposite side is level then.
        let below = Pose::from_parts([0.4, 0.0, -0.2], UnitQuaternion::identity());
        assert!((shape.opposite(&below).translation.z - 0.03).abs() < 1e-9);
    }
}
