//! Pairs of a robot's collision shapes that can meet.

use spatial::{Base, Pose};

use crate::{Link, RobotModel, Shape, distance_bounds};

/// Two collision shapes that can meet, by their numbers: the shapes of the first link come first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShapePair {
    /// Number of the first.
    pub first: usize,
    /// Number of the second, greater than the first's.
    pub second: usize,
    /// How near their bodies are in the tree.
    pub kinship: Kinship,
}

/// A collision shape of a hand, and what else of the hand it touches.
///
/// Different fingers touch each other, links of one finger never do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HandShape {
    /// Number of its link.
    pub link: usize,
    /// Number of its finger, from 0 in the order of the links; `None` for the palm's shapes.
    pub finger: Option<usize>,
    /// Whether a finger's shape touches the palm: it is not of the link next to it, and overlaps none of the palm's
    /// shapes with all joints at zero.
    pub touches_palm: bool,
}

impl HandShape {
    /// Says whether two shapes touch each other.
    pub fn touches(&self, other: &Self) -> bool {
        match [self.finger, other.finger] {
            [Some(finger), Some(other)] => finger != other,
            [None, None] => false,
            _ => self.touches_palm || other.touches_palm,
        }
    }
}

/// How near two bodies are in a robot's tree, of those without a joint between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kinship {
    /// One hangs on a body that hangs on the other: they come near each other by design, and the limits of two joints
    /// keep them apart.
    Grandparent,
    /// Both hang on the same body.
    Siblings,
    /// Farther apart.
    Far,
}

impl RobotModel {
    /// Returns a hand's collision shapes in the order of its links: those of the body of its root link are the palm's,
    /// and each body on it begins a finger.
    pub fn hand_shapes(&self) -> Vec<HandShape> {
        let bodies = self.bodies_of_links();
        let mut finger_of: Vec<Option<usize>> = vec![None; bodies.len()];
        let mut finger_n = 0;
        for (idx, link) in self.links().iter().enumerate() {
            let Some(parent) = link.parent else { continue };
            finger_of[idx] = finger_of[parent];
            if link.kind.is_some() && finger_of[parent].is_none() {
                finger_of[idx] = Some(finger_n);
                finger_n += 1;
            }
        }
        let links = self.links().iter().enumerate();
        let shapes = links.flat_map(|(link, body)| body.collisions.iter().map(move |_| link));
        let mut shapes: Vec<HandShape> = shapes
            .map(|link| HandShape {
                link,
                finger: finger_of[link],
                touches_palm: false,
            })
            .collect();
        let palm_n = shapes.iter().filter(|shape| shape.finger.is_none()).count();
        let mut met_n = vec![0; shapes.len()];
        for pair in self.shape_pairs(|a, b| finger_of[a].is_some() != finger_of[b].is_some()) {
            met_n[pair.first] += 1;
            met_n[pair.second] += 1;
        }
        for (shape, met_n) in shapes.iter_mut().zip(met_n) {
            shape.touches_palm = shape.finger.is_some() && met_n == palm_n;
        }
        shapes
    }

    /// Returns the pairs of collision shapes of different links that can meet, of those that `counts` says of by their
    /// links.
    ///
    /// Links that are fixed to each other are one body. Left out are shapes of one body, those of two
    /// bodies with a joint between them, which touch there, and those that touch or overlap where all
    /// joints are at zero, or at the limit nearest to it: neighbors whose shapes are rougher than they are.
    pub fn shape_pairs(&self, counts: impl Fn(usize, usize) -> bool) -> Vec<ShapePair> {
        let bodies = self.bodies_of_links();
        // The body's parent, if it has one.
        let below = |body: usize| Some(bodies[self.links().get(body)?.parent?]);
        let base_from_links = self.link_poses::<Base>(|joint| self.joints()[joint].nearest_zero());
        let links = self.links().iter().enumerate();
        let shapes: Vec<(usize, Pose<Base, Shape>, &Shape)> = links
            .flat_map(|(link, body)| {
                let pose: Pose<Base, Link> = base_from_links[link];
                let shapes = body.collisions.iter();
                shapes.map(move |collision| {
                    (link, pose * collision.link_from_shape, &collision.shape)
                })
            })
            .collect();
        let mut pairs = Vec::new();
        for (first, (link_a, at_a, a)) in shapes.iter().enumerate() {
            for (second, (link_b, at_b, b)) in shapes.iter().enumerate().skip(first + 1) {
                let [of_a, of_b] = [bodies[*link_a], bodies[*link_b]];
                let [under_a, under_b] = [of_a, of_b].map(below);
                let touch = of_a == of_b || under_a == Some(of_b) || under_b == Some(of_a);
                if touch
                    || !counts(*link_a, *link_b)
                    || distance_bounds((at_a, a), (at_b, b)).at_least_m <= 0.0
                {
                    continue;
                }
                let is_below =
                    under_a.and_then(below) == Some(of_b) || under_b.and_then(below) == Some(of_a);
                let kinship = if is_below {
                    Kinship::Grandparent
                } else if under_a.is_some() && under_a == under_b {
                    Kinship::Siblings
                } else {
                    Kinship::Far
                };
                pairs.push(ShapePair {
                    first,
                    second,
                    kinship,
                });
            }
        }
        pairs
    }
}
