//! Joint names on the wire, where a cell's drivers use other names than the URDF.

use std::collections::{BTreeMap, BTreeSet};

use cell::{Goal, PalmTrajectory};
use options::OptionFault;
use robot::{Joint, RobotModel};

use crate::DispatchError;

/// The names of joints on the wire.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointNames {
    /// By the URDF's names.
    on_wire: BTreeMap<String, String>,
    /// By the names on the wire.
    in_urdf: BTreeMap<String, String>,
}

impl JointNames {
    /// Creates the mapping from the names that differ from the hand URDF's.
    pub(crate) fn new(
        named: &BTreeMap<String, String>,
        hand: &RobotModel,
    ) -> Result<Self, DispatchError> {
        let wrong = |problem: String| DispatchError::from(OptionFault::new("joint_names", problem));
        let joints: Vec<&String> = named.keys().collect();
        hand.require_joints(&joints)
            .map_err(|err| wrong(err.to_string()))?;
        let mut taken = BTreeSet::new();
        for joint in hand.joint_names() {
            let name = named.get(&joint).unwrap_or(&joint);
            if name.is_empty() || !taken.insert(name.clone()) {
                return Err(wrong(format!(
                    "joint `{joint}` would be `{name}` on the wire, which is empty or another joint's name"
                )));
            }
        }
        let swapped = named
            .iter()
            .map(|(joint, name)| (name.clone(), joint.clone()));
        Ok(Self {
            on_wire: named.clone(),
            in_urdf: swapped.collect(),
        })
    }

    /// Renames a goal's joints to their names on the wire.
    pub(crate) fn to_wire(&self, goal: &mut Goal) {
        let names = goal.hand.joints.iter_mut();
        rename(&self.on_wire, names.chain(&mut goal.grasp.flexion_joints));
        if let PalmTrajectory::Arm(arm) = &mut goal.carrier {
            rename(&self.on_wire, &mut arm.joints);
        }
    }

    /// Renames joints to their names in the robot's URDF.
    pub(crate) fn to_urdf(&self, joints: &mut [String]) {
        rename(&self.in_urdf, joints);
    }

    /// Returns a robot's joints under their names on the wire.
    pub(crate) fn joints_on_wire(&self, robot: &RobotModel) -> Vec<Joint> {
        let mut joints = robot.joints().to_vec();
        rename(
            &self.on_wire,
            joints.iter_mut().map(|joint| &mut joint.name),
        );
        joints
    }
}

fn rename<'a>(names: &BTreeMap<String, String>, joints: impl IntoIterator<Item = &'a mut String>) {
    for joint in joints {
        if let Some(name) = names.get(joint) {
            joint.clone_from(name);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HAND: &str = r#"<robot name="hand">
  <link name="palm"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/></joint>
  <joint name="jb" type="revolute"><parent link="palm"/><child link="b"/>
    <limit lower="-3" upper="3" effort="1" velocity="7"/></joint>
  <joint name="jc" type="prismatic"><parent link="palm"/><child link="c"/>
    <limit lower="-3" upper="3" effort="1" velocity="0.5"/></joint>
</robot>"#;

    fn names(named: &[(&str, &str)]) -> Result<JointNames, DispatchError> {
        let named = named
            .iter()
            .map(|(joint, name)| ((*joint).to_owned(), (*name).to_owned()));
        JointNames::new(&named.collect(), &RobotModel::from_urdf(HAND).unwrap())
    }

    #[test]
    fn joints_go_out_and_come_back() {
        // Even with two names exchanged.
        let names = names(&[("ja", "jb"), ("jb", "ja"), ("jc", "ah_joint02")]).unwrap();
        let mut joints = ["ah_joint02", "ja", "jb"].map(str::to_owned);
        names.to_urdf(&mut joints);
        assert_eq!(joints, ["jc", "jb", "ja"]);
        let robot = RobotModel::from_urdf(HAND).unwrap();
        let out = names.joints_on_wire(&robot);
        let out: Vec<&str> = out.iter().map(|joint| joint.name.as_str()).collect();
        assert_eq!(out[..3], ["jb", "ja", "ah_joint02"]);
    }

    #[test]
    fn names_that_are_unknown_or_doubled_are_refused() {
        let refused = |named: &[(&str, &str)]| names(named).unwrap_err().to_string();
        assert!(refused(&[("jx", "a")]).contains("`jx`"));
        assert!(refused(&[("ja", "a"), ("jb", "a")]).contains("`a`"));
        // `jb` keeps its own name.
        assert!(refused(&[("ja", "jb")]).contains("`jb`"));
        assert!(refused(&[("ja", "")]).contains("`ja`"));
        assert!(names(&[]).is_ok());
    }
}
