//! What views say of an object: points of its surface, and the space in which it is not.

use std::collections::{BTreeMap, BTreeSet};

use depth_view::{DepthView, Intrinsics, SeenPoint, TablePlane, cloud, table_plane};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use spatial::{Object, Pose, World};

use crate::CompletionError;

/// Least number of points of an object.
const LEAST_POINTS: usize = 50;
/// Side of the cells whose points are averaged, in meters.
const CELL_M: f64 = 0.0025;
/// Least number of points in a cell and those about it.
const LEAST_NEIGHBORS: usize = 6;
/// Parts of an object that are farther apart than this are clusters of their own, in meters.
const GAP_M: f64 = 0.01;
/// Least size of a cluster, as a share of the largest one's points.
const LEAST_CLUSTER: f64 = 0.15;
/// Points farther below the table than this are errors, in meters.
const BELOW_M: f64 = 0.005;

/// What one or several views say of an object.
#[derive(Debug, Clone)]
pub struct Observation {
    /// The object's frame of the views: see the crate.
    pub world_from_object: Pose<World, Object>,
    /// Points of the surface, in that frame.
    pub points: Vec<Point3<f64>>,
    /// Unit normals of the surface at the points, toward the camera.
    pub normals: Vec<Vector3<f64>>,
    cameras: Vec<ObservedView>,
}

/// A point of a surface.
struct Surfel {
    point: Point3<f64>,
    normal: Vector3<f64>,
}

/// A view, as what it says of the space about the object.
#[derive(Debug, Clone)]
struct ObservedView {
    intrinsics: Intrinsics,
    camera_from_object: Isometry3<f64>,
    /// Depths of the object, smoothed and without holes, in meters; 0 beside it.
    depth_m: Vec<f64>,
    /// Whether each of them was measured: others are those of the nearest pixel with one.
    is_measured: Vec<bool>,
    /// Distance of each pixel from the object's, in pixels: 0 in the object.
    beside_px: Vec<f64>,
}

impl Observation {
    /// Takes views in one world, and the table if it is known; else the first view in which a plane is found shows it.
    ///
    /// # Errors
    ///
    /// Fails without a view, if no table is seen, or with few points of the object.
    pub fn new(views: &[DepthView], table: Option<TablePlane>) -> Result<Self, CompletionError> {
        let first = views.first().ok_or(CompletionError::NoView)?;
        let table = match table {
            Some(table) => table,
            None => found_table(views)?,
        };
        let clouds: Vec<Vec<SeenPoint>> = views.iter().map(cloud).collect();
        let forward = first.world_from_camera.rotation * Vector3::z();
        let on_table = |seen: &SeenPoint| table.above_m(&seen.point_in_world) > -BELOW_M;
        let seen: Vec<SeenPoint> = clouds.concat().into_iter().filter(on_table).collect();
        let seen = averaged(&seen);
        let kept = largest_clusters(&seen);
        let is_kept = |point: &Point3<f64>| kept.contains(&coarse_cell(point));
        let seen: Vec<Surfel> = seen
            .into_iter()
            .filter(|seen| is_kept(&seen.point))
            .collect();
        if seen.len() < LEAST_POINTS {
            return Err(CompletionError::FewPoints {
                found: seen.len(),
                least: LEAST_POINTS,
            });
        }
        let (low, high) = bounds(seen.iter().map(|seen| seen.point));
        let middle = nalgebra::center(&low, &high);
        let foot = middle - table.up.into_inner() * table.above_m(&middle);
        let rotation = upright(&table.up, &forward);
        let world_from_object: Pose<World, Object> = Pose::from_parts(foot.coords, rotation);
        let object_from_world = world_from_object.inverse();
        let cameras = views.iter().zip(&clouds).map(|(view, cloud)| {
            let own = cloud.iter().filter(|seen| is_kept(&seen.point_in_world));
            let camera_from_object = (object_from_world * view.world_from_camera).inverse();
            ObservedView::new(view, own, *camera_from_object)
        });
        Ok(Self {
            points: seen
                .iter()
                .map(|seen| object_from_world * seen.point)
                .collect(),
            normals: seen
                .iter()
                .map(|seen| object_from_world * seen.normal)
                .collect(),
            cameras: cameras.collect(),
            world_from_object,
        })
    }

