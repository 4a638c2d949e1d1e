"""The scene, the script and the verdicts of `crates/physics/simulation` in MuJoCo.

A hand as a tree of links with primitives, masses, joint limits and torque limits, one object of convex parts, a
table. Lengths in meters, quaternions as x y z w.

What is told to the palm is done: its mass is 10 t, and each control step gives it the velocity that takes
it to its place, so that it yields to nothing; it never touches the table, which yields as little. With
`palm_compliance` an `Arm` of limited force carries a palm that has a mass, and the table stops it. Finger
joints are position servos with damping and a torque limit, and the hand feels no gravity. Fingers touch each
other with `fingers_touch` and the palm with `fingers_touch_palm`, else hand touches hand nowhere. All
contacts have the scene's friction and no friction about the normal.
"""

import time

import mujoco
import numpy as np

import hand
from arm import Arm
from script import compose, turned as turned_by

# How MuJoCo computes contacts.
ENGINE = {
    # MuJoCo's default, `pyramidal`, lets held objects slide out of the fingers.
    "cone": "elliptic",
    # Friction ten times as stiff as the normal force: a sticking contact creeps a tenth as fast as by default (1).
    "impratio": 10.0,
    # Time constant in seconds and damping ratio: a held object is about as deep in the fingers as in `screen`.
    "solref": [0.01, 1.0],
    # Several points where convex bodies meet: a box would rock on one.
    "multiccd": "enable",
    # Solver passes that stop creep: none, MuJoCo's default. With 5 neither engine is more lenient.
    "noslip_iterations": 0,
    # Most iterations of Newton's method, and the relative improvement that ends it: MuJoCo's defaults.
    "iterations": 100, "tolerance": 1e-8,
    # MuJoCo's time steps in one `scene.time_step_s`, by default 4 ms as in `screen`: at half of it, 4.5 % of verdicts change.
    "steps": 1,
}
# What hand touches hand, and an arm that yields: as in `screen`, none by default.
HAND_CONTACTS = {"fingers_touch": False, "fingers_touch_palm": False, "palm_compliance": None}

PALM_MASS, PALM_INERTIA = 1e4, 1e2
# Contact groups. From `FINGER` on each finger has one of its own, those beyond the last share it.
OBJECT, HAND, PALM, ON_PALM, FINGER, LAST = 1, 2, 4, 8, 16, 1 << 30
DIVERGED = [
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
]
FINAL_WINDOW_S, TOUCHING_SHARE = 0.5, 0.5
# How the object is put down: as far above the table as it falls, and when it rests.
GAP_M, RESTING_SPEED, RESTING_STEPS = 0.0005, 0.002, 10
# Where the hand waits meanwhile, in meters above the table.
PARKED_M = 5.0
GEOM = mujoco.mjtGeom


def text(numbers):
    return " ".join(repr(float(number)) for number in numbers)


def placed(pose):
    """A pose as MJCF writes it: the quaternion's w first."""
    x, y, z, i, j, k, w = pose
    return f'pos="{text([x, y, z])}" quat="{text([w, i, j, k])}"'


def inertial(body):
    xx, yy, zz, xy, xz, yz = body["inertia"]
    return (
        f'<inertial pos="{text(body["center_of_mass"])}" mass="{body["mass"]!r}" '
        f'fullinertia="{text([xx, yy, zz, xy, xz, yz])}"/>'
    )


def geom(shape, name, groups):
    sizes = text(shape["size"])
    own, others = groups
    return (
        f'<geom name="{name}" type="{shape["type"]}" size="{sizes}" {placed(shape["link_from_shape"])} '
        f'contype="{own}" conaffinity="{others}"/>'
    )


