//! The pixels of an object on the table.

use crate::{DepthView, TablePlane, ViewError};

/// What is higher above the table than this is no table, in meters.
const ABOVE_M: f64 = 0.008;
/// Neighboring pixels of one thing differ by at most this in depth, in meters.
const JUMP_M: f64 = 0.015;
/// Least number of pixels of an object.
const LEAST_PIXELS: usize = 40;

/// Returns the pixels of the largest thing that stands on a table: connected pixels more than 8 mm above it, without jumps
/// of their depth.
///
/// # Errors
///
/// Fails if nothing of 40 pixels stands on the table, or the largest thing reaches the image's border.
pub fn largest_object(view: &DepthView, table: &TablePlane) -> Result<Vec<bool>, ViewError> {
    let pixels_n = view.depth_m.len();
    let is_above = |pixel: usize| {
        let point = view.point_in_camera(pixel)?;
        Some(table.above_m(&(view.world_from_camera * point)) > ABOVE_M)
    };
    let mut open: Vec<bool> = (0..pixels_n)
        .map(|pixel| is_above(pixel).unwrap_or(false))
        .collect();
    let mut largest: Vec<usize> = Vec::new();
    for seed in 0..pixels_n {
        if !std::mem::take(&mut open[seed]) {
            continue;
        }
        let mut cluster = vec![seed];
        let mut done = 0;
        while let Some(&pixel) = cluster.get(done) {
            done += 1;
            for other in view.around(pixel, 1) {
                let jump_m = (view.depth_m[other] - view.depth_m[pixel]).abs();
                if open[other] && jump_m < JUMP_M {
                    open[other] = false;
                    cluster.push(other);
                }
            }
        }
        if cluster.len() > largest.len() {
            largest = cluster;
        }
    }
    if largest.len() < LEAST_PIXELS {
        return Err(ViewError::NoObject {
            least: LEAST_PIXELS,
        });
    }
    let mut mask = vec![false; pixels_n];
    for &pixel in &largest {
        mask[pixel] = true;
    }
    if view.intrinsics.is_cut_off(&mask) {
        return Err(ViewError::OutOfView);
    }
    Ok(mask)
}

#[cfg(test)]
mod tests {
    use geometry::TriMesh;
    use nalgebra::Point3;
    use spatial::Pose;

    use super::*;
    use crate::{Intrinsics, RenderedObject, StereoNoise, looking_at, render, table_plane};

    fn view(x_m: f64) -> crate::Rendered {
        let mesh = TriMesh::cuboid(Point3::new(-0.05, -0.02, 0.0), Point3::new(0.05, 0.02, 0.1));
        let object = RenderedObject {
            mesh: &mesh,
            world_from_object: Pose::from_parts(
                [x_m, 0.0, 0.0],
                nalgebra::UnitQuaternion::identity(),
            ),
        };
        let camera = looking_at(Point3::new(0.0, -0.4, 0.5), Point3::new(0.0, 0.0, 0.04));
        render(&object, &Intrinsics::of_field(320, 240, 1.0), &camera)
    }

    #[test]
    fn the_object_on_the_table_is_found() {
        let rendered = view(0.02);
        for measured in [
            rendered.view.clone(),
            StereoNoise::default().measured(&rendered, 4),
        ] {
            let unmasked = DepthView {
                mask: vec![false; measured.mask.len()],
                ..measured
            };
            let table = table_plane(&unmasked).unwrap();
            let found = largest_object(&unmasked, &table).unwrap();
            let pairs = || found.iter().zip(&rendered.view.mask);
            let both = pairs().filter(|&(a, b)| *a && *b).count() as f64;
            let either = pairs().filter(|&(a, b)| *a || *b).count() as f64;
            // Its lowest 8 mm are left out.
            assert!(both / either > 0.8, "{}", both / either);
        }
    }

    #[test]
    fn an_object_that_is_cut_off_and_an_empty_table_are_errors() {
        let cut = view(0.3).view;
        let table = table_plane(&cut).unwrap();
        assert_eq!(largest_object(&cut, &table), Err(ViewError::OutOfView));
        let away = view(2.0).view;
        let table = table_plane(&away).unwrap();
        assert!(matches!(
            largest_object(&away, &table),
            Err(ViewError::NoObject { .. })
        ));
    }
}
