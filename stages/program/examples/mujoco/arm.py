"""An arm that carries the hand: springs and dampers of limited force and torque between the palm and its path.

The palm is a free body of MuJoCo with the effective mass of arm and hand, so that contacts, the fingers' drives and
their inertia push it, and the solver has all of it at once. `crates/physics/simulation/src/palm_compliance.rs` has the
same options and another method: it integrates the deviation from the load of the step before.
"""

import mujoco
import numpy as np

# The defaults of `scene.palm_compliance` of `pipeline stages screen`, with their reasons there.
PALM_COMPLIANCE = {
    "force_limit_n": 50.0, "torque_limit_nm": 10.0, "stiffness_n_per_m": 20_000.0, "damping_ns_per_m": 630.0,
    "mass_kg": 5.0, "stiffness_nm_per_rad": 2000.0, "damping_nms_per_rad": 28.0, "inertia_kg_m2": 0.1,
    "max_deviation_m": 0.01, "max_deviation_rad": float(np.radians(5.0)),
}


def rotated(vector, quaternion):
    found = np.zeros(3)
    mujoco.mju_rotVecQuat(found, vector, quaternion)
    return found


def inverse(quaternion):
    found = np.zeros(4)
    mujoco.mju_negQuat(found, quaternion)
    return found


def rotation_from(start, end):
    """The rotation vector from one orientation to another, along the table's axes; quaternions with w first."""
    local = np.zeros(3)
    mujoco.mju_subQuat(local, end, start)
    return rotated(local, start)


def limited(effort, most):
    size = np.linalg.norm(effort)
    return effort * (most / size) if size > most else effort


class Arm:
    """Vectors along the table's axes, in meters, newtons, radians and newton meters about the palm's origin."""

    def __init__(self, settings, data, palm_q, palm_v):
        self.settings, self.data, self.q, self.v = settings, data, palm_q, palm_v
        self.begin()

    def begin(self):
        """Takes the palm as it is, at rest on its path."""
        self.place, self.turn = (part.copy() for part in self.pose())
        self.velocity, self.rate = np.zeros(3), np.zeros(3)

    def pose(self):
        return self.data.qpos[self.q : self.q + 3], self.data.qpos[self.q + 3 : self.q + 7]

    def lead_to(self, target, seconds):
        """Lets the path lead to a pose at an even speed. The hand takes part in the change of speed, which costs no
        force: the arm's controller knows it beforehand."""
        x, y, z, w = target[3:]
        velocity = (np.asarray(target[:3]) - self.place) / seconds
        rate = rotation_from(self.turn, np.array([w, x, y, z])) / seconds
        _, turn = self.pose()
        speed = self.data.qvel[self.v : self.v + 6]
        speed[:3] += velocity - self.velocity
        # A free joint's angular velocity is in the body's own frame.
        speed[3:] += rotated(rate - self.rate, inverse(turn))
        self.velocity, self.rate = velocity, rate

    def deviation(self):
        place, turn = self.pose()
        return place - self.place, rotation_from(self.turn, turn)

    def pull(self, seconds):
        """Sets the effort of the next step, and goes on along the path. Explicit in time: stable and without overshoot for
        the default mass at 4 ms, where damping times step over inertia is 0.5, and 1.1 about the axes."""
        of = self.settings
        away, about = self.deviation()
        _, turn = self.pose()
        speed = self.data.qvel[self.v : self.v + 6]
        force = -of["stiffness_n_per_m"] * away - of["damping_ns_per_m"] * (speed[:3] - self.velocity)
        torque = -of["stiffness_nm_per_rad"] * about
        torque -= of["damping_nms_per_rad"] * (rotated(speed[3:], turn) - self.rate)
        applied = self.data.qfrc_applied[self.v : self.v + 6]
        applied[:3] = limited(force, of["force_limit_n"])
        applied[3:] = rotated(limited(torque, of["torque_limit_nm"]), inverse(turn))
        self.place += seconds * self.velocity
        mujoco.mju_quatIntegrate(self.turn, rotated(self.rate, inverse(self.turn)), seconds)

    def is_overloaded(self):
        away, about = self.deviation()
        of = self.settings
        return np.linalg.norm(away) > of["max_deviation_m"] or np.linalg.norm(about) > of["max_deviation_rad"]