def contact_groups(scene, on_palm):
    """For the shapes of each link, by their names, their own group and those that they touch; `on_palm` names those of
    fingers that touch the palm."""
    links = scene["links"]
    fingers = hand.fingers(links)
    numbers = sorted({finger for finger in fingers if finger != hand.PALM})
    own_group = {finger: min(FINGER << idx, LAST) for idx, finger in enumerate(numbers)}
    every_finger = 0
    for group in own_group.values():
        every_finger |= group
    groups = {}
    for number, link in enumerate(links):
        for idx in range(len(link["shapes"])):
            own, others, name = HAND, OBJECT, shape_name(number, idx)
            if fingers[number] == hand.PALM:
                if scene["fingers_touch_palm"]:
                    own, others = own | PALM, others | ON_PALM
            else:
                if scene["fingers_touch"]:
                    group = own_group[fingers[number]]
                    own, others = own | group, others | (every_finger & ~group)
                if name in on_palm:
                    own, others = own | ON_PALM, others | PALM
            groups[name] = (own, others)
    return groups


def shape_name(link, idx):
    return f"link{link}_{idx}"


def palm_mass(scene):
    """Mass and moment of inertia of the palm's body: with an arm that yields, what the fingers leave of the effective mass."""
    arm = scene["palm_compliance"]
    if arm is None:
        return PALM_MASS, PALM_INERTIA
    others_kg = sum(link["mass"] for link in scene["links"][1:])
    if others_kg >= arm["mass_kg"]:
        raise hand.HandError(f"the hand without its root weighs {others_kg:.2f} kg, as much as `palm_compliance.mass_kg`")
    return arm["mass_kg"] - others_kg, arm["inertia_kg_m2"]


def link_xml(scene, number, groups):
    links, armature = scene["links"], scene["drive"]["armature"]
    link = links[number]
    if link["parent"] is None:
        mass, inertia = palm_mass(scene)
        own = (
            f'<freejoint/><inertial pos="0 0 0" mass="{mass!r}" '
            f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        )
        place = ""
    else:
        place = placed(link["parent_from_joint"])
        own = inertial(link) if link["mass"] > 0 else ""
        if link["joint"] is not None:
            joint = link["joint"]
            kind = {"prismatic": "slide"}.get(joint["kind"], "hinge")
            limits = (
                'limited="false"'
                if joint["kind"] == "continuous"
                else f'limited="true" range="{text([joint["lower"], joint["upper"]])}"'
            )
            own += (
                f'<joint name="{joint["name"]}" type="{kind}" axis="{text(joint["axis"])}" '
                f'{limits} armature="{armature!r}"/>'
            )
    for idx, shape in enumerate(link["shapes"]):
        name = shape_name(number, idx)
        own += geom(shape, name, groups[name])
    children = (idx for idx, other in enumerate(links) if other["parent"] == number)
    inside = "".join(link_xml(scene, child, groups) for child in children)
    name = "palm" if link["parent"] is None else link["name"]
    return f'<body name="{name}" {place} gravcomp="1">{own}{inside}</body>'


def mjcf(scene, on_palm=frozenset()):
    """The scene as MuJoCo reads it; coordinates are palm, fingers, object."""
    drive, engine = scene["drive"], scene["engine"]
    links, thing = scene["links"], scene["object"]
    meshes = "".join(
        f'<mesh name="part{idx}" inertia="convex" vertex="{text(np.ravel(part))}"/>'
        for idx, part in enumerate(thing["parts"])
    )
    parts = "".join(
        f'<geom type="mesh" mesh="part{idx}" contype="{OBJECT}" conaffinity="{HAND}"/>'
        for idx in range(len(thing["parts"]))
    )
    k, d, limit = drive["stiffness"], drive["damping"], drive["torque_limit"]
    servos = "".join(
        f'<general joint="{joint["name"]}" biastype="affine" gainprm="{k!r}" '
        f'biasprm="0 {-k!r} {-d!r}" forcelimited="true" forcerange="{-limit!r} {limit!r}"/>'
        for joint in hand.joints(links)
    )
    # As stiff as a constraint may be at this time step.
    equal = "".join(
        f'<joint joint1="{joint["name"]}" joint2="{joint["master"]}" solref="{2 * scene["time_step_s"]!r} 1" '
        f'polycoef="{text([joint["offset"], joint["multiplier"], 0, 0, 0])}"/>'
        for joint in hand.followers(links)
    )
    groups = contact_groups(scene, on_palm)
    beside = '<exclude body1="world" body2="palm"/>' if scene["palm_compliance"] is None else ""
    return f"""<mujoco>
<compiler angle="radian" fusestatic="true"/>
<option timestep="{scene["time_step_s"]!r}" integrator="implicitfast" cone="{engine["cone"]}"
 impratio="{engine["impratio"]!r}" noslip_iterations="{engine["noslip_iterations"]}"
 iterations="{engine["iterations"]}" tolerance="{engine["tolerance"]!r}"><flag multiccd="{engine["multiccd"]}"/></option>
<default><geom friction="{scene["friction"]!r} 0 0" condim="3" solref="{text(engine["solref"])}"/></default>
<asset>{meshes}</asset>
<worldbody>
<geom name="table" type="box" size="1 1 0.025" pos="0 0 -0.025" contype="0" conaffinity="{HAND | OBJECT}"/>
{link_xml(scene, 0, groups)}
<body name="object"><freejoint/>{inertial(thing)}{parts}</body>
</worldbody>
<contact>{beside}</contact>
<equality>{equal}</equality>
<actuator>{servos}</actuator>
</mujoco>"""


