//! Layout of a hand: side, palm, wrist and the fingers by name; a guess from the tree.

use nalgebra::{Point3, Vector3};
use spatial::{Base, Pose};

use crate::{Finger, Joint, Link, RobotModel, Shape};

/// Names of the fingers beside the thumb, in their order from it.
const FINGERS: [[&str; 2]; 4] = [
    ["index", "ff"],
    ["middle", "mf"],
    ["ring", "rf"],
    ["little", "lf"],
];

/// A hand as its tree suggests it.
#[derive(Debug, Clone, PartialEq)]
pub struct HandLayout {
    /// Whether it is likely to be a left hand.
    pub is_left: bool,
    /// The link on which the fingers hang.
    pub palm: usize,
    /// Position of the wrist in that link's frame, in meters.
    pub wrist_offset_m: Vector3<f64>,
    /// The thumb, if one of the fingers is one.
    pub thumb: Option<Finger>,
    /// The other fingers, the one beside the thumb first.
    pub fingers: Vec<Finger>,
    /// From the wrist to the farthest tip of those fingers, in meters.
    pub length_m: f64,
}

impl RobotModel {
    /// Guesses the layout of the hand; `None` if the robot has no finger beside a thumb.
    ///
    /// Every joint is taken as near to 0 as its limits allow. Fingers whose names say which they are
    /// (`index`, `middle`, `ring`, `little` or `pinky`, or the Shadow hand's `ff`, `mf`, `rf`, `lf`) are
    /// in that order; others along the line between the two tips that are farthest apart, from the end
    /// at which the thumb begins. The wrist is the end of the palm's collision shapes away from the
    /// fingers, or the joint on which the palm turns where most of the palm is on the fingers' side of
    /// it. A hand is a right or a left one if its names say so; else it is a right one if little finger
    /// to index, then wrist to tips, then the way in which the tips go when the fingers bend are axes of
    /// a right-handed frame.
    pub fn hand_layout(&self) -> Option<HandLayout> {
        let (thumbs, mut fingers): (Vec<Finger>, Vec<Finger>) = self
            .fingers()
            .into_iter()
            .partition(|finger| finger.is_thumb);
        let thumb = thumbs.into_iter().next();
        let q = self.open();
        let open = self.link_poses(|joint| q[joint]);
        let palm = fingers.first()?.palm;
        // In the palm's own frame, wherever an arm or a wrist has put it.
        let tip = |finger: &Finger, base_from_links: &[Pose<Base, Link>]| {
            let in_base = base_from_links[finger.tip_link] * Point3::from(finger.tip_offset_m);
            base_from_links[palm].inverse_transform_point(&in_base)
        };
        let base = |finger: &Finger| {
            let in_base = Point3::from(open[finger.links[0]].translation.vector);
            open[palm].inverse_transform_point(&in_base)
        };
        let tips: Vec<Point3<f64>> = fingers.iter().map(|finger| tip(finger, &open)).collect();
        let mut across = farthest_apart(&tips);
        if let Some(thumb) = &thumb {
            let middle = center(&tips);
            if (base(thumb) - middle).dot(&across) < 0.0 {
                across = -across;
            }
        }
        if let Some(order) = self.named_order(&fingers) {
            let mut named: Vec<(usize, Finger)> = order.into_iter().zip(fingers).collect();
            named.sort_by_key(|(place, _)| *place);
            fingers = named.into_iter().map(|(_, finger)| finger).collect();
            if let [index, .., little] = fingers.as_slice() {
                across = tip(index, &open) - tip(little, &open);
            }
        } else {
            fingers.sort_by(|a, b| {
                let along = |finger: &Finger| tip(finger, &open).coords.dot(&across);
                along(b).total_cmp(&along(a))
            });
        }
        let bases: Vec<Point3<f64>> = fingers.iter().map(base).collect();
        let forward = center(&tips) - center(&bases);
        let bent = self.bent(&q);
        let bent = self.link_poses(|joint| bent[joint]);
        let bending: Vector3<f64> = fingers
            .iter()
            .map(|finger| tip(finger, &bent) - tip(finger, &open))
            .sum();
        let wrist_offset_m = self.wrist(palm, &forward, &center(&bases));
        let length_m = tips
            .iter()
            .map(|tip| (tip.coords - wrist_offset_m).norm())
            .fold(0.0, f64::max);
        Some(HandLayout {
            is_left: self
                .named_left()
                .unwrap_or(across.cross(&forward).dot(&bending) < 0.0),
            palm,
            wrist_offset_m,
            thumb,
            fingers,
            length_m,
        })
    }

