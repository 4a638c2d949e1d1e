//! Landmarks from `pose.npz` and the user's own hand model, beside those of the labels.

use dataflow::SourceFile;
use schemas::demonstrations::Side;

use super::layout::SequenceFiles;
use crate::{
    config::Landmarks,
    error::RecordingError,
    mano::ManoModel,
    npz::Arrays,
    reader::{read, read_yaml},
    recording::{Keypoints, Recording},
    yaml::{HandShape, Meta},
};

/// Largest accepted hand model: MANO's have 4 MB.
pub(crate) const MAX_MODEL_BYTES: u64 = 64 << 20;
/// Numbers that describe a hand in an image.
const HAND: usize = 51;

/// Returns the name of the file in which the licensed model of a hand comes.
pub(crate) fn model_file(hand: Side) -> &'static str {
    match hand {
        Side::Right => "MANO_RIGHT.pkl",
        Side::Left => "MANO_LEFT.pkl",
    }
}

/// Returns where the shape of a person's hand lies, relative to the dataset.
pub(super) fn shape_name(id: &str) -> String {
    format!("calibration/mano_{id}/mano.yml")
}

/// Checks that the files beside a hand model are there, for a recording that cannot do without it.
///
/// # Errors
///
/// Fails with the name of the one that is missing.
pub(super) fn check_files(files: &SequenceFiles<'_>, meta: &Meta) -> Result<(), RecordingError> {
    let missing = |file: String| Err(RecordingError::Missing { file });
    match (files.hand_model, files.hand_shape, files.poses) {
        (Some(_), None, _) => {
            let id = meta.mano_calib.first();
            missing(shape_name(id.map_or("ID", String::as_str)))
        }
        (Some(_), _, None) => missing("pose.npz".to_owned()),
        // That there is no model at all is said by others.
        (None, ..) | (Some(_), Some(_), Some(_)) => Ok(()),
    }
}

/// Returns the landmarks in the world, image by image; `None` where the recording's files have no
/// hand model, or no hand is seen.
///
/// # Errors
///
/// Fails if the model, the hand's shape or the poses cannot be read.
pub(super) fn keypoints(
    files: &SequenceFiles<'_>,
    hand: Side,
    poses: Option<(&SourceFile, &[u8])>,
    n_images: usize,
) -> Result<Option<Vec<Option<Keypoints>>>, RecordingError> {
    let (Some(model_file), Some(shape_file), Some((file, bytes))) =
        (files.hand_model, files.hand_shape, poses)
    else {
        return Ok(None);
    };
    let model = model(model_file)?;
    if model.side() != hand {
        return Err(RecordingError::HandModel {
            file: model_file.name.clone(),
            reason: format!("the model of a {} hand", model.side().as_str()),
        });
    }
    let shape: HandShape = read_yaml(shape_file)?;
    let shaped = model.shaped(&shape.betas);
    let numbers = Arrays::open(bytes)
        .and_then(|mut arrays| arrays.numbers("pose_m", &[n_images as u64, 1, HAND as u64]))
        .map_err(|source| RecordingError::Npz {
            file: file.name.clone(),
            source,
        })?;
    let (hands, _) = numbers.as_chunks::<HAND>();
    let of_images = hands.iter().map(|numbers| {
        let is_seen = numbers.iter().any(|&number| number != 0.0);
        is_seen.then(|| shaped.keypoints(numbers))
    });
    Ok(Some(of_images.collect()))
}

/// Puts the model's landmarks where `landmarks` wants them, and reports how far they are from those
/// of the labels.
///
/// # Errors
///
/// Fails if they are wanted and not there.
pub(super) fn combine(
    recording: &mut Recording,
    posed: Option<Vec<Option<Keypoints>>>,
    landmarks: Landmarks,
) -> Result<(), RecordingError> {
    let Some(posed) = posed else {
        return match landmarks {
            Landmarks::Mano => Err(RecordingError::NoHandModel),
            Landmarks::Either | Landmarks::Labels => Ok(()),
        };
    };
    let (mut n, mut sum_m, mut largest_m) = (0_u32, 0.0, 0.0_f64);
    for (image, posed) in recording.images.iter_mut().zip(posed) {
        if let (Some(labeled), Some(posed)) = (&image.keypoints_in_world, &posed) {
            for (labeled, posed) in labeled.iter().zip(posed) {
                let distance_m = (labeled - posed).norm();
                n += 1;
                sum_m += distance_m;
                largest_m = largest_m.max(distance_m);
            }
        }
        match landmarks {
            Landmarks::Labels => {}
            Landmarks::Either => {
                image.keypoints_in_world = image.keypoints_in_world.or(posed);
            }
            Landmarks::Mano => {
                image.keypoints_in_world = posed;
                image.cameras_n = 0;
            }
        }
    }
    if n > 0 {
        recording.agreement.mano_difference_m = Some(sum_m / f64::from(n));
        recording.agreement.mano_largest_difference_m = Some(largest_m);
    }
    Ok(())
}

fn model(file: &SourceFile) -> Result<ManoModel, RecordingError> {
    ManoModel::from_pickle(&read(file, MAX_MODEL_BYTES)?).map_err(|err| RecordingError::HandModel {
        file: file.name.clone(),
        reason: err.to_string(),
    })
}
