//! A demonstration as a recording to look at: the hand's landmarks and bones, the object, and the
//! frames `table`, `object` and `wrist` over time, up to the grasp and as far beyond as was recorded.

use std::{collections::BTreeMap, path::Path};

use geometry::TriMesh;
use lake::{LakeError, recording::Recording};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use schemas::{
    demonstrations::{Demonstration, KEYPOINTS},
    ros2::{
        Marker, TfMessage,
        motion::{
            LANDMARK_COLOR, MARKERS, OBJECT, OBJECT_COLOR, START_NS, TABLE, TF, markers,
            mesh_marker, points_marker, stamp_ns, transform_stamped,
        },
    },
};
use spatial::{Object, Palm, Pose, Table};

use crate::after_grasp::ImageAfterGrasp;

/// Frame of the person's wrist: x out of a right hand's palm or a left hand's back, y to the thumb's
/// side, z to the fingers.
const WRIST: &str = "wrist";
/// Topic of the landmarks and the bones between them.
const HAND: &str = "/hand";
/// Diameter of a landmark as drawn, in meters.
const LANDMARK_M: f64 = 0.012;
/// Width of a bone as drawn, in meters.
const BONE_M: f64 = 0.005;
/// Shape number of pairs of points joined by lines, in `visualization_msgs/msg/Marker`.
const LINE_LIST: i32 = 5;
/// Maximum number of triangles drawn; of a finer mesh its convex hull is, lest every demonstration hold a
/// megabyte of the same mesh.
const MAX_TRIANGLES: usize = 4096;

/// Writes the recording.
pub(crate) fn write(
    path: &Path,
    demonstration: &Demonstration,
    after: &[ImageAfterGrasp],
    mesh: Option<&TriMesh>,
) -> Result<(), LakeError> {
    let mut recording = Recording::create(path, &about(demonstration))?;
    if let Some(mesh) = mesh {
        let hull = (mesh.triangles.len() > MAX_TRIANGLES)
            .then(|| mesh.convex_hull().ok())
            .flatten();
        let drawn = hull.as_ref().unwrap_or(mesh);
        let vertices: Vec<[f64; 3]> = drawn.vertices_m.iter().map(|&v| v.into()).collect();
        let shape = mesh_marker(START_NS, OBJECT, &vertices, &drawn.triangles, OBJECT_COLOR);
        recording.write_latched(MARKERS, START_NS, &markers([shape]))?;
    }
    let table_from_object = demonstration.rest.table_from_object();
    let reach = demonstration.steps.iter().map(|step| RecordedScene {
        time_s: step.time_s,
        table_from_object,
        keypoints_in_object: Some(step.keypoints_m.map(Point3::from)),
    });
    let after = after.iter().map(|after| RecordedScene {
        time_s: after.time_s,
        table_from_object: table_from_object * after.rest_from_object,
        keypoints_in_object: after.keypoints_in_object,
    });
    for scene in reach.chain(after) {
        let time_ns = stamp_ns(scene.time_s);
        let mut transforms = vec![transform_stamped(
            time_ns,
            TABLE,
            OBJECT,
            &scene.table_from_object,
        )];
        let hand = scene.keypoints_in_object.as_ref();
        transforms.extend(
            hand.map(|points| {
                transform_stamped(time_ns, OBJECT, WRIST, &object_from_wrist(points))
            }),
        );
        recording.write(TF, time_ns, &TfMessage { transforms })?;
        let Some(points) = scene.keypoints_in_object else {
            continue;
        };
        let landmarks = points_marker(
            time_ns,
            OBJECT,
            "landmarks",
            &points,
            LANDMARK_M,
            LANDMARK_COLOR,
        );
        let bones = Marker {
            r#type: LINE_LIST,
            ..points_marker(
                time_ns,
                OBJECT,
                "bones",
                &bone_ends(&points),
                BONE_M,
                LANDMARK_COLOR,
            )
        };
        recording.write(HAND, time_ns, &markers([landmarks, bones]))?;
    }
    recording.finish()
}

/// Returns the recording's facts in words.
fn about(demonstration: &Demonstration) -> BTreeMap<String, String> {
    let grasp_time_s = demonstration.steps.last().map_or(0.0, |step| step.time_s);
    let facts = [
        ("object", demonstration.object.clone()),
        ("sequence", demonstration.sequence.clone()),
        ("hand", demonstration.hand.as_str().to_owned()),
        ("mirrored", demonstration.mirrored.to_string()),
        ("start_reason", demonstration.start_reason.clone()),
        ("end_reason", demonstration.end_reason.clone()),
        ("grasp_time_s", format!("{grasp_time_s:.6}")),
    ];
    facts.map(|(key, value)| (key.to_owned(), value)).into()
}

/// The scene at one time.
struct RecordedScene {
    time_s: f64,
    table_from_object: Pose<Table, Object>,
    keypoints_in_object: Option<[Point3<f64>; KEYPOINTS]>,
}

/// Returns both ends of each bone: fingers of four landmarks each, joined at the wrist.
fn bone_ends(points: &[Point3<f64>; KEYPOINTS]) -> Vec<Point3<f64>> {
    let [wrist, fingers @ ..] = points;
    fingers
        .chunks(4)
        .flat_map(|finger| {
            let ends = std::iter::once(wrist).chain(finger);
            ends.zip(finger).flat_map(|(near, far)| [*near, *far])
        })
        .collect()
}

/// Returns the wrist's pose from the bases of the index, middle and little fingers; without a turn
/// where they lie on one line.
fn object_from_wrist(points: &[Point3<f64>; KEYPOINTS]) -> Pose<Object, Palm> {
    let wrist = points[0];
    let across = points[5] - points[17];
    let axes = (points[9] - wrist).try_normalize(1e-9).and_then(|z| {
        let y: Vector3<f64> = (across - z * z.dot(&across)).try_normalize(1e-9)?;
        Some(Matrix3::from_columns(&[y.cross(&z), y, z]))
    });
    let rotation = axes.map_or_else(UnitQuaternion::identity, |axes| {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
    });
    Pose::from_parts(wrist, rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bones_join_the_wrist_to_each_tip() {
        let points = std::array::from_fn(|n| Point3::new(n as f64, 0.0, 0.0));
        let ends: Vec<f64> = bone_ends(&points).iter().map(|point| point.x).collect();
        assert_eq!(ends.len(), 40);
        assert_eq!(
            &ends[..10],
            [0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 0.0, 5.0]
        );
    }

    #[test]
    fn wrist_frame_is_the_palms() {
        let mut points = [Point3::origin(); KEYPOINTS];
        points[9] = Point3::new(0.0, 0.0, 0.09);
        points[5] = Point3::new(0.0, 0.02, 0.09);
        points[17] = Point3::new(0.0, -0.05, 0.07);
        let turn = object_from_wrist(&points).rotation;
        assert!(turn.angle() < 1e-9, "{turn}");
        assert!(
            object_from_wrist(&[Point3::origin(); KEYPOINTS])
                .rotation
                .angle()
                < 1e-9
        );
    }
}
