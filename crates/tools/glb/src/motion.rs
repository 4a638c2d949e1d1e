//! From a robot, an object and the moments of a motion to a scene.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use robot::{JointKind, Link, RobotModel, WrongDof};
use spatial::{Object, Pose, Table};

use crate::{
    Contact, GlbError, contacts,
    keyframes::keyframes,
    scene::{Geometry, Material, Node, Scene, Track, Values, single, single_rotation},
    shapes, write,
};

/// Largest distance of a point of a robot's links from a joint that moves it, in meters: a rotation
/// error counts as that much error of position.
const REACH_M: f64 = 0.2;
/// Half of the table's sides and of its thickness, in meters.
const TABLE_HALF_M: [f64; 3] = [0.35, 0.35, 0.005];

/// The object's mesh, in its own frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjectMesh {
    /// Vertices in meters.
    pub vertices_m: Vec<[f64; 3]>,
    /// Triangles, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Parts of a motion that are the same at all moments.
#[derive(Debug, Clone, Copy)]
pub struct MotionScene<'a> {
    /// The animation's name.
    pub name: &'a str,
    /// The robot, with the shapes of its meshes.
    pub robot: &'a RobotModel,
    /// The object.
    pub object: &'a ObjectMesh,
    /// Facts for people and programs, e.g. `verdict`: the scene's `extras`.
    pub about: &'a [(&'a str, String)],
}

impl ObjectMesh {
    /// Returns the shapes of a robot's links at joint positions `q`, in radians (meters if prismatic), in the root's frame.
    ///
    /// # Errors
    ///
    /// Fails unless there is one position per joint.
    pub fn of_robot(robot: &RobotModel, q: &[f64]) -> Result<Self, WrongDof> {
        let mut all = Geometry::default();
        let root_from_links = robot.forward_kinematics::<Link>(q)?;
        for (link, root_from_link) in robot.links().iter().zip(&root_from_links) {
            for collision in &link.collisions {
                let placed = *root_from_link * collision.link_from_shape;
                all.add(&shapes::triangles(&collision.shape), &placed);
            }
        }
        Ok(Self {
            vertices_m: all
                .positions
                .iter()
                .map(|point| point.map(f64::from))
                .collect(),
            triangles: all.triangles,
        })
    }
}

/// A moment of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Seconds since the first moment.
    pub time_s: f64,
    /// Pose of the robot's root link.
    pub table_from_root: Pose<Table, Link>,
    /// Joint positions in radians (meters if prismatic), in the robot's order.
    pub q: Vec<f64>,
    /// Commanded joint positions; `None` if they are not known, and then no ghost is shown.
    pub q_command: Option<Vec<f64>>,
    /// Pose of the object.
    pub table_from_object: Pose<Table, Object>,
    /// Contacts of robot and object.
    pub contacts: Vec<Contact>,
}

impl Moment {
    /// Returns a moment of a robot without joints, with everything at the table's origin.
    pub fn still(time_s: f64) -> Self {
        Self {
            time_s,
            table_from_root: Pose::identity(),
            q: Vec::new(),
            q_command: None,
            table_from_object: Pose::identity(),
            contacts: Vec::new(),
        }
    }

    fn is_finite(&self) -> bool {
        let poses = [
            self.table_from_root.to_array(),
            self.table_from_object.to_array(),
        ];
        let joints = self.q.iter().chain(self.q_command.iter().flatten());
        let contacts = self.contacts.iter().flat_map(|contact| {
            let [x, y, z] = contact.point_in_table_m;
            [x, y, z, contact.force_n]
        });
        let mut numbers = poses.iter().flatten().chain(joints).copied();
        let mut contacts = contacts;
        self.time_s.is_finite() && numbers.all(f64::is_finite) && contacts.all(f64::is_finite)
    }
}

/// Materials, by their place in a scene. Colors are those of Okabe and Ito, linear, so that they can be told
/// apart by color-blind readers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Appearance {
    Table,
    Object,
    Hand,
    Ghost,
    Contact,
}

