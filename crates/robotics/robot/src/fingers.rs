//! Detection of fingers among the chains of links: a first proposal, from the tree alone.

use nalgebra::{Point3, Vector3};
use spatial::{Base, Pose};

use crate::{JointKind, Link, RobotModel};

/// A chain of links from the palm to a tip.
///
/// Indices are those of [`RobotModel::links`] and [`RobotModel::joints`].
#[derive(Debug, Clone, PartialEq)]
pub struct Finger {
    /// The link that the chain hangs on.
    pub palm: usize,
    /// The links from the palm (left out) to the tip, in that order.
    pub links: Vec<usize>,
    /// The independent joints that move them, from the palm to the tip, each once.
    pub joints: Vec<usize>,
    /// The link that is nearest to the tip: the last of [`Finger::links`].
    pub tip_link: usize,
    /// The tip in that link's frame, in meters: zero where the link is a frame made for the tip.
    pub tip_offset_m: Vector3<f64>,
    /// Length of the chain from the palm's first joint to the tip, in meters.
    pub length_m: f64,
    /// Whether this is likely to be the thumb; true of one finger at most.
    pub is_thumb: bool,
}

/// Largest effort of a joint that is a finger's, in newton meters: published files have 100 or 1000 where nobody
/// measured it.
const MAX_FINGER_NM: f64 = 20.0;

impl RobotModel {
    /// Returns the efforts of the joints that may be a finger's, in newton meters, the least first; none where the
    /// URDF has none.
    pub fn finger_efforts_nm(&self) -> Vec<f64> {
        let efforts = self.joints().iter().map(|joint| joint.effort);
        let mut efforts: Vec<f64> = efforts
            .filter(|effort| *effort > 0.0 && *effort <= MAX_FINGER_NM)
            .collect();
        efforts.sort_by(f64::total_cmp);
        efforts
    }

    /// Proposes the robot's fingers, in the order of its links; none if nothing moves.
    ///
    /// Links that are fixed to each other count as one body. The palm is the body from which the
    /// most moving bodies branch off, the nearest to the root if several do (the root itself if
    /// nothing branches), so that an arm, a forearm or a wrist before it is not a finger. Each moving
    /// body beyond the palm on which no other hangs ends a finger.
    /// Its tip is a fixed leaf of that body: one whose name (or whose joint's) has `tip` in it, else
    /// the farthest one that has a shape or a mass; frames that carry nothing are passed over.
    /// Where there is none the body's own far end is taken, as its collision shapes or, without
    /// any, twice the distance of its center of mass say.
    /// The thumb is the one finger that is named so; without names, the one of at least three that
    /// points least the way the others do when every joint is as near to 0 as its limits allow.
    ///
    /// It is a guess for people to check: linkages that close a loop in the real hand look like
    /// fingers, too.
    pub fn fingers(&self) -> Vec<Finger> {
        let body_of = self.bodies_of_links();
        let Some(palm_body) = self.palm_body(&body_of) else {
            return Vec::new();
        };
        let mut has_moving_child = vec![false; self.links().len()];
        let mut has_child = vec![false; self.links().len()];
        for link in self.links() {
            let Some(parent) = link.parent else { continue };
            has_child[parent] = true;
            if link.kind.is_some() {
                has_moving_child[body_of[parent]] = true;
            }
        }
        let base_from_links = self.link_poses(|joint| self.joints()[joint].nearest_zero());
        let mut fingers = Vec::new();
        for (body, link) in self.links().iter().enumerate() {
            if link.kind.is_none() || has_moving_child[body] {
                continue;
            }
            let leaves = (0..self.links().len())
                .filter(|&idx| idx != body && body_of[idx] == body && !has_child[idx]);
            let (tip_link, tip_offset_m) = self.tip(body, leaves, &base_from_links);
            let mut links: Vec<usize> = self
                .up_from(tip_link)
                .take_while(|&idx| body_of[idx] != palm_body)
                .collect();
            let Some(&last) = links.last() else { continue };
            // A body that hangs on the arm before the palm is not a finger.
            let Some(palm) = self.links()[last]
                .parent
                .filter(|&parent| body_of[parent] == palm_body)
            else {
                continue;
            };
            links.reverse();
            let mut joints = Vec::new();
            for joint in links.iter().filter_map(|&idx| self.links()[idx].joint) {
                if !joints.contains(&joint) {
                    joints.push(joint);
                }
            }
            let length_m = links
                .windows(2)
                .map(|pair| {
                    let [from, to] = [pair[0], pair[1]].map(|idx| &base_from_links[idx]);
                    (to.translation.vector - from.translation.vector).norm()
                })
                .sum::<f64>()
                + tip_offset_m.norm();
            fingers.push(Finger {
                palm,
                links,
                joints,
                tip_link,
                tip_offset_m,
                length_m,
                is_thumb: false,
            });
        }
        if let Some(thumb) = self
            .thumb_by_name(&fingers)
            .or_else(|| thumb_by_direction(&fingers, &base_from_links))
        {
            fingers[thumb].is_thumb = true;
        }
        fingers
    }

