"""A hand from its URDF: a tree of links with joints, masses and primitives, in meters, kilograms and radians."""

import xml.etree.ElementTree as ElementTree

import numpy as np

KINDS = {"revolute", "continuous", "prismatic", "fixed"}
# The number of the root link, and of the palm's body among fingers.
PALM = 0


class HandError(Exception):
    """What the judge cannot simulate of a hand."""


def numbers(text, default):
    return np.array([float(word) for word in text.split()]) if text else np.array(default, float)


def rotation(rpy):
    """The matrix of roll, pitch and yaw about fixed axes, as URDF has them."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])


def xyzw(matrix):
    """The unit quaternion of a rotation, w last and not negative (K. Shoemake, 1985)."""
    m = matrix
    four = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                     1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])
    largest = int(np.argmax(four))
    rows = [
        [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], four[0]],
        [four[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
        [m[1, 0] + m[0, 1], four[2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
        [m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], four[3], m[1, 0] - m[0, 1]],
    ]
    q = np.array(rows[largest])
    q /= np.linalg.norm(q)
    return q if q[3] >= 0 else -q


def origin(element):
    """Translation and rotation of an element's `<origin>`."""
    found = element.find("origin") if element is not None else None
    given = (lambda key: found.get(key)) if found is not None else (lambda key: None)
    return numbers(given("xyz"), [0, 0, 0]), rotation(numbers(given("rpy"), [0, 0, 0]))


def seven(place, turn):
    return [*map(float, place), *map(float, xyzw(turn))]


def shapes(link):
    found = []
    for collision in link.findall("collision"):
        geometry = collision.find("geometry")[0]
        size = {
            "box": lambda: [float(edge) / 2 for edge in geometry.get("size").split()],
            "sphere": lambda: [float(geometry.get("radius"))],
            "cylinder": lambda: [float(geometry.get("radius")), float(geometry.get("length")) / 2],
            "capsule": lambda: [float(geometry.get("radius")), float(geometry.get("length")) / 2],
        }.get(geometry.tag)
        if size is None:
            raise HandError(f"link `{link.get('name')}` collides with a {geometry.tag}: this judge knows primitives")
        found.append({"type": geometry.tag, "size": size(), "link_from_shape": seven(*origin(collision))})
    return found


def inertial(link):
    element = link.find("inertial")
    if element is None:
        return {"mass": 0.0, "center_of_mass": None, "inertia": None}
    place, turn = origin(element)
    given = element.find("inertia")
    xx, xy, xz, yy, yz, zz = (float(given.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    m = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return {
        "mass": float(element.find("mass").get("value")),
        "center_of_mass": [float(x) for x in place],
        "inertia": [float(m[at]) for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))],
    }


def follow(robot):
    """For each joint that follows another in the end: the independent one, multiplier and offset."""
    mimics = {joint.get("name"): joint.find("mimic") for joint in robot.findall("joint")}
    followed = {}
    for name, mimic in mimics.items():
        factor, offset, master = 1.0, 0.0, name
        for _ in mimics:
            if mimic is None:
                break
            offset += factor * float(mimic.get("offset", 0))
            factor *= float(mimic.get("multiplier", 1))
            master = mimic.get("joint")
            if master not in mimics:
                raise HandError(f"joint `{name}` follows `{master}`, which is no joint")
            mimic = mimics[master]
        if mimic is not None:
            raise HandError(f"joint `{name}` follows itself")
        if master != name:
            followed[name] = (master, factor, offset)
    return followed


def narrow(links):
    """Keeps each independent joint where those that follow it are within their own limits."""
    by_name = {link["joint"]["name"]: link["joint"] for link in links if link["joint"]}
    for joint in by_name.values():
        if "master" not in joint:
            continue
        if joint["master"] not in by_name:
            raise HandError(f"joint `{joint['name']}` follows `{joint['master']}`, which does not move")
        master = by_name[joint["master"]]
        joint["number"] = master["number"]
        if joint["multiplier"] == 0:
            continue
        ends = sorted((joint[end] - joint["offset"]) / joint["multiplier"] for end in ("lower", "upper"))
        lower, upper = max(master["lower"], ends[0]), min(master["upper"], ends[1])
        if lower <= upper:
            master["lower"], master["upper"] = lower, upper


def read(path):
    """The links, the root first and every link after its parent; independent joints are numbered in that order, and
    those that follow one have its number."""
    robot = ElementTree.parse(path).getroot()
    by_name = {link.get("name"): link for link in robot.findall("link")}
    below = {}
    for joint in robot.findall("joint"):
        if joint.get("type") not in KINDS:
            raise HandError(f"joint `{joint.get('name')}` is {joint.get('type')}: not simulated here")
        below.setdefault(joint.find("parent").get("link"), []).append(joint)
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}
    (root,) = [name for name in by_name if name not in children]
    followed = follow(robot)
    links, n_joints = [], 0

    def walk(name, parent, joint):
        nonlocal n_joints
        entry = {"name": name, "parent": parent, "joint": None, "parent_from_joint": seven(*origin(joint)),
                 **inertial(by_name[name]), "shapes": shapes(by_name[name])}
        if joint is not None and joint.get("type") != "fixed":
            axis = joint.find("axis")
            axis = numbers(axis.get("xyz") if axis is not None else None, [1, 0, 0])
            limit = joint.find("limit")
            bound = lambda key, default: float(limit.get(key, default)) if limit is not None else default
            is_bounded = joint.get("type") != "continuous"
            entry["joint"] = {
                "number": n_joints, "name": joint.get("name"), "kind": joint.get("type"),
                "multiplier": 1.0, "offset": 0.0,
                "axis": [float(x) for x in axis / np.linalg.norm(axis)],
                "lower": bound("lower", 0.0) if is_bounded else -np.inf,
                "upper": bound("upper", 0.0) if is_bounded else np.inf,
            }
            if joint.get("name") in followed:
                keys = ("master", "multiplier", "offset")
                entry["joint"] |= dict(zip(keys, followed[joint.get("name")]))
            else:
                n_joints += 1
        links.append(entry)
        number = len(links) - 1
        for child in below.get(name, []):
            walk(child.find("child").get("link"), number, child)

    walk(root, None, None)
    narrow(links)
    return links


def joints(links):
    """The independent joints in their order."""
    found = (link["joint"] for link in links if link["joint"] and "master" not in link["joint"])
    return sorted(found, key=lambda joint: joint["number"])


def followers(links):
    """The joints that follow others."""
    return [link["joint"] for link in links if link["joint"] and "master" in link["joint"]]


def bodies(links):
    """For each link the first of those that are fixed to each other: their body."""
    found = []
    for number, link in enumerate(links):
        is_fixed = link["parent"] is not None and link["joint"] is None
        found.append(found[link["parent"]] if is_fixed else number)
    return found


def fingers(links):
    """For each link the first body of its finger, which hangs on the palm; the palm's own is `PALM`."""
    found, body_of = [PALM], bodies(links)
    for number, link in enumerate(links[1:], 1):
        above = found[link["parent"]]
        found.append(number if above == PALM and body_of[number] == number else above)
    return found
