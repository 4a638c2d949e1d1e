"""A second judge of candidates: MuJoCo, by the protocol of `screen`, as a program for `kind = "program"`.

Reads `candidates` and `objects` of one object, the hand's URDF (`files.hand`) and the hand's file (`files.hand_file`),
whose drive and flexion joints are the defaults; makes `rollouts`. Its options are those of `screen`: `scene`, `protocol`,
`max_penetration_m`, with the same defaults, and `engine`, how MuJoCo computes contacts (`ENGINE` in `scene.py`).
Unknown ones are refused. With `parts = "own"` the object has the convex parts of `inputs.parts`, a table of `parts.py`,
in place of those of `objects`. `recorded` writes the first rollouts step by step as JSON.
"""

import json
import os
import sys
import tomllib

# One thread: the units of a stage run side by side.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import hand as urdf
import script
import smoothness
from arm import PALM_COMPLIANCE
from scene import ENGINE, HAND_CONTACTS, Judge, Scene
from surface import Surface

# The defaults of `pipeline stages screen`; what has none there is required here too.
SCENE = {"friction": 1.0, "mass_scale": 1.0, "time_step_s": 0.004, "steps_per_control": 5, "settle_s": 1.0}
SCENE |= HAND_CONTACTS
DRIVE = ["stiffness", "damping", "torque_limit", "armature"]
PROTOCOL = {
    "name": "table_lift", "approach": "follow", "trial": "lift", "reach_s": 0.8, "close_fraction": 0.25,
    "open_rad": 0.3, "squeeze_rad": 0.15, "squeeze_s": 0.3, "pause_s": 0.3, "lift_m": 0.15, "lift_s": 0.4,
    "hold_s": 2.0, "lifted_m": 0.08, "min_links": 2, "max_slip_m_per_s": 0.01, "knocked_m": 0.03, "knocked_rad": 0.6,
    "limit_tolerance_rad": 0.1, "table_tolerance_m": 0.01, "early_tolerance_m": 0.02,
}
STRICT = {
    "min_fingers": 2, "max_spin_rad_per_s": 0.2, "palm_table_tolerance_m": 0.002, "start_tolerance_m": 0.002,
    "knocked_until": "squeeze",
}
KNOCKED_UNTIL = ["squeeze", "lift"]
# The object's convex parts: `shared` with `screen`, or made apart from them.
PARTS = ["shared", "own"]
OPTIONS = {"max_penetration_m": 0.005, "parts": "shared", "recorded": 0}
# Contacts that are measured against the mesh, in meters.
NOTED_DEPTH_M = 0.001
# Columns of a candidate that its rollout repeats.
SOURCE = ["candidate_id", "generator", "draw_n", "origin", "demonstration", "object_split"]


def given(name, options, defaults, required=()):
    """Options with their defaults; what is unknown here ends the program."""
    unknown = set(options) - set(defaults) - set(required)
    missing = set(required) - set(options)
    if unknown or missing:
        wrong = ", ".join(sorted(unknown)) or f"no {', '.join(sorted(missing))}"
        sys.exit(f"`options.{name}` has {wrong}: this judge knows {', '.join([*defaults, *required])}")
    return {**defaults, **options}


def hand_file(files):
    """The values of the hand's file, if there is one."""
    if "hand_file" not in files:
        return {}
    with open(files["hand_file"], "rb") as file:
        return tomllib.load(file)


def settings(options, of_hand):
    """Scene, protocol, engine and the rest, complete."""
    options = dict(options)
    scene, protocol = dict(options.pop("scene", {})), dict(options.pop("protocol", {}))
    drive, strict = scene.pop("drive", {}), protocol.pop("strict", {})
    engine = given("engine", options.pop("engine", {}), ENGINE)
    scene = given("scene", scene, SCENE)
    if scene["palm_compliance"] is not None:
        scene["palm_compliance"] = given("scene.palm_compliance", scene["palm_compliance"], PALM_COMPLIANCE)
    scene["drive"] = given("scene.drive", of_hand.get("drive", {}) | drive, {}, DRIVE)
    flexion = {key: of_hand[key] for key in ["flexion_joints"] if key in of_hand}
    protocol = given("protocol", flexion | protocol, PROTOCOL, ["flexion_joints"])
    protocol["strict"] = given("protocol.strict", strict, STRICT)
    if protocol["name"] != "table_lift" or protocol["trial"] != "lift":
        sys.exit("`options.protocol` names another protocol than `table_lift`, or another trial than `lift`")
    options = given("", options, OPTIONS)
    one_of("protocol.strict.knocked_until", protocol["strict"]["knocked_until"], KNOCKED_UNTIL)
    one_of("parts", options["parts"], PARTS)
    return scene, protocol, engine, options


