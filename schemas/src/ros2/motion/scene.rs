//! The scene of a recording: a hand and an object in motion.

use nalgebra::Isometry3;

use super::{OBJECT, OBJECT_COLOR, START_NS, TABLE, stamp_ns, transform_stamped};
use crate::ros2::{JointState, MarkerArray, Text, TfMessage, TransformStamped};

/// The static part of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The hand's URDF.
    pub urdf: &'a str,
    /// Names of its movable joints.
    pub joints: &'a [String],
    /// Its links.
    pub hand: &'a Hand,
    /// Pose of each link at any joint positions; fixed links are taken from it.
    pub palm_from_links: &'a [Isometry3<f64>],
    /// Vertices of the object's mesh, object frame, in meters.
    pub vertices_m: &'a [[f64; 3]],
    /// Triangles of the object's mesh.
    pub triangles: &'a [[u32; 3]],
}

/// One moment of a motion.
#[derive(Debug, Clone, Copy)]
pub struct SceneStep<'a> {
    /// Seconds since the motion's first step.
    pub time_s: f64,
    /// Pose of the palm.
    pub table_from_palm: Isometry3<f64>,
    /// Pose of the object.
    pub table_from_object: Isometry3<f64>,
    /// Pose of each link, in the order of [`Scene::hand`].
    pub palm_from_links: &'a [Isometry3<f64>],
    /// Joint positions in radians, in the order of [`Scene::joints`].
    pub q_rad: &'a [f64],
    /// Joint velocities in rad/s; empty if not known.
    pub q_velocity_rad_per_s: &'a [f64],
}

impl SceneStep<'_> {
    /// Returns the step's stamp in nanoseconds.
    pub fn time_ns(&self) -> i64 {
        stamp_ns(self.time_s)
    }
}

impl Scene<'_> {
    /// Returns the hand's URDF, for [`super::ROBOT_DESCRIPTION`].
    pub fn description(&self) -> Text {
        super::robot_description(self.urdf)
    }

    /// Returns the fixed links' poses, for [`super::TF_STATIC`].
    pub fn fixed(&self) -> TfMessage {
        self.hand.fixed(START_NS, self.palm_from_links)
    }

    /// Returns the object's mesh, for [`super::MARKERS`].
    pub fn shapes(&self) -> MarkerArray {
        super::markers([super::mesh_marker(
            START_NS,
            OBJECT,
            self.vertices_m,
            self.triangles,
            OBJECT_COLOR,
        )])
    }

    /// Returns the joint positions, for [`super::JOINT_STATES`].
    pub fn state(&self, step: &SceneStep<'_>) -> JointState {
        super::joint_state(
            step.time_ns(),
            self.joints,
            step.q_rad,
            step.q_velocity_rad_per_s,
        )
    }

    /// Returns the poses of the hand's links and of the object, for [`super::TF`].
    pub fn poses(&self, step: &SceneStep<'_>) -> TfMessage {
        let time_ns = step.time_ns();
        let mut poses = self
            .hand
            .moving(time_ns, &step.table_from_palm, step.palm_from_links);
        poses.transforms.push(transform_stamped(
            time_ns,
            TABLE,
            OBJECT,
            &step.table_from_object,
        ));
        poses
    }
}

/// A link of a hand, as [`Hand`] needs it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HandLink {
    /// Its name in the URDF.
    pub name: String,
    /// Index of its parent link, which comes before it; none for the root.
    pub parent: Option<usize>,
    /// Whether a joint moves it relative to its parent.
    pub moves: bool,
}

/// The links of a hand, parents before children, the root (palm) first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hand {
    links: Vec<HandLink>,
}

impl Hand {
    /// Returns a hand with these links, in the order of the poses given later.
    pub fn new(links: impl IntoIterator<Item = HandLink>) -> Self {
        Self {
            links: links.into_iter().collect(),
        }
    }

    /// Returns the poses that change, for `TF`: the root in the table's frame and every moving
    /// link in its parent's. `palm_from_links` holds one pose per link.
    pub fn moving(
        &self,
        time_ns: i64,
        table_from_palm: &Isometry3<f64>,
        palm_from_links: &[Isometry3<f64>],
    ) -> TfMessage {
        let root = self
            .links
            .first()
            .map(|link| transform_stamped(time_ns, TABLE, &link.name, table_from_palm));
        let mut transforms: Vec<TransformStamped> = root.into_iter().collect();
        transforms.extend(self.below_parents(time_ns, palm_from_links, |link| link.moves));
        TfMessage { transforms }
    }

    /// Returns the poses that never change, for `TF_STATIC`: links fixed to their parents.
    pub fn fixed(&self, time_ns: i64, palm_from_links: &[Isometry3<f64>]) -> TfMessage {
        TfMessage {
            transforms: self
                .below_parents(time_ns, palm_from_links, |link| !link.moves)
                .collect(),
        }
    }

    fn below_parents(
        &self,
        time_ns: i64,
        palm_from_links: &[Isometry3<f64>],
        wanted: impl Fn(&HandLink) -> bool,
    ) -> impl Iterator<Item = TransformStamped> {
        self.links
            .iter()
            .zip(palm_from_links)
            .filter(move |(link, _)| wanted(link))
            .filter_map(move |(link, palm_from_link)| {
                let parent = link.parent?;
                let parent_from_palm = palm_from_links.get(parent)?.inverse();
                Some(transform_stamped(
                    time_ns,
                    &self.links.get(parent)?.name,
                    &link.name,
                    &(parent_from_palm * palm_from_link),
                ))
            })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn link(name: &str, parent: Option<usize>, moves: bool) -> HandLink {
        HandLink {
            name: name.to_owned(),
            parent,
            moves,
        }
    }

    #[test]
    fn every_link_hangs_below_its_parent_once() {
        let hand = Hand::new([
            link("palm", None, false),
            link("finger", Some(0), true),
            link("tip", Some(1), false),
        ]);
        let at = |z| Isometry3::new(Vector3::new(0.0, 0.0, z), Vector3::zeros());
        let poses = [at(0.0), at(0.1), at(0.15)];
        let names = |tf: &TfMessage| -> Vec<(String, String, f64)> {
            tf.transforms
                .iter()
                .map(|t| {
                    let up = (t.transform.translation.z * 1e6).round() / 1e6;
                    (t.header.frame_id.clone(), t.child_frame_id.clone(), up)
                })
                .collect()
        };
        let row = |parent: &str, child: &str, up| (parent.to_owned(), child.to_owned(), up);
        assert_eq!(
            names(&hand.moving(START_NS, &at(0.5), &poses)),
            [row("table", "palm", 0.5), row("palm", "finger", 0.1)]
        );
        assert_eq!(
            names(&hand.fixed(START_NS, &poses)),
            [row("finger", "tip", 0.05)]
        );
    }
}
