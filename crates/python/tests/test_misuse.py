"""Whatever is passed, the answer is a result or an exception that says what to do: no crash, no hang."""

import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np

import lab
import pipeline
from lab import recording

DATA = Path(__file__).parents[3] / "data"
N = int(os.environ.get("PIPELINE_MISUSES", "1000"))


def anything(rng: random.Random) -> object:
    """An argument that hardly ever is one."""
    shape = [rng.choice([0, 1, 3, 4, 6, 16, 21, 100]) for _ in range(rng.randrange(4))]
    array = np.full(shape, rng.choice([0.0, 1e308, -1.0, math.nan, math.inf]))
    return rng.choice([
        lambda: array,
        lambda: array.astype(rng.choice(["float32", "int8", "uint64", "complex64", "bool", "float16"])),
        lambda: np.asfortranarray(array),
        lambda: array[..., ::-1] if array.ndim else array,
        lambda: array.T,
        lambda: array.tolist(),
        lambda: np.array(["a", "b"]),
        lambda: np.array([object()] * 16),
        lambda: np.zeros(16, dtype=[("x", "f8")]),
        lambda: np.broadcast_to(0.0, (1 << 40, 16))[:0],
        lambda: None,
        lambda: "link_3.0_tip",
        lambda: b"\0",
        lambda: {"q": 1},
        lambda: object(),
        lambda: -1,
        lambda: [[1.0], [1.0, 2.0]],
        lambda: iter([1.0]),
    ])()