const MATERIALS: [Material; 5] = [
    Material {
        name: "table",
        color: [0.42, 0.43, 0.45, 1.0],
    },
    Material {
        name: "object",
        color: [0.79, 0.35, 0.0, 1.0],
    },
    Material {
        name: "hand",
        color: [0.09, 0.46, 0.81, 1.0],
    },
    Material {
        name: "ghost",
        color: [0.6, 0.19, 0.39, 0.45],
    },
    Material {
        name: "contact",
        color: [0.012, 0.012, 0.012, 1.0],
    },
];

impl MotionScene<'_> {
    /// Writes the motion as a binary glTF file.
    ///
    /// # Errors
    ///
    /// Fails if there is no moment, times do not increase, a moment does not fit the robot, a number is not
    /// finite, or a triangle names a vertex that there is not.
    pub fn to_glb(&self, moments: &[Moment]) -> Result<Vec<u8>, GlbError> {
        self.check(moments)?;
        let mut scene = Scene {
            materials: MATERIALS.to_vec(),
            ..Scene::default()
        };
        let quarter =
            UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -std::f64::consts::FRAC_PI_2);
        let world = scene.add_node(Node {
            name: "world".to_owned(),
            parent: None,
            pose_in_parent: Isometry3::from_parts(Vector3::zeros().into(), quarter),
            mesh: None,
        });
        add_table(&mut scene, world);
        let object = self.add_object(&mut scene, world, moments);
        let links = self.add_links(&mut scene, world, moments);
        let positions: Vec<&[f64]> = moments.iter().map(|one| one.q.as_slice()).collect();
        let poses: Vec<Vec<Isometry3<f64>>> = positions.iter().map(|q| self.local(q)).collect();
        let kept = self.hand_keys(moments, &positions);
        move_node(&mut scene, links.first().copied(), moments, &kept, |one| {
            *one.table_from_root
        });
        self.move_joints(&mut scene, &links, moments, &kept, &poses);
        move_node(
            &mut scene,
            Some(object),
            moments,
            &object_keys(moments),
            |one| *one.table_from_object,
        );
        self.add_ghost(&mut scene, &links, moments);
        contacts::add(&mut scene, world, moments);
        write::to_glb(&scene, self.name, self.about)
    }

    fn check(&self, moments: &[Moment]) -> Result<(), GlbError> {
        if moments.is_empty() {
            return Err(GlbError::Empty);
        }
        let expected = self.robot.dof();
        for (idx, moment) in moments.iter().enumerate() {
            if !moment.is_finite() {
                return Err(GlbError::NotFinite { idx });
            }
            let before = idx.checked_sub(1).and_then(|before| moments.get(before));
            if before.is_some_and(|before| before.time_s >= moment.time_s) {
                let time_s = moment.time_s;
                return Err(GlbError::Order { idx, time_s });
            }
            for q in [Some(&moment.q), moment.q_command.as_ref()]
                .into_iter()
                .flatten()
            {
                if q.len() != expected {
                    let found = q.len();
                    return Err(GlbError::Joints {
                        idx,
                        found,
                        expected,
                    });
                }
            }
        }
        let vertices_n = self.object.vertices_m.len();
        for (triangle, corners) in self.object.triangles.iter().enumerate() {
            if let Some(&vertex) = corners
                .iter()
                .find(|&&corner| corner as usize >= vertices_n)
            {
                return Err(GlbError::Vertex {
                    triangle,
                    vertex,
                    vertices_n,
                });
            }
        }
        Ok(())
    }

    /// The pose of each link in its parent; of the root, the identity.
    fn local(&self, q: &[f64]) -> Vec<Isometry3<f64>> {
        let root_from_links = self.robot.link_poses::<Link>(|joint| q[joint]);
        let links = self.robot.links().iter().zip(&root_from_links);
        links
            .map(|(link, root_from_link)| {
                let parent = link.parent.and_then(|parent| root_from_links.get(parent));
                parent.map_or_else(Isometry3::identity, |root_from_parent| {
                    *root_from_parent.inv_mul(root_from_link)
                })
            })
            .collect()
    }

    fn add_object(&self, scene: &mut Scene, world: usize, moments: &[Moment]) -> usize {
        let geometry = Geometry {
            positions: self
                .object
                .vertices_m
                .iter()
                .map(|&vertex| single(vertex.into()))
                .collect(),
            triangles: self.object.triangles.clone(),
        };
        let mesh = scene.add_mesh("object", geometry, Appearance::Object as usize);
        let first = moments.first().map(|one| *one.table_from_object);
        scene.add_node(Node {
            name: "object".to_owned(),
            parent: Some(world),
            pose_in_parent: first.unwrap_or_else(Isometry3::identity),
            mesh,
        })
    }

    /// Adds the links at the first moment, and returns their nodes.
    fn add_links(&self, scene: &mut Scene, world: usize, moments: &[Moment]) -> Vec<usize> {
        let Some(first) = moments.first() else {
            return Vec::new();
        };
        let local = self.local(&first.q);
        let mut nodes: Vec<usize> = Vec::new();
        for (link, parent_from_link) in self.robot.links().iter().zip(local) {
            let mut geometry = Geometry::default();
            for collision in &link.collisions {
                geometry.add(
                    &shapes::triangles(&collision.shape),
                    &collision.link_from_shape,
                );
            }
            let mesh = scene.add_mesh(&link.name, geometry, Appearance::Hand as usize);
            let parent = link.parent.and_then(|parent| nodes.get(parent).copied());
            let is_root = parent.is_none();
            nodes.push(scene.add_node(Node {
                name: link.name.clone(),
                parent: Some(parent.unwrap_or(world)),
                pose_in_parent: if is_root {
                    *first.table_from_root
                } else {
                    parent_from_link
                },
                mesh,
            }));
        }
        nodes
    }

    /// The moments between which the robot moves linearly, within the tolerance, with these joint positions.
    fn hand_keys(&self, moments: &[Moment], q: &[&[f64]]) -> Vec<usize> {
        let links = self.robot.links();
        keyframes(moments.len(), |from, to, at| {
            let root = |moment: &Moment| moment.table_from_root;
            let Some((share, root)) = pose_error_m(moments, [from, to, at], root) else {
                return 0.0;
            };
            // Along each chain the errors of the joints add up, at most.
            let mut chains = vec![0.0_f64; links.len()];
            let mut worst = 0.0_f64;
            for (idx, link) in links.iter().enumerate() {
                let above = link.parent.and_then(|parent| chains.get(parent).copied());
                let own = link.joint.map_or(0.0, |joint| {
                    let [a, b, c] = [from, to, at].map(|moment| q[moment][joint]);
                    let arm = if link.kind == Some(JointKind::Prismatic) {
                        1.0
                    } else {
                        REACH_M
                    };
                    (a + share * (b - a) - c).abs() * link.multiplier.abs() * arm
                });
                let chain = above.unwrap_or_default() + own;
                if let Some(kept) = chains.get_mut(idx) {
                    *kept = chain;
                }
                worst = worst.max(chain);
            }
            root + worst
        })
    }

    fn move_joints(
        &self,
        scene: &mut Scene,
        nodes: &[usize],
        moments: &[Moment],
        kept: &[usize],
        poses: &[Vec<Isometry3<f64>>],
    ) {
        let times = scene.add_times(times(moments, kept));
        for (idx, (link, &node)) in self.robot.links().iter().zip(nodes).enumerate() {
            let at = |moment: &usize| poses.get(*moment).and_then(|poses| poses.get(idx));
            let values = match link.kind {
                None => continue,
                Some(JointKind::Prismatic) => Values::Translation(
                    kept.iter()
                        .filter_map(at)
                        .map(|pose| single(pose.translation.vector))
                        .collect(),
                ),
                Some(JointKind::Revolute | JointKind::Continuous) => Values::RotationOfJoint(
                    kept.iter()
                        .filter_map(at)
                        .map(|pose| write::sixteen_bits(&pose.rotation))
                        .collect(),
                ),
            };
            scene.tracks.push(Track {
                node,
                times,
                values,
            });
        }
    }

    /// Adds the robot as it was commanded, on the same root, if every moment knows that.
    fn add_ghost(&self, scene: &mut Scene, links: &[usize], moments: &[Moment]) {
        let commands: Option<Vec<&[f64]>> =
            moments.iter().map(|one| one.q_command.as_deref()).collect();
        let (Some(commands), Some(&root)) = (commands, links.first()) else {
            return;
        };
        let Some(first) = commands.first() else {
            return;
        };
        let local = self.local(first);
        let mut nodes: Vec<usize> = Vec::new();
        for (idx, (link, parent_from_link)) in self.robot.links().iter().zip(local).enumerate() {
            let of_link = links.get(idx).and_then(|&node| scene.nodes.get(node)?.mesh);
            // The root is where the robot's own is.
            let of_link = of_link.filter(|_| idx > 0);
            let name = format!("ghost_{}", link.name);
            let mesh =
                of_link.and_then(|mesh| scene.add_alike(&name, mesh, Appearance::Ghost as usize));
            let parent = link.parent.and_then(|parent| nodes.get(parent).copied());
            nodes.push(scene.add_node(Node {
                name,
                parent: Some(parent.unwrap_or(root)),
                pose_in_parent: parent_from_link,
                mesh,
            }));
        }
        let poses: Vec<Vec<Isometry3<f64>>> = commands.iter().map(|q| self.local(q)).collect();
        let kept = self.hand_keys(moments, &commands);
        self.move_joints(scene, &nodes, moments, &kept, &poses);
    }
}

