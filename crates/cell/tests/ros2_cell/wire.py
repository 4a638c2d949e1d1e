"""What another implementation of ROS 2 over zenoh hears of a cell, and the object's pose by it."""
import os, sys, threading, time
from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, get_topic_names_and_types

port, arm, hand, pose = int(sys.argv[1]), *sys.argv[2:5]
store = get_typestore(Stores.ROS2_JAZZY)


def of(kind):
    """Definition and hash of a type, both by the other implementation."""
    return {"msg_type": kind, "msg_definition": store.generate_msgdef(kind)[0], "type_hash": store.hash_rihs01(kind),
            "domain_id": 0, "router_port": port}


def heard(message):
    name, points = message.joint_names[0], message.points
    times = [p.time_from_start.sec + p.time_from_start.nanosec * 1e-9 for p in points]
    rising = all(a < b for a, b in zip(times, times[1:]))
    whole = all(len(p.positions) == len(p.velocities) == len(message.joint_names) for p in points)
    stops = not any(points[-1].velocities)
    print(f"heard {name} {len(points)} {rising} {whole} {stops}", flush=True)


keep = [ROS2Subscriber(f"{topic}/joint_trajectory", callback=heard, **of("trajectory_msgs/msg/JointTrajectory"))
        for topic in (arm, hand)]
publisher = ROS2Publisher(pose, **of("geometry_msgs/msg/PoseStamped"))
part = {name: store.types[f"{package}/msg/{name}"] for package, name in (
    ("geometry_msgs", "Pose"), ("geometry_msgs", "Point"), ("geometry_msgs", "Quaternion"),
    ("std_msgs", "Header"), ("builtin_interfaces", "Time"))}
there = part["Pose"](part["Point"](0.0, 0.0, 0.05), part["Quaternion"](0.0, 0.0, 0.0, 1.0))


def publish():
    while True:
        stamp = part["Time"](*divmod(time.time_ns(), 10**9))
        publisher.publish(header=part["Header"](stamp, "table"), pose=there)
        time.sleep(0.05)


threading.Thread(target=publish, daemon=True).start()
print("ready", flush=True)
sys.stdin.readline()
for topic, types in get_topic_names_and_types(domain_id=0, router_port=port):
    print(f"topic {topic} {types[0]}", flush=True)
os._exit(0)
