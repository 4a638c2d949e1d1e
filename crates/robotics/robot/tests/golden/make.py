"""Writes golden numbers of kinematics and dynamics with Pinocchio.

    python -m venv venv && venv/bin/pip install pin==4.1.0
    venv/bin/python crates/robotics/robot/tests/golden/make.py [FOLDER WITH PUBLISHED URDFS]

For each URDF, `NAME.f64` holds little-endian doubles and `golden.json` what they are. The states
are drawn by SplitMix64 from a seed, which the test does as well; so are the weights by which long
results are summed up, one sum per link, over all their entries: an error in any entry shows.

Numbers of a state, first with a fixed root and then with a free one:
  fixed: pose of each link        one sum over the 12 entries of [R | p]
         Jacobian of each link    one sum over the entries of (6, dof), at the link's origin,
                                  along the root's axes, linear rows first
         inverse dynamics         dof
         gravity torque           dof
         mass matrix              its diagonal, then its product with the weights: 2 dof
  free:  pose of each link, Jacobian of each link (6, 6 + dof), inverse dynamics 6 + dof,
         gravity 6 + dof, mass matrix 2 (6 + dof), pose of the root after its twist for 1 s: 12
The first state also has every entry of poses, Jacobians and mass matrix, row by row.

Joints that mimic others: the numbers are those of the robot in which every joint is independent,
brought together by the constant matrix G with q_full = G q + o: torques G^T tau, mass matrix
G^T M G, Jacobians J G. Pinocchio's own mimic joints are not used: not all of its algorithms have
them. G is made here from the XML, apart from any parser under test.

Links whose inertial has no mass are left out by Pinocchio's reader as by ours; it takes the first
of several inertials. It refuses a <limit> without effort or velocity: they are filled in with 0.
"""

import json
import os
import struct
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

N_STATES = 100
GRAVITY = 9.81
HERE = os.path.dirname(os.path.abspath(__file__))
OURS = [
    os.path.join(HERE, "../../../../../data/robots/allegro_right.urdf"),
    os.path.join(HERE, "../../../../../data/robots/allegro_left.urdf"),
    os.path.join(HERE, "../../../../../data/robots/xarm6_allegro.urdf"),
    os.path.join(HERE, "mimic_hand.urdf"),
    os.path.join(HERE, "odd_arm.urdf"),
]


class SplitMix64:
    """Steele, Lea and Flood, Fast splittable pseudorandom number generators, 2014."""

    def __init__(self, seed):
        self.state = seed

    def unit(self):
        """The next number in [-1, 1)."""
        mask = (1 << 64) - 1
        self.state = (self.state + 0x9E3779B97F4A7C15) & mask
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        z ^= z >> 31
        return (z >> 11) / float(1 << 52) - 1.0

    def vector(self, n):
        return np.array([self.unit() for _ in range(n)])


def mimics(path):
    """Each mimic joint's master, multiplier and offset, through any number of others."""
    direct = {}
    for joint in ElementTree.parse(path).getroot().findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            direct[joint.get("name")] = (
                mimic.get("joint"),
                float(mimic.get("multiplier", 1)),
                float(mimic.get("offset", 0)),
            )
    resolved = {}
    for name in direct:
        master, multiplier, offset = direct[name]
        while master in direct:
            above, times, plus = direct[master]
            offset += multiplier * plus
            multiplier *= times
            master = above
        resolved[name] = (master, multiplier, offset)
    return resolved


def readable(path):
    """The text of a URDF with what Pinocchio's reader wants to see in each limit."""
    tree = ElementTree.parse(path)
    for limit in tree.getroot().iter("limit"):
        for key in ["effort", "velocity"]:
            limit.set(key, limit.get(key, "0"))
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


