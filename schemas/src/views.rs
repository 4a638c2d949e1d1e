//! `views`: depth images of an object on a table, one partition per object, one row per image.
//!
//! The camera's frame has x right, y down and z forward; a pixel's center has whole coordinates. Images are rectified.

use spatial::{Camera, Object, Pose, World};

use crate::{SchemaError, columns::columns, table::table};

columns! {
    /// One image.
    #[derive(Debug, Clone, PartialEq)]
    pub struct View {
        view: String => "name of the image",
        width: i64 ["px"] => "pixels of a row",
        height: i64 ["px"] => "number of rows",
        focal_px: [f64; 2] ["px"] => "focal length along x and y",
        center_px: [f64; 2] ["px"] => "principal point: the pixel that looks along the camera's z",
        world_from_camera: Pose<World, Camera> ["m, 1"]
            => "pose of the camera, as it is known: xyz, xyzw; the identity if nothing is known of it",
        table: Vec<[f64; 4]> ["1, m"]
            => "the table if it is known: unit vector against gravity, world frame, and the table's height along it",
        depth_step_m: f64 ["m"] => "depth that the number 1 stands for",
        depth: Vec<i64> => "depths along the camera's z, row by row, in these steps; 0 where none was measured",
        mask: Vec<i64>
            => "the object's pixels, row by row: lengths of runs, first of pixels beside the object, then of its own, and so on",
        world_from_object: Vec<Pose<World, Object>> ["m, 1"]
            => "true pose of the object in its mesh's frame, of a simulated image; else empty",
    }
}

/// The images of one object.
pub type Views = Vec<View>;
table! {"views", 1, per "object", rows: View}

impl View {
    /// Returns the lengths of runs of a mask's equal pixels, first of those that are not set.
    pub fn runs(mask: &[bool]) -> Vec<i64> {
        let mut runs = vec![0];
        let mut is_set = false;
        for &pixel in mask {
            if pixel != is_set {
                is_set = pixel;
                runs.push(0);
            }
            if let Some(run) = runs.last_mut() {
                *run += 1;
            }
        }
        runs
    }

    /// Returns the object's pixels, row by row.
    ///
    /// # Errors
    ///
    /// Fails if the runs are not those of the image.
    pub fn pixels(&self) -> Result<Vec<bool>, SchemaError> {
        let pixels_n = self.pixels_n()?;
        let mut mask = Vec::new();
        for (idx, &run) in self.mask.iter().enumerate() {
            let run = usize::try_from(run).unwrap_or(usize::MAX);
            if run > pixels_n - mask.len() {
                let message = "its runs are negative or longer than the image".to_owned();
                return Err(SchemaError::invalid("mask", message));
            }
            mask.resize(mask.len() + run, idx % 2 == 1);
        }
        SchemaError::check_length("mask", "pixels", &mask, pixels_n)?;
        Ok(mask)
    }

    /// Returns the depths row by row, in meters; 0 where none was measured.
    ///
    /// # Errors
    ///
    /// Fails if they are not those of an image of this size, or one is negative.
    pub fn depths_m(&self) -> Result<Vec<f64>, SchemaError> {
        SchemaError::check_length("depth", "pixels", &self.depth, self.pixels_n()?)?;
        if let Some(negative) = self.depth.iter().find(|&&depth| depth < 0) {
            let message = format!("depth {negative} is negative");
            return Err(SchemaError::invalid("depth", message));
        }
        let depths = self.depth.iter();
        Ok(depths
            .map(|&depth| depth as f64 * self.depth_step_m)
            .collect())
    }

    fn pixels_n(&self) -> Result<usize, SchemaError> {
        let side = |n: i64| {
            usize::try_from(n)
                .ok()
                .filter(|n| (1..=1 << 15).contains(n))
        };
        let sides = side(self.width).zip(side(self.height));
        sides.map(|(width, height)| width * height).ok_or_else(|| {
            let message = format!("{} by {} pixels are no image", self.width, self.height);
            SchemaError::invalid("width", message)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_is_its_runs() {
        let mask = [true, true, false, true, false, false];
        let runs = View::runs(&mask);
        assert_eq!(runs, [0, 2, 1, 1, 2]);
        let view = |mask: Vec<i64>| View {
            view: "0".to_owned(),
            width: 3,
            height: 2,
            focal_px: [1.0; 2],
            center_px: [1.0; 2],
            world_from_camera: Pose::identity(),
            table: Vec::new(),
            depth_step_m: 1e-4,
            depth: vec![0, 1, 2, 3, 4, 10_000],
            mask,
            world_from_object: Vec::new(),
        };
        assert_eq!(view(runs).pixels().unwrap(), mask);
        assert_eq!(view(vec![6]).depths_m().unwrap()[5], 1.0);
        for wrong in [vec![7], vec![5], vec![8, -2], vec![]] {
            assert!(view(wrong).pixels().is_err());
        }
    }
}
