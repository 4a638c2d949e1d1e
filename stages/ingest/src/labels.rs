//! One label file.
use dataflow::SourceFile;
use nalgebra::{Isometry3, Point3};
use schemas::demonstrations::KEYPOINTS;

use crate::{error::Unusable, npz::Arrays, reader::read, recording::Keypoints, yaml};

const MAX_LABEL_BYTES: u64 = 4 << 20;

#[derive(Default)]
pub(crate) struct LabelReader;

pub(crate) struct Labels {
    pub(crate) keypoints_in_camera: Option<Keypoints>,
    pub(crate) camera_from_object: Option<Isometry3<f64>>,
}

impl LabelReader {
    pub(crate) fn read(
        &mut self,
        file: &SourceFile,
        n_objects: usize,
        grasped: usize,
    ) -> Result<Labels, Unusable> {
        let bytes = read(file, MAX_LABEL_BYTES)?;
        let npz = |source| Unusable::Npz {
            file: file.name.clone(),
            source,
        };
        let mut labels = Arrays::open(&bytes).map_err(npz)?;
        let numbers = labels
            .numbers("joint_3d", &[1, KEYPOINTS as u64, 3])
            .map_err(npz)?;
        let keypoints_in_camera = keypoints(&numbers);
        let numbers = labels
            .numbers("pose_y", &[n_objects as u64, 3, 4])
            .map_err(npz)?;
        let rows = numbers.chunks_exact(12).nth(grasped);
        let rows: Option<[f64; 12]> = rows.and_then(|rows| rows.try_into().ok());
        let camera_from_object = rows
            .filter(|rows| rows.iter().any(|&number| number != 0.0))
            .map(|rows| {
                yaml::isometry(&rows).ok_or_else(|| Unusable::Value {
                    what: "`pose_y` is not a rotation and a translation".to_owned(),
                    file: file.name.clone(),
                })
            })
            .transpose()?;
        Ok(Labels {
            keypoints_in_camera,
            camera_from_object,
        })
    }
}

fn keypoints(numbers: &[f64]) -> Option<Keypoints> {
    #[expect(clippy::float_cmp, reason = "the mark for `no hand` is exactly -1")]
    let is_marked = numbers.iter().all(|&number| number == -1.0);
    if is_marked {
        return None;
    }
    let mut keypoints = [Point3::origin(); KEYPOINTS];
    for (point, xyz) in keypoints.iter_mut().zip(numbers.chunks_exact(3)) {
        point.coords.copy_from_slice(xyz);
    }
    Some(keypoints)
}
