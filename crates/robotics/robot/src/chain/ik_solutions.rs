//! All ways in which a chain's end can be at one pose.

use std::f64::consts::{PI, TAU};

use spatial::{Base, Palm, Pose};

use super::Chain;
use crate::{Joint, JointKind};

/// Places from which solutions are sought. For the xArm 6 they find 998 of 1,000 that a thousand places
/// find, and 48 find 991.
const STARTS: usize = 64;
/// Solutions are the same if no joint differs by more than this, in radians (meters if prismatic).
const SAME_SOLUTION_Q: f64 = 1e-5;

impl Chain {
    /// Returns the joint positions with which the end is at `base_from_palm`, within the limits or not, as
    /// [`Chain::inverse_kinematics`] finds them from 64 places; those that differ by whole turns once, with every
    /// joint as near the middle of its limits as turns bring it.
    pub fn ik_solutions(&self, base_from_palm: &Pose<Base, Palm>) -> Vec<Vec<f64>> {
        self.solutions_from(STARTS, base_from_palm)
    }

    /// Returns the joint positions within the limits with which the end is at `base_from_palm`: that to which damped
    /// least squares come from `near`, else the nearest one of [`Chain::ik_solutions`]. `None` if none is found.
    pub fn solution_near(
        &self,
        base_from_palm: &Pose<Base, Palm>,
        near: &[f64],
    ) -> Option<Vec<f64>> {
        let is_within = |q: &Vec<f64>| {
            let mut joints = self.links.joints.iter().zip(q);
            joints.all(|(joint, q)| (joint.lower..=joint.upper).contains(q))
        };
        let direct = self.inverse_kinematics(base_from_palm, near);
        direct.filter(is_within).or_else(|| {
            let distance = |q: &Vec<f64>| -> f64 {
                let pairs = q.iter().zip(near);
                pairs.map(|(q, near)| (q - near).powi(2)).sum()
            };
            let within = self
                .ik_solutions(base_from_palm)
                .into_iter()
                .filter(is_within);
            within.min_by(|a, b| distance(a).total_cmp(&distance(b)))
        })
    }

    fn solutions_from(&self, starts_n: usize, base_from_palm: &Pose<Base, Palm>) -> Vec<Vec<f64>> {
        let mut found: Vec<Vec<f64>> = Vec::new();
        for start in self.starts(starts_n) {
            let Some(mut q) = self.inverse_kinematics(base_from_palm, &start) else {
                continue;
            };
            for (joint, q) in self.links.joints.iter().zip(&mut q) {
                *q = centered(joint, *q);
            }
            if !found.iter().any(|other| self.is_same(other, &q)) {
                found.push(q);
            }
        }
        found
    }

    /// Whether two solutions differ by whole turns at most.
    fn is_same(&self, a: &[f64], b: &[f64]) -> bool {
        let pairs = self.links.joints.iter().zip(a.iter().zip(b));
        pairs.into_iter().all(|(joint, (a, b))| {
            let off = a - b;
            let off = match joint.kind {
                JointKind::Prismatic => off,
                JointKind::Revolute | JointKind::Continuous => off - TAU * (off / TAU).round(),
            };
            off.abs() < SAME_SOLUTION_Q
        })
    }

    /// Returns places spread evenly over the joints' ranges, the same ones always: multiples of the
    /// powers of the generalized golden ratio (Roberts, *The Unreasonable Effectiveness of
    /// Quasirandom Sequences*, 2018).
    fn starts(&self, n: usize) -> impl Iterator<Item = Vec<f64>> + '_ {
        let mut ratio: f64 = 1.5;
        for _ in 0..64 {
            ratio = (1.0 + ratio).powf(1.0 / (self.dof() as f64 + 1.0));
        }
        (0..n).map(move |start| {
            let mut power = 1.0;
            self.links
                .joints
                .iter()
                .map(|joint| {
                    power /= ratio;
                    let share = (0.5 + power * (start as f64 + 1.0)).fract();
                    let [low, high] = range(joint);
                    low + share * (high - low)
                })
                .collect()
        })
    }
}

/// Returns where a joint's positions differ by more than turns: all of its limits, or one turn in the
/// middle of them.
fn range(joint: &Joint) -> [f64; 2] {
    let middle = joint.middle();
    match joint.kind {
        JointKind::Prismatic => [joint.lower, joint.upper],
        JointKind::Continuous => [-PI, PI],
        JointKind::Revolute => [joint.lower.max(middle - PI), joint.upper.min(middle + PI)],
    }
}

/// Returns a joint's position turned to be as near the middle of its limits as can be.
fn centered(joint: &Joint, q: f64) -> f64 {
    match joint.kind {
        JointKind::Prismatic => q,
        JointKind::Revolute | JointKind::Continuous => {
            q - TAU * ((q - joint.middle()) / TAU).round()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RobotModel;

    /// Of the postures of poses in reach, a thousand starts find next to none that the usual ones miss.
    #[test]
    fn more_starts_find_no_more() {
        let urdf = include_str!("../../../../../data/robots/xarm6_allegro.urdf");
        let robot = RobotModel::from_urdf(urdf).unwrap();
        let chain = Chain::to_link(&robot, "base_link").unwrap();
        let (mut usual, mut many) = (0, 0);
        for q in chain.starts(60) {
            let at = chain.state(&q).unwrap();
            if at.is_regular(0.02) {
                usual += chain.ik_solutions(&at.base_from_palm).len();
                many += chain.solutions_from(1000, &at.base_from_palm).len();
            }
        }
        println!("{usual} of {many} postures");
        assert!(many > 300 && usual * 100 >= many * 99, "{usual} of {many}");
    }
}
