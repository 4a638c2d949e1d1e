//! Depth images from the rows of `views` and back: what a stage reads is what [`depth_view`] computes with.
//!
//! ```
//! use depth_view::{DepthView, Intrinsics};
//! use spatial::Pose;
//!
//! let image = DepthView {
//!     intrinsics: Intrinsics::of_field(2, 1, 1.0),
//!     world_from_camera: Pose::identity(),
//!     depth_m: vec![0.5, 0.0],
//!     mask: vec![true, false],
//! };
//! let view = stored_views::stored("can-0".to_owned(), &image, stored_views::DEPTH_STEP_M);
//! assert_eq!(stored_views::image(&view)?, image);
//! assert_eq!(stored_views::all(&[view])?, (vec![image], None));
//! # Ok::<(), schemas::SchemaError>(())
//! ```
//!
//! Lengths are in meters.

use depth_view::{DepthView, Intrinsics, TablePlane};
use nalgebra::{UnitVector3, Vector3};
use schemas::{SchemaError, views::View};

/// Depth of the number 1 in stored images that have no step of their own, in meters.
pub const DEPTH_STEP_M: f64 = 1e-4;

/// Returns a stored view as an image.
///
/// # Errors
///
/// Fails if its depths or its mask are not those of an image of its size.
pub fn image(view: &View) -> Result<DepthView, SchemaError> {
    let (depth_m, mask) = (view.depths_m()?, view.pixels()?);
    Ok(DepthView {
        intrinsics: Intrinsics {
            // Checked with the depths.
            width: usize::try_from(view.width).unwrap_or_default(),
            height: usize::try_from(view.height).unwrap_or_default(),
            focal: view.focal_px,
            center: view.center_px,
        },
        world_from_camera: view.world_from_camera,
        depth_m,
        mask,
    })
}

/// Returns the images of an object, and the table if a view knows it.
///
/// # Errors
///
/// Fails as [`image`] does.
pub fn all(views: &[View]) -> Result<(Vec<DepthView>, Option<TablePlane>), SchemaError> {
    let images = views.iter().map(image).collect::<Result<_, _>>()?;
    Ok((images, views.iter().find_map(table)))
}

/// Returns the table of a view, if it is known.
fn table(view: &View) -> Option<TablePlane> {
    let &[x, y, z, height_m] = view.table.first()?;
    let up = UnitVector3::try_new(Vector3::new(x, y, z), 1e-6)?;
    Some(TablePlane { up, height_m })
}

/// Returns an image to be stored under this name, its depths in these steps, without a known table or a true pose.
pub fn stored(name: String, image: &DepthView, depth_step_m: f64) -> View {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a depth in steps has far fewer digits"
    )]
    let step = |&depth_m: &f64| (depth_m / depth_step_m).round() as i64;
    View {
        view: name,
        // No image has more pixels than an integer.
        width: i64::try_from(image.intrinsics.width).unwrap_or(i64::MAX),
        height: i64::try_from(image.intrinsics.height).unwrap_or(i64::MAX),
        focal_px: image.intrinsics.focal,
        center_px: image.intrinsics.center,
        world_from_camera: image.world_from_camera,
        table: Vec::new(),
        depth_step_m,
        depth: image.depth_m.iter().map(step).collect(),
        mask: View::runs(&image.mask),
        world_from_object: Vec::new(),
    }
}
