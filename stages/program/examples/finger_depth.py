"""Measures again how deep fingers are in each other and in the palm: an independent check of `finger_penetration_m`.

    pipeline run pipelines/cgf.toml --until screen --set screen.recorded_per_object=10000
    python stages/program/examples/finger_depth.py

Reads the rollouts of a stage `screen` and their recordings (MCAP) from a lake. MuJoCo reads the hand's URDF, places its
links by the joint positions recorded at every control step, and measures the depth of every pair of collision shapes in
question (`mj_geomDistance`); nothing here is computed by `pipeline` but the positions themselves.

Pairs, by the rule of `robot::HandShape`, derived here from MuJoCo's model:

- Links that are fixed to each other are one body; the palm is the root link's, and each body with a joint on the palm
  begins a finger.
- Every shape of a finger counts with every shape of every other finger, and with none of its own.
- A shape of a finger counts with every shape of the palm, unless a joint joins its body to the palm, or it touches a shape
  of the palm with all joints at zero, or at the limit nearest to it.

The depth of two shapes is the shortest way along which one leaves the other. The screen takes it from its contacts at the
start of every physics step, 4 ms apart by default; here it is measured at the control steps, of which step 0 is the start
of a motion.

Exits with 1 if an accepted motion is deeper than `--max-depth-m` and `--tolerance-m` together, or its depth differs from
`finger_penetration_m` by more than the tolerance; else with 3 if accepted motions are not recorded, and so unchecked.
"""

import argparse
import sys
from pathlib import Path

import mujoco
import numpy as np
import pyarrow.parquet as pq
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

PRIMITIVES = [getattr(mujoco.mjtGeom, f"mjGEOM_{name}") for name in ("BOX", "SPHERE", "CYLINDER", "CAPSULE")]
MESSAGES = get_typestore(Stores.ROS2_JAZZY)
HAND = "data/robots/allegro_right.urdf"
PALM = 0


