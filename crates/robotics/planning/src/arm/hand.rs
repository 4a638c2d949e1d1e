//! The hand on the arm, and the hand for which motions are made.

use options::OptionFault;
use robot::{Chain, Joint, JointKind, Link, RobotModel};
use spatial::{Base, Palm, Pose};

/// Tolerance on link poses between the two descriptions, in meters and radians.
const LINK_TOLERANCE: f64 = 1e-9;
/// Shares of the joints' ranges at which two descriptions that are not of one hand differ.
const SAMPLES: [f64; 3] = [0.1, 0.5, 0.9];

/// Returns the index in `robot` of each joint of the hand.
///
/// # Errors
///
/// Fails if the links of `robot` beyond its link `palm` are not the hand: if a joint or link is missing,
/// one is there that is neither the arm's nor the hand's, or the hand's links have other poses.
pub(crate) fn joints_of_hand(
    robot: &RobotModel,
    chain: &Chain,
    palm: usize,
    hand: &RobotModel,
) -> Result<Vec<usize>, OptionFault> {
    let carried = beyond(robot, palm);
    let is_carried = |link: usize| carried[link];
    let joints = hand
        .joints()
        .iter()
        .map(|joint| {
            let found = robot.joint(&joint.name);
            let link = |idx: usize| robot.joints().get(idx).map(|joint| joint.link);
            let found = found.filter(|&idx| link(idx).is_some_and(is_carried));
            found.ok_or_else(|| wrong(&format!("there is no joint `{}`", joint.name)))
        })
        .collect::<Result<Vec<usize>, _>>()?;
    for (idx, joint) in robot.joints().iter().enumerate() {
        if !joints.contains(&idx) && !chain.joints().contains(&idx) {
            let problem = format!("joint `{}` is neither the arm's nor the hand's", joint.name);
            return Err(wrong(&problem));
        }
    }
    for share in SAMPLES {
        let q: Vec<f64> = hand.joints().iter().map(|joint| at(joint, share)).collect();
        let palm_from_links = hand.link_poses::<Palm>(|joint| q[joint]);
        let mut all = vec![0.0; robot.dof()];
        for (&joint, &q) in joints.iter().zip(&q) {
            all[joint] = q;
        }
        let base_from_links = robot.link_poses::<Base>(|joint| all[joint]);
        // The hand's root is the palm, whatever it is called.
        let base_from_palm = base_from_links[palm].reinterpret::<Base, Palm>();
        for (link, palm_from_link) in hand.links().iter().zip(&palm_from_links).skip(1) {
            let ours = robot.link(&link.name).filter(|&idx| is_carried(idx));
            let Some(found) = ours.map(|idx| base_from_links[idx]) else {
                return Err(wrong(&format!("there is no link `{}`", link.name)));
            };
            let off = off(&(base_from_palm.inverse() * found), palm_from_link);
            if off > LINK_TOLERANCE {
                let problem = format!(
                    "link `{}` is {off:.1e} (m or rad) from where the hand's own URDF has it",
                    link.name
                );
                return Err(wrong(&problem));
            }
        }
    }
    Ok(joints)
}

/// Returns for each link whether it is the palm or hangs on it.
pub(crate) fn beyond(robot: &RobotModel, palm: usize) -> Vec<bool> {
    let mut carried: Vec<bool> = Vec::with_capacity(robot.links().len());
    // Parents come before their children.
    for (idx, link) in robot.links().iter().enumerate() {
        let hangs = link.parent.and_then(|parent| carried.get(parent).copied());
        carried.push(idx == palm || hangs == Some(true));
    }
    carried
}

/// Returns the position of a joint at a share of its range (rad, where it has none).
fn at(joint: &Joint, share: f64) -> f64 {
    match joint.kind {
        JointKind::Continuous => share,
        JointKind::Revolute | JointKind::Prismatic => {
            joint.lower + share * (joint.upper - joint.lower)
        }
    }
}

fn off(a: &Pose<Palm, Link>, b: &Pose<Palm, Link>) -> f64 {
    let distance = (a.translation.vector - b.translation.vector).norm();
    // The angle of a small turn, from the vector part: the cosine has lost it.
    let turn = (a.rotation * b.rotation.inverse()).vector().norm() * 2.0;
    distance.max(turn)
}

fn wrong(problem: &str) -> OptionFault {
    let problem = format!("the links below `arm.palm` differ from the hand in `hand`: {problem}");
    OptionFault::new("arm.robot", problem)
}