fn add_table(scene: &mut Scene, world: usize) {
    let half = Vector3::from(TABLE_HALF_M);
    let mesh = scene.add_mesh("table", shapes::cuboid(&half), Appearance::Table as usize);
    let below = Isometry3::translation(0.0, 0.0, -half.z);
    scene.add_node(Node {
        name: "table".to_owned(),
        parent: Some(world),
        pose_in_parent: below,
        mesh,
    });
}

pub(crate) fn times(moments: &[Moment], kept: &[usize]) -> Vec<f32> {
    #[expect(clippy::cast_possible_truncation, reason = "seconds of a motion")]
    let time = |idx: &usize| moments.get(*idx).map(|one| one.time_s as f32);
    kept.iter().filter_map(time).collect()
}

/// How far along between two moments a third one is, and how far a pose is then from the one between theirs: of the
/// origin, and of a point at [`REACH_M`].
fn pose_error_m<F, G>(
    moments: &[Moment],
    places: [usize; 3],
    pose: impl Fn(&Moment) -> Pose<F, G>,
) -> Option<(f64, f64)> {
    let [from, to, found] = places.map(|place| moments.get(place));
    let (from, to, found) = (from?, to?, found?);
    let share = (found.time_s - from.time_s) / (to.time_s - from.time_s);
    let [from, to, found] = [from, to, found].map(pose);
    let position = from.translation.vector.lerp(&to.translation.vector, share);
    let rotation = from
        .rotation
        .try_slerp(&to.rotation, share, 1e-12)
        .unwrap_or(from.rotation);
    let off_m = (position - found.translation.vector).norm();
    Some((share, off_m + REACH_M * rotation.angle_to(&found.rotation)))
}

fn object_keys(moments: &[Moment]) -> Vec<usize> {
    let object = |moment: &Moment| moment.table_from_object;
    keyframes(moments.len(), |from, to, at| {
        pose_error_m(moments, [from, to, at], object).map_or(0.0, |(_, error_m)| error_m)
    })
}

/// Moves a node in the world at the kept moments.
fn move_node(
    scene: &mut Scene,
    node: Option<usize>,
    moments: &[Moment],
    kept: &[usize],
    pose: impl Fn(&Moment) -> Isometry3<f64>,
) {
    let Some(node) = node else { return };
    let times = scene.add_times(times(moments, kept));
    let poses: Vec<Isometry3<f64>> = kept
        .iter()
        .filter_map(|&idx| moments.get(idx))
        .map(pose)
        .collect();
    let positions = poses.iter().map(|pose| single(pose.translation.vector));
    let rotations = poses.iter().map(|pose| single_rotation(&pose.rotation));
    for values in [
        Values::Translation(positions.collect()),
        Values::Rotation(rotations.collect()),
    ] {
        scene.tracks.push(Track {
            node,
            times,
            values,
        });
    }
}
