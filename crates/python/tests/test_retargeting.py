"""A robot hand follows, within its limits, whoever calls and from whichever thread."""

import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import pip._vendor.tomli as tomllib

import pipeline
from lab import recording

LANDMARKS = ["wrist"] + [
    f"{finger}_{joint}"
    for finger in ["thumb", "index", "middle", "ring", "little"]
    for joint in ["mcp", "pip", "dip", "tip"]
]
DATA = Path(__file__).parents[3] / "data"


class Retargeting(unittest.TestCase):
    def setUp(self):
        self.hand = pipeline.Retargeter(DATA / "hands/allegro_right.toml")

    def test_error_and_palm_are_those_of_the_points_of_the_hands_file(self):
        with open(DATA / "hands/allegro_right.toml", "rb") as file:
            table = tomllib.load(file)
        self.assertEqual((self.hand.side, self.hand.scale), (table["side"], table["scale"]))
        robot = pipeline.Robot(DATA / "robots/allegro_right.urdf")
        self.assertEqual(robot.joint_names, self.hand.joint_names)
        points = [point for point in table["points"] if point["weight"] > 0.0]
        for landmarks in recording(0)["landmarks"]:
            q, palm, error = self.hand.step(landmarks)
            self.assertTrue(np.all((robot.lower <= q) & (q <= robot.upper)))
            scaled = landmarks[0] + self.hand.scale * (landmarks - landmarks[0])
            links = robot.forward_kinematics(q, [point["link"] for point in points])
            squares = []
            for point, link in zip(points, links):
                offset = [*point.get("offset_m", [0.0, 0.0, 0.0]), 1.0]
                at = (palm @ link @ offset)[:3]
                squares.append(np.sum((at - scaled[LANDMARKS.index(point["keypoint"])]) ** 2))
            self.assertAlmostEqual(error, np.sqrt(np.mean(squares)), places=12)
            self.assertLess(error, 0.04)

    def test_steps_in_a_loop_stay_near_each_other(self):
        steps = [self.hand.step(landmarks)[0] for landmarks in recording(0)["landmarks"]]
        self.assertLess(np.abs(np.diff(steps, axis=0)).max(), 0.3)

    def test_a_reset_starts_afresh(self):
        stream = recording(1)["landmarks"]
        first = self.hand.step(stream[0])
        for landmarks in stream[:30]:
            self.hand.step(landmarks)
        self.hand.reset()
        for one, other in zip(self.hand.step(stream[0]), first):
            np.testing.assert_array_equal(one, other)

    def test_several_recordings_at_once_are_each_alone(self):
        recordings = [(r["times"], r["landmarks"]) for r in map(recording, range(4))]
        together = self.hand.retarget_all(recordings)
        for motion, (times, landmarks) in zip(together, recordings, strict=True):
            alone = self.hand.retarget(times, landmarks)
            np.testing.assert_array_equal(motion.q, alone.q)
            np.testing.assert_array_equal(motion.palm, alone.palm)
            np.testing.assert_array_equal(motion.times, times)
            middle = (motion.q[2:] - motion.q[:-2]) / (times[2:] - times[:-2])[:, None]
            np.testing.assert_allclose(motion.velocity[1:-1], middle, atol=1e-9)

    def test_a_urdf_alone_gets_proposed_points(self):
        hand = pipeline.Retargeter(DATA / "robots/leap_right.urdf")
        self.assertLess(hand.retarget(**{
            "times": recording(2)["times"], "landmarks": recording(2)["landmarks"],
        }).errors.mean(), 0.06)

    def test_each_thread_follows_its_own_stream_with_its_own_hand(self):
        def follow(seed: int) -> np.ndarray:
            hand = pipeline.Retargeter(DATA / "hands/allegro_right.toml")
            return np.array([hand.step(landmarks)[0] for landmarks in recording(seed)["landmarks"]])

        with ThreadPoolExecutor(4) as threads:
            together = list(threads.map(follow, range(4)))
        for seed, motion in enumerate(together):
            np.testing.assert_array_equal(motion, follow(seed))

    def test_a_step_far_off_does_not_spoil_those_after_it(self):
        stream = recording(0)["landmarks"]
        errors = [self.hand.step(landmarks)[2] for landmarks in stream]
        self.hand.step(1000 * stream[-1])
        self.assertLess(self.hand.step(stream[-1])[2], errors[-1] + 0.01)


if __name__ == "__main__":
    unittest.main()
