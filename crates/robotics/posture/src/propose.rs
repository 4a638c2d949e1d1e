//! A first proposal of a hand table, from the robot's tree alone.

use robot::{Finger, RobotModel};
use schemas::demonstrations::Side;

use crate::{FollowedPoint, HandTable};

/// From the wrist to the tip of the middle finger of a person's hand, in meters: the mean of men and
/// women (Garrett, *The adult human hand: some anthropometric and biomechanical considerations*,
/// 1971).
const PERSON_M: f64 = 0.187;
/// Share of the difference of a hand's length from a person's by which the person's is scaled: objects
/// stay as large as they are, so that a longer hand bends more around them than a person's. Of five
/// published hands, 0.95 to 1.35 times as long as a person's, landmarks of grasps were followed nearest
/// at scales from 0.85 to 1.05.
const OF_LENGTH: f64 = 0.25;
/// Weight of the middles of fingers and of the wrist, relative to the tips.
const BESIDE_TIPS: f64 = 0.3;
/// The fingers beside the thumb, in their order across the palm.
const FINGERS: [&str; 4] = ["index", "middle", "ring", "little"];

impl HandTable {
    /// Proposes a table for a robot: tips follow tips, the middle of each finger its counterpart,
    /// the wrist the wrist; `None` if the robot has no finger beside a thumb, or too few links for
    /// three points.
    ///
    /// It is a guess for people to check.
    pub fn proposed(model: &RobotModel) -> Option<Self> {
        let hand = model.hand_layout()?;
        let name_of = |link: usize| Some(model.links().get(link)?.name.clone());
        let thumb = hand.thumb.iter().map(|finger| ("thumb", finger));
        let named: Vec<(&str, &Finger)> = thumb
            .chain(FINGERS.into_iter().zip(&hand.fingers))
            .collect();
        let mut points = Vec::new();
        for (name, finger) in &named {
            points.push(FollowedPoint {
                keypoint: format!("{name}_tip"),
                link: name_of(finger.tip_link)?,
                offset_m: rounded(finger.tip_offset_m.into()),
                weight: 1.0,
                tip_radius_m: Some(model.tip_radius_m(finger).unwrap_or(0.0)),
            });
        }
        for (name, finger) in &named {
            if let Some(link) = middle(model, finger) {
                points.push(FollowedPoint {
                    keypoint: format!("{name}_pip"),
                    link: name_of(link)?,
                    offset_m: [0.0; 3],
                    weight: BESIDE_TIPS,
                    tip_radius_m: None,
                });
            }
        }
        points.push(FollowedPoint {
            keypoint: "wrist".to_owned(),
            link: name_of(hand.palm)?,
            offset_m: rounded(hand.wrist_offset_m.into()),
            weight: BESIDE_TIPS,
            tip_radius_m: None,
        });
        let table = Self {
            side: if hand.is_left {
                Side::Left
            } else {
                Side::Right
            },
            scale: scale(hand.length_m),
            points,
        };
        (table.points.len() >= 3).then_some(table)
    }
}

/// Returns the scale of a hand of this length, in steps of a twentieth.
fn scale(length_m: f64) -> f64 {
    let scale = 1.0 + OF_LENGTH * (length_m / PERSON_M - 1.0);
    (scale * 20.0).round() / 20.0
}

/// Returns the link that the last joint but one moves, or the only one beyond the knuckle.
fn middle(model: &RobotModel, finger: &Finger) -> Option<usize> {
    let moves = |&link: &usize| {
        model
            .links()
            .get(link)
            .is_some_and(|link| link.kind.is_some())
    };
    let moving: Vec<usize> = finger.links.iter().copied().filter(moves).collect();
    match moving.as_slice() {
        [.., _, middle, _] | [_, middle] => Some(*middle),
        [] | [_] => None,
    }
}

/// Rounds to a hundredth of a millimeter.
fn rounded(offset_m: [f64; 3]) -> [f64; 3] {
    // Without a negative zero.
    offset_m.map(|x| (x * 1e5).round() / 1e5 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_hand_is_scaled_less_than_it_is_long() {
        // Length over a person's, and the scales at which landmarks are within 2 mm of the nearest.
        for (length, [least, most]) in [
            (1.2, [0.95, 1.1]),
            (0.95, [0.8, 1.0]),
            (1.05, [0.95, 1.05]),
            (1.35, [0.95, 1.2]),
        ] {
            let found = scale(length * PERSON_M);
            assert!((least..=most).contains(&found), "{length}: {found}");
        }
        assert_eq!(scale(PERSON_M), 1.0);
        assert!(scale(0.5 * PERSON_M) < 0.95 && scale(2.0 * PERSON_M) > 1.15);
    }
}
