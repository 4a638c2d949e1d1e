"""A robot hand follows, within its limits, whoever calls and from whichever thread."""

import threading
import unittest
from pathlib import Path

import numpy as np

import pipeline
from lab import recording

DATA = Path(__file__).parents[3] / "data"


class Retargeting(unittest.TestCase):
    def setUp(self):
        self.hand = pipeline.Retargeter(DATA / "hands/allegro_right.toml")

    def test_a_hand_that_moves_as_the_robot_can_is_followed(self):
        robot = pipeline.Robot(DATA / "robots/allegro_right.urdf")
        self.assertEqual(robot.joint_names, self.hand.joint_names)
        hand = pipeline.Retargeter(DATA / "hands/allegro_right.toml")
        for landmarks in recording(0)["landmarks"]:
            q, palm, error = hand.step(landmarks)
            self.assertTrue(np.all((robot.lower <= q) & (q <= robot.upper)))
            turn = palm[:3, :3]
            np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
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
            self.assertEqual(motion.velocity.shape, motion.q.shape)

    def test_a_urdf_alone_gets_proposed_points(self):
        hand = pipeline.Retargeter(DATA / "robots/leap_right.urdf")
        self.assertLess(hand.retarget(**{
            "times": recording(2)["times"], "landmarks": recording(2)["landmarks"],
        }).errors.mean(), 0.06)

    def test_threads_may_share_a_hand(self):
        stream = recording(3)["landmarks"]
        failed = []

        def follow():
            try:
                for landmarks in stream:
                    self.hand.step(landmarks)
            except Exception as err:  # noqa: BLE001
                failed.append(err)

        threads = [threading.Thread(target=follow) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(failed, [])


if __name__ == "__main__":
    unittest.main()