    /// Returns how deep a point is in the space that a camera saw to be free, in meters: in front of the object along the
    /// ray, or beside its outline. Negative where every camera's view of it is blocked by the object, by how far it is
    /// behind the surface; minus infinity where no camera looks.
    pub fn free_m(&self, point: &Point3<f64>) -> f64 {
        self.most(|camera| camera.free_m(point))
    }

    /// Returns the same from measured depths alone: minus infinity, too, where a camera looks at the object and has
    /// measured no depth. There it may be nearer than beside: the near wall of a bowl, seen at a flat angle.
    pub fn measured_free_m(&self, point: &Point3<f64>) -> f64 {
        self.most(|camera| camera.measured_free_m(point))
    }

    fn most(&self, of_camera: impl Fn(&ObservedView) -> f64) -> f64 {
        self.cameras
            .iter()
            .map(of_camera)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns where the cameras were, in the object's frame.
    pub fn eyes(&self) -> impl Iterator<Item = Point3<f64>> {
        let eye = |camera: &ObservedView| camera.camera_from_object.inverse() * Point3::origin();
        self.cameras.iter().map(eye)
    }

    /// Returns how far each of these points is from the nearest that a view shows, in meters.
    pub fn unseen_m(&self, points: impl Iterator<Item = Point3<f64>>) -> Vec<f64> {
        let nearest = |point: Point3<f64>| {
            let squares = self.points.iter().map(|seen| (seen - point).norm_squared());
            squares.fold(f64::INFINITY, f64::min).sqrt()
        };
        points.map(nearest).collect()
    }

    /// Moves the origin of the object's frame on the table.
    pub(crate) fn moved(&mut self, offset: &Vector3<f64>) {
        self.world_from_object = self.world_from_object
            * Pose::<Object, Object>::from_parts(*offset, UnitQuaternion::identity());
        for point in &mut self.points {
            *point -= offset;
        }
        for camera in &mut self.cameras {
            camera.camera_from_object *= Isometry3::translation(offset.x, offset.y, offset.z);
        }
    }
}

impl ObservedView {
    fn new<'a>(
        view: &DepthView,
        cloud: impl Iterator<Item = &'a SeenPoint>,
        camera_from_object: Isometry3<f64>,
    ) -> Self {
        let mut depth_m = vec![0.0; view.depth_m.len()];
        for seen in cloud {
            let in_camera = view
                .world_from_camera
                .inverse_transform_point(&seen.point_in_world);
            depth_m[seen.pixel] = in_camera.z;
        }
        let is_measured = depth_m.iter().map(|&depth_m| depth_m > 0.0).collect();
        fill(&mut depth_m, &view.mask, &view.intrinsics);
        // What of the mask shows other things is beside the object.
        let mask: Vec<bool> = depth_m.iter().map(|&depth_m| depth_m > 0.0).collect();
        Self {
            intrinsics: view.intrinsics,
            camera_from_object,
            beside_px: beside(&mask, &view.intrinsics),
            depth_m,
            is_measured,
        }
    }

    fn free_m(&self, point: &Point3<f64>) -> f64 {
        self.free_where(point, |pixel| self.depth_m[pixel] > 0.0)
    }

    fn measured_free_m(&self, point: &Point3<f64>) -> f64 {
        self.free_where(point, |pixel| self.is_measured[pixel])
    }

