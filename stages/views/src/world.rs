//! The images of an object together: whether they show one world.

use depth_view::{DepthView, TablePlane};
use nalgebra::Point3;

use crate::{
    error::Fault,
    object::{self, FoundTable},
};

/// Tables of one world differ by at most this angle, in radians (6 degrees), and by this height at the object, in meters.
const TILT_RAD: f64 = 0.105;
const HEIGHT_M: f64 = 0.025;
/// Most pixels of an object's images together: they are in memory.
const MAX_PIXELS: usize = 1 << 25;
/// What images show of one object is at most this far apart, along each axis of the world, in meters.
const APART_M: f64 = 0.1;

/// A checked image of an object.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Image {
    /// Its name.
    pub(crate) name: String,
    /// Camera, depths in meters and the object's pixels.
    pub(crate) view: DepthView,
    /// Depth of the number 1 as it is stored, in meters.
    pub(crate) depth_step_m: f64,
    /// The table, known or as it is seen here.
    pub(crate) table: FoundTable,
}

/// Keeps the images in which the object stands on the table of the first image that shows one; the reasons for the others
/// are added to `left_out`. `poses` says what the cameras' poses are, for messages.
///
/// # Errors
///
/// Fails if none shows a table, or the images do not show the same object on the same table.
pub(crate) fn of_one_world(
    images: Vec<Image>,
    poses: &'static str,
    left_out: &mut Vec<String>,
) -> Result<Vec<Image>, Fault> {
    let shows_table = |image: &&Image| image.table.is_ok();
    let Some(first) = images.iter().find(shows_table).or(images.first()) else {
        return Ok(images);
    };
    let (first_name, first_table) = (first.name.clone(), first.table.clone()?);
    let mut first_bounds: Option<(String, [Point3<f64>; 2])> = None;
    let mut kept = Vec::new();
    for image in images {
        let Some(bounds) = bounds(&image.view) else {
            continue;
        };
        let differs = |what, first: &str, off| {
            let problem = format!(
                "the {what} in image {} is {off} from that in {first}",
                image.name
            );
            Fault::new(problem, poses)
        };
        if let Ok(table) = &image.table
            && let Some(off) = table_off(&first_table, table, &bounds)
        {
            return Err(differs("table", &first_name, off));
        }
        if let Err(fault) = object::check_stands(&image.view, &first_table) {
            left_out.push(format!("image {}: {}", image.name, fault.reason()));
            continue;
        }
        if let Some((name, first)) = &first_bounds {
            if let Some(off) = object_off(first, &bounds) {
                return Err(differs("object", name, off));
            }
        } else {
            first_bounds = Some((image.name.clone(), bounds));
        }
        kept.push(image);
    }
    Ok(kept)
}

/// Checks that images are not too many for the memory.
pub(crate) fn check_pixels(images: &[Image]) -> Result<(), Fault> {
    let pixels = images.iter().map(|image| image.view.mask.len());
    if pixels.sum::<usize>() > MAX_PIXELS {
        let problem = format!("its images have more than {MAX_PIXELS} pixels together");
        return Err(Fault::new(problem, "choose fewer `images`"));
    }
    Ok(())
}

/// Returns how far two images' tables are from each other at an object, if they are not the same.
fn table_off(
    first: &TablePlane,
    table: &TablePlane,
    [low, high]: &[Point3<f64>; 2],
) -> Option<String> {
    let tilt = first.up.angle(&table.up);
    let at = nalgebra::center(low, high);
    let height_m = (first.above_m(&at) - table.above_m(&at)).abs();
    (tilt > TILT_RAD || height_m > HEIGHT_M)
        .then(|| format!("{:.0}° and {:.0} mm", tilt.to_degrees(), 1e3 * height_m))
}

/// Returns how far two images' objects are from each other, if they are not the same.
fn object_off(
    [first_low, first_high]: &[Point3<f64>; 2],
    [low, high]: &[Point3<f64>; 2],
) -> Option<String> {
    let apart_m = (low - first_high).sup(&(first_low - high)).max();
    (apart_m > APART_M).then(|| format!("{apart_m:.2} m"))
}

/// Returns the least and greatest coordinates of the object in the world, without the outermost twentieth.
fn bounds(view: &DepthView) -> Option<[Point3<f64>; 2]> {
    let points = object::points(view);
    let mut bounds = [Point3::origin(); 2];
    for axis in 0..3 {
        let mut along: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        bounds[0][axis] = object::quantile(&mut along, 0.05)?;
        bounds[1][axis] = object::quantile(&mut along, 0.95)?;
    }
    Some(bounds)
}
