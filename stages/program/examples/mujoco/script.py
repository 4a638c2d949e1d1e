"""The script of a motion, one command per control step: what `crates/physics/simulation/src/script.rs` commands.

A command is the part of the script, the palm's pose in the frame of the object as it lay, how far it is carried
from there along the table's axes, and the joints' positions. Poses are seven numbers, the quaternion's w last.
"""

import numpy as np


def steps(seconds, control_s):
    """How many control steps a duration takes, halves rounded away from zero."""
    return int(np.floor(max(seconds / control_s, 0.0) + 0.5))


def slerp(a, b, share):
    """Between two unit quaternions along the shorter arc; `b` where they are equal within rounding."""
    dot = float(np.dot(a, b))
    if dot < 0:
        b, dot = -b, -dot
    if dot >= 1:
        return a
    angle, sine = np.arccos(dot), np.sqrt(1 - dot * dot)
    if sine <= 1e-9:
        return b
    return (a * np.sin((1 - share) * angle) + b * np.sin(share * angle)) / sine


def product(a, b):
    """The product of two quaternions, w last."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return np.array([
        aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
    ])


def turned(q, vector):
    """A vector turned by a unit quaternion."""
    u, w = np.asarray(q[:3]), q[3]
    return vector + 2 * np.cross(u, np.cross(u, vector) + w * vector)


def compose(a, b):
    """The pose `b` in the frame in which `a` is given."""
    return np.concatenate([a[:3] + turned(a[3:], np.asarray(b[:3])), product(a[3:], b[3:])])


class Motion:
    """A candidate: times, palm poses in the object's frame, and joint positions in the hand's order."""

    def __init__(self, time_s, object_from_palm, q):
        self.time_s, self.palm, self.q = np.asarray(time_s), np.asarray(object_from_palm), np.asarray(q)

    def at(self, fraction):
        """The hand after a fraction of the duration."""
        last = len(self.time_s) - 1
        time = self.time_s[0] + (self.time_s[-1] - self.time_s[0]) * min(max(fraction, 0.0), 1.0)
        if time <= self.time_s[0] or last == 0:
            return self.palm[0], self.q[0]
        after = min(max(int(np.searchsorted(self.time_s, time, side="left")), 1), last)
        before = after - 1
        span = self.time_s[after] - self.time_s[before]
        share = min(max((time - self.time_s[before]) / span, 0.0), 1.0)
        a, b = self.palm[before], self.palm[after]
        palm = np.concatenate([a[:3] * (1 - share) + b[:3] * share, slerp(a[3:], b[3:], share)])
        return palm, self.q[before] + (self.q[after] - self.q[before]) * share


class Flexion:
    """The joints that open and squeeze together."""

    def __init__(self, names, joints):
        known = [joint["name"] for joint in joints]
        unknown = set(names) - set(known)
        if unknown:
            raise ValueError(f"`flexion_joints` names {sorted(unknown)}, the hand has {known}")
        self.weight = np.array([float(name in names) for name in known])
        self.lower = np.array([joint["lower"] for joint in joints])
        self.upper = np.array([joint["upper"] for joint in joints])

    def flexed(self, q, angle):
        """Adds an angle; never beyond a limit that `q` itself keeps."""
        moved = np.maximum(q + self.weight * angle, np.minimum(self.lower, q))
        return np.minimum(moved, np.maximum(self.upper, q))


def write(motion, protocol, joints, control_s):
    """The start and the commands of a motion, and the hand as the motion asks for it over the reach."""
    flexion = Flexion(protocol["flexion_joints"], joints)
    n = lambda key: steps(protocol[key], control_s)
    reach, squeeze, pause = max(n("reach_s"), 1), n("squeeze_s"), n("pause_s")
    lift, hold = max(n("lift_s"), 1), max(n("hold_s"), 1)
    approach = protocol["approach"]
    closing = 1.0 if approach == "at_grasp" else min(max(protocol["close_fraction"], 0.0), 1.0)
    before = 1.0 - closing
    grasp_palm, grasp_q = motion.at(1.0)

    def command(phase, palm, q, carried=(0.0, 0.0, 0.0)):
        return {"phase": phase, "palm": palm, "q": q, "carried": np.array(carried)}

    def reached(fraction):
        phase = "reach" if fraction <= before else "close"
        if approach == "follow":
            return command(phase, *motion.at(fraction))
        if approach == "open":
            palm, _ = motion.at(fraction / before if before > 0 else 1.0)
            closed = (fraction - before) / closing if phase == "close" else 0.0
            return command(phase, palm, flexion.flexed(grasp_q, -protocol["open_rad"] * (1.0 - closed)))
        opened = flexion.flexed(grasp_q, -protocol["open_rad"])
        return command(phase, grasp_palm, opened + fraction * (grasp_q - opened))

    def squeezed(phase, share, height_m=0.0):
        q = flexion.flexed(grasp_q, protocol["squeeze_rad"] * share)
        return command(phase, grasp_palm, q, (0.0, 0.0, height_m))

    fractions = lambda count: [step / count for step in range(1, count + 1)]
    smooth = lambda fraction: fraction * fraction * (3.0 - 2.0 * fraction)
    commands = [reached(fraction) for fraction in fractions(reach)]
    commands += [squeezed("squeeze", fraction) for fraction in fractions(squeeze)]
    commands += [squeezed("squeeze", 1.0) for _ in range(pause)]
    commands += [squeezed("lift", 1.0, smooth(fraction) * protocol["lift_m"]) for fraction in fractions(lift)]
    commands += [squeezed("hold", 1.0, protocol["lift_m"]) for _ in range(hold)]
    if approach == "at_grasp":
        requested = [motion.at(1.0)]
    else:
        requested = [motion.at(fraction) for fraction in [0.0, *fractions(reach)]]
    return reached(0.0), commands, requested


def setpoint(command, table_from_object):
    """The command in the table's frame, for an object that lies so."""
    palm = compose(np.asarray(table_from_object), command["palm"])
    palm[:3] += command["carried"]
    return {"phase": command["phase"], "palm": palm, "q": command["q"]}