class Hand:
    """A hand of primitives as MuJoCo reads its URDF; the palm stands still."""

    def __init__(self, path):
        spec = mujoco.MjSpec.from_file(str(path))
        # Links keep their names.
        spec.compiler.fusestatic = False
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        if not set(self.model.geom_type) <= {int(kind) for kind in PRIMITIVES}:
            sys.exit(f"`{path}` has collision shapes other than primitives, which are not measured here")
        self.qpos = {self.model.joint(idx).name: self.model.jnt_qposadr[idx] for idx in range(self.model.njnt)}
        self.pair()
        self.reach = self.model.geom_rbound[self.first] + self.model.geom_rbound[self.second]

    def place(self, positions):
        """Places the links by the positions of the independent joints, by name."""
        if not positions.keys() <= self.qpos.keys():
            sys.exit(f"the motions are of a hand with the joints {', '.join(positions)}, and not of the one in `--hand`")
        for name, position in positions.items():
            self.data.qpos[self.qpos[name]] = position
        for idx in np.flatnonzero(self.model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
            follower, master = (self.model.jnt_qposadr[joint[idx]] for joint in (self.model.eq_obj1id, self.model.eq_obj2id))
            self.data.qpos[follower] = np.polynomial.polynomial.polyval(self.data.qpos[master], self.model.eq_data[idx, :5])
        mujoco.mj_kinematics(self.model, self.data)

    def depth_m(self, first, second):
        """How deep two shapes are in each other, 0 if they are apart."""
        return max(0.0, -mujoco.mj_geomDistance(self.model, self.data, first, second, 0.0, None))

    def deepest(self):
        """The greatest depth of all pairs, and the names of its links."""
        centers = self.data.geom_xpos
        apart = np.linalg.norm(centers[self.first] - centers[self.second], axis=1)
        deepest_m, links = 0.0, None
        for pair in np.flatnonzero(apart < self.reach):
            depth_m = self.depth_m(self.first[pair], self.second[pair])
            if depth_m > deepest_m:
                deepest_m, links = depth_m, (self.link(self.first[pair]), self.link(self.second[pair]))
        return deepest_m, links

    def link(self, shape):
        return self.model.body(self.model.geom_bodyid[shape]).name

    def parent(self, body):
        """The body on which a body hangs by a joint."""
        return self.model.body_weldid[self.model.body_parentid[body]]

    def pair(self):
        """Notes the shapes of each pair, and the links whose shapes count with none of the palm."""
        low, high = self.model.jnt_range.T
        limited = self.model.jnt_limited.astype(bool)
        nearest_zero = np.where(limited, np.clip(0.0, low, high), 0.0)
        self.place({name: nearest_zero[idx] for idx, name in enumerate(self.qpos)})
        shapes = range(self.model.ngeom)
        bodies = self.model.body_weldid[self.model.geom_bodyid]
        fingers = [self.finger(body) for body in bodies]
        of_palm = [shape for shape in shapes if fingers[shape] == PALM]
        touches = lambda shape, palm: mujoco.mj_geomDistance(self.model, self.data, shape, palm, 1.0, None) <= 0
        left_out = {shape for shape in shapes if fingers[shape] != PALM
                    and (self.parent(bodies[shape]) == PALM or any(touches(shape, palm) for palm in of_palm))}
        found = [(a, b) for a in shapes for b in shapes[a + 1:]
                 if fingers[a] != fingers[b] and not (PALM in (fingers[a], fingers[b]) and left_out & {a, b})]
        self.first, self.second = np.array(found).T
        self.with_palm_n = sum(PALM in (fingers[a], fingers[b]) for a, b in found)
        self.left_out = sorted({self.link(shape) for shape in left_out})

    def finger(self, body):
        """The first body of a body's finger; `PALM` for the palm."""
        while body != PALM and self.parent(body) != PALM:
            body = self.parent(body)
        return body


def positions(recording):
    """The joint positions recorded in a file, step by step, by name."""
    with Reader(recording) as reader:
        states = [one for one in reader.connections if one.topic == "/joint_states"]
        for connection, _, data in reader.messages(connections=states):
            state = MESSAGES.deserialize_cdr(data, connection.msgtype)
            yield dict(zip(state.name, state.position))


def measured(hand, recording, control_steps_n):
    """The greatest depth of all recorded steps with its links and its step, and that of the steps of the rollout itself,
    which ended where its verdict was certain."""
    depths = []
    for at in positions(recording):
        hand.place(at)
        depths.append(hand.deepest())
    step = max(range(len(depths)), key=lambda step: depths[step][0])
    of_rollout_m = max(depth_m for depth_m, _ in depths[:control_steps_n + 1])
    return {"depth_m": depths[step][0], "links": depths[step][1], "step": step, "of_rollout_m": of_rollout_m}


def rollouts(lake, pipeline, stage):
    """The accepted motions, each with its recording's path, and the number of all motions."""
    folder = lake / "tables" / "rollouts" / f"pipeline={pipeline}" / f"stage={stage}"
    accepted, motions_n = [], 0
    for part in sorted(folder.glob("object=*/part.parquet")):
        name = part.parent.name.removeprefix("object=")
        columns = ["candidate_id", "success", "control_steps_n", "finger_penetration_m"]
        rows = pq.read_table(part, columns=columns, partitioning=None).to_pylist()
        motions_n += len(rows)
        for row in rows:
            if row["success"]:
                recording = lake / "files" / pipeline / stage / "rollouts" / name / f"{row['candidate_id']}.mcap"
                accepted.append(row | {"recording": recording})
    if not motions_n:
        sys.exit(f"no rollouts in `{folder}`: run `pipeline run pipelines/{pipeline}.toml --until {stage}`")
    if any(row["finger_penetration_m"] is None for row in accepted):
        sys.exit(f"`finger_penetration_m` is null in `{folder}`: fingers do not touch each other and the palm there")
    return accepted, motions_n


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lake", type=Path, default=Path("data/lake"), help="folder of the artifacts (data/lake)")
    parser.add_argument("--pipeline", default="cgf", help="name of the pipeline file (cgf)")
    parser.add_argument("--stage", default="screen", help="stage that made the rollouts (screen)")
    parser.add_argument("--hand", type=Path, default=Path(HAND), help=f"URDF of the hand ({HAND})")
    parser.add_argument("--max-depth-m", type=float, default=0.002, help="`screen.max_finger_penetration_m` (0.002)")
    parser.add_argument("--tolerance-m", type=float, default=0.0005, help="difference of the two measurements (0.0005)")
    return parser.parse_args()


def main():
    asked = arguments()
    hand = Hand(asked.hand)
    accepted, motions_n = rollouts(asked.lake, asked.pipeline, asked.stage)
    recorded = [row for row in accepted if row["recording"].exists()]
    print(f"pairs of shapes {len(hand.first)}, of them {hand.with_palm_n} of a finger and the palm, "
          f"without {', '.join(hand.left_out)}")
    print(f"motions {motions_n}, accepted {len(accepted)}, recorded {len(recorded)}")
    if not recorded:
        sys.exit(f"nothing to measure: record motions with `--set {asked.stage}.recorded_per_object=10000`")
    for row in recorded:
        row |= measured(hand, row["recording"], row["control_steps_n"])
        row["difference_m"] = row["of_rollout_m"] - row["finger_penetration_m"]
    deepest = max(recorded, key=lambda row: row["depth_m"])
    most = max(recorded, key=lambda row: abs(row["difference_m"]))
    is_deep = [row["depth_m"] > asked.max_depth_m + asked.tolerance_m for row in recorded]
    differs = [abs(row["difference_m"]) > asked.tolerance_m for row in recorded]
    mm = lambda meters: f"{1000 * meters:.3f} mm"
    where = f"{' in '.join(deepest['links'] or ['none'])} at step {deepest['step']} of {deepest['candidate_id']}"
    print(f"deepest {mm(deepest['depth_m'])}, {where}")
    print(f"deeper than {mm(asked.max_depth_m)}: {sum(row['depth_m'] > asked.max_depth_m for row in recorded)}, "
          f"by more than the tolerance of {mm(asked.tolerance_m)}: {sum(is_deep)}")
    print(f"difference to `finger_penetration_m` at most {mm(most['difference_m'])}, of {most['candidate_id']}; "
          f"beyond the tolerance: {sum(differs)}")
    if any(is_deep) or any(differs):
        sys.exit(1)
    if len(recorded) < len(accepted):
        print(f"{len(accepted) - len(recorded)} accepted motions are not recorded: "
              f"`--set {asked.stage}.recorded_per_object=10000` records all", file=sys.stderr)
        sys.exit(3)


if __name__ == "__main__":
    main()
