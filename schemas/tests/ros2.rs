//! Messages against the bytes that an independent implementation writes (`golden/messages.py`).

use schemas::ros2::{
    CameraInfo, ColorRgba, CompressedImage, Duration, Header, Image, JointState, JointTrajectory,
    JointTrajectoryPoint, Marker, MarkerArray, MeshFile, Message, Point, PointCloud2, PointField,
    Pose, PoseStamped, Quaternion, RegionOfInterest, Text, TfMessage, Time, Transform,
    TransformStamped, UvCoordinate, Vector3,
};

const GOLDEN: &str = include_str!("golden/messages.txt");

/// Compares type, hash and bytes of `message` with line `line` of the golden file, both ways.
fn check<M: Message + PartialEq + std::fmt::Debug>(line: usize, message: &M) {
    let golden = GOLDEN.lines().nth(line).unwrap();
    let mut words = golden.split(' ');
    assert_eq!(words.next(), Some(M::TYPE));
    assert_eq!(words.next(), Some(M::HASH));
    let expected = words.next().unwrap();
    let bytes = message.to_cdr();
    let found: Vec<String> = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(found.concat(), expected, "line {line}: {}", M::TYPE);
    assert_eq!(M::from_cdr(&bytes).as_ref(), Ok(message));
}

fn header(sec: i32, nanosec: u32, frame: &str) -> Header {
    Header {
        stamp: Time { sec, nanosec },
        frame_id: frame.to_owned(),
    }
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn quaternion(x: f64, y: f64, z: f64, w: f64) -> Quaternion {
    Quaternion { x, y, z, w }
}

fn transform(parent: &str, child: &str, xyz: [f64; 3], rotation: Quaternion) -> TransformStamped {
    let [x, y, z] = xyz;
    TransformStamped {
        header: header(2, 3, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: Vector3 { x, y, z },
            rotation,
        },
    }
}

#[test]
fn joint_messages_have_the_bytes_of_ros2() {
    check(
        0,
        &JointState {
            header: header(1, 250_000_000, ""),
            name: names(&["joint_0.0", "joint_1.0"]),
            position: vec![0.5, -1.25],
            velocity: vec![],
            effort: vec![0.1, 0.7],
        },
    );
    check(
        1,
        &JointTrajectory {
            header: header(1, 0, "base_link"),
            joint_names: names(&["a", "bc", ""]),
            points: vec![
                JointTrajectoryPoint {
                    positions: vec![0.1, 0.2, 0.3],
                    velocities: vec![1.0, 2.0, 3.0],
                    time_from_start: Duration {
                        sec: 0,
                        nanosec: 4_000_000,
                    },
                    ..JointTrajectoryPoint::default()
                },
                JointTrajectoryPoint {
                    positions: vec![-0.1, -0.2, -0.3],
                    accelerations: vec![4.0, 5.0, 6.0],
                    time_from_start: Duration {
                        sec: 2,
                        nanosec: 999_999_999,
                    },
                    ..JointTrajectoryPoint::default()
                },
            ],
        },
    );
}

#[test]
fn pose_messages_have_the_bytes_of_ros2() {
    check(
        2,
        &TfMessage {
            transforms: vec![
                transform(
                    "table",
                    "object",
                    [0.1, 0.2, 0.3],
                    quaternion(0.0, 0.0, 0.6, 0.8),
                ),
                transform(
                    "base_link",
                    "link_0.0",
                    [-0.1, 0.0, 1e-9],
                    Quaternion::default(),
                ),
            ],
        },
    );
    check(
        3,
        &PoseStamped {
            header: header(-1, 999_999_999, "object"),
            pose: Pose {
                position: Point {
                    x: 1.0,
                    y: 2.0,
                    z: 3.0,
                },
                orientation: quaternion(0.5, 0.5, 0.5, 0.5),
            },
        },
    );
}

#[test]
fn texts_have_the_bytes_of_ros2() {
    for (line, text) in [(4, "<robot name=\"größe\"/>"), (5, "")] {
        let data = text.to_owned();
        check(line, &Text { data });
    }
}

#[test]
fn markers_have_the_bytes_of_ros2() {
    let marker = Marker {
        header: header(1, 0, "object"),
        ns: "contacts".to_owned(),
        id: 7,
        r#type: Marker::SPHERE_LIST,
        scale: Vector3 {
            x: 0.01,
            y: 0.01,
            z: 0.01,
        },
        color: ColorRgba {
            r: 0.25,
            g: 0.5,
            b: 0.75,
            a: 1.0,
        },
        frame_locked: true,
        points: vec![
            Point {
                x: 0.1,
                y: 0.2,
                z: 0.3,
            },
            Point {
                x: -0.1,
                y: 0.0,
                z: 0.0,
            },
        ],
        colors: vec![ColorRgba {
            r: 1.0,
            g: 0.0,
            b: 0.0,
            a: 1.0,
        }],
        texture: CompressedImage {
            format: "png".to_owned(),
            data: vec![1, 2, 3],
            ..CompressedImage::default()
        },
        uv_coordinates: vec![UvCoordinate { u: 0.5, v: 0.25 }],
        text: "text".to_owned(),
        mesh_file: MeshFile {
            filename: "a.stl".to_owned(),
            data: vec![9],
        },
        mesh_use_embedded_materials: true,
        ..Marker::default()
    };
    check(
        6,
        &MarkerArray {
            markers: vec![marker],
        },
    );
    check(7, &MarkerArray::default());
}

#[test]
fn messages_of_cameras_have_the_bytes_of_ros2() {
    let header = || header(1, 2, "optical");
    check(
        8,
        &Image {
            header: header(),
            height: 1,
            width: 2,
            encoding: "16UC1".to_owned(),
            is_bigendian: 0,
            step: 4,
            data: vec![1, 0, 2, 3],
        },
    );
    check(
        9,
        &CompressedImage {
            header: header(),
            format: "16UC1; compressedDepth png".to_owned(),
            data: vec![1, 2, 3],
        },
    );
    check(
        10,
        &CameraInfo {
            header: header(),
            height: 480,
            width: 640,
            distortion_model: "plumb_bob".to_owned(),
            d: vec![0.1, 0.2, 0.3, 0.4, 0.5],
            k: [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [
                600.0, 0.0, 320.0, -30.0, 0.0, 601.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0,
            ],
            binning_x: 1,
            binning_y: 2,
            roi: RegionOfInterest {
                x_offset: 3,
                y_offset: 4,
                height: 5,
                width: 6,
                do_rectify: true,
            },
        },
    );
    let field = |name: &str, offset, datatype| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    };
    check(
        11,
        &PointCloud2 {
            header: header(),
            height: 1,
            width: 1,
            fields: vec![
                field("x", 0, PointField::FLOAT32),
                field("rgb", 16, PointField::FLOAT64),
            ],
            is_bigendian: false,
            point_step: 24,
            row_step: 24,
            data: (0..24).collect(),
            is_dense: true,
        },
    );
}
