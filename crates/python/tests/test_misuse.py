"""Whatever is passed, the answer is a result or an exception that says what to do: no crash, no hang."""

import math
import os
import random
import signal
import time
import unittest
from pathlib import Path

import numpy as np

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

    def test_random_arguments(self):
        robot, hand = self.robot, self.hand
        calls = [
            (robot.forward_kinematics, 2),
            (robot.jacobian, 3),
            (robot.inverse_kinematics, 3),
            (robot.inverse_dynamics, 4),
            (robot.mass_matrix, 1),
            (robot.center_of_mass, 1),
            (hand.step, 1),
            (hand.retarget, 2),
            (hand.retarget_all, 1),
            (pipeline.Robot, 1),
            (pipeline.Robot.from_text, 1),
            (pipeline.Retargeter, 1),
            (lambda options: pipeline.Retargeter(DATA / "hands/allegro_right.toml", options=options), 1),
        ]
        rng = random.Random(7)
        refused = 0
        for _ in range(N):
            call, n = rng.choice(calls)
            try:
                call(*[anything(rng) for _ in range(n)])
            except pipeline.Error as err:
                refused += 1
                self.assertTrue(str(err))
            except TypeError as err:
                # What Python says of the type of a path, a name or a dict.
                refused += 1
                self.assertTrue(str(err))
        self.assertGreater(refused, N // 2)
        # After all that it works.
        self.assertLess(hand.step(recording(0)["landmarks"][0])[2], 0.05)

    def test_what_is_wrong_is_said_with_its_remedy(self):
        q = np.zeros(16)
        for call, what in [
            (lambda: self.robot.forward_kinematics(q[:3]), r"`q` has the shape \(3,\), not \(16,\)"),
            (lambda: self.robot.forward_kinematics(q + math.nan), "`q` has NaN at the flat index 0"),
            (lambda: self.robot.jacobian(q, "link_3.0_tp"), "no link `link_3.0_tp`"),
            (lambda: pipeline.Robot("nowhere.urdf"), "nowhere.urdf"),
            (lambda: pipeline.Robot.from_text("<robot/>"), "no link"),
            (lambda: self.hand.step(np.zeros((20, 3))), r"\(20, 3\), not \(21, 3\)"),
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

    def test_a_signal_in_a_long_call_is_handled_after_it(self):
        caught = []
        before = signal.signal(signal.SIGALRM, lambda *_: caught.append(True))
        self.addCleanup(signal.signal, signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, 0.01)
        recordings = [(r["times"], r["landmarks"]) for r in map(recording, range(60))]
        self.hand.retarget_all(recordings)
        self.assertEqual(caught, [True])


if __name__ == "__main__":
    unittest.main()
