//! Joints whose positions follow those of others.

use std::collections::BTreeMap;

use super::parts::{kind, range};
use crate::{
    Finding, Joint, JointKind, MimicFault, RobotError,
    findings::{Part, Severity},
    near_names::near_names,
};

/// A joint's own position is `multiplier * q + offset`, with `q` that of an independent joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Follower {
    /// The independent joint, by its place in the file.
    pub(super) master: usize,
    pub(super) multiplier: f64,
    pub(super) offset: f64,
}

/// Returns the independent joint that each mimic joint follows in the end, through any number of
/// others; `None` for those that mimic none.
pub(super) fn followers(joints: &[urdf_rs::Joint]) -> Result<Vec<Option<Follower>>, RobotError> {
    let by_name: BTreeMap<&str, usize> = joints
        .iter()
        .enumerate()
        .map(|(idx, joint)| (joint.name.as_str(), idx))
        .collect();
    joints
        .iter()
        .map(|joint| match kind(joint).and(joint.mimic.as_ref()) {
            Some(_) => follow(joints, &by_name, joint).map(Some),
            None => Ok(None),
        })
        .collect()
}

fn follow(
    joints: &[urdf_rs::Joint],
    by_name: &BTreeMap<&str, usize>,
    joint: &urdf_rs::Joint,
) -> Result<Follower, RobotError> {
    let bad = |master: &str, fault| RobotError::BadMimic {
        joint: joint.name.clone(),
        master: master.to_owned(),
        fault,
    };
    let (mut current, mut multiplier, mut offset) = (joint, 1.0, 0.0);
    let mut last = "";
    // One turn per joint at most: more is a loop.
    for _ in 0..=joints.len() {
        let Some(mimic) = &current.mimic else { break };
        last = &mimic.joint;
        let &master = by_name.get(last).ok_or_else(|| {
            let near = near_names(last, by_name.keys().copied());
            bad(last, MimicFault::Unknown { near })
        })?;
        offset += multiplier * mimic.offset.unwrap_or(0.0);
        multiplier *= mimic.multiplier.unwrap_or(1.0);
        current = &joints[master];
        if kind(current).is_none() {
            return Err(bad(last, MimicFault::Fixed));
        }
        if !(f64::is_finite(multiplier) && f64::is_finite(offset)) {
            return Err(bad(last, MimicFault::NotFinite));
        }
        if current.mimic.is_none() {
            return Ok(Follower {
                master,
                multiplier,
                offset,
            });
        }
    }
    Err(bad(last, MimicFault::Loop))
}

/// Narrows a joint's limits to where one that follows it stays inside its own; one that turns without
/// end is revolute if it gets limits so.
pub(super) fn narrow(
    joint: &mut Joint,
    follower: &urdf_rs::Joint,
    by: Follower,
    findings: &mut Vec<Finding>,
) {
    /// Limits that were rounded when they were written, in radians or meters.
    const ROUNDED: f64 = 1e-4;
    let (lower, upper) = range(follower);
    let mut ends = [lower, upper].map(|end| (end - by.offset) / by.multiplier);
    if by.multiplier < 0.0 {
        ends.reverse();
    }
    let [from, to] = ends;
    if by.multiplier == 0.0 || from.is_nan() || to.is_nan() {
        return;
    }
    let (lower, upper) = (joint.lower.max(from), joint.upper.min(to));
    let part = Part::Joint(follower.name.clone());
    if lower > upper {
        findings.push(Finding {
            severity: Severity::Wrong,
            part,
            problem: format!(
                "follows `{}` and is outside its own limits wherever that one may be; its own \
                 limits are passed over",
                joint.name
            ),
            advice: "correct its limits, or the multiplier or offset of its `<mimic>`".to_owned(),
        });
        return;
    }
    if lower > joint.lower + ROUNDED || upper < joint.upper - ROUNDED {
        findings.push(Finding {
            severity: Severity::Note,
            part,
            problem: format!(
                "reaches its limits before `{}`, which it follows: that one is kept within \
                 {lower:.4} to {upper:.4}",
                joint.name
            ),
            advice: String::new(),
        });
    }
    (joint.lower, joint.upper) = (lower, upper);
    if joint.kind == JointKind::Continuous && lower.is_finite() && upper.is_finite() {
        joint.kind = JointKind::Revolute;
    }
}
