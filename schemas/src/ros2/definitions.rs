//! The `.msg` definitions of ROS 2 Jazzy, without their comments.
//!
//! They are interface definitions from `common_interfaces` and `rcl_interfaces` (Apache-2.0) and
//! `geometry2` (BSD-3-Clause).

use super::Part;

pub(super) const TIME: Part = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
pub(super) const DURATION: Part = ("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n");
pub(super) const HEADER: Part = (
    "std_msgs/Header",
    "builtin_interfaces/Time stamp\nstring frame_id\n",
);
pub(super) const STRING: Part = ("std_msgs/String", "string data\n");
pub(super) const COLOR_RGBA: Part = (
    "std_msgs/ColorRGBA",
    "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
);
pub(super) const VECTOR3: Part = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");
pub(super) const POINT: Part = ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n");
pub(super) const QUATERNION: Part = (
    "geometry_msgs/Quaternion",
    "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
);
pub(super) const POSE: Part = (
    "geometry_msgs/Pose",
    "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
);
pub(super) const POSE_STAMPED: Part = (
    "geometry_msgs/PoseStamped",
    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
);
pub(super) const TRANSFORM: Part = (
    "geometry_msgs/Transform",
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
);
pub(super) const TRANSFORM_STAMPED: Part = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
);
pub(super) const TF_MESSAGE: Part = (
    "tf2_msgs/TFMessage",
    "geometry_msgs/TransformStamped[] transforms\n",
);
pub(super) const JOINT_STATE: Part = (
    "sensor_msgs/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
);
pub(super) const JOINT_TRAJECTORY: Part = (
    "trajectory_msgs/JointTrajectory",
    "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n",
);
pub(super) const JOINT_TRAJECTORY_POINT: Part = (
    "trajectory_msgs/JointTrajectoryPoint",
    "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n\
     builtin_interfaces/Duration time_from_start\n",
);
pub(super) const COMPRESSED_IMAGE: Part = (
    "sensor_msgs/CompressedImage",
    "std_msgs/Header header\nstring format\nuint8[] data\n",
);
pub(super) const IMAGE: Part = (
    "sensor_msgs/Image",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\n\
     uint8[] data\n",
);
pub(super) const REGION_OF_INTEREST: Part = (
    "sensor_msgs/RegionOfInterest",
    "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
);
pub(super) const CAMERA_INFO: Part = (
    "sensor_msgs/CameraInfo",
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
     float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
);
pub(super) const POINT_FIELD: Part = (
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\n\
     uint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
);
pub(super) const POINT_CLOUD2: Part = (
    "sensor_msgs/PointCloud2",
    "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
     uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
);
pub(super) const UV_COORDINATE: Part =
    ("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n");
pub(super) const MESH_FILE: Part = (
    "visualization_msgs/MeshFile",
    "string filename\nuint8[] data\n",
);
pub(super) const MARKER: Part = (
    "visualization_msgs/Marker",
    "int32 ARROW=0
int32 CUBE=1
int32 SPHERE=2
int32 CYLINDER=3
int32 LINE_STRIP=4
int32 LINE_LIST=5
int32 CUBE_LIST=6
int32 SPHERE_LIST=7
int32 POINTS=8
int32 TEXT_VIEW_FACING=9
int32 MESH_RESOURCE=10
int32 TRIANGLE_LIST=11
int32 ARROW_STRIP=12
int32 ADD=0
int32 MODIFY=0
int32 DELETE=2
int32 DELETEALL=3
std_msgs/Header header
string ns
int32 id
int32 type
int32 action
geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
std_msgs/ColorRGBA color
builtin_interfaces/Duration lifetime
bool frame_locked
geometry_msgs/Point[] points
std_msgs/ColorRGBA[] colors
string texture_resource
sensor_msgs/CompressedImage texture
visualization_msgs/UVCoordinate[] uv_coordinates
string text
string mesh_resource
visualization_msgs/MeshFile mesh_file
bool mesh_use_embedded_materials
",
);
pub(super) const MARKER_ARRAY: Part = (
    "visualization_msgs/MarkerArray",
    "visualization_msgs/Marker[] markers\n",
);
