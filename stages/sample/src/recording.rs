//! Several motions side by side as one recording for a viewer: one hand and one object for each.
//!
//! The frames of motion k hang below `motion_k`, which lies beside the table's frame along y; the hand
//! is drawn as its collision shapes, so that no viewer needs to know that there are several.

use std::{collections::BTreeMap, path::Path};

use ::motion::Step;
use dataflow::BoxedDiagnostic;
use geometry::TriMesh;
use lake::recording::Recording;
use nalgebra::{Isometry3, Point3};
use robot::{JointOrder, RobotModel, Shape, WrongDof, spheres};
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    objects::Object,
    ros2::{
        ColorRgba, Marker, TfMessage, TransformStamped,
        motion::{self, MARKERS, OBJECT_COLOR, ROBOT_DESCRIPTION, START_NS, TABLE, TF, TF_STATIC},
    },
};
use spatial::{Object as InObject, Palm, Pose};

use crate::SampleError;

/// Name of the recording in the artifact.
pub(crate) const FILE: &str = "motions.mcap";
/// Distance of neighboring motions along y, in meters: more than a hand and most objects are wide.
const BESIDE_M: f64 = 0.4;
/// Diameter of the points along which the palm goes, in meters.
const TRAIL_M: f64 = 0.004;

/// Constants of all motions of a recording.
pub(crate) struct RecordingContext<'a> {
    /// The hand's URDF.
    pub(crate) urdf: &'a str,
    /// The hand.
    pub(crate) model: &'a RobotModel,
    /// The object.
    pub(crate) object: &'a Object,
    /// From a candidate's joints to the hand's.
    pub(crate) order: &'a JointOrder,
}

/// Returns the numbers of `n` of `total` motions: the first, the last, and others at equal distances.
pub(crate) fn chosen(n: usize, total: usize) -> Vec<usize> {
    let n = n.min(total);
    let last = total.saturating_sub(1);
    (0..n)
        .map(|k| k * last / n.saturating_sub(1).max(1))
        .collect()
}

/// Writes the recording of motions with equal times into `folder`.
pub(crate) fn record(
    context: &RecordingContext<'_>,
    motions: &[&Candidate],
    folder: &Path,
) -> Result<(), BoxedDiagnostic> {
    let names: Vec<&str> = motions.iter().map(|m| m.candidate_id.as_str()).collect();
    let about = [
        ("schema", Candidates::VERSION),
        ("object", &context.object.name),
        ("candidate_ids", &names.join(",")),
    ]
    .map(|(key, value)| (key.to_owned(), value.to_owned()));
    let mut recording = Recording::create(&folder.join(FILE), &BTreeMap::from(about))?;
    recording.attach("robot.urdf", "application/xml", context.urdf.as_bytes())?;
    let description = motion::robot_description(context.urdf);
    recording.write_latched(ROBOT_DESCRIPTION, START_NS, &description)?;
    let shown: Vec<DisplayedMotion<'_>> = motions
        .iter()
        .enumerate()
        .map(|(number, motion)| DisplayedMotion::new(context, motion, number, motions.len()))
        .collect();
    let fixed = shown.iter().flat_map(DisplayedMotion::fixed).collect();
    recording.write_latched(TF_STATIC, START_NS, &TfMessage { transforms: fixed })?;
    let markers = shown.iter().flat_map(DisplayedMotion::markers);
    recording.write_latched(MARKERS, START_NS, &motion::markers(markers))?;
    let n_steps = motions.iter().map(|one| one.motion.steps().len()).min();
    for idx in 0..n_steps.unwrap_or(0) {
        let mut transforms = Vec::new();
        let mut time_ns = START_NS;
        for shown in &shown {
            let Some(step) = shown.candidate.motion.steps().get(idx) else {
                continue;
            };
            time_ns = motion::stamp_ns(step.time_s);
            let q = context
                .order
                .apply(&step.q_rad)
                .map_err(SampleError::from)?;
            let q_velocity = context
                .order
                .apply(&step.rates.joints.velocity)
                .map_err(SampleError::from)?;
            transforms.extend(shown.poses(step, &q, time_ns).map_err(SampleError::from)?);
            let names = shown.joints();
            let joints = motion::joint_state(time_ns, &names, &q, &q_velocity);
            recording.write(&format!("/{}/joint_states", shown.frame), time_ns, &joints)?;
        }
        recording.write(TF, time_ns, &TfMessage { transforms })?;
    }
    Ok(recording.finish()?)
}

/// One motion among several.
struct DisplayedMotion<'a> {
    context: &'a RecordingContext<'a>,
    candidate: &'a Candidate,
    /// The frame of its own table.
    frame: String,
    /// Offset beside the table's frame, in meters along y.
    beside_m: f64,
    color: ColorRgba,
}

impl<'a> DisplayedMotion<'a> {
    fn new(
        context: &'a RecordingContext<'a>,
        candidate: &'a Candidate,
        number: usize,
        total: usize,
    ) -> Self {
        let frame = format!("motion_{number}");
        let share = number as f64 / total.saturating_sub(1).max(1) as f64;
        Self {
            beside_m: BESIDE_M * (number as f64 - 0.5 * total.saturating_sub(1) as f64),
            color: between_blue_and_red(share),
            context,
            candidate,
            frame,
        }
    }

