"""Writes messages.txt: messages as `rosbags` 0.11.9 (PyPI) serializes them for ROS 2 Jazzy.

    python3 -m venv .venv && .venv/bin/pip install rosbags==0.11.9
    .venv/bin/python messages.py > messages.txt

One line each: type, type hash, the CDR bytes in hexadecimal digits.
"""

import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
t = store.types


def make(name, *args):
    return t[name](*args)


def floats(*numbers):
    return np.array(numbers, dtype=np.float64)


def header(sec, nanosec, frame):
    return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", sec, nanosec), frame)


def vector(*xyz):
    return make("geometry_msgs/msg/Vector3", *xyz)


def point(*xyz):
    return make("geometry_msgs/msg/Point", *xyz)


def quaternion(*xyzw):
    return make("geometry_msgs/msg/Quaternion", *xyzw)


def pose(p, q):
    return make("geometry_msgs/msg/Pose", point(*p), quaternion(*q))


def color(*rgba):
    return make("std_msgs/msg/ColorRGBA", *rgba)


def bytes_of(*numbers):
    return np.array(numbers, dtype=np.uint8)


messages = [
    make("sensor_msgs/msg/JointState", header(1, 250_000_000, ""),
         ["joint_0.0", "joint_1.0"], floats(0.5, -1.25), floats(), floats(0.1, 0.7)),
    make("trajectory_msgs/msg/JointTrajectory", header(1, 0, "base_link"), ["a", "bc", ""], [
        make("trajectory_msgs/msg/JointTrajectoryPoint", floats(0.1, 0.2, 0.3), floats(1, 2, 3),
             floats(), floats(), make("builtin_interfaces/msg/Duration", 0, 4_000_000)),
        make("trajectory_msgs/msg/JointTrajectoryPoint", floats(-0.1, -0.2, -0.3), floats(),
             floats(4, 5, 6), floats(), make("builtin_interfaces/msg/Duration", 2, 999_999_999)),
    ]),
    make("tf2_msgs/msg/TFMessage", [
        make("geometry_msgs/msg/TransformStamped", header(2, 3, "table"), "object",
             make("geometry_msgs/msg/Transform", vector(0.1, 0.2, 0.3), quaternion(0, 0, 0.6, 0.8))),
        make("geometry_msgs/msg/TransformStamped", header(2, 3, "base_link"), "link_0.0",
             make("geometry_msgs/msg/Transform", vector(-0.1, 0, 1e-9), quaternion(0, 0, 0, 1))),
    ]),
    make("geometry_msgs/msg/PoseStamped", header(-1, 999_999_999, "object"),
         pose((1, 2, 3), (0.5, 0.5, 0.5, 0.5))),
    make("std_msgs/msg/String", "<robot name=\"größe\"/>"),
    make("std_msgs/msg/String", ""),
    make("visualization_msgs/msg/MarkerArray", [
        make("visualization_msgs/msg/Marker", header(1, 0, "object"), "contacts", 7, 7, 0,
             pose((0, 0, 0), (0, 0, 0, 1)), vector(0.01, 0.01, 0.01), color(0.25, 0.5, 0.75, 1.0),
             make("builtin_interfaces/msg/Duration", 0, 0), True,
             [point(0.1, 0.2, 0.3), point(-0.1, 0, 0)], [color(1, 0, 0, 1)],
             "", make("sensor_msgs/msg/CompressedImage", header(0, 0, ""), "png", bytes_of(1, 2, 3)),
             [make("visualization_msgs/msg/UVCoordinate", 0.5, 0.25)],
             "text", "", make("visualization_msgs/msg/MeshFile", "a.stl", bytes_of(9)), True),
    ]),
    make("visualization_msgs/msg/MarkerArray", []),
    make("sensor_msgs/msg/Image", header(1, 2, "optical"), 1, 2, "16UC1", 0, 4, bytes_of(1, 0, 2, 3)),
    make("sensor_msgs/msg/CompressedImage", header(1, 2, "optical"), "16UC1; compressedDepth png",
         bytes_of(1, 2, 3)),
    make("sensor_msgs/msg/CameraInfo", header(1, 2, "optical"), 480, 640, "plumb_bob",
         floats(0.1, 0.2, 0.3, 0.4, 0.5), floats(600, 0, 320, 0, 601, 240, 0, 0, 1),
         floats(1, 0, 0, 0, 1, 0, 0, 0, 1), floats(600, 0, 320, -30, 0, 601, 240, 0, 0, 0, 1, 0), 1, 2,
         make("sensor_msgs/msg/RegionOfInterest", 3, 4, 5, 6, True)),
    make("sensor_msgs/msg/PointCloud2", header(1, 2, "optical"), 1, 1, [
        make("sensor_msgs/msg/PointField", "x", 0, 7, 1),
        make("sensor_msgs/msg/PointField", "rgb", 16, 8, 1),
    ], False, 24, 24, bytes_of(*range(24)), True),
]

for message in messages:
    kind = message.__msgtype__
    data = bytes(store.serialize_cdr(message, kind))
    print(kind, store.hash_rihs01(kind), data.hex())
