//! The messages as structs, field by field in the order of their definitions.

use serde::Serialize;
use serde_json::Value;

use super::{
    Message, Part,
    cdr::{Cdr, CdrError, CdrReader, CdrWriter},
    definitions as text,
};

/// Encodes a struct's fields in the order given, which is the order of the definition.
macro_rules! fields {
    ($message:ident { $($field:ident),* $(,)? }) => {
        impl Cdr for $message {
            fn encode(&self, writer: &mut CdrWriter) {
                $(self.$field.encode(writer);)*
            }

            fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
                Ok(Self { $($field: Cdr::decode(reader)?),* })
            }
        }
    };
}
pub(super) use fields;

/// `builtin_interfaces/Time`: a point in time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds beyond them, below 1e9.
    pub nanosec: u32,
}
fields!(Time { sec, nanosec });

/// `builtin_interfaces/Duration`: a length of time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Duration {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds beyond them, below 1e9.
    pub nanosec: u32,
}
fields!(Duration { sec, nanosec });

/// `std_msgs/Header`: time and frame.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Header {
    /// Time of the data.
    pub stamp: Time,
    /// The frame of the coordinates.
    pub frame_id: String,
}
fields!(Header { stamp, frame_id });

/// `geometry_msgs/Vector3`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Vector3 {
    /// Along the frame's x.
    pub x: f64,
    /// Along the frame's y.
    pub y: f64,
    /// Along the frame's z.
    pub z: f64,
}
fields!(Vector3 { x, y, z });

/// `geometry_msgs/Point`, in meters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Point {
    /// Along the frame's x, in meters.
    pub x: f64,
    /// Along the frame's y, in meters.
    pub y: f64,
    /// Along the frame's z, in meters.
    pub z: f64,
}
fields!(Point { x, y, z });

/// `geometry_msgs/Quaternion`, of unit length; the default is the identity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quaternion {
    /// First imaginary part.
    pub x: f64,
    /// Second imaginary part.
    pub y: f64,
    /// Third imaginary part.
    pub z: f64,
    /// Real part.
    pub w: f64,
}
fields!(Quaternion { x, y, z, w });

impl Default for Quaternion {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

/// `geometry_msgs/Pose`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Pose {
    /// Position in meters.
    pub position: Point,
    /// Orientation.
    pub orientation: Quaternion,
}
fields!(Pose {
    position,
    orientation
});

/// `geometry_msgs/PoseStamped`: a pose at a time, in the header's frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PoseStamped {
    /// Time and frame.
    pub header: Header,
    /// The pose.
    pub pose: Pose,
}
fields!(PoseStamped { header, pose });

/// `geometry_msgs/Transform`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Transform {
    /// Translation in meters.
    pub translation: Vector3,
    /// Rotation.
    pub rotation: Quaternion,
}
fields!(Transform {
    translation,
    rotation
});

/// `geometry_msgs/TransformStamped`: the pose of a child frame in the header's frame.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TransformStamped {
    /// Time, and the parent frame.
    pub header: Header,
    /// The child frame.
    pub child_frame_id: String,
    /// Parent from child.
    pub transform: Transform,
}
fields!(TransformStamped {
    header,
    child_frame_id,
    transform
});

/// `tf2_msgs/TFMessage`: poses of frames, topic `/tf` or `/tf_static`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct TfMessage {
    /// One entry per child frame.
    pub transforms: Vec<TransformStamped>,
}
fields!(TfMessage { transforms });

/// `sensor_msgs/JointState`; each list is empty or as long as `name`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct JointState {
    /// Time.
    pub header: Header,
    /// The joints' names.
    pub name: Vec<String>,
    /// Positions in radians, meters if prismatic.
    pub position: Vec<f64>,
    /// Velocities in radians or meters per second.
    pub velocity: Vec<f64>,
    /// Torques in newton meters, forces in newtons if prismatic.
    pub effort: Vec<f64>,
}
fields!(JointState {
    header,
    name,
    position,
    velocity,
    effort
});