class Robot:
    def __init__(self, path, free):
        root = pin.JointModelFreeFlyer() if free else None
        xml = readable(path)
        self.model = pin.buildModelFromXML(xml) if root is None else pin.buildModelFromXML(xml, root)
        self.model.gravity.linear = np.array([0, 0, -GRAVITY])
        self.data = self.model.createData()
        self.n_root = 6 if free else 0
        first = 2 if free else 1
        names = list(self.model.names)[first:]
        follows = mimics(path)
        self.joints = sorted(name for name in names if name not in follows)
        n = self.n_root + len(self.joints)
        self.g = np.zeros((self.model.nv, n))
        self.offset = np.zeros(self.model.nv)
        self.g[: self.n_root, : self.n_root] = np.eye(self.n_root)
        for name in names:
            row = self.model.joints[self.model.getJointId(name)].idx_v
            master, multiplier, offset = follows.get(name, (name, 1.0, 0.0))
            self.g[row, self.n_root + self.joints.index(master)] = multiplier
            self.offset[row] = offset
        self.links = sorted(
            frame.name for frame in self.model.frames if frame.type == pin.FrameType.BODY and frame.name != "universe"
        )

    def configuration(self, q, world_from_root):
        """Pinocchio's configuration: joints that turn without end are cosine and sine."""
        positions = self.g[:, self.n_root :] @ q + self.offset
        full = pin.neutral(self.model)
        if world_from_root is not None:
            full[:7] = pin.SE3ToXYZQUAT(world_from_root)
        for joint in self.model.joints[2 if self.n_root else 1 :]:
            position = positions[joint.idx_v]
            if joint.nq == 2:
                full[joint.idx_q : joint.idx_q + 2] = [np.cos(position), np.sin(position)]
            else:
                full[joint.idx_q] = position
        return full

    def numbers(self, q, v, a, weights, world_from_root, everything):
        model, data, g = self.model, self.data, self.g
        full = self.configuration(q, world_from_root)
        out, rest = [], []
        pin.computeJointJacobians(model, data, full)
        pin.updateFramePlacements(model, data)
        poses, jacobians = [], []
        for name in self.links:
            frame = model.getFrameId(name, pin.FrameType.BODY)
            pose = data.oMf[frame]
            entries = np.hstack([pose.rotation, pose.translation.reshape(3, 1)]).flatten()
            jacobian = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED) @ g
            poses.append(entries @ weights[:12])
            jacobians.append(jacobian.flatten() @ weights[: jacobian.size])
            rest += [entries, jacobian.flatten()]
        tau = g.T @ pin.rnea(model, data, full, g @ v, g @ a)
        gravity = g.T @ pin.computeGeneralizedGravity(model, data, full)
        upper = pin.crba(model, data, full)
        mass = np.triu(upper) + np.triu(upper, 1).T
        mass = g.T @ mass @ g
        out += [poses, jacobians, tau, gravity, np.diag(mass), mass @ weights[: len(mass)]]
        if world_from_root is not None:
            after = world_from_root * pin.exp6(v[:6])
            out.append(np.hstack([after.rotation, after.translation.reshape(3, 1)]).flatten())
        if everything:
            out += rest + [mass.flatten()]
        return np.concatenate([np.asarray(part, dtype=float).ravel() for part in out])


def write(path, seed, prefix):
    name = prefix + os.path.splitext(os.path.basename(path))[0]
    fixed, free = Robot(path, False), Robot(path, True)
    assert fixed.joints == free.joints and fixed.links == free.links
    n = len(fixed.joints)
    random = SplitMix64(seed)
    weights = random.vector(6 * (6 + n) + 12)
    parts = []
    for state in range(N_STATES):
        q, v, a = random.vector(n) * 1.5, random.vector(6 + n) * 3.0, random.vector(6 + n) * 10.0
        quaternion, place = random.vector(4), random.vector(3)
        quaternion /= np.linalg.norm(quaternion)
        world_from_root = pin.XYZQUATToSE3(np.concatenate([place, quaternion]))
        parts.append(fixed.numbers(q, v[6:], a[6:], weights, None, state == 0))
        parts.append(free.numbers(q, v, a, weights, world_from_root, state == 0))
    numbers = np.concatenate(parts)
    with open(os.path.join(HERE, name + ".f64"), "wb") as file:
        file.write(struct.pack(f"<{len(numbers)}d", *numbers))
    return {
        "name": name,
        "seed": seed,
        "joints": fixed.joints,
        "links": fixed.links,
        "numbers": len(numbers),
    }


def main():
    published = []
    if len(sys.argv) > 1:
        published = sorted(
            os.path.join(sys.argv[1], file) for file in os.listdir(sys.argv[1]) if file.endswith(".urdf")
        )
    robots = []
    for seed, path in enumerate(OURS + published):
        robot = write(path, seed + 1, "published_" if path in published else "")
        robot["published"] = path in published
        robots.append(robot)
    golden = {"pinocchio": pin.__version__, "states": N_STATES, "gravity": GRAVITY, "robots": robots}
    with open(os.path.join(HERE, "golden.json"), "w") as file:
        json.dump(golden, file, indent=1)
        file.write("\n")


main()
