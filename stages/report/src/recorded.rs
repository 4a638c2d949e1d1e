//! Motions of recordings, and of candidates, as a player shows them.

use std::collections::BTreeMap;

use glb::{Contact, Moment, MotionScene, ObjectMesh};
use lake::recording::Contents;
use robot::{JointOrder, Link, RobotModel};
use schemas::{
    candidates::Candidate,
    objects::Object,
    ros2::{
        JointState, JointTrajectory, Marker, MarkerArray, Message, TfMessage, Transform,
        motion::{
            CONTACTS, JOINT_COMMANDS, JOINT_STATES, JOINT_TRAJECTORY, MARKERS, METERS_PER_NEWTON,
            OBJECT, START_NS, TABLE, TF,
        },
    },
};
use spatial::{Pose, Table};

use crate::ReportError;

/// Name of a recording's attachment.
const URDF: &str = "robot.urdf";

/// A motion of a recording.
#[derive(Debug, Clone)]
pub struct RecordedMotion {
    /// The robot.
    pub robot: RobotModel,
    /// The object.
    pub object: ObjectMesh,
    /// Every recorded moment.
    pub moments: Vec<Moment>,
    /// The recording's metadata.
    pub about: BTreeMap<String, String>,
}

impl RecordedMotion {
    /// Takes the motion out of a recording; `hand` is the robot with its meshes if the recording is of it: a
    /// recording has none.
    ///
    /// # Errors
    ///
    /// Fails if the recording is not one of a robot and an object.
    pub fn read(
        name: &str,
        contents: &Contents,
        hand: Option<(&str, &RobotModel)>,
    ) -> Result<Self, ReportError> {
        let problem = |problem: &str| ReportError::Recording {
            name: name.to_owned(),
            problem: problem.to_owned(),
        };
        let urdf = contents.attachments.get(URDF);
        let urdf = urdf.ok_or_else(|| problem("it has no robot"))?;
        let urdf = String::from_utf8_lossy(urdf);
        let robot = match hand.filter(|(plain, _)| *plain == urdf) {
            Some((_, model)) => model.clone(),
            None => RobotModel::from_urdf(&urdf).map_err(|err| problem(&err.to_string()))?,
        };
        let poses = messages::<TfMessage>(contents, TF).map_err(|err| problem(&err))?;
        let states = messages::<JointState>(contents, JOINT_STATES).map_err(|err| problem(&err))?;
        let commanded = messages::<JointState>(contents, JOINT_COMMANDS);
        let commanded = commanded.map_err(|err| problem(&err))?;
        let base = robot.links().first().map(|link| link.name.clone());
        let base = base.unwrap_or_default();
        let commands = commands(contents, &robot).map_err(|err| problem(&err))?;
        let contacts = contacts(contents).map_err(|err| problem(&err))?;
        let mut moments: Vec<Moment> = Vec::with_capacity(states.len());
        for (time_ns, state) in &states {
            let tf = poses
                .get(time_ns)
                .ok_or_else(|| problem("a step has no poses"))?;
            let pose = |child: &str| {
                let of = tf
                    .transforms
                    .iter()
                    .find(|one| one.header.frame_id == TABLE && one.child_frame_id == child);
                of.and_then(|one| numbers(&one.transform))
                    .ok_or_else(|| problem(&format!("a step has no pose of `{child}`")))
            };
            let in_order = |state: &JointState| {
                let order = JointOrder::new(&state.name, &robot.joint_names());
                let order = order.map_err(|err| problem(&err.to_string()))?;
                let q = order.apply(&state.position);
                q.map_err(|err| problem(&err.to_string()))
            };
            let q = in_order(state)?;
            let moment = Moment {
                time_s: (time_ns - START_NS) as f64 / 1e9,
                table_from_root: pose(&base)?.reinterpret(),
                table_from_object: pose(OBJECT)?.reinterpret(),
                q,
                q_command: commanded.get(time_ns).map(in_order).transpose()?,
                contacts: contacts.get(time_ns).cloned().unwrap_or_default(),
            };
            moments.push(moment);
        }
        if let Some(commands) = commands
            && commanded.is_empty()
            && commands.len() == moments.len()
        {
            for (moment, command) in moments.iter_mut().zip(commands) {
                moment.q_command = Some(command);
            }
        }
        Ok(Self {
            object: object(contents).map_err(|err| problem(&err))?,
            about: contents.about.clone(),
            robot,
            moments,
        })
    }

    /// Writes the motion as a binary glTF file, the object with at most `triangles_n` triangles.
    ///
    /// # Errors
    ///
    /// Fails if the motion cannot be shown.
    pub fn to_glb(&self, name: &str, triangles_n: usize) -> Result<Vec<u8>, ReportError> {
        let object = glb::simplified(&self.object, triangles_n);
        let about: Vec<(&str, String)> = self
            .about
            .iter()
            .map(|(key, value)| (key.as_str(), value.clone()))
            .collect();
        let scene = MotionScene {
            name,
            robot: &self.robot,
            object: &object,
            about: &about,
        };
        scene
            .to_glb(&self.moments)
            .map_err(|source| ReportError::Motion {
                name: name.to_owned(),
                source,
            })
    }
}

