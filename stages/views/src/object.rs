//! The object in an image: its pixels, and whether they fit the depths and the table.

use depth_view::{DepthView, TablePlane, ViewError, largest_object, table_plane};
use nalgebra::Point3;

use crate::error::Fault;

/// Range in which half of the depths that a camera over a table measures are, in meters.
const DEPTHS_M: [f64; 2] = [0.05, 10.0];
/// What such a depth is, in meters.
const USUAL_M: f64 = 0.7;
/// Least number of an object's pixels with a depth.
const LEAST_PIXELS: usize = 40;
/// An object's highest part is higher than this above the table, in meters.
const ABOVE_M: f64 = 0.003;
/// A quarter of an object's pixels that is farther below the table than this is no noise, in meters.
const BELOW_M: f64 = 0.02;

/// What to do about an image that does not show enough.
const OTHER: &str = "choose other `images`";

/// The table, as it is known or as one image shows it.
pub(crate) type FoundTable = Result<TablePlane, ViewError>;

/// Checks that depths in meters are those of a camera over a table; `unit` is the value of the option or field `key`,
/// which they are proportional to.
pub(crate) fn check_unit(
    depths_m: impl Iterator<Item = f64>,
    key: &'static str,
    unit: f64,
) -> Result<(), Fault> {
    let mut depths_m: Vec<f64> = depths_m.filter(|&depth_m| depth_m > 0.0).collect();
    let median_m = quantile(&mut depths_m, 0.5);
    let median_m = median_m.ok_or_else(|| Fault::new("no pixel has a depth", OTHER))?;
    if (DEPTHS_M[0]..=DEPTHS_M[1]).contains(&median_m) {
        return Ok(());
    }
    // Units are powers of ten of each other.
    let plausible = unit * 10_f64.powf((USUAL_M / median_m).log10().round());
    let plausible: f64 = format!("{plausible:.2e}").parse().unwrap_or(plausible);
    Err(Fault::new(
        format!("the median of its depths is {median_m:.4} m, expected 0.05 m to 10 m"),
        format!("`{key}` of {plausible} would be plausible"),
    ))
}

/// Finds the pixels of the object: those of the mask if there is one, else the largest thing on the table. The table is
/// the known one, else the one that the image shows.
pub(crate) fn found(
    mut view: DepthView,
    mask: Option<Vec<bool>>,
    known: Option<TablePlane>,
) -> Result<(DepthView, FoundTable), Fault> {
    let camera = Point3::from(view.world_from_camera.translation.vector);
    let above_m = known.map(|table| table.above_m(&camera));
    if let Some(above_m) = above_m.filter(|&above_m| above_m <= 0.0) {
        return Err(Fault::new(
            format!("the camera is {:.3} m below the table", -above_m),
            "give the vector of `table` against gravity, and its height in m",
        ));
    }
    let is_masked = mask.is_some();
    view.mask = mask.unwrap_or(view.mask);
    if is_masked {
        check_mask(&view)?;
    }
    let table = known.map_or_else(|| table_plane(&view), Ok);
    if !is_masked {
        view.mask = largest_object(&view, &table.clone()?)?;
    }
    Ok((view, table))
}

/// Checks that a mask shows a whole object with depths.
fn check_mask(view: &DepthView) -> Result<(), Fault> {
    let own = || (0..view.mask.len()).filter(|&pixel| view.mask[pixel]);
    if own().next().is_none() {
        return Err(Fault::new("the mask is empty", OTHER));
    }
    let measured = own().filter(|&pixel| view.depth_m[pixel] > 0.0).count();
    if measured < LEAST_PIXELS {
        return Err(Fault::new(
            format!(
                "{measured} pixels of the mask have a depth, at least {LEAST_PIXELS} are needed"
            ),
            OTHER,
        ));
    }
    if view.intrinsics.is_cut_off(&view.mask) {
        return Err(ViewError::OutOfView.into());
    }
    Ok(())
}

/// Checks that the object stands on the table.
pub(crate) fn check_stands(view: &DepthView, table: &TablePlane) -> Result<(), Fault> {
    let points = points(view);
    let mut above_m: Vec<f64> = points.iter().map(|point| table.above_m(point)).collect();
    let [low_m, high_m] = [0.25, 0.95].map(|share| quantile(&mut above_m, share).unwrap_or(0.0));
    if low_m < -BELOW_M || high_m < ABOVE_M {
        return Err(Fault::new(
            format!("the object is from {low_m:.3} m to {high_m:.3} m above the table"),
            "give the right `table` or mask",
        ));
    }
    Ok(())
}

/// Returns the points of the object that have a depth, in the world's frame.
pub(crate) fn points(view: &DepthView) -> Vec<Point3<f64>> {
    let own = (0..view.mask.len()).filter(|&pixel| view.mask[pixel]);
    own.filter_map(|pixel| Some(view.world_from_camera * view.point_in_camera(pixel)?))
        .collect()
}

/// Returns the number below which this share of the numbers is; `None` without numbers.
pub(crate) fn quantile(numbers: &mut [f64], share: f64) -> Option<f64> {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the share of a length is an index"
    )]
    let idx = (share * numbers.len().checked_sub(1)? as f64) as usize;
    Some(*numbers.select_nth_unstable_by(idx, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_unit_is_named_with_the_plausible_one() {
        let check = |depth_m: f64, unit: f64, expected: Option<f64>| {
            let depths_m = [0.0, depth_m, depth_m, 0.0, 4.0 * depth_m];
            let said = check_unit(depths_m.into_iter(), "unit_m", unit).map_err(|it| it.hint);
            let hint = |plausible| format!("`unit_m` of {plausible} would be plausible");
            assert_eq!(said.err(), expected.map(hint));
        };
        check(0.6, 1.0, None);
        check(600.0, 1.0, Some(0.001));
        check(0.000_6, 0.001, Some(1.0));
        check(12.0, 1.0, Some(0.1));
        check(6e-5, 0.001, Some(10.0));
        let none = check_unit([0.0].into_iter(), "unit_m", 1.0);
        assert_eq!(none.unwrap_err().to_string(), "no pixel has a depth");
    }

    #[test]
    fn quantiles_are_of_the_sorted_numbers() {
        let mut numbers = [3.0, 1.0, 2.0, 5.0, 4.0];
        let found = [0.0, 0.25, 0.5, 0.99, 1.0].map(|share| quantile(&mut numbers, share).unwrap());
        assert_eq!(found, [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(quantile(&mut [], 0.5), None);
    }
}