    fn free_where(&self, point: &Point3<f64>, is_known: impl Fn(usize) -> bool) -> f64 {
        let in_camera = self.camera_from_object * point;
        let at = self.intrinsics.project(&in_camera);
        let Some(pixel) = at.and_then(|at| self.intrinsics.pixel(at)) else {
            return f64::NEG_INFINITY;
        };
        let beside_px = self.beside_px[pixel];
        if beside_px > 0.0 {
            beside_px * in_camera.z / self.intrinsics.focal[0]
        } else if is_known(pixel) {
            self.depth_m[pixel] - in_camera.z
        } else {
            f64::NEG_INFINITY
        }
    }
}

/// Returns the table of the first view that shows one.
fn found_table(views: &[DepthView]) -> Result<TablePlane, CompletionError> {
    let mut first_error = None;
    for view in views {
        match table_plane(view) {
            Ok(table) => return Ok(table),
            Err(err) => {
                first_error.get_or_insert(err);
            }
        }
    }
    Err(first_error.map_or(CompletionError::NoView, Into::into))
}

/// Returns the rotation of a frame with z along `up` and x along what of `forward` is horizontal.
fn upright(up: &Vector3<f64>, forward: &Vector3<f64>) -> UnitQuaternion<f64> {
    let horizontal =
        |direction: &Vector3<f64>| (direction - up * up.dot(direction)).try_normalize(1e-3);
    // Straight down, any direction serves, if only it is the same for equal views.
    let x = horizontal(forward)
        .or_else(|| horizontal(&Vector3::x()))
        .or_else(|| horizontal(&Vector3::y()))
        .unwrap_or_else(Vector3::x);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, up.cross(&x), *up]));
    UnitQuaternion::from_rotation_matrix(&rotation)
}

/// Returns the least and the greatest coordinates of points.
pub(crate) fn bounds(points: impl Iterator<Item = Point3<f64>>) -> (Point3<f64>, Point3<f64>) {
    points.fold(
        (
            Point3::from([f64::INFINITY; 3]),
            Point3::from([f64::NEG_INFINITY; 3]),
        ),
        |(low, high), point| (low.inf(&point), high.sup(&point)),
    )
}

/// Returns the mean point and normal of each cell of space that has several points: single ones are errors of the camera.
fn averaged(seen: &[SeenPoint]) -> Vec<Surfel> {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "cells of millimeters in a room"
    )]
    let cell = |point: &Point3<f64>| [0, 1, 2].map(|axis| (point[axis] / CELL_M).floor() as i32);
    let mut cells: BTreeMap<[i32; 3], (usize, Vector3<f64>, Vector3<f64>)> = BTreeMap::new();
    for seen in seen {
        let (n, points, normals) = cells.entry(cell(&seen.point_in_world)).or_default();
        *n += 1;
        *points += seen.point_in_world.coords;
        *normals += seen.normal_in_world.into_inner();
    }
    let around = |at: [i32; 3]| {
        let near = neighbors(at).filter_map(|other| cells.get(&other));
        near.map(|(n, ..)| n).sum::<usize>()
    };
    cells
        .iter()
        .filter(|(at, _)| around(**at) >= LEAST_NEIGHBORS)
        .filter_map(|(_, (n, points, normals))| {
            Some(Surfel {
                point: Point3::from(points / *n as f64),
                normal: normals.try_normalize(1e-9)?,
            })
        })
        .collect()
}

/// Returns the cells of the largest cluster of points, and of those that are not much smaller: a mask's stray pixels show
/// other things, and a part of an object may be hidden from a camera.
fn largest_clusters(points: &[Surfel]) -> BTreeSet<[i32; 3]> {
    let mut open: BTreeMap<[i32; 3], usize> = BTreeMap::new();
    for surfel in points {
        *open.entry(coarse_cell(&surfel.point)).or_default() += 1;
    }
    let mut clusters: Vec<(usize, BTreeSet<[i32; 3]>)> = Vec::new();
    while let Some((first, n)) = open.pop_first() {
        let (mut cells, mut points_n) = (BTreeSet::from([first]), n);
        let mut frontier = vec![first];
        while let Some(at) = frontier.pop() {
            for other in neighbors(at) {
                if let Some(n) = open.remove(&other) {
                    points_n += n;
                    cells.insert(other);
                    frontier.push(other);
                }
            }
        }
        clusters.push((points_n, cells));
    }
    let largest_n = clusters.iter().map(|(n, _)| *n).max().unwrap_or_default();
    let large = |n: usize| n as f64 >= LEAST_CLUSTER * largest_n as f64;
    let kept = clusters.into_iter().filter(|(n, _)| large(*n));
    kept.flat_map(|(_, cells)| cells).collect()
}

