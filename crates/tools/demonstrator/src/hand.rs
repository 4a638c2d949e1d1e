//! A hand of 21 landmarks: bone lengths, joint ranges and forward kinematics.
//!
//! The hand's frame is at the wrist: x towards the fingertips, z out of the back of the hand, and y
//! towards the thumb of a right hand (away from it in a left hand, which is the mirror image).
//! Landmarks are in the dataset's order: wrist, then thumb to little finger from the palm outward.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use spatial::Pose;

use crate::noise::normal;

/// Side of a hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
}

impl Side {
    /// Returns the dataset's word for it.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// Returns 1 for a right hand, −1 for a left one.
    pub(crate) fn sign(self) -> f64 {
        match self {
            Self::Left => -1.0,
            Self::Right => 1.0,
        }
    }
}

/// Independent joints: four of the thumb, three of each finger (the last follows the middle one).
pub(crate) const DOF: usize = 16;
/// Joint positions in radians. Thumb: flexion and abduction at the wrist, then the two flexions
/// outward. Each finger: abduction, flexion at the knuckle, flexion of the middle joint.
pub(crate) type Joints = [f64; DOF];

/// Fingers, thumb included.
pub(crate) const FINGERS: usize = 5;
/// The last finger joint bends by this part of the middle one.
const COUPLING: f64 = 2.0 / 3.0;

/// Lower and upper end of each joint in degrees (AAOS norms; Ingram et al., "The statistics of
/// natural hand movements", 2008).
const RANGES_DEG: [[f64; 2]; DOF] = [
    [-25.0, 40.0],
    [-25.0, 25.0],
    [-10.0, 55.0],
    [-10.0, 75.0],
    [-18.0, 18.0],
    [-15.0, 90.0],
    [0.0, 100.0],
    [-12.0, 12.0],
    [-15.0, 90.0],
    [0.0, 100.0],
    [-15.0, 15.0],
    [-15.0, 90.0],
    [0.0, 100.0],
    [-20.0, 20.0],
    [-15.0, 90.0],
    [0.0, 100.0],
];

/// Returns the lower and upper end of each joint, in radians.
pub(crate) fn ranges() -> [[f64; 2]; DOF] {
    RANGES_DEG.map(|range| range.map(f64::to_radians))
}

/// Points of the hand in the order in which [`Hand::points`] returns them.
pub(crate) mod point {
    use super::FINGERS;

    /// The landmarks come first.
    pub(crate) const LANDMARKS: usize = 21;
    /// Then the middle of each finger's pad on the bone's axis.
    pub(crate) const PADS: usize = LANDMARKS;
    /// Then the skin of each pad.
    pub(crate) const SKIN: usize = PADS + FINGERS;
    /// Then the middles of balls of flesh.
    pub(crate) const FLESH: usize = SKIN + FINGERS;
}

/// Bones from the palm outward in millimeters, the pulp of the tip added to the last (Buryanov and
/// Kotiuk, "Proportions of hand segments", 2010).
const BONES_MM: [[f64; 3]; FINGERS] = [
    [46.2, 31.6, 27.4],
    [39.8, 22.4, 19.6],
    [44.6, 26.3, 21.4],
    [41.4, 25.7, 21.3],
    [32.7, 18.1, 19.7],
];
/// Base of each finger, in millimeters.
const BASES_MM: [[f64; 3]; FINGERS] = [
    [28.0, 26.0, -14.0],
    [92.0, 24.0, 0.0],
    [92.0, 2.0, 2.0],
    [85.0, -18.0, 0.0],
    [77.0, -36.0, -4.0],
];
/// Abduction of the fingers at rest, in degrees.
const SPREAD_DEG: [f64; FINGERS] = [0.0, 6.0, 0.0, -5.0, -12.0];
/// Radius of the flesh along each finger, in millimeters: at the start of each bone and at the tip.
const RADII_MM: [[f64; 4]; FINGERS] = [
    [13.0, 11.0, 10.0, 9.0],
    [11.0, 9.0, 8.0, 7.5],
    [11.0, 9.5, 8.5, 7.5],
    [11.0, 9.0, 8.0, 7.0],
    [10.0, 8.0, 7.0, 6.5],
];
/// Radius of the flesh of the palm, in millimeters.
const PALM_RADIUS_MM: f64 = 13.0;
/// Position of the pad along the last bone, as a share of its length.
const PAD_AT: f64 = 0.6;

/// One person's hand.
#[derive(Debug, Clone)]
pub(crate) struct Hand {
    side: Side,
    fingers: Vec<Finger>,
    palm: Vec<Point3<f64>>,
    /// Radius of each ball of flesh, in meters.
    radii_m: Vec<f64>,
}

