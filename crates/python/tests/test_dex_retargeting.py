"""Configuration files of dex-retargeting, unchanged."""

import os
import tempfile
import unittest
from pathlib import Path

import numpy as np

import pipeline
from lab import recording

DATA = Path(__file__).parents[3] / "data"
TIPS = ["link_15.0_tip", "link_3.0_tip", "link_7.0_tip", "link_11.0_tip"]
POSITION = f"""
retargeting:
  type: position
  urdf_path: allegro_right.urdf
  target_link_names: {TIPS}
  target_link_human_indices: [ 4, 8, 12, 16 ]
  add_dummy_free_joint: True
  low_pass_alpha: 1
"""
VECTOR = f"""
retargeting:
  type: vector
  urdf_path: allegro_right.urdf
  target_origin_link_names: [ base_link, base_link, base_link, base_link ]
  target_task_link_names: {TIPS}
  target_link_human_indices: [ [ 0, 0, 0, 0 ], [ 4, 8, 12, 16 ] ]
  scaling_factor: 1.6
  low_pass_alpha: 1
"""
DEXPILOT = f"""
retargeting:
  type: DexPilot
  urdf_path: allegro_right.urdf
  wrist_link_name: base_link
  finger_tip_link_names: {TIPS}
  scaling_factor: 1.6
  low_pass_alpha: 1
"""


def stream(seed: int) -> np.ndarray:
    """The recording along the wrist's axes: x out of the palm, y to the thumb, z to the fingers."""
    return recording(seed)["landmarks"] @ [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]


class DexRetargeting(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.robot = pipeline.Robot(DATA / "robots/allegro_right.urdf")

    def hand(self, text: str) -> pipeline.Retargeter:
        path = self.folder / "hand.yml"
        path.write_text(text)
        return pipeline.Retargeter(path, urdf_folder=DATA / "robots")

    def test_errors_are_those_of_what_each_type_follows(self):
        for text in (POSITION, VECTOR, DEXPILOT):
            hand = self.hand(text)
            self.assertEqual(hand.joint_names, self.robot.joint_names)
            for landmarks in stream(0):
                q, palm, error = hand.step(landmarks)
                self.assertTrue(np.all((hand.lower <= q) & (q <= hand.upper)))
                if text == DEXPILOT:
                    continue
                tips = (palm @ self.robot.forward_kinematics(q, TIPS))[:, :3, 3]
                wanted = landmarks[[4, 8, 12, 16]]
                if text == VECTOR:
                    np.testing.assert_array_equal(palm, np.eye(4))
                    wanted = 1.6 * (wanted - landmarks[0])
                squares = np.sum((tips - wanted) ** 2, axis=1)
                self.assertAlmostEqual(error, np.sqrt(squares.mean()), places=12)

    def test_reference_values_are_as_good_as_landmarks(self):
        for text in (POSITION, VECTOR, DEXPILOT):
            one, other = self.hand(text), self.hand(text)
            indices = one.target_link_human_indices
            for landmarks in stream(1)[:20]:
                if text == POSITION:
                    reference = landmarks[indices]
                else:
                    reference = landmarks[indices[1]] - landmarks[indices[0]]
                for of_one, of_other in zip(one.step(landmarks), other.step_reference(reference)):
                    np.testing.assert_array_equal(of_one, of_other)

    def test_a_recording_is_a_loop_of_steps(self):
        times = recording(0)["times"]
        for text in (POSITION, VECTOR, DEXPILOT):
            hand = self.hand(text)
            together = hand.retarget_all([(times, stream(seed)) for seed in range(3)])
            for seed, motion in enumerate(together):
                hand.reset()
                steps = [hand.step(landmarks) for landmarks in stream(seed)]
                np.testing.assert_array_equal(motion.q, [q for q, _, _ in steps])
                np.testing.assert_allclose(motion.errors, [error for _, _, error in steps])

    def test_the_filter_goes_a_share_of_the_way(self):
        plain = self.hand(VECTOR)
        answers = [plain.step(landmarks)[0] for landmarks in stream(2)]
        hand = self.hand(VECTOR.replace("alpha: 1", "alpha: 0.2"))
        smooth = answers[0]
        for landmarks, answer in zip(stream(2), answers):
            smooth = smooth + 0.2 * (answer - smooth)
            np.testing.assert_allclose(hand.step(landmarks)[0], smooth, atol=1e-12)

    def test_what_the_library_does_not_know_is_refused(self):
        for change, part in [
            (("scaling_factor", "scaling_size"), "did you mean `scaling_factor`?"),
            (("type: vector", "type: vectors"), "`dexpilot`"),
            (("link_3.0_tip", "link_3_tip"), "`link_3.0_tip`"),
            (("allegro_right.urdf", "nowhere.urdf"), "urdf_folder"),
        ]:
            with self.subTest(change), self.assertRaises(pipeline.Error) as raised:
                self.hand(VECTOR.replace(*change))
            self.assertIn(part, str(raised.exception))
        with self.assertRaisesRegex(pipeline.Error, "options"):
            pipeline.Retargeter(self.folder / "hand.yml", options={"loss": "squared"})
        own = pipeline.Retargeter(DATA / "hands/allegro_right.toml")
        self.assertIsNone(own.target_link_human_indices)
        with self.assertRaisesRegex(pipeline.Error, "step"):
            own.step_reference(np.zeros((4, 3)))

    def test_every_file_of_the_library_loads_and_follows(self):
        """`PIPELINE_DEX_RETARGETING` is a folder with its `configs`, and dex-urdf's `robots`."""
        folder = os.environ.get("PIPELINE_DEX_RETARGETING")
        if folder is None:
            self.skipTest("`PIPELINE_DEX_RETARGETING` names no folder with `configs` and `robots`")
        paths = sorted(Path(folder, "configs").glob("*/*.yml"))
        self.assertGreaterEqual(len(paths), 36)
        for path in paths:
            with self.subTest(path.name):
                hand = pipeline.Retargeter(path, urdf_folder=Path(folder, "robots/hands"))
                for landmarks in stream(0):
                    q, _, error = hand.step(landmarks)
                    self.assertTrue(np.isfinite(error))
                    self.assertTrue(np.all((hand.lower <= q) & (q <= hand.upper)))


if __name__ == "__main__":
    unittest.main()
