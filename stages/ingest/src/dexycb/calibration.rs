//! Poses of the cameras and of the table's tag.

use dataflow::SourceFile;
use nalgebra::{Point3, Vector3};
use spatial::{Camera, Pose, World};

use super::layout::SequenceFiles;
use crate::{
    error::RecordingError,
    reader::read_yaml,
    recording::Tag,
    yaml::{Extrinsics, Meta},
};

/// The tag on the table, among the cameras of `extrinsics.yml`.
pub(super) const TAG: &str = "apriltag";

/// Returns where a calibration lies, relative to the dataset.
pub(super) fn extrinsics_name(id: &str) -> String {
    format!("calibration/extrinsics_{id}/extrinsics.yml")
}

/// A recording's `extrinsics.yml`.
pub(super) struct Calibration<'a> {
    file: &'a SourceFile,
    extrinsics: Extrinsics,
}

impl<'a> Calibration<'a> {
    pub(super) fn read(meta: &Meta, files: &SequenceFiles<'a>) -> Result<Self, RecordingError> {
        let file = files.extrinsics.ok_or_else(|| RecordingError::Missing {
            file: extrinsics_name(&meta.extrinsics),
        })?;
        Ok(Self {
            file,
            extrinsics: read_yaml(file)?,
        })
    }

    /// Returns a camera's pose.
    ///
    /// # Errors
    ///
    /// Fails if it is not there, or is not a rotation and translation.
    pub(super) fn world_from_camera(
        &self,
        serial: &str,
    ) -> Result<Pose<World, Camera>, RecordingError> {
        self.extrinsics.pose(serial, self.file)
    }

    /// Returns the tag's pose, if there is a tag.
    ///
    /// # Errors
    ///
    /// Fails if it is not a rotation and translation.
    pub(super) fn world_from_tag(&self) -> Result<Option<Pose<World, Tag>>, RecordingError> {
        let has_tag = self.extrinsics.extrinsics.contains_key(TAG);
        let tag = has_tag.then(|| self.extrinsics.pose(TAG, self.file));
        tag.transpose()
    }

    /// Returns the middle of these cameras, which look down on the table; `None` without cameras.
    ///
    /// # Errors
    ///
    /// Fails if one is not there, or is not a rotation and translation.
    pub(super) fn middle_of_cameras(
        &self,
        serials: &[String],
    ) -> Result<Option<Point3<f64>>, RecordingError> {
        let mut sum = Vector3::zeros();
        for serial in serials {
            sum += self.world_from_camera(serial)?.translation.vector;
        }
        let middle = Point3::from(sum / serials.len().max(1) as f64);
        Ok((!serials.is_empty()).then_some(middle))
    }
}