def one_of(name, value, known):
    if value not in known:
        sys.exit(f"`options.{name}` is {value!r}: this judge knows {', '.join(known)}")


def column(table, name):
    """A column of lists of lists as arrays, row by row."""
    return [np.array(row, float) for row in table[name].to_pylist()]


def candidates(path, joints):
    """The rows of the candidates' table, each with its motion in the hand's order of joints."""
    table = pq.read_table(path)
    names = table.schema.metadata[b"joints"].decode().split(",")
    if sorted(names) != sorted(joint["name"] for joint in joints):
        sys.exit(f"the candidates are of a hand with the joints {names}, and not of the one in `files.hand`")
    order = [names.index(joint["name"]) for joint in joints]
    rows = table.select(SOURCE + ["table_from_object"]).to_pylist()
    times, palms, positions = (column(table, name) for name in ("time_s", "object_from_palm", "q_rad"))
    for row, time_s, palm, q in zip(rows, times, palms, positions):
        row["motion"] = script.Motion(time_s, palm.reshape(-1, 7), q.reshape(len(time_s), -1)[:, order])
    return rows


def thing(path, scale):
    """The object: its convex parts, mass and inertia, and its surface."""
    (row,) = pq.read_table(path).to_pylist()
    points = np.array(row["part_points_m"], float)
    parts = np.split(points, np.cumsum(row["part_sizes"])[:-1])
    body = {
        "parts": parts, "mass": row["mass_kg"] * scale, "center_of_mass": row["center_of_mass_m"],
        "inertia": [number * scale for number in row["inertia_kg_m2"]],
    }
    triangles = np.array(row["triangles"], int).reshape(-1, 3)
    return body, Surface(np.array(row["vertices_m"], float), triangles)


def own_parts(job):
    """The convex parts of the object that `parts.py` made."""
    if "parts" not in job["inputs"]:
        sys.exit('`options.parts` is "own", which needs `inputs.parts`: a stage with the command `parts.py`')
    (table,) = job["inputs"]["parts"]
    rows = pq.read_table(table["files"]["part.parquet"]).to_pylist()
    return [np.array(row["points_m"], float).reshape(-1, 3) for row in sorted(rows, key=lambda row: row["part_idx"])]


def lying(table_from_object):
    """The resting pose of an object without its yaw and place: the shortest turn that takes its up to +z."""
    x, y, z, w = table_from_object[3:]
    up = script.turned([-x, -y, -z, w], np.array([0.0, 0.0, 1.0]))
    axis = np.cross(up, [0.0, 0.0, 1.0])
    if np.linalg.norm(axis) < 1e-12:
        turn = [0.0, 0.0, 0.0, 1.0] if up[2] > 0 else [1.0, 0.0, 0.0, 0.0]
    else:
        half = np.arctan2(np.linalg.norm(axis), up[2]) / 2
        turn = [*(np.sin(half) * axis / np.linalg.norm(axis)), np.cos(half)]
    return np.array([0.0, 0.0, table_from_object[2], *turn])


def penetration_m(contacts, surface):
    """The deepest that the hand was below the object's surface, of which the convex parts only stand for it."""
    deepest = 0.0
    for *point, depth_m in sorted(contacts, key=lambda contact: -contact[3]):
        if depth_m <= deepest:
            break
        deepest = max(deepest, depth_m - max(surface.distance(np.array(point)), 0.0))
    return deepest


