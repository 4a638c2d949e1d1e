//! A first proposal of a hand's table, drawn from its tree.

use nalgebra::Vector3;
use robot::{Finger, HandShape, RobotModel};
use schemas::demonstrations::Side;
use stage_retarget::{FollowedPoint, HandTable};

/// From the wrist to the tip of the middle finger of a person's hand, in meters: the mean of men and
/// women (Garrett, *The adult human hand: some anthropometric and biomechanical considerations*,
/// 1971).
const PERSON_M: f64 = 0.187;
/// How much the middle knuckles and the wrist count beside the tips.
const BESIDE_TIPS: f64 = 0.3;
/// Steps in which a size is proposed: the tree does not say more.
const SCALE_STEP: f64 = 0.05;

/// Returns the table as TOML: which landmark of a person's hand each point of the robot follows.
pub(super) fn table(model: &RobotModel, hand: &HandShape) -> String {
    let thumb = hand.thumb.iter().map(|finger| ("thumb", finger));
    let others = ["index", "middle", "ring", "little"]
        .into_iter()
        .zip(&hand.fingers);
    let named: Vec<(&str, &Finger)> = thumb.chain(others).collect();
    let link = |idx: usize| match model.links().get(idx) {
        Some(link) => link.name.clone(),
        None => String::new(),
    };
    let mut points: Vec<FollowedPoint> = named
        .iter()
        .map(|(name, finger)| FollowedPoint {
            keypoint: format!("{name}_tip"),
            link: link(finger.tip_link),
            offset_m: rounded(&finger.tip_offset_m),
            weight: 1.0,
            tip_radius_m: Some(model.tip_radius_m(finger).unwrap_or(0.0)),
        })
        .collect();
    let beside = |keypoint: String, idx: usize, offset_m: &Vector3<f64>| FollowedPoint {
        keypoint,
        link: link(idx),
        offset_m: rounded(offset_m),
        weight: BESIDE_TIPS,
        tip_radius_m: None,
    };
    points.extend(named.iter().filter_map(|(name, finger)| {
        let middle = middle_link(model, finger)?;
        Some(beside(format!("{name}_pip"), middle, &Vector3::zeros()))
    }));
    points.push(beside("wrist".to_owned(), hand.palm, &hand.wrist_offset_m));
    let steps = (hand.length_m / PERSON_M / SCALE_STEP).round().max(1.0);
    let table = HandTable {
        side: if hand.is_left {
            Side::Left
        } else {
            Side::Right
        },
        scale: to_digits(steps * SCALE_STEP, 2),
        points,
    };
    format!(
        "# A first proposal of a hand's table, from the tree alone: check it, then save it beside\n\
         # those in `data/hands`. It seems to be a {} hand, {:.0} mm from wrist to tips.\n{}",
        table.side.as_str(),
        hand.length_m * 1000.0,
        table.to_toml()
    )
}

/// Returns the link that the last joint but one moves, or the only one beyond the first.
fn middle_link(model: &RobotModel, finger: &Finger) -> Option<usize> {
    let moves = |idx: &usize| {
        let link = model.links().get(*idx);
        link.is_some_and(|link| link.kind.is_some())
    };
    let moving: Vec<usize> = finger.links.iter().copied().filter(moves).collect();
    match moving.as_slice() {
        [.., _, middle, _] | [_, middle] => Some(*middle),
        [] | [_] => None,
    }
}

/// An offset to a hundredth of a millimeter.
fn rounded(offset_m: &Vector3<f64>) -> [f64; 3] {
    // Adding 0 makes the negative zero positive.
    offset_m.map(|number| to_digits(number, 5) + 0.0).into()
}

/// A number to so many digits behind the point.
fn to_digits(number: f64, digits: i32) -> f64 {
    let unit = 10.0_f64.powi(digits);
    (number * unit).round() / unit
}