#[derive(Debug, Clone)]
struct Finger {
    base: Point3<f64>,
    rotation: Rotation3<f64>,
    bones_m: [f64; 3],
    radii_m: [f64; 4],
}

/// A person's size: one factor for the hand, one more for each bone.
#[derive(Debug, Clone)]
pub(crate) struct Size {
    scale: f64,
    bones: [[f64; 3]; FINGERS],
}

impl Size {
    /// Draws a size; both standard deviations are shares, and nobody is farther out than two.
    pub(crate) fn draw(rng: &mut ChaCha8Rng, scale_sd: f64, bone_sd: f64) -> Self {
        let mut factor = |sd: f64| 1.0 + sd * normal(rng).clamp(-2.0, 2.0);
        Self {
            scale: factor(scale_sd),
            bones: std::array::from_fn(|_| std::array::from_fn(|_| factor(bone_sd))),
        }
    }
}

impl Hand {
    /// Makes the hand of a person.
    pub(crate) fn new(side: Side, person: &Size) -> Self {
        let meters = |mm: f64| mm * 1e-3 * person.scale;
        let fingers: Vec<Finger> = (0..FINGERS)
            .map(|idx| Finger {
                base: Point3::from(Vector3::from(BASES_MM[idx]).map(meters)),
                rotation: if idx == 0 {
                    thumb_rotation()
                } else {
                    Rotation3::from_axis_angle(&Vector3::z_axis(), SPREAD_DEG[idx].to_radians())
                },
                bones_m: std::array::from_fn(|bone| {
                    meters(BONES_MM[idx][bone]) * person.bones[idx][bone]
                }),
                radii_m: RADII_MM[idx].map(meters),
            })
            .collect();
        let mut palm = Vec::new();
        for finger in fingers.iter().skip(1) {
            for share in [0.2, 0.45, 0.7] {
                palm.push(Point3::from(finger.base.coords * share));
            }
        }
        let mut hand = Self {
            side,
            fingers,
            palm,
            radii_m: Vec::new(),
        };
        hand.radii_m = hand.flesh_radii(meters(PALM_RADIUS_MM));
        hand
    }

    /// Returns the side of the hand.
    pub(crate) fn side(&self) -> Side {
        self.side
    }

    /// Returns the radius of the flesh at each pad, in meters.
    pub(crate) fn pad_radius_m(&self, finger: usize) -> f64 {
        let [.., start, tip] = self.fingers[finger].radii_m;
        start + (tip - start) * PAD_AT
    }

    /// Returns the radius of each ball of flesh, in the order of the points from
    /// [`point::FLESH`], in meters.
    pub(crate) fn radii_m(&self) -> &[f64] {
        &self.radii_m
    }

    fn flesh_radii(&self, palm_m: f64) -> Vec<f64> {
        let mut radii = vec![palm_m; self.palm.len()];
        for finger in &self.fingers {
            let [base, first, second, tip] = finger.radii_m;
            radii.extend([
                base,
                base.midpoint(first),
                first,
                first.midpoint(second),
                second,
                tip,
            ]);
        }
        radii
    }

    /// Returns the hand's points in its own frame, in meters, in the order of [`point`].
    pub(crate) fn points(&self, q: &Joints) -> Vec<Point3<f64>> {
        let mut landmarks = vec![Point3::origin()];
        let (mut pads, mut skin) = (Vec::new(), Vec::new());
        let mut flesh = self.palm.clone();
        for (idx, finger) in self.fingers.iter().enumerate() {
            let (abduction, bends) = if idx == 0 {
                (q[1], [q[0], q[2], q[3]])
            } else {
                let at = 3 * idx + 1;
                (q[at], [q[at + 1], q[at + 2], COUPLING * q[at + 2]])
            };
            let mut rotation =
                finger.rotation * Rotation3::from_axis_angle(&Vector3::z_axis(), abduction);
            let mut from = finger.base;
            landmarks.push(from);
            flesh.push(from);
            for (bone, bend) in bends.into_iter().enumerate() {
                rotation *= Rotation3::from_axis_angle(&Vector3::y_axis(), bend);
                let along = rotation * Vector3::x();
                let to = from + along * finger.bones_m[bone];
                landmarks.push(to);
                if bone < 2 {
                    flesh.push(nalgebra::center(&from, &to));
                    flesh.push(to);
                } else {
                    flesh.push(to - along * finger.radii_m[3]);
                    let pad = from + along * (finger.bones_m[bone] * PAD_AT);
                    pads.push(pad);
                    skin.push(pad - rotation * Vector3::z() * self.pad_radius_m(idx));
                }
                from = to;
            }
        }
        let mirror = self.side.sign();
        [landmarks, pads, skin, flesh]
            .concat()
            .into_iter()
            .map(|p| Point3::new(p.x, p.y * mirror, p.z))
            .collect()
    }