    /// Returns the independent joints of a finger that turn about the axis of its last joint when every joint
    /// is as near to 0 as its limits allow, and reach farther to positive positions: those that flex it.
    pub fn closing_joints(&self, finger: &Finger) -> Vec<usize> {
        /// Least cosine between two axes that count as one.
        const PARALLEL: f64 = 0.7;
        let base_from_links: Vec<Pose<Base, Link>> =
            self.link_poses(|joint| self.joints()[joint].nearest_zero());
        let moving = finger
            .links
            .iter()
            .filter(|&&idx| self.links()[idx].kind.is_some());
        let axes = moving.map(|&idx| {
            let link = &self.links()[idx];
            (link, base_from_links[idx].rotation * link.axis)
        });
        let axes: Vec<(&Link, _)> = axes.collect();
        let Some((_, last)) = axes.last() else {
            return Vec::new();
        };
        let closing = axes
            .iter()
            .filter(|(_, axis)| axis.dot(last).abs() > PARALLEL);
        let mut joints: Vec<usize> = closing.filter_map(|(link, _)| link.joint).collect();
        joints.retain(|&joint| self.joints()[joint].upper >= -self.joints()[joint].lower);
        joints.dedup();
        joints
    }

    /// Returns for each link the first link of the body that it is fixed to.
    pub(crate) fn bodies_of_links(&self) -> Vec<usize> {
        let mut body_of: Vec<usize> = Vec::with_capacity(self.links().len());
        for (idx, link) in self.links().iter().enumerate() {
            body_of.push(match link.parent {
                Some(parent) if link.kind.is_none() => body_of[parent],
                Some(_) | None => idx,
            });
        }
        body_of
    }

