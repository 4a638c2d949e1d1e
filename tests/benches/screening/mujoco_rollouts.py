"""Carries out scripted grasps in MuJoCo, with the scene, the script and the verdicts of the shipped judge.

Reads lines of JSON. The first is answered with the version. {"scene": ...} builds a model: a hand as a tree of links with primitives, masses,
joint limits and torque limits, one object of convex parts, a table. {"rollouts": [...]} carries out one
script after the other to its end and answers with the CPU seconds of the physics steps until the motion fails or ends
(this thread's, without Python's share), the verdicts, and the deep contacts of the hand with what it carries. Lengths in meters, quaternions as x y z w.
"""

import json
import sys
from pathlib import Path

JUDGE = Path(__file__).resolve().parents[3] / "stages" / "program" / "examples" / "mujoco"
sys.path.insert(0, str(JUDGE))

import mujoco  # noqa: E402

from scene import Scene  # noqa: E402


def say(what):
    print(json.dumps(what), flush=True)


def serve():
    sys.stdin.readline()
    say({"mujoco": mujoco.__version__})
    scene = None
    for line in sys.stdin:
        request = json.loads(line)
        if "scene" in request:
            scene = Scene(request["scene"])
            say({})
        else:
            rolled = [scene.roll(rollout) for rollout in request["rollouts"]]
            seconds, verdicts, deep = zip(*rolled)
            say({"cpu_s": seconds, "verdicts": verdicts, "deep": deep})


if __name__ == "__main__":
    serve()