/// Returns the cell of a point by which clusters are told apart.
#[expect(
    clippy::cast_possible_truncation,
    reason = "cells of a centimeter in a room"
)]
fn coarse_cell(point: &Point3<f64>) -> [i32; 3] {
    [0, 1, 2].map(|axis| (point[axis] / GAP_M).floor() as i32)
}

/// Returns a cell and those about it.
fn neighbors([x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    let along = |at: i32| at - 1..=at + 1;
    along(x).flat_map(move |x| along(y).flat_map(move |y| along(z).map(move |z| [x, y, z])))
}

/// Gives each pixel of the mask without a depth that of the nearest with one, along rows and columns.
fn fill(depth_m: &mut [f64], mask: &[bool], intrinsics: &Intrinsics) {
    let mut frontier: Vec<usize> = (0..mask.len())
        .filter(|&pixel| depth_m[pixel] > 0.0)
        .collect();
    while !frontier.is_empty() {
        let mut next = Vec::new();
        for &pixel in &frontier {
            for other in beside_pixel(pixel, intrinsics) {
                if mask[other] && depth_m[other] <= 0.0 {
                    depth_m[other] = depth_m[pixel];
                    next.push(other);
                }
            }
        }
        frontier = next;
    }
}

/// Returns the pixels on the right, on the left, above and below one.
fn beside_pixel(pixel: usize, intrinsics: &Intrinsics) -> impl Iterator<Item = usize> {
    let (x, y) = intrinsics.coordinates(pixel);
    let (width, height) = (intrinsics.width, intrinsics.height);
    [
        (x > 0).then(|| pixel - 1),
        (x + 1 < width).then_some(pixel + 1),
        (y > 0).then(|| pixel - width),
        (y + 1 < height).then_some(pixel + width),
    ]
    .into_iter()
    .flatten()
}

/// Returns the distance of each pixel from the mask, in pixels: two passes of a chamfer with steps of 1 and √2 (Borgefors,
/// "Distance transformations in digital images", 1986), which are at most 8 % too long.
fn beside(mask: &[bool], intrinsics: &Intrinsics) -> Vec<f64> {
    let (width, height) = (intrinsics.width, intrinsics.height);
    let mut far: Vec<f64> = mask
        .iter()
        .map(|&inside| if inside { 0.0 } else { f64::MAX })
        .collect();
    let mut relax = |x: usize, y: usize, sign: bool| {
        // What was passed before: the row above and the pixel on the left, or the other way round.
        let row = if sign {
            y.checked_sub(1)
        } else {
            (y + 1 < height).then_some(y + 1)
        };
        let column = if sign {
            x.checked_sub(1)
        } else {
            (x + 1 < width).then_some(x + 1)
        };
        let mut least = far[y * width + x];
        if let Some(column) = column {
            least = least.min(far[y * width + column] + 1.0);
        }
        if let Some(row) = row {
            least = least.min(far[row * width + x] + 1.0);
            for diagonal in [x.checked_sub(1), (x + 1 < width).then_some(x + 1)]
                .into_iter()
                .flatten()
            {
                least = least.min(far[row * width + diagonal] + std::f64::consts::SQRT_2);
            }
        }
        far[y * width + x] = least;
    };
    for y in 0..height {
        for x in 0..width {
            relax(x, y, true);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            relax(x, y, false);
        }
    }
    far
}