    /// Returns a link, its parent, and so on to the root.
    pub fn up_from(&self, link: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(link), |&idx| self.links()[idx].parent)
    }

    /// Returns the body from which the most moving bodies branch off; none if nothing moves.
    fn palm_body(&self, body_of: &[usize]) -> Option<usize> {
        let mut n_branches = vec![0_usize; self.links().len()];
        for link in self.links() {
            if let (Some(parent), Some(_)) = (link.parent, link.kind) {
                n_branches[body_of[parent]] += 1;
            }
        }
        let most = n_branches.iter().copied().max().filter(|&most| most > 0)?;
        if most == 1 {
            return Some(0);
        }
        n_branches.iter().position(|&n| n == most)
    }

    /// Returns the link of a finger's last body that is nearest to its tip, and the tip's offset.
    fn tip(
        &self,
        body: usize,
        leaves: impl Iterator<Item = usize>,
        base_from_links: &[Pose<Base, Link>],
    ) -> (usize, Vector3<f64>) {
        let rank = |idx: usize| {
            let link = &self.links()[idx];
            let joint = link.joint_name.as_deref().unwrap_or_default();
            let is_named = [&link.name, joint]
                .iter()
                .any(|name| name.to_lowercase().contains("tip"));
            let carries = link.inertial.is_some() || !link.collisions.is_empty();
            let [body, tip] = [body, idx].map(|idx| base_from_links[idx].translation.vector);
            let rank = (is_named, carries, (tip - body).norm());
            (is_named || carries).then_some((rank, idx))
        };
        let best = leaves
            .filter_map(rank)
            .max_by(|(a, _), (b, _)| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        match best {
            Some((_, tip)) => (tip, Vector3::zeros()),
            None => (body, far_end(&self.links()[body])),
        }
    }

    /// Returns the only finger that its names call a thumb.
    fn thumb_by_name(&self, fingers: &[Finger]) -> Option<usize> {
        let is_named = |finger: &&Finger| {
            let names: Vec<String> = finger
                .links
                .iter()
                .map(|&idx| self.links()[idx].name.to_lowercase())
                .collect();
            // The Shadow hand's links are called `thbase`, `rh_thproximal` and so on.
            let is_short = |name: &String| {
                name.rsplit(|c: char| !c.is_alphanumeric())
                    .next()
                    .is_some_and(|word| word.starts_with("th") && !word.starts_with("third"))
            };
            names.iter().any(|name| name.contains("thumb")) || names.iter().all(is_short)
        };
        let mut named = (0..fingers.len()).filter(|&idx| is_named(&&fingers[idx]));
        let first = named.next()?;
        named.next().is_none().then_some(first)
    }
}

/// Returns the finger that points least the way the others do, if there are at least three.
fn thumb_by_direction(fingers: &[Finger], base_from_links: &[Pose<Base, Link>]) -> Option<usize> {
    if fingers.len() < 3 {
        return None;
    }
    let directions: Vec<Vector3<f64>> = fingers
        .iter()
        .map(|finger| {
            let base = base_from_links[finger.links[0]].translation.vector;
            let tip = base_from_links[finger.tip_link] * Point3::from(finger.tip_offset_m);
            (tip.coords - base)
                .try_normalize(1e-9)
                .unwrap_or_else(Vector3::zeros)
        })
        .collect();
    let sum: Vector3<f64> = directions.iter().sum();
    let agreement = |direction: &Vector3<f64>| direction.dot(&(sum - direction));
    let least = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
    directions
        .iter()
        .map(agreement)
        .enumerate()
        .min_by(least)
        .map(|(idx, _)| idx)
}

/// Returns the point of a link that is farthest along the direction of its shapes' middle (or of
/// its center of mass, if it has no shape), in its frame in meters.
fn far_end(link: &Link) -> Vector3<f64> {
    const MIN_LENGTH_M: f64 = 1e-6;
    let n = link.collisions.len() as f64;
    let middle: Vector3<f64> = link
        .collisions
        .iter()
        .map(|collision| collision.link_from_shape.translation.vector / n)
        .sum();
    if let Some(direction) = middle.try_normalize(MIN_LENGTH_M) {
        let far = link
            .collisions
            .iter()
            .map(|collision| collision.reach(&direction))
            .fold(0.0, f64::max);
        return direction * far;
    }
    link.inertial
        .as_ref()
        .map(|inertial| inertial.center_of_mass_m.coords * 2.0)
        .filter(|_| link.kind != Some(JointKind::Prismatic))
        .unwrap_or_else(Vector3::zeros)
}

impl crate::Collision {
    /// Returns the extent of the shape along a unit vector of its link's frame, from the link's
    /// origin, in meters.
    pub(crate) fn reach(&self, direction: &Vector3<f64>) -> f64 {
        let center = self.link_from_shape.translation.vector.dot(direction);
        let local = self.link_from_shape.rotation.inverse() * direction;
        center + self.shape.extent_m(&local)
    }
}