/// `trajectory_msgs/JointTrajectoryPoint`; each list is empty or as long as the joints' names.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct JointTrajectoryPoint {
    /// Positions in radians, meters if prismatic.
    pub positions: Vec<f64>,
    /// Velocities in radians or meters per second.
    pub velocities: Vec<f64>,
    /// Accelerations in radians or meters per second squared.
    pub accelerations: Vec<f64>,
    /// Torques in newton meters, forces in newtons if prismatic.
    pub effort: Vec<f64>,
    /// Time at which the point is to be reached, counted from the start.
    pub time_from_start: Duration,
}
fields!(JointTrajectoryPoint {
    positions,
    velocities,
    accelerations,
    effort,
    time_from_start,
});

/// `trajectory_msgs/JointTrajectory`: commands for joints over time.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct JointTrajectory {
    /// Start time.
    pub header: Header,
    /// The joints' names.
    pub joint_names: Vec<String>,
    /// The points in time order.
    pub points: Vec<JointTrajectoryPoint>,
}
fields!(JointTrajectory {
    header,
    joint_names,
    points
});

/// `std_msgs/String`, e.g. a robot's URDF on topic `/robot_description`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Text {
    /// The text.
    pub data: String,
}
fields!(Text { data });

/// `std_msgs/ColorRGBA`, each part in 0..=1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ColorRgba {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Opacity.
    pub a: f32,
}
fields!(ColorRgba { r, g, b, a });

/// `sensor_msgs/CompressedImage`, e.g. of a depth camera; markers carry one, always empty here.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct CompressedImage {
    /// Time and frame.
    pub header: Header,
    /// E.g. `png`, or `16UC1; compressedDepth png`.
    pub format: String,
    /// The image file's bytes; of depths behind a header of 12 bytes.
    pub data: Vec<u8>,
}
fields!(CompressedImage {
    header,
    format,
    data
});

/// `visualization_msgs/UVCoordinate`: a place in a texture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct UvCoordinate {
    /// Rightwards, 0..=1.
    pub u: f32,
    /// Upwards, 0..=1.
    pub v: f32,
}
fields!(UvCoordinate { u, v });

/// `visualization_msgs/MeshFile`; markers carry one, always empty here.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct MeshFile {
    /// The file's name.
    pub filename: String,
    /// Its bytes.
    pub data: Vec<u8>,
}
fields!(MeshFile { filename, data });

/// `visualization_msgs/Marker`: a shape to draw.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Marker {
    /// Time and frame.
    pub header: Header,
    /// With `id` the marker's name.
    pub ns: String,
    /// With `ns` the marker's name.
    pub id: i32,
    /// The shape: [`Marker::SPHERE_LIST`] or [`Marker::TRIANGLE_LIST`].
    pub r#type: i32,
    /// Action: 0 adds or replaces.
    pub action: i32,
    /// Pose in the header's frame.
    pub pose: Pose,
    /// Size in meters; a factor for triangles.
    pub scale: Vector3,
    /// Color of the whole.
    pub color: ColorRgba,
    /// Duration of the display; zero means forever.
    pub lifetime: Duration,
    /// Whether it moves with its frame after the stamp.
    pub frame_locked: bool,
    /// Points in meters.
    pub points: Vec<Point>,
    /// A color per point, or none.
    pub colors: Vec<ColorRgba>,
    /// Name of a texture.
    pub texture_resource: String,
    /// An embedded texture.
    pub texture: CompressedImage,
    /// Places in the texture, one per point.
    pub uv_coordinates: Vec<UvCoordinate>,
    /// Text of a text marker.
    pub text: String,
    /// Address of a mesh.
    pub mesh_resource: String,
    /// An embedded mesh.
    pub mesh_file: MeshFile,
    /// Whether the mesh brings its colors.
    pub mesh_use_embedded_materials: bool,
}
fields!(Marker {
    header,
    ns,
    id,
    r#type,
    action,
    pose,
    scale,
    color,
    lifetime,
    frame_locked,
    points,
    colors,
    texture_resource,
    texture,
    uv_coordinates,
    text,
    mesh_resource,
    mesh_file,
    mesh_use_embedded_materials,
});