def turned(xyzw):
    x, y, z, w = xyzw
    return np.array([w, x, y, z])


class Scene:
    def __init__(self, scene):
        scene = HAND_CONTACTS | scene | {"engine": ENGINE | scene["engine"]}
        self.scene, self.protocol = scene, scene["protocol"]
        self.load(mjcf(scene))
        if scene["fingers_touch_palm"]:
            self.load(mjcf(scene, self.apart_from_palm()))
        arm = scene["palm_compliance"]
        self.arm = None if arm is None else Arm(arm, self.data, self.palm_q, self.palm_v)

    def load(self, xml):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        scene = self.scene
        joints = hand.joints(scene["links"])
        self.followers = hand.followers(scene["links"])
        self.lower = np.array([joint["lower"] for joint in joints])
        self.upper = np.array([joint["upper"] for joint in joints])
        at = lambda joint: self.model.jnt_qposadr[mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, joint["name"])]
        self.q = np.array([at(joint) for joint in joints])
        self.q_of_followers = [at(joint) for joint in self.followers]
        body = lambda name: mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name)
        self.palm, self.thing = body("palm"), body("object")
        # The coordinates of the two free joints.
        self.palm_q = self.model.jnt_qposadr[self.model.body_jntadr[self.palm]]
        self.palm_v = self.model.jnt_dofadr[self.model.body_jntadr[self.palm]]
        self.thing_q = self.model.jnt_qposadr[self.model.body_jntadr[self.thing]]

    def apart_from_palm(self):
        """The fingers' shapes that can meet all of the palm's: not of a link next to it, and apart from them with every
        joint at 0 or at its limit nearest to it."""
        links = self.scene["links"]
        bodies, fingers = hand.bodies(links), hand.fingers(links)
        self.start_at([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], np.clip(0.0, self.lower, self.upper))
        mujoco.mj_kinematics(self.model, self.data)
        shapes = [(number, idx) for number, link in enumerate(links) for idx in range(len(link["shapes"]))]
        number_of = lambda shape: mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_GEOM, shape_name(*shape))
        palm = [number_of(shape) for shape in shapes if fingers[shape[0]] == hand.PALM]
        found = set()
        for shape in shapes:
            body = bodies[shape[0]]
            if fingers[body] in (hand.PALM, body):
                continue
            of_shape = number_of(shape)
            if all(mujoco.mj_geomDistance(self.model, self.data, of_shape, of_palm, 1.0, None) > 0 for of_palm in palm):
                found.add(shape_name(*shape))
        return found

    def palm_pose(self):
        at = self.data.qpos[self.palm_q :]
        return at[:3].copy(), at[3:7].copy()

    def object_pose(self):
        at = self.data.qpos[self.thing_q :]
        return at[:3].copy(), at[3:7].copy()

    def move_palm(self, target, seconds):
        """Gives the palm the velocity that takes it there."""
        place, turn = self.palm_pose()
        velocity = self.data.qvel[self.palm_v :]
        velocity[:3] = (np.array(target[:3]) - place) / seconds
        local = np.zeros(3)
        mujoco.mju_subQuat(local, turned(target[3:]), turn)
        velocity[3:6] = local / seconds

    def touching(self):
        """The hand's bodies that press on the object."""
        bodies, force = set(), np.zeros(6)
        for idx in range(self.data.ncon):
            contact = self.data.contact[idx]
            pair = [int(self.model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2)]
            if self.thing in pair and 0 not in pair:
                mujoco.mj_contactForce(self.model, self.data, idx, force)
                if force[0] > 0:
                    bodies.add(pair[0] if pair[1] == self.thing else pair[1])
        return bodies

    def deep(self, depth_m):
        """Contacts of the hand deeper in the object: the point of the object's part, in the object's frame, and the depth."""
        # The contacts are those of the step's start, as is the body's pose in space.
        place, turn = self.data.xpos[self.thing], self.data.xquat[self.thing]
        inverse, local, found = np.zeros(4), np.zeros(3), []
        mujoco.mju_negQuat(inverse, turn)
        for idx in range(self.data.ncon):
            contact = self.data.contact[idx]
            pair = [int(self.model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2)]
            if contact.dist < -depth_m and self.thing in pair and 0 not in pair:
                # The normal points from the first to the second.
                side = -0.5 if pair[0] == self.thing else 0.5
                on_part = contact.pos + side * contact.dist * contact.frame[:3]
                mujoco.mju_rotVecQuat(local, on_part - place, inverse)
                found.append([*local, -contact.dist])
        return found

    def finger(self, body):
        """The first body of a body's finger; the palm's own is itself."""
        while body != self.palm and self.model.body_parentid[body] != self.palm:
            body = int(self.model.body_parentid[body])
        return body

    def begin(self, start, table_from_object):
        """Puts hand and object where a script starts."""
        data = self.data
        mujoco.mj_resetData(self.model, data)
        self.start_at(start["palm"], start["q"])
        data.qpos[self.thing_q : self.thing_q + 3] = table_from_object[:3]
        data.qpos[self.thing_q + 3 : self.thing_q + 7] = turned(table_from_object[3:])
        mujoco.mj_forward(self.model, data)
        if self.arm is not None:
            self.arm.begin()

    def start_at(self, palm, q):
        """Puts the hand there."""
        data = self.data
        data.qpos[self.palm_q : self.palm_q + 3] = palm[:3]
        data.qpos[self.palm_q + 3 : self.palm_q + 7] = turned(palm[3:])
        data.qpos[self.q] = q
        for joint, at in zip(self.followers, self.q_of_followers):
            data.qpos[at] = joint["multiplier"] * q[joint["number"]] + joint["offset"]

    def step(self, setpoint):
        """Carries out one command; returns the seconds that the physics took."""
        substeps, step_s = self.scene["steps_per_control"], self.scene["time_step_s"]
        self.data.ctrl[:] = np.clip(setpoint["q"], self.lower, self.upper)
        if self.arm is None:
            self.move_palm(setpoint["palm"], substeps * step_s)
        else:
            self.arm.lead_to(setpoint["palm"], substeps * step_s)
        if self.arm is None:
            return self.physics(substeps)
        spent_s = 0.0
        for _ in range(substeps):
            self.arm.pull(step_s)
            spent_s += self.physics(1)
        return spent_s

    def physics(self, steps):
        before = time.thread_time()
        mujoco.mj_step(self.model, self.data, steps)
        return time.thread_time() - before

    def roll(self, rollout):
        """Carries out one script to its end; returns the seconds of its steps up to a failure, the verdict, and the
        deep contacts of what is carried."""
        start, *setpoints = rollout["setpoints"]
        self.begin(start, rollout["table_from_object"])
        judge = Judge(self, setpoints, self.scene["steps_per_control"] * self.scene["time_step_s"])
        seconds = 0.0
        for setpoint in setpoints:
            spent_s = self.step(setpoint)
            seconds += 0.0 if judge.failure else spent_s
            judge.see(setpoint["phase"])
        return seconds, judge.verdict(), judge.deep

    def settle(self, table_from_object, parts, settle_s):
        """Lets the object come to rest alone on the table; returns its pose, or nothing if it does not stay there."""
        pose = np.array(table_from_object, float)
        lowest = min(turned_by(pose[3:], part)[:, 2].min() for part in parts) + pose[2]
        pose[2] += GAP_M - lowest
        parked = {"palm": np.array([0.0, 0.0, PARKED_M, 0.0, 0.0, 0.0, 1.0]), "q": np.clip(0.0, self.lower, self.upper)}
        self.begin(parked, pose)
        self.data.ctrl[:] = parked["q"]
        at = self.model.jnt_dofadr[self.model.body_jntadr[self.thing]]
        resting = 0
        for _ in range(round(settle_s / self.scene["time_step_s"])):
            mujoco.mj_step(self.model, self.data)
            speed = self.data.qvel[at : at + 6]
            is_slow = max(np.linalg.norm(speed[:3]), np.linalg.norm(speed[3:])) < RESTING_SPEED
            resting = resting + 1 if is_slow else 0
            if resting == RESTING_STEPS:
                break
        place, turn = self.object_pose()
        pose = np.concatenate([place, turn[1:], turn[:1]])
        return pose if np.isfinite(pose).all() and place[2] > -0.5 else None

    def refusal(self, start, commands, requested, table_from_object):
        """Why geometry alone refuses a script, as `crates/physics/simulation/src/rejection.rs` has it, or nothing."""
        protocol, strict = self.protocol, self.protocol["strict"]
        tolerance = protocol["limit_tolerance_rad"]
        for _, q in requested:
            if (q < self.lower - tolerance).any() or (q > self.upper + tolerance).any():
                return "limit"
        for palm, q in requested:
            self.begin({"palm": compose(table_from_object, palm), "q": q}, table_from_object)
            if self.is_below(strict["palm_table_tolerance_m"], protocol["table_tolerance_m"]):
                return "table"
        depths = [(start, strict["start_tolerance_m"])]
        depths += [(one, protocol["early_tolerance_m"]) for one in commands if one["phase"] == "reach"]
        for command, tolerance_m in depths:
            self.begin({"palm": compose(table_from_object, command["palm"]), "q": command["q"]}, table_from_object)
            if self.depth() > tolerance_m:
                return "early_contact"
        return None

    def is_below(self, palm_m, finger_m):
        """Whether a shape of the hand is deeper below the table than a palm or a finger may be."""
        model, data = self.model, self.data
        for geom in np.flatnonzero(model.geom_contype & HAND):
            size, row = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)[2]
            reach = {
                GEOM.mjGEOM_BOX: lambda: np.abs(row) @ size,
                GEOM.mjGEOM_SPHERE: lambda: size[0],
                GEOM.mjGEOM_CYLINDER: lambda: abs(row[2]) * size[1] + np.sqrt(max(1 - row[2] ** 2, 0)) * size[0],
                GEOM.mjGEOM_CAPSULE: lambda: abs(row[2]) * size[1] + size[0],
            }[GEOM(model.geom_type[geom])]()
            tolerance = palm_m if model.geom_bodyid[geom] == self.palm else finger_m
            if data.geom_xpos[geom][2] - reach < -tolerance:
                return True
        return False

    def depth(self):
        """How deep the hand is in the object's deepest part, in meters."""
        contacts = (self.data.contact[idx] for idx in range(self.data.ncon))
        bodies = lambda contact: {int(self.model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2)}
        return max((-c.dist for c in contacts if self.thing in bodies(c) and 0 not in bodies(c)), default=0.0)

    def origins(self, palm, q):
        """Coordinates of the origins of all links, the root's first, for a palm pose in any frame."""
        places = {}
        found = []
        for number, link in enumerate(self.scene["links"]):
            if link["parent"] is None:
                pose = np.asarray(palm, float)
            else:
                pose = compose(places[link["parent"]], np.array(link["parent_from_joint"]))
                joint = link["joint"]
                if joint is not None:
                    position = joint["multiplier"] * q[joint["number"]] + joint["offset"]
                    pose = compose(pose, moved(joint, position))
            places[number] = pose
            found.append(pose[:3])
        return np.concatenate(found)