/// Returns the motion of a candidate as it was drawn, about an object that lies still.
///
/// # Errors
///
/// Fails if the candidate is for another hand.
pub fn of_candidate(
    candidate: &Candidate,
    joints: &[String],
    object: &Object,
    hand: &RobotModel,
) -> Result<RecordedMotion, ReportError> {
    let problem = |problem: String| ReportError::Recording {
        name: candidate.candidate_id.clone(),
        problem,
    };
    let order = JointOrder::new(joints, &hand.joint_names());
    let order = order.map_err(|err| problem(err.to_string()))?;
    let moment = |step: &motion::Step<spatial::Object>| -> Result<Moment, ReportError> {
        let table_from_palm = candidate.table_from_object * step.frame_from_palm;
        Ok(Moment {
            time_s: step.time_s,
            table_from_root: table_from_palm.reinterpret(),
            q: order
                .apply(&step.q_rad)
                .map_err(|err| problem(err.to_string()))?,
            q_command: None,
            table_from_object: candidate.table_from_object,
            contacts: Vec::new(),
        })
    };
    let steps = candidate.motion.steps().iter();
    Ok(RecordedMotion {
        robot: hand.clone(),
        object: ObjectMesh {
            vertices_m: object.vertices_m.clone(),
            triangles: object.triangles.clone(),
        },
        moments: steps.map(moment).collect::<Result<_, _>>()?,
        about: BTreeMap::from([("candidate_id".to_owned(), candidate.candidate_id.clone())]),
    })
}

/// The messages of a topic by their time.
fn messages<M: Message>(contents: &Contents, topic: &str) -> Result<BTreeMap<i64, M>, String> {
    let mut messages = BTreeMap::new();
    for message in contents.topic(topic) {
        let decoded = message.decode::<M>();
        let decoded = decoded.ok_or_else(|| format!("`{topic}` holds other messages"))?;
        let decoded = decoded.map_err(|err| format!("`{topic}`: {err}"))?;
        messages.insert(message.time_ns, decoded);
    }
    Ok(messages)
}

/// The commanded joint positions of each step; `None` if another robot's are commanded.
fn commands(contents: &Contents, robot: &RobotModel) -> Result<Option<Vec<Vec<f64>>>, String> {
    let all = messages::<JointTrajectory>(contents, JOINT_TRAJECTORY)?;
    let Some(trajectory) = all.into_values().next() else {
        return Ok(None);
    };
    let Ok(order) = JointOrder::new(&trajectory.joint_names, &robot.joint_names()) else {
        return Ok(None);
    };
    let points = trajectory.points.iter();
    let commands = points.map(|point| order.apply(&point.positions).map_err(|err| err.to_string()));
    commands.collect::<Result<_, _>>().map(Some)
}

/// The contacts of each step.
fn contacts(contents: &Contents) -> Result<BTreeMap<i64, Vec<Contact>>, String> {
    let all = messages::<MarkerArray>(contents, CONTACTS)?;
    let contact = |marker: &Marker| {
        let [from, to] = marker.points.as_slice() else {
            return None;
        };
        let length_m = [to.x - from.x, to.y - from.y, to.z - from.z]
            .iter()
            .map(|side| side * side)
            .sum::<f64>()
            .sqrt();
        Some(Contact {
            point_in_table_m: [from.x, from.y, from.z],
            force_n: length_m / METERS_PER_NEWTON,
        })
    };
    let contacts = all.into_iter().map(|(time_ns, markers)| {
        let contacts = markers.markers.iter().filter_map(contact);
        (time_ns, contacts.collect())
    });
    Ok(contacts.collect())
}

/// The object's mesh, from its marker.
fn object(contents: &Contents) -> Result<ObjectMesh, String> {
    let all = messages::<MarkerArray>(contents, MARKERS)?;
    let markers = all.into_values().flat_map(|array| array.markers);
    let mut meshes = markers.filter(|marker| {
        marker.r#type == Marker::TRIANGLE_LIST && marker.header.frame_id == OBJECT
    });
    let Some(mesh) = meshes.next() else {
        return Err("it has no object".to_owned());
    };
    // A corner of a list of triangles is the same vertex wherever its numbers are the same.
    let mut places: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let mut object = ObjectMesh::default();
    for corners in mesh.points.chunks_exact(3) {
        let mut triangle = [0; 3];
        for (at, corner) in triangle.iter_mut().zip(corners) {
            let numbers = [corner.x, corner.y, corner.z];
            let next = u32::try_from(object.vertices_m.len()).unwrap_or(u32::MAX);
            *at = *places.entry(numbers.map(f64::to_bits)).or_insert_with(|| {
                object.vertices_m.push(numbers);
                next
            });
        }
        object.triangles.push(triangle);
    }
    Ok(object)
}

fn numbers(transform: &Transform) -> Option<Pose<Table, Link>> {
    let (t, r) = (&transform.translation, &transform.rotation);
    Pose::from_array([t.x, t.y, t.z, r.x, r.y, r.z, r.w]).ok()
}
