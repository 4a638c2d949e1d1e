"""Kinematics and dynamics obey what mechanics says of them, for one posture and for a batch."""

import unittest
from pathlib import Path

import numpy as np

import pipeline

ROBOTS = Path(__file__).parents[3] / "data" / "robots"


class Kinematics(unittest.TestCase):
    def setUp(self):
        self.hand = pipeline.Robot(ROBOTS / "allegro_right.urdf")
        random = np.random.default_rng(1)
        n = len(self.hand.joint_names)
        self.q = random.uniform(self.hand.lower, self.hand.upper, (100, n))
        self.velocity, self.acceleration = random.normal(size=(2, 100, n))

    def test_a_batch_is_its_rows(self):
        hand, q = self.hand, self.q
        for compute in [
            hand.forward_kinematics,
            lambda q: hand.jacobian(q, "link_3.0_tip"),
            hand.inverse_dynamics,
            hand.mass_matrix,
            hand.center_of_mass,
        ]:
            batch = compute(q)
            rows = np.stack([compute(row) for row in q])
            np.testing.assert_array_equal(batch, rows)
            np.testing.assert_array_equal(compute(q[::2]), batch[::2])
            self.assertEqual(compute(q[:1]).shape, (1, *rows.shape[1:]))

    def test_jacobian_is_the_derivative_of_the_pose(self):
        point, step = np.array([0.01, 0.02, 0.03]), 1e-6
        q = self.q[0]
        jacobian = self.hand.jacobian(q, "link_3.0_tip", point)
        for joint in range(len(q)):
            poses = []
            for sign in (1, -1):
                moved = q.copy()
                moved[joint] += sign * step
                poses.append(self.hand.forward_kinematics(moved, ["link_3.0_tip"])[0])
            ahead, behind = poses
            along = (ahead - behind) @ [*point, 1.0] / (2 * step)
            np.testing.assert_allclose(jacobian[:3, joint], along[:3], atol=1e-8)
            spin = (ahead[:3, :3] - behind[:3, :3]) @ behind[:3, :3].T / (2 * step)
            turn = [spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(jacobian[3:, joint], turn, atol=1e-6)

    def test_dynamics_add_up(self):
        hand, q = self.hand, self.q
        weight = hand.inverse_dynamics(q)
        moving = hand.inverse_dynamics(q, acceleration=self.acceleration)
        mass = hand.mass_matrix(q)
        np.testing.assert_allclose(mass, mass.swapaxes(1, 2), atol=1e-12)
        inertia = np.einsum("nij,nj->ni", mass, self.acceleration)
        np.testing.assert_allclose(moving - weight, inertia, atol=1e-10)
        whole = hand.inverse_dynamics(q, self.velocity, self.acceleration, [0.0, 0.0, 0.0])
        self.assertGreater(abs(whole - inertia).max(), 1e-6)

    def test_gravity_is_the_slope_of_the_height_of_the_center_of_mass(self):
        q, step = self.q[3], 1e-6
        torque = self.hand.inverse_dynamics(q)
        for joint in range(len(q)):
            heights = []
            for sign in (1, -1):
                moved = q.copy()
                moved[joint] += sign * step
                heights.append(self.hand.center_of_mass(moved)[2])
            slope = self.hand.mass * 9.81 * (heights[0] - heights[1]) / (2 * step)
            self.assertAlmostEqual(torque[joint], slope, places=6)

    def test_an_arm_reaches_a_pose_within_its_limits(self):
        arm = pipeline.Robot(ROBOTS / "xarm6_allegro.urdf")
        q = 0.5 * (arm.lower + arm.upper) + 0.2
        pose = arm.forward_kinematics(q, ["base_link"])[0]
        found = arm.inverse_kinematics(pose, "base_link")
        self.assertTrue(np.all((arm.lower <= found) & (found <= arm.upper)))
        reached = arm.forward_kinematics(found, ["base_link"])[0]
        np.testing.assert_allclose(reached, pose, atol=1e-9)
        near = arm.inverse_kinematics(pose, "base_link", near=q)
        np.testing.assert_allclose(near, q, atol=1e-9)
        far = pose.copy()
        far[:3, 3] = [5.0, 0.0, 0.0]
        self.assertIsNone(arm.inverse_kinematics(far, "base_link"))


if __name__ == "__main__":
    unittest.main()
