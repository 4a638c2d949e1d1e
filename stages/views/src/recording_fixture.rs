//! Recordings of depth cameras for tests, made in code byte by byte: with every part that may be missing or wrong.

use depth_view::DepthView;
use nalgebra::Isometry3;
use schemas::ros2::{
    CameraInfo, Header, Image, Message, PointCloud2, PointField, Quaternion, TfMessage, Time,
    Transform, TransformStamped, Vector3,
};
use spatial::xyzw;

/// The frame of the cameras.
pub(crate) const OPTICAL: &str = "camera_optical";

/// A message of a recording.
#[derive(Clone)]
pub(crate) struct Sent {
    pub(crate) topic: String,
    /// Empty for a topic without a schema.
    pub(crate) message_type: String,
    pub(crate) encoding: String,
    pub(crate) time_ms: i32,
    pub(crate) bytes: Vec<u8>,
}

/// Returns a message as it is sent.
pub(crate) fn sent<M: Message>(topic: &str, time_ms: i32, message: &M) -> Sent {
    Sent {
        topic: topic.to_owned(),
        message_type: M::TYPE.to_owned(),
        encoding: "cdr".to_owned(),
        time_ms,
        bytes: message.to_cdr(),
    }
}

/// Returns an MCAP file without chunks, index and checksums (<https://mcap.dev/spec>).
pub(crate) fn mcap(messages: &[Sent]) -> Vec<u8> {
    const MAGIC: &[u8] = b"\x89MCAP0\r\n";
    let mut bytes = MAGIC.to_vec();
    record(&mut bytes, 1, &[text("ros2"), text("a test")].concat());
    let mut topics: Vec<&str> = Vec::new();
    for message in messages {
        let known = topics.iter().position(|topic| *topic == message.topic);
        let channel = known.unwrap_or(topics.len());
        let number = |idx: usize| u16::try_from(idx).unwrap().to_le_bytes().to_vec();
        if known.is_none() {
            topics.push(&message.topic);
            let schema = if message.message_type.is_empty() {
                0
            } else {
                channel + 1
            };
            if schema > 0 {
                let name = text(&message.message_type);
                let schema = [number(schema), name, text("ros2msg"), text("")];
                record(&mut bytes, 3, &schema.concat());
            }
            let names = [text(&message.topic), text(&message.encoding), text("")];
            let ids = [number(channel), number(schema)];
            record(&mut bytes, 4, &[ids.concat(), names.concat()].concat());
        }
        let time_ns = 1_000_000 * u64::try_from(message.time_ms).unwrap();
        let times = [time_ns.to_le_bytes(); 2].concat();
        let parts = [number(channel), vec![0; 4], times, message.bytes.clone()];
        record(&mut bytes, 5, &parts.concat());
    }
    record(&mut bytes, 15, &[0; 4]);
    record(&mut bytes, 2, &[0; 20]);
    bytes.extend(MAGIC);
    bytes
}

fn record(bytes: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    bytes.push(opcode);
    bytes.extend((content.len() as u64).to_le_bytes());
    bytes.extend(content);
}

fn text(text: &str) -> Vec<u8> {
    let length = u32::try_from(text.len()).unwrap().to_le_bytes();
    [&length, text.as_bytes()].concat()
}

/// Returns the header of what the camera sees at a time.
pub(crate) fn header(time_ms: i32, frame: &str) -> Header {
    Header {
        stamp: Time {
            sec: time_ms / 1000,
            nanosec: u32::try_from(time_ms % 1000).unwrap() * 1_000_000,
        },
        frame_id: frame.to_owned(),
    }
}

/// Returns an image of millimeters, in the camera's frame at time 0.
pub(crate) fn image_16([width, height]: [u32; 2], numbers: &[u16]) -> Image {
    Image {
        header: header(0, OPTICAL),
        height,
        width,
        encoding: "16UC1".to_owned(),
        is_bigendian: 0,
        step: 2 * width,
        data: numbers.iter().flat_map(|it| it.to_le_bytes()).collect(),
    }
}

/// Returns an image of meters, in the camera's frame at time 0.
pub(crate) fn image_32([width, height]: [u32; 2], numbers: &[f32]) -> Image {
    Image {
        encoding: "32FC1".to_owned(),
        step: 4 * width,
        data: numbers.iter().flat_map(|it| it.to_le_bytes()).collect(),
        ..image_16([width, height], &[])
    }
}

/// Returns a cloud of numbers of 32 bits, with this many points of a row, and a color and two bytes of padding after each.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the cloud's numbers have 32 bits"
)]
pub(crate) fn cloud_message(points: &[[f64; 3]], width: usize) -> PointCloud2 {
    let field = |(idx, name): (u32, &str)| PointField {
        name: name.to_owned(),
        offset: 4 * idx,
        datatype: PointField::FLOAT32,
        count: 1,
    };
    let of_point = |point: &[f64; 3]| {
        let numbers = point.map(|number| (number as f32).to_le_bytes());
        [numbers.concat(), vec![7; 8]].concat()
    };
    let sides = [width, points.len() / width].map(|side| u32::try_from(side).unwrap());
    PointCloud2 {
        header: header(0, OPTICAL),
        height: sides[1],
        width: sides[0],
        fields: (0..).zip(["x", "y", "z", "rgb"]).map(field).collect(),
        is_bigendian: false,
        point_step: 20,
        row_step: 20 * sides[0],
        data: points.iter().flat_map(of_point).collect(),
        is_dense: false,
    }
}

/// Returns the camera of an image that is not distorted, in the camera's frame at time 0.
pub(crate) fn camera_info(view: &DepthView) -> CameraInfo {
    let [fx, fy] = view.intrinsics.focal;
    let [cx, cy] = view.intrinsics.center;
    let side = |side: usize| u32::try_from(side).unwrap();
    CameraInfo {
        header: header(0, OPTICAL),
        height: side(view.intrinsics.height),
        width: side(view.intrinsics.width),
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..CameraInfo::default()
    }
}

/// Returns the pose of a frame in another at a time.
pub(crate) fn tf(time_ms: i32, [parent, child]: [&str; 2], pose: &Isometry3<f64>) -> TfMessage {
    let [x, y, z, w] = xyzw(&pose.rotation);
    let at = pose.translation.vector;
    TfMessage {
        transforms: vec![TransformStamped {
            header: header(time_ms, parent),
            child_frame_id: child.to_owned(),
            transform: Transform {
                translation: Vector3 {
                    x: at.x,
                    y: at.y,
                    z: at.z,
                },
                rotation: Quaternion { x, y, z, w },
            },
        }],
    }
}
