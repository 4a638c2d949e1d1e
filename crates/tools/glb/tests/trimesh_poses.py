"""Checks where trimesh finds the links of a motion.

Usage: trimesh_poses.py FILE NODES TIME|LINK|x,y,z,qx,qy,qz,qw ...

The animation is sampled here, with numpy alone, and put into the nodes; trimesh then loads the scene and
says where each link is. glTF is y up, the poses given are z up.
"""

import io
import json
import struct
import sys

import numpy as np
import trimesh


def chunks(data):
    magic, version, length = struct.unpack_from("<4sII", data)
    assert magic == b"glTF" and version == 2 and length == len(data)
    n, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + n]), data[20 + n + 8 :]


def accessor(root, buffer, idx):
    one = root["accessors"][idx]
    view = root["bufferViews"][one["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[one["type"]]
    kind = {5126: "<f4", 5122: "<i2"}[one["componentType"]]
    numbers = np.frombuffer(buffer, kind, one["count"] * width, view.get("byteOffset", 0))
    numbers = numbers.astype(float).reshape(one["count"], width)
    return np.maximum(numbers / 32767, -1) if one.get("normalized") else numbers


def slerp(a, b, share):
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = a @ b
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > 1 - 1e-12:
        return a
    angle = np.arccos(cosine)
    return (np.sin((1 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)


def posed(root, buffer, time_s):
    """The same scene, at rest as it is at a time."""
    root = json.loads(json.dumps(root))
    for animation in root.pop("animations"):
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times = accessor(root, buffer, sampler["input"])[:, 0]
            values = accessor(root, buffer, sampler["output"])
            at = int(np.searchsorted(times, time_s, side="right")) - 1
            path = channel["target"]["path"]
            if at < 0:
                value = values[0]
            elif at + 1 >= len(times) or sampler["interpolation"] == "STEP":
                value = values[at]
            else:
                share = (time_s - times[at]) / (times[at + 1] - times[at])
                if path == "rotation":
                    value = slerp(values[at], values[at + 1], share)
                else:
                    value = values[at] + share * (values[at + 1] - values[at])
            root["nodes"][channel["target"]["node"]][path] = value.tolist()
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(buffer))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer


def main():
    with open(sys.argv[1], "rb") as file:
        root, buffer = chunks(file.read())
    found = len(root["nodes"])
    assert found == int(sys.argv[2]), f"{found} nodes, expected {sys.argv[2]}"
    worst = 0.0
    scenes = {}
    to_y_up = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])
    for argument in sys.argv[3:]:
        time_s, link, numbers = argument.split("|")
        if time_s not in scenes:
            data = io.BytesIO(posed(root, buffer, float(time_s)))
            scenes[time_s] = trimesh.load(data, file_type="glb", force="scene")
            names = set(scenes[time_s].graph.nodes)
            missing = {node["name"] for node in root["nodes"]} - names
            assert not missing, f"trimesh does not find {missing}"
        world_from_link, _ = scenes[time_s].graph.get(link)
        x, y, z, qx, qy, qz, qw = map(float, numbers.split(","))
        expected = trimesh.transformations.quaternion_matrix([qw, qx, qy, qz])
        expected[:3, 3] = [x, y, z]
        off = np.linalg.norm((to_y_up @ expected)[:3, 3] - world_from_link[:3, 3])
        # A point 10 cm along each axis says where the link is turned to.
        turned = np.abs((to_y_up @ expected)[:3, :3] - world_from_link[:3, :3]).max() * 0.1
        worst = max(worst, off, turned)
        assert off < 1e-4 and turned < 1e-4, f"{link} at {time_s} s is off by {off} m, {turned} m"
    print(f"{len(sys.argv) - 3} poses within 1e-4 m, the farthest by {worst:.2e} m")


main()
