//! From links and joints in any order to a tree.

use std::collections::BTreeMap;

use urdf_rs::{Joint, Link};

use crate::{RobotError, near_names::near_names};

/// A link's place in the tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct TreePosition {
    /// Index of the link in the file.
    pub(super) link: usize,
    /// Index in the file of the joint that it hangs on.
    pub(super) joint: Option<usize>,
    /// Index of its parent's place.
    pub(super) parent: Option<usize>,
}

/// Returns the place of each name; two of one name are refused.
pub(super) fn by_name<'a>(
    what: &'static str,
    names: impl Iterator<Item = &'a str>,
) -> Result<BTreeMap<&'a str, usize>, RobotError> {
    let mut by_name = BTreeMap::new();
    for (idx, name) in names.enumerate() {
        if by_name.insert(name, idx).is_some() {
            return Err(RobotError::Duplicate {
                what,
                name: name.to_owned(),
            });
        }
    }
    Ok(by_name)
}

/// Returns every link with the joint it hangs on, depth first, in the order of the file.
pub(super) fn walk(links: &[Link], joints: &[Joint]) -> Result<Vec<TreePosition>, RobotError> {
    let link_of = by_name("link", links.iter().map(|link| link.name.as_str()))?;
    by_name("joint", joints.iter().map(|joint| joint.name.as_str()))?;
    let find = |joint: &Joint, role: &'static str, name: &str| {
        link_of
            .get(name)
            .copied()
            .ok_or_else(|| RobotError::UnknownLink {
                joint: joint.name.clone(),
                role,
                link: name.to_owned(),
                near: near_names(name, link_of.keys().copied()),
            })
    };
    let mut parent_joint: Vec<Option<usize>> = vec![None; links.len()];
    // Links that hang on each link, with their joints.
    let mut children: Vec<Vec<(usize, usize)>> = vec![Vec::new(); links.len()];
    for (idx, joint) in joints.iter().enumerate() {
        let parent = find(joint, "parent", &joint.parent.link)?;
        let child = find(joint, "child", &joint.child.link)?;
        if let Some(first) = parent_joint[child].replace(idx) {
            return Err(RobotError::TwoParents {
                link: joint.child.link.clone(),
                first: joints[first].name.clone(),
                second: joint.name.clone(),
            });
        }
        children[parent].push((child, idx));
    }
    let name = |link: usize| links[link].name.clone();
    if links.is_empty() {
        return Err(RobotError::NoLink);
    }
    let mut orphans = (0..links.len()).filter(|&link| parent_joint[link].is_none());
    let root = orphans
        .next()
        .ok_or_else(|| RobotError::Loop { link: name(0) })?;
    if let Some(second) = orphans.next() {
        return Err(RobotError::TwoRoots {
            first: name(root),
            second: name(second),
        });
    }
    let mut order = Vec::with_capacity(links.len());
    let mut is_reached = vec![false; links.len()];
    let mut stack = vec![TreePosition {
        link: root,
        joint: None,
        parent: None,
    }];
    while let Some(place) = stack.pop() {
        let parent = Some(order.len());
        order.push(place);
        is_reached[place.link] = true;
        stack.extend(
            children[place.link]
                .iter()
                .rev()
                .map(|&(link, joint)| TreePosition {
                    link,
                    joint: Some(joint),
                    parent,
                }),
        );
    }
    // Each link has at most one parent, so a link that the walk misses hangs on a loop.
    match is_reached.iter().position(|&reached| !reached) {
        Some(missed) => Err(RobotError::Loop { link: name(missed) }),
        None => Ok(order),
    }
}