    /// Returns the hand's points in the frame of `frame_from_hand`, in meters.
    pub(crate) fn points_in<Frame>(
        &self,
        frame_from_hand: &Pose<Frame, Self>,
        q: &Joints,
    ) -> Vec<Point3<f64>> {
        let points = self.points(q).into_iter();
        points.map(|point| *frame_from_hand * point).collect()
    }

    /// Returns the distance between the tips of thumb and index finger, in meters.
    pub(crate) fn aperture_m(&self, q: &Joints) -> f64 {
        let points = self.points(q);
        (points[4] - points[8]).norm()
    }
}

/// Returns the rotation of the thumb's base: its axis about 45° out of the palm's plane, its pad
/// turned towards the fingers.
fn thumb_rotation() -> Rotation3<f64> {
    let along = Vector3::new(0.62, 0.42, -0.66).normalize();
    let pad = Vector3::new(0.72, -0.68, 0.0);
    let pad = (pad - along * along.dot(&pad)).normalize();
    let z = -pad;
    Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[along, z.cross(&along), z]))
}

/// Returns the joints between two postures; `share` 0 is the first.
pub(crate) fn blend(from: &Joints, to: &Joints, share: f64) -> Joints {
    std::array::from_fn(|idx| from[idx] + (to[idx] - from[idx]) * share)
}

/// Returns the joints moved into their ranges.
pub(crate) fn clamped(q: &Joints) -> Joints {
    let ranges = ranges();
    std::array::from_fn(|idx| q[idx].clamp(ranges[idx][0], ranges[idx][1]))
}

/// Builds joints from degrees: thumb, then abduction, knuckle and middle joint of all fingers.
pub(crate) fn posture_deg(thumb: [f64; 4], finger: [f64; 3]) -> Joints {
    let mut q = [0.0; DOF];
    for (slot, value) in q
        .iter_mut()
        .zip(thumb.into_iter().chain(finger.into_iter().cycle()))
    {
        *slot = value.to_radians();
    }
    q
}

/// Returns the rotation with the given columns, orthonormalized from the first two.
pub(crate) fn rotation_from_axes(
    x: &Vector3<f64>,
    z: &Vector3<f64>,
) -> Option<UnitQuaternion<f64>> {
    let x = x.try_normalize(1e-9)?;
    let z = (z - x * x.dot(z)).try_normalize(1e-9)?;
    let matrix = Matrix3::from_columns(&[x, z.cross(&x), z]);
    Some(UnitQuaternion::from_rotation_matrix(
        &Rotation3::from_matrix_unchecked(matrix),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{between, stream};

    fn average(side: Side) -> Hand {
        Hand::new(
            side,
            &Size {
                scale: 1.0,
                bones: [[1.0; 3]; FINGERS],
            },
        )
    }

    #[test]
    fn bones_keep_their_length_in_every_posture() {
        let hand = average(Side::Right);
        let straight = hand.points(&[0.0; DOF]);
        let mut rng = stream(1, "test", 0);
        for _ in 0..50 {
            let q: Joints = ranges().map(|range| between(&mut rng, range));
            let points = hand.points(&q);
            for finger in 0..FINGERS {
                for bone in 1..4 {
                    let (a, b) = (4 * finger + bone, 4 * finger + bone + 1);
                    let (now, then) = (
                        (points[a] - points[b]).norm(),
                        (straight[a] - straight[b]).norm(),
                    );
                    assert!((now - then).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn fingers_bend_towards_the_palm_and_the_thumb_meets_them() {
        let hand = average(Side::Right);
        let points = hand.points(&posture_deg([5.0, 0.0, 15.0, 20.0], [0.0, 55.0, 50.0]));
        assert!(points[12].z < -0.05, "{}", points[12]);
        let gap = (points[4] - points[8]).norm();
        assert!(gap < 0.07, "thumb {} index {}", points[4], points[8]);
    }

    #[test]
    fn a_left_hand_is_the_mirror_image() {
        let q = posture_deg([5.0, 0.0, 15.0, 20.0], [3.0, 55.0, 50.0]);
        let (left, right) = (
            average(Side::Left).points(&q),
            average(Side::Right).points(&q),
        );
        for (l, r) in left.iter().zip(&right) {
            assert_eq!([l.x, -l.y, l.z], [r.x, r.y, r.z]);
        }
    }
}