impl Marker {
    /// An arrow from the first of two points to the second.
    pub const ARROW: i32 = 0;
    /// A sphere at every point.
    pub const SPHERE_LIST: i32 = 7;
    /// A triangle for every three points.
    pub const TRIANGLE_LIST: i32 = 11;
}

/// `visualization_msgs/MarkerArray`: shapes to draw.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MarkerArray {
    /// The shapes.
    pub markers: Vec<Marker>,
}
fields!(MarkerArray { markers });

/// Names a root message: its type, its hash in ROS 2 Jazzy and the definitions it is made of.
macro_rules! root {
    ($message:ident, $name:literal, $hash:literal, [$($part:ident),* $(,)?]) => {
        impl Message for $message {
            const TYPE: &'static str = $name;
            const HASH: &'static str = $hash;
            const PARTS: &'static [Part] = &[$(text::$part),*];
        }
    };
}
pub(super) use root;

root!(
    JointState,
    "sensor_msgs/msg/JointState",
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    [JOINT_STATE, HEADER, TIME]
);
root!(
    JointTrajectory,
    "trajectory_msgs/msg/JointTrajectory",
    "RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    [
        JOINT_TRAJECTORY,
        HEADER,
        TIME,
        JOINT_TRAJECTORY_POINT,
        DURATION
    ]
);
root!(
    TfMessage,
    "tf2_msgs/msg/TFMessage",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    [
        TF_MESSAGE,
        TRANSFORM_STAMPED,
        HEADER,
        TIME,
        TRANSFORM,
        VECTOR3,
        QUATERNION
    ]
);
root!(
    PoseStamped,
    "geometry_msgs/msg/PoseStamped",
    "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    [POSE_STAMPED, HEADER, TIME, POSE, POINT, QUATERNION]
);
root!(
    Text,
    "std_msgs/msg/String",
    "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    [STRING]
);
root!(
    MarkerArray,
    "visualization_msgs/msg/MarkerArray",
    "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
    [
        MARKER_ARRAY,
        MARKER,
        HEADER,
        TIME,
        POSE,
        POINT,
        QUATERNION,
        VECTOR3,
        COLOR_RGBA,
        DURATION,
        COMPRESSED_IMAGE,
        UV_COORDINATE,
        MESH_FILE,
    ]
);

/// Decodes the bytes of a message, whose type has this full name, as a JSON object with the fields of its definition;
/// `None` for a type that no recording of this project has. A number that is not finite is null.
///
/// ```
/// use schemas::ros2::{Message, Text, json_of};
///
/// let text = Text { data: "hello".to_owned() };
/// assert_eq!(json_of(Text::TYPE, &text.to_cdr()).unwrap()?["data"], "hello");
/// assert!(json_of("std_msgs/msg/Bool", &[]).is_none());
/// # Ok::<(), schemas::ros2::CdrError>(())
/// ```
///
/// # Errors
///
/// Fails if the bytes are not a message of the type.
pub fn json_of(message_type: &str, cdr: &[u8]) -> Option<Result<Value, CdrError>> {
    fn json<M: Message + Serialize>(cdr: &[u8]) -> Result<Value, CdrError> {
        M::from_cdr(cdr).map(|message| serde_json::to_value(message).unwrap_or_default())
    }
    let decode: fn(&[u8]) -> Result<Value, CdrError> = match message_type {
        JointState::TYPE => json::<JointState>,
        JointTrajectory::TYPE => json::<JointTrajectory>,
        TfMessage::TYPE => json::<TfMessage>,
        PoseStamped::TYPE => json::<PoseStamped>,
        Text::TYPE => json::<Text>,
        MarkerArray::TYPE => json::<MarkerArray>,
        _ => return None,
    };
    Some(decode(cdr))
}