    /// Returns for each finger its place after the thumb, as its names say; `None` unless they say it
    /// of each, and of each another.
    fn named_order(&self, fingers: &[Finger]) -> Option<Vec<usize>> {
        let mut places = Vec::new();
        for finger in fingers {
            let names = finger
                .links
                .iter()
                .filter_map(|&link| self.links().get(link));
            let names = names.flat_map(|link| [Some(&link.name), link.joint_name.as_ref()]);
            let text: Vec<String> = names.flatten().map(|name| name.to_lowercase()).collect();
            let is_called = |(_, called): &(usize, &[&str; 2])| {
                let [long, short] = called;
                text.iter().flat_map(|name| words(name)).any(|word| {
                    word.starts_with(long)
                        || word.starts_with(short) && word.get(2..) != Some("inger")
                })
            };
            let mut said = FINGERS.iter().enumerate().filter(is_called);
            match (said.next(), said.next()) {
                (Some((place, _)), None) if !places.contains(&place) => places.push(place),
                _ => return None,
            }
        }
        Some(places)
    }

    /// Returns whether the names call the hand a left one; `None` if they call it neither or both.
    fn named_left(&self) -> Option<bool> {
        let side = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
            let is_called = |side: [&str; 2]| {
                let mut all = names.iter().flat_map(|name| words(name));
                all.any(|word| side.contains(&word))
            };
            match (is_called(["left", "lh"]), is_called(["right", "rh"])) {
                (true, false) => Some(true),
                (false, true) => Some(false),
                (true, true) | (false, false) => None,
            }
        };
        let links: Vec<&str> = self.links().iter().map(|link| link.name.as_str()).collect();
        side(&[self.name()]).or_else(|| side(&links))
    }

    /// Returns the radius of the finger's end, in meters: that of the ball, cylinder or capsule that
    /// its last link has, or half of the way across a box or body where it is thinnest; `None` if it
    /// has no shape.
    pub fn tip_radius_m(&self, finger: &Finger) -> Option<f64> {
        let link = self.links().get(finger.tip_link)?;
        link.collisions
            .iter()
            .map(|collision| match &collision.shape {
                Shape::Box { half_extents_m } => half_extents_m.min(),
                Shape::Sphere { radius_m }
                | Shape::Cylinder { radius_m, .. }
                | Shape::Capsule { radius_m, .. } => *radius_m,
                Shape::Convex(body) => body.half_thickness_m(),
            })
            .reduce(f64::min)
    }

    /// Returns the joint positions that are nearest to 0.
    pub(crate) fn open(&self) -> Vec<f64> {
        self.joints().iter().map(Joint::nearest_zero).collect()
    }

    /// Returns joint positions a little nearer to the middle of the limits than `q`.
    fn bent(&self, q: &[f64]) -> Vec<f64> {
        const SHARE: f64 = 0.3;
        q.iter()
            .zip(self.mid_range())
            .map(|(q, middle)| q + SHARE * (middle - q))
            .collect()
    }

    /// Returns the position of the wrist in the palm's frame.
    fn wrist(&self, palm: usize, forward: &Vector3<f64>, knuckles: &Point3<f64>) -> Vector3<f64> {
        let link = &self.links()[palm];
        let Some(back) = (-forward).try_normalize(1e-9) else {
            return Vector3::zeros();
        };
        let reaches = link.collisions.iter().map(|shape| shape.reach(&back));
        let reach = reaches.fold(0.0, f64::max);
        // The palm begins at the joint that it turns on, if most of it is on the fingers' side.
        if link.kind.is_some() && reach < -knuckles.coords.dot(&back) {
            return Vector3::zeros();
        }
        back * reach
    }
}

/// Returns the words of a name in lower case; a little finger is one, whatever it is called.
fn words(name: &str) -> impl Iterator<Item = &str> {
    let words = name.split(|c: char| !c.is_alphanumeric());
    words.map(|word| match word.strip_prefix("pink") {
        Some(_) => "little",
        None => word,
    })
}

/// Returns the direction between the two points that are farthest apart; zero if there are no two.
fn farthest_apart(points: &[Point3<f64>]) -> Vector3<f64> {
    let mut farthest = Vector3::zeros();
    for (idx, a) in points.iter().enumerate() {
        for b in points.iter().skip(idx + 1) {
            if (b - a).norm() > farthest.norm() {
                farthest = b - a;
            }
        }
    }
    farthest.try_normalize(1e-9).unwrap_or_else(Vector3::zeros)
}

fn center(points: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}
