//! Posing a hand: linear blend skinning of joints and fingertips.

use nalgebra::{Point3, Rotation3, Vector3};

use super::model::{ANGLES, BETAS, JOINTS, ManoModel, PARENTS, POSE_FEATURES};

/// Indices of the 21 landmarks in joints 0 to 15 followed by the five tips: wrist, then thumb,
/// index, middle, ring and little finger, each from base to tip.
const LANDMARKS: [usize; 21] = [
    0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 19, 7, 8, 9, 20,
];

/// The hand of one person, at rest.
#[derive(Debug, Clone)]
pub struct ShapedHand<'m> {
    model: &'m ManoModel,
    /// Joints, in meters in the model's frame.
    joints: [Vector3<f64>; JOINTS],
    /// Tips of thumb, index, middle, ring and little finger, in meters in the model's frame.
    tips: [Vector3<f64>; 5],
}

impl<'m> ShapedHand<'m> {
    pub(super) fn new(model: &'m ManoModel, betas: &[f64; BETAS]) -> Self {
        Self {
            model,
            joints: std::array::from_fn(|joint| model.joints[joint].at(betas)),
            tips: std::array::from_fn(|tip| model.tips[tip].rest.at(betas)),
        }
    }

    /// Returns the 21 landmarks of the posed hand, in meters, in the frame of `pose_m`: wrist, then
    /// thumb, index, middle, ring and little finger, each from base to tip.
    ///
    /// `pose_m` is what `DexYCB` stores per image: 0 to 2 the rotation of the hand as axis times
    /// angle in radians, 3 to 47 coefficients of the model's principal components, which add to
    /// its mean pose, and 48 to 50 a translation in meters. The hand turns about its wrist at rest,
    /// which is not the model's origin, and is translated afterwards. Where `pose_m` is not finite
    /// neither are the landmarks; zeros stand for "no hand" in the dataset, and are not told apart
    /// here.
    ///
    /// The steps are those of Loper et al., *SMPL: A Skinned Multi-Person Linear Model*, 2015,
    /// section 3, on the hand of Romero, Tzionas and Black, *Embodied Hands*, 2017, section 3.
    pub fn keypoints(&self, pose_m: &[f64; 3 + ANGLES + 3]) -> [Point3<f64>; 21] {
        let [rx, ry, rz, inner @ .., x, y, z] = pose_m;
        // θ: mean pose and principal components.
        let mut angles = self.model.mean;
        for (coefficient, component) in inner.iter().zip(&self.model.components) {
            for (angle, part) in angles.iter_mut().zip(component) {
                *angle += coefficient * part;
            }
        }
        let mut rotations = [Rotation3::new(Vector3::new(*rx, *ry, *rz)); JOINTS];
        let (axes, _) = angles.as_chunks::<3>();
        for (rotation, &axis) in rotations.iter_mut().skip(1).zip(axes) {
            *rotation = Rotation3::new(Vector3::from(axis));
        }

        // G: the world transformation of each joint (eq. 3); parents come before children.
        let mut world = [(Rotation3::identity(), Vector3::zeros()); JOINTS];
        world[0] = (rotations[0], self.joints[0]);
        for joint in 1..JOINTS {
            let parent = PARENTS[joint];
            let (turn, place) = world[parent];
            let bone = self.joints[joint] - self.joints[parent];
            world[joint] = (turn * rotations[joint], place + turn * bone);
        }

        let features = pose_features(&rotations);
        let tips = self.model.tips.iter().zip(&self.tips).map(|(tip, rest)| {
            // B_P: pose blend shapes (eq. 9), then skinning (eq. 2).
            let moved = tip.pose_directions.iter().zip(&features);
            let vertex = moved.fold(*rest, |at, (direction, feature)| at + direction * *feature);
            let parts = tip.weights.iter().zip(&world).zip(&self.joints);
            parts.fold(Vector3::zeros(), |sum, ((weight, (turn, place)), joint)| {
                sum + (turn * (vertex - joint) + place) * *weight
            })
        });
        let translation = Vector3::new(*x, *y, *z);
        let mut all = [Vector3::zeros(); JOINTS + 5];
        let joints = world.iter().map(|&(_, place)| place);
        for (to, from) in all.iter_mut().zip(joints.chain(tips)) {
            *to = from + translation;
        }
        LANDMARKS.map(|idx| all[idx].into())
    }
}

/// Returns the entries, row by row, of the rotation matrices less the identity, without the
/// wrist's.
fn pose_features(rotations: &[Rotation3<f64>; JOINTS]) -> [f64; POSE_FEATURES] {
    let mut features = [0.0; POSE_FEATURES];
    let (matrices, _) = features.as_chunks_mut::<9>();
    for (entries, rotation) in matrices.iter_mut().zip(&rotations[1..]) {
        let rows = rotation.matrix().transpose();
        // The transpose's columns are the rows.
        for (entry, value) in entries.iter_mut().zip(rows.iter()) {
            *entry = *value;
        }
        for diagonal in [0, 4, 8] {
            entries[diagonal] -= 1.0;
        }
    }
    features
}