class Bench:
    """One object in one scene, and everything that is done with its candidates."""

    def __init__(self, job):
        self.settings, self.protocol, self.engine, self.options = settings(job["options"], hand_file(job["files"]))
        links = urdf.read(job["files"]["hand"])
        self.joints = urdf.joints(links)
        steps = self.engine["steps"]
        (objects,) = job["inputs"]["objects"]
        body, self.surface = thing(objects["files"]["part.parquet"], self.settings["mass_scale"])
        if self.options["parts"] == "own":
            body["parts"] = own_parts(job)
        self.control_s = self.settings["time_step_s"] * self.settings["steps_per_control"]
        self.scene = Scene({
            "time_step_s": self.settings["time_step_s"] / steps,
            "steps_per_control": self.settings["steps_per_control"] * steps,
            "friction": self.settings["friction"], "drive": self.settings["drive"], "protocol": self.protocol,
            "noted_depth_m": NOTED_DEPTH_M, "links": links, "object": body, "engine": self.engine,
            **{key: self.settings[key] for key in HAND_CONTACTS},
        })
        self.parts, self.settled = body["parts"], {}

    def lies(self, table_from_object):
        """Where the object rests that lies so; nothing if it does not come to rest."""
        key = tuple(table_from_object)
        if key not in self.settled:
            pose = lying(np.array(table_from_object))
            self.settled[key] = self.scene.settle(pose, self.parts, self.settings["settle_s"])
        return self.settled[key]

    def judge(self, candidate, trace=None):
        """The row of a candidate; its steps are added to `trace`."""
        row = {key: candidate[key] for key in SOURCE}
        row |= {"control_steps_n": 0, "skipped_steps_n": 0, "lift_m": 0.0, "slip_m": 0.0, "displacement_m": 0.0, "penetration_m": 0.0,
                "contacts_n": 0, "reached": False}
        row |= smoothness.unmeasured("executed_")  # The hand's motion as executed is not measured here.
        motion, start_pose = candidate["motion"], self.lies(candidate["table_from_object"])
        if start_pose is None:
            return row | smoothness.unmeasured() | {"reason": "infeasible", "success": False}
        row |= smoothness.columns(motion, self.scene.origins)
        start, commands, requested = script.write(motion, self.protocol, self.joints, self.control_s)
        setpoints = [script.setpoint(command, start_pose) for command in [start, *commands]]
        verdict = self.scene.refusal(start, commands, requested, start_pose)
        row["skipped_steps_n"] = len(commands)
        if trace is not None:
            trace["table_from_object"] = start_pose.tolist()
            trace["limits"] = [[joint["lower"], joint["upper"]] for joint in self.joints]
            trace["torque_limit"] = self.settings["drive"]["torque_limit"]
            trace["refused"] = verdict
            trace["steps"] = [{"phase": one["phase"], "palm": one["palm"].tolist(), "q": one["q"].tolist()}
                              for one in setpoints]
        if verdict is None:
            verdict = self.roll(row, setpoints, start_pose, trace)
        return row | {"reason": verdict, "success": verdict == "held"}

    def roll(self, row, setpoints, start_pose, trace):
        """Carries out a script until it has failed or ends; returns the verdict."""
        self.scene.begin(setpoints[0], start_pose)
        judge = Judge(self.scene, setpoints[1:], self.control_s)
        for idx, setpoint in enumerate(setpoints[1:], 1):
            self.scene.step(setpoint)
            judge.see(setpoint["phase"])
            if trace is not None:
                place, turn = self.scene.object_pose()
                trace["steps"][idx]["object"] = [*place.tolist(), *turn[1:].tolist(), float(turn[0])]
            row["control_steps_n"], row["skipped_steps_n"] = idx, len(setpoints) - 1 - idx
            if judge.failure:
                break
        verdict = judge.verdict()
        if verdict == "diverged":
            return verdict
        row["lift_m"], row["displacement_m"], row["slip_m"] = judge.rise_m, judge.displacement_m, judge.slip_m()
        row["contacts_n"] = len(judge.touching())
        row["penetration_m"] = float(penetration_m(judge.deep, self.surface))
        is_too_deep = verdict == "held" and row["penetration_m"] > self.options["max_penetration_m"]
        return "too_deep" if is_too_deep else verdict


def main():
    with open("job.json") as file:
        job = json.load(file)
    try:
        bench = Bench(job)
    except urdf.HandError as error:
        sys.exit(str(error))
    (part,) = job["inputs"]["candidates"]
    asked = candidates(part["files"]["part.parquet"], bench.joints)
    rows = []
    for idx, candidate in enumerate(asked):
        trace = {"candidate_id": candidate["candidate_id"]} if idx < bench.options["recorded"] else None
        rows.append(bench.judge(candidate, trace))
        if trace is not None:
            with open(f"out/{candidate['candidate_id']}.json", "w") as file:
                json.dump(trace, file)
        print(f"progress {(idx + 1) / len(asked):.3f} in MuJoCo")
    columns = pq.read_schema(job["output"]["template"])
    pq.write_table(pa.Table.from_pylist(rows, schema=columns), job["output"]["table"])


if __name__ == "__main__":
    main()