def moved(joint, position):
    """The transform of a joint at a position."""
    axis = np.array(joint["axis"])
    if joint["kind"] == "prismatic":
        return np.concatenate([axis * position, [0.0, 0.0, 0.0, 1.0]])
    return np.concatenate([[0.0] * 3, axis * np.sin(position / 2), [np.cos(position / 2)]])


def angle(one, other):
    return 2 * np.arccos(min(1.0, abs(float(np.dot(one, other)))))


class Judge:
    """What `crates/physics/simulation/src/judge.rs` judges, but that nothing ends early."""

    def __init__(self, scene, setpoints, control_s):
        self.scene, self.protocol, self.control_s = scene, scene.protocol, control_s
        self.start = scene.object_pose()
        self.failure = None
        self.lift_left = sum(i["phase"] == "lift" for i in setpoints)
        self.hold_left = sum(i["phase"] == "hold" for i in setpoints)
        self.window = min(max(round(FINAL_WINDOW_S / control_s), 1), self.hold_left)
        self.pressed, self.in_palm, self.deep = {}, [], []
        self.rise_m, self.displacement_m = 0.0, None

    def fail(self, verdict):
        self.failure = self.failure or verdict

    def see(self, phase):
        protocol, (place, turn) = self.protocol, self.scene.object_pose()
        # MuJoCo starts again from the beginning where numbers overflow, and warns.
        if any(self.scene.data.warning[idx].number for idx in DIVERGED):
            self.fail("diverged")
        if self.scene.arm is not None and self.scene.arm.is_overloaded():
            self.fail("overloaded")
        rise = self.rise_m = float(place[2] - self.start[0][2])
        until_lift = protocol["strict"]["knocked_until"] == "lift"
        if phase in ("reach", "close") or (phase == "squeeze" and until_lift):
            moved = np.linalg.norm(place - self.start[0])
            if phase != "squeeze":
                self.displacement_m = float(moved)
            if moved > protocol["knocked_m"] or angle(turn, self.start[1]) > protocol["knocked_rad"]:
                self.fail("knocked_over")
        if phase in ("lift", "hold"):
            self.deep += self.scene.deep(self.scene.scene["noted_depth_m"])
        if phase == "lift":
            self.lift_left -= 1
            if self.lift_left == 0:
                self.follow(place, turn)
                if rise <= protocol["lifted_m"]:
                    self.fail("not_grasped")
        if phase == "hold":
            self.follow(place, turn)
            if rise <= protocol["lifted_m"]:
                self.fail("dropped")
            if self.hold_left <= self.window:
                for body in self.scene.touching():
                    self.pressed[body] = self.pressed.get(body, 0) + 1
            self.hold_left -= 1

    def follow(self, place, turn):
        """Notes the object's pose in the palm's frame."""
        palm, palm_turn = self.scene.palm_pose()
        inverse, local, local_turn = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, palm_turn)
        mujoco.mju_rotVecQuat(local, place - palm, inverse)
        mujoco.mju_mulQuat(local_turn, inverse, turn)
        self.in_palm.append((local, local_turn))

    def touching(self):
        """The bodies that pressed for most of the final window."""
        enough = TOUCHING_SHARE * self.window
        return [body for body, n in self.pressed.items() if n >= enough]

    def slip_m(self):
        """How far the object moved in the palm's frame since the end of the lift; nothing before it."""
        return float(np.linalg.norm(self.in_palm[-1][0] - self.in_palm[0][0])) if self.in_palm else None

    def verdict(self):
        if self.failure:
            return self.failure
        touching = self.touching()
        fingers = {self.scene.finger(body) for body in touching}
        protocol, strict = self.protocol, self.protocol["strict"]
        if len(touching) < protocol["min_links"] or len(fingers) < strict["min_fingers"]:
            return "dropped"
        (place, turn), (end, end_turn) = self.in_palm[max(len(self.in_palm) - self.window - 1, 0)], self.in_palm[-1]
        seconds = self.window * self.control_s
        slips = np.linalg.norm(end - place) > protocol["max_slip_m_per_s"] * seconds
        spins = angle(end_turn, turn) > strict["max_spin_rad_per_s"] * seconds
        return "slipped" if slips or spins else "held"