class Misuse(unittest.TestCase):
    def setUp(self):
        self.robot = pipeline.Robot(DATA / "robots/allegro_right.urdf")
        self.hand = pipeline.Retargeter(DATA / "hands/allegro_right.toml")

    def test_a_valid_call_with_one_argument_spoiled(self):
        robot, hand = self.robot, self.hand
        q, landmarks = np.zeros((100, 16)), recording(0)["landmarks"]
        times, tip = recording(0)["times"], "link_3.0_tip"
        pose = robot.forward_kinematics(q[0], [tip])[0]
        file = DATA / "hands/allegro_right.toml"
        lake = pipeline.Lake(lab.done() / "data/lake")
        grasper, function = pipeline.Hand(file), lake.function()
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T * 0.03
        cube = pipeline.Object.from_points(corners, 0.1, name="cube")
        drawn = function.sample(cube, 2)
        codes, clock = drawn.codes, drawn.times[0]
        calls = [
            (pipeline.Object.from_points, [corners, 0.1]),
            (lambda options: pipeline.Object.from_points(corners, 0.1, options=options), [{"points_n": 64}]),
            (cube.distance, [corners]),
            (cube.mean_distance, [cube]),
            (function.sample, [cube, 2]),
            (lambda options: function.sample(cube, 2, options=options), [{"steps": 9}]),
            (function.decode, [cube, codes, clock]),
            (
                pipeline.Candidates,
                [cube, drawn.joint_names, clock, drawn.palm, drawn.q],
            ),
            (drawn.__getitem__, [0]),
            (grasper.mesh, [q[0]]),
            (grasper.refine, [cube, drawn]),
            (lambda options: grasper.refine(cube, drawn, options=options), [{"draws": 2}]),
            (grasper.screen, [cube, drawn]),
            (grasper.rollout, [cube, drawn, 0]),
            (grasper.plan, [cube, drawn]),
            (lake.object, [lake.query("select object from objects").column("object")[0]]),
            (lake.recordings, ["rollouts"]),
            (lake.lineage, ["screen.rollouts"]),
            (pipeline.Recording, [next(iter(lake.recordings("rollouts"))).path]),
            (robot.forward_kinematics, [q, [tip]]),
            (robot.forward_kinematics, [q[0]]),
            (robot.jacobian, [q, tip, np.zeros(3)]),
            (robot.inverse_kinematics, [pose, tip, q[0]]),
            (robot.inverse_dynamics, [q, q, q, np.zeros(3)]),
            (robot.mass_matrix, [q]),
            (robot.center_of_mass, [q]),
            (hand.step, [landmarks[0]]),
            (hand.retarget, [times, landmarks]),
            (hand.retarget_all, [[(times, landmarks)]]),
            (lambda times, landmarks: hand.retarget_all([(times, landmarks)] * 2), [times, landmarks]),
            (pipeline.Robot, [DATA / "robots/allegro_right.urdf"]),
            (pipeline.Robot.from_text, ["<robot name='r'><link name='l'/></robot>"]),
            (pipeline.Retargeter, [file]),
            (lambda options: pipeline.Retargeter(file, options=options), [{"contact_weight": 1.0}]),
            (pipeline.Lake("nowhere").query, ["select 1"]),
        ]
        for call, arguments in calls[:-1]:
            call(*arguments)
        rng = random.Random(7)
        refused = 0
        for _ in range(N):
            call, arguments = rng.choice(calls)
            spoiled = list(arguments)
            spoiled[rng.randrange(len(spoiled))] = anything(rng)
            try:
                call(*spoiled)
            except pipeline.Error as err:
                refused += 1
                self.assertTrue(str(err))
            except (TypeError, MemoryError, IndexError, OverflowError) as err:
                # What Python says of the type of a path, a name, a number or a dict, and of a place in a sequence.
                refused += 1
                self.assertTrue(str(err))
        self.assertGreater(refused, N // 2)
        # After all that it works.
        hand.reset()
        self.assertLess(hand.step(landmarks[0])[2], 0.05)

    def test_a_forked_process_asks_a_lake(self):
        path = lab.done() / "data/lake"
        pipeline.Lake(path).query("select * from rollouts")
        if (child := os.fork()) == 0:
            code = 1
            try:
                code = 0 if len(pipeline.Lake(path).query("select * from rollouts")) > 0 else 2
            finally:
                os._exit(code)
        for _ in range(600):
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                break
            time.sleep(0.1)
        else:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            self.fail("the child hangs")
        self.assertEqual(os.waitstatus_to_exitcode(status), 0)

    def test_a_damaged_recording_is_refused(self):
        path = next(iter(pipeline.Lake(lab.done() / "data/lake").recordings("rollouts"))).path
        whole = path.read_bytes()
        rng = random.Random(3)
        with tempfile.TemporaryDirectory() as folder:
            damaged = Path(folder) / "damaged.mcap"
            for _ in range(200):
                at = rng.randrange(len(whole))
                damaged.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
                try:
                    list(pipeline.Recording(damaged))
                except pipeline.Error as err:
                    self.assertTrue(str(err))

    def test_what_is_wrong_is_said_with_its_remedy(self):
        q = np.zeros(16)
        for call, what in [
            (lambda: self.robot.forward_kinematics(q[:3]), r"`q` has the shape \(3,\), not \(16,\)"),
            (lambda: self.robot.forward_kinematics(q + math.nan), r"`q` has nan at \[0\]|`q` has NaN at \[0\]"),
            (lambda: self.robot.jacobian(q, "link_3.0_tp"), "no link `link_3.0_tp`"),
            (lambda: pipeline.Robot("nowhere.urdf"), "nowhere.urdf"),
            (lambda: pipeline.Robot.from_text("<robot/>"), "no link"),
            (lambda: self.hand.step(np.zeros((20, 3))), r"\(20, 3\), not \(21, 3\)"),
            (lambda: self.hand.step(None), "no array of numbers but a `NoneType`"),
            (lambda: self.hand.step(np.ma.masked_all((21, 3))), "masked array"),
            (lambda: self.hand.step(np.full((21, 3), 1e300)), "usable"),
            (lambda: self.robot.inverse_kinematics(np.eye(4), "link_3.0_tip", q[None]), "not \\(16,\\)"),
            (lambda: self.robot.inverse_kinematics(2 * np.eye(4), "link_3.0_tip"), "last row"),
            (lambda: self.robot.inverse_kinematics(np.diag([1, 1, -1, 1]), "link_3.0_tip"), "determinant"),
            (lambda: self.robot.inverse_dynamics(q, q + 1e200), "too large"),
            (lambda: self.hand.retarget_all([([0, 0], np.zeros((2, 21, 3)))] * 2), "recording 0: step 1"),
            (lambda: self.hand.retarget_all([([0], [0])]), r"`recordings\[0\]\[1\]`"),
            (lambda: self.hand.retarget_all([3]), "no sequence of pairs"),
        ]:
            with self.assertRaisesRegex(pipeline.Error, what) as raised:
                call()
            self.assertTrue(raised.exception.hint)
        with self.assertRaisesRegex(pipeline.Error, "did you mean `link_3.0_tip`"):
            self.robot.jacobian(q, "link_3.0_tp")

    def test_a_forked_process_computes(self):
        recordings = [(r["times"], r["landmarks"]) for r in map(recording, range(4))]
        before = self.hand.retarget_all(recordings)[0].q
        child = os.fork()
        if child == 0:
            same = np.array_equal(self.hand.retarget_all(recordings)[0].q, before)
            os._exit(0 if same else 1)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                self.assertEqual(status, 0)
                return
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)
        self.fail("the forked process hangs")

    def test_a_process_that_another_thread_forks_at_the_first_batch_computes(self):
        code = """
import os, sys, threading
import numpy as np
import pipeline
robot = pipeline.Robot(sys.argv[1])
q = np.zeros((1000, 16))
thread = threading.Thread(target=robot.forward_kinematics, args=(q,))
thread.start()
child = os.fork()
if child == 0:
    robot.forward_kinematics(q)
    os._exit(0)
thread.join()
sys.exit(os.waitpid(child, 0)[1])
"""
        urdf = DATA / "robots/allegro_right.urdf"
        for _ in range(10):
            words = [sys.executable, "-W", "ignore", "-c", code, urdf]
            subprocess.run(words, check=True, timeout=60)

    def test_what_a_handler_raises_ends_a_long_call(self):
        recordings = [(r["times"], r["landmarks"]) for r in map(recording, range(20))]
        started = time.monotonic()
        # Half a second of work for each processor.
        many = recordings * (40 * (os.cpu_count() or 1))
        with self.assertRaises(lab.Interrupted), lab.interrupting(0.05):
            self.hand.retarget_all(many)
        self.assertLess(time.monotonic() - started, 60)
        # And the next one works.
        self.assertEqual(len(self.hand.retarget_all(recordings)), 20)

    def test_what_reading_an_argument_raises_reaches_the_caller(self):
        class Stopped:
            def __array__(self, *_):
                raise KeyboardInterrupt

        class Refused:
            def __array__(self, *_):
                raise ValueError("detach it first")

        with self.assertRaises(KeyboardInterrupt):
            self.hand.step(Stopped())
        with self.assertRaisesRegex(pipeline.Error, "detach it first") as raised:
            self.hand.step(Refused())
        self.assertIsInstance(raised.exception.__cause__, ValueError)
        self.assertIsNone(pipeline.Error("mine").hint)


if __name__ == "__main__":
    unittest.main()