    fn name(&self, part: &str) -> String {
        format!("{}/{part}", self.frame)
    }

    fn joints(&self) -> Vec<String> {
        let names = self.context.model.joint_names();
        names.iter().map(|joint| self.name(joint)).collect()
    }

    /// Returns the poses that stay: its table, its object and the hand's fixed links.
    fn fixed(&self) -> Vec<TransformStamped> {
        let table_from_own = Pose::<spatial::Table, spatial::Table>::new(Isometry3::translation(
            0.0,
            self.beside_m,
            0.0,
        ));
        let own_from_object = &self.candidate.table_from_object;
        let mut all = vec![
            motion::transform_stamped(START_NS, TABLE, &self.frame, &table_from_own),
            motion::transform_stamped(START_NS, &self.frame, &self.name("object"), own_from_object),
        ];
        let model = self.context.model;
        let fixed = motion::fixed_links::<Palm>(model, &model.link_poses(|_| 0.0));
        all.extend(self.own(fixed));
        all
    }

    /// Returns transforms between frames of its own.
    fn own(&self, message: TfMessage) -> impl Iterator<Item = TransformStamped> {
        let root = self.context.model.links().first().map(|link| &link.name);
        message.transforms.into_iter().map(move |mut transform| {
            transform.header.frame_id = if Some(&transform.child_frame_id) == root {
                self.frame.clone()
            } else {
                self.name(&transform.header.frame_id)
            };
            transform.child_frame_id = self.name(&transform.child_frame_id);
            transform
        })
    }

    /// Returns the poses that change, with the hand's joint positions `q`.
    fn poses(
        &self,
        step: &Step<InObject>,
        q: &[f64],
        time_ns: i64,
    ) -> Result<impl Iterator<Item = TransformStamped>, WrongDof> {
        let model = self.context.model;
        let palm_from_links = model.forward_kinematics(q)?;
        let own_from_palm = self.candidate.table_from_object * step.frame_from_palm;
        let moving = motion::moving_links(time_ns, model, &own_from_palm, &palm_from_links);
        Ok(self.own(moving))
    }

    /// Returns the object, the way of the palm's origin and the hand's collision shapes.
    fn markers(&self) -> Vec<Marker> {
        let object = self.context.object;
        let in_object = self.name("object");
        let (vertices_m, triangles) = (&object.vertices_m, &object.triangles);
        let mesh = motion::mesh_marker(START_NS, &in_object, vertices_m, triangles, OBJECT_COLOR);
        let steps = self.candidate.motion.steps().iter();
        let trail: Vec<Point3<f64>> = steps
            .map(|step| step.frame_from_palm.translation.vector.into())
            .collect();
        let trail =
            motion::points_marker(START_NS, &in_object, "trail", &trail, TRAIL_M, self.color);
        let mut all = vec![mesh, trail];
        for link in self.context.model.links() {
            for collision in &link.collisions {
                let number = all.len();
                let mut marker = self.shape(&self.name(&link.name), collision);
                "hand".clone_into(&mut marker.ns);
                marker.id = i32::try_from(number).unwrap_or(i32::MAX);
                all.push(marker);
            }
        }
        for marker in &mut all {
            marker.ns = self.name(&marker.ns);
        }
        all
    }

    /// Returns a box or a body as it is, any other shape as the spheres that fill it.
    fn shape(&self, frame: &str, collision: &robot::Collision) -> Marker {
        let mesh = |corners: &[Point3<f64>], triangles: &[[u32; 3]]| {
            let corners: Vec<[f64; 3]> = corners
                .iter()
                .map(|corner| (collision.link_from_shape * *corner).into())
                .collect();
            motion::mesh_marker(START_NS, frame, &corners, triangles, self.color)
        };
        match &collision.shape {
            Shape::Box { half_extents_m } => {
                let high = Point3::from(*half_extents_m);
                let cuboid = TriMesh::cuboid(-high, high);
                return mesh(&cuboid.vertices_m, &cuboid.triangles);
            }
            Shape::Convex(body) => return mesh(body.corners_m(), body.triangles()),
            Shape::Sphere { .. } | Shape::Cylinder { .. } | Shape::Capsule { .. } => {}
        }
        let spheres = spheres::fill(collision);
        let centers: Vec<Point3<f64>> =
            spheres.iter().map(|sphere| sphere.center_in_link).collect();
        let diameter_m = spheres.first().map_or(0.0, |sphere| 2.0 * sphere.radius_m);
        motion::points_marker(START_NS, frame, "balls", &centers, diameter_m, self.color)
    }
}

/// Returns a color that says how far along the row a motion is.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a color has no more digits"
)]
fn between_blue_and_red(share: f64) -> ColorRgba {
    let share = share as f32;
    ColorRgba {
        r: 0.2 + 0.7 * share,
        g: 0.4 - 0.15 * share,
        b: 0.9 - 0.7 * share,
        a: 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::chosen;

    #[test]
    fn motions_are_chosen_from_the_first_to_the_last() {
        assert_eq!(chosen(3, 9), [0, 4, 8]);
        assert_eq!(chosen(9, 9), (0..9).collect::<Vec<_>>());
        assert_eq!(chosen(20, 3), [0, 1, 2]);
        assert_eq!(chosen(1, 5), [0]);
        assert!(chosen(0, 5).is_empty() && chosen(3, 0).is_empty());
    }
}
