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

    def test_a_planar_arm_is_where_trigonometry_says(self):
        link = "<inertial><mass value='{}'/><origin xyz='0.5 0 0'/>" + (
            "<inertia ixx='0' iyy='0' izz='0' ixy='0' ixz='0' iyz='0'/></inertial>"
        )
        joint = "<joint name='{0}' type='{1}'><parent link='{2}'/><child link='{3}'/>" + (
            "<origin xyz='{4} 0 0'/><axis xyz='{5}'/>{6}"
            "<limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
        )
        arm = pipeline.Robot.from_text(
            "<robot name='arm'><link name='base'/>"
            f"<link name='a'>{link.format(2)}</link><link name='b'>{link.format(3)}</link>"
            "<link name='slider'/><link name='follower'/>"
            + joint.format("one", "revolute", "base", "a", 0, "0 0 1", "")
            + joint.format("two", "revolute", "a", "b", 1, "0 0 1", "")
            + joint.format("slide", "prismatic", "b", "slider", 1, "1 0 0", "")
            + joint.format(
                "mimic", "revolute", "b", "follower", 1, "0 0 1",
                "<mimic joint='two' multiplier='-2' offset='0.1'/>",
            )
            + "</robot>"
        )
        self.assertEqual(arm.joint_names, ["one", "two", "slide"])
        one, two, slide = q = np.array([0.3, 0.4, 0.5])
        slider, follower = arm.forward_kinematics(q, ["slider", "follower"])
        elbow = np.array([np.cos(one), np.sin(one)])
        wrist = elbow + [np.cos(one + two), np.sin(one + two)]
        along = np.array([np.cos(one + two), np.sin(one + two)])
        np.testing.assert_allclose(slider[:2, 3], wrist + slide * along, atol=1e-15)
        angle = np.arctan2(follower[1, 0], follower[0, 0])
        self.assertAlmostEqual(angle, one + two - 2 * two + 0.1, places=14)
        # Two point masses, 2 kg and 3 kg, in the middle of the links; gravity along -y.
        torque = arm.inverse_dynamics(q, gravity=[0.0, -9.81, 0.0])
        second = 3 * 9.81 * 0.5 * np.cos(one + two)
        first = 2 * 9.81 * 0.5 * np.cos(one) + 3 * 9.81 * np.cos(one) + second
        np.testing.assert_allclose(torque[:2], [first, second], atol=1e-13)
        # Coriolis and centrifugal torques (Lynch and Park, Modern Robotics, 2017, section 8.1).
        velocity = np.array([0.7, -0.2, 0.0])
        h = 3 * 1 * 0.5 * np.sin(two)
        torque = arm.inverse_dynamics(q, velocity, gravity=np.zeros(3))
        expected = [-h * (2 * velocity[0] * velocity[1] + velocity[1] ** 2), h * velocity[0] ** 2]
        np.testing.assert_allclose(torque[:2], expected, atol=1e-14)

    def test_joints_beside_the_chain_stay_within_their_limits(self):
        q = self.q[0]
        pose = self.hand.forward_kinematics(q, ["link_3.0_tip"])[0]
        chain = [name in {f"joint_{n}.0" for n in range(4)} for name in self.hand.joint_names]
        found = self.hand.inverse_kinematics(pose, "link_3.0_tip", near=np.where(chain, q, 99.0))
        np.testing.assert_allclose(found, np.where(chain, q, self.hand.upper), atol=1e-9)
        exact = self.hand.inverse_kinematics(pose, "link_3.0_tip", near=q)
        np.testing.assert_allclose(exact, q, atol=1e-9)

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
        single = arm.inverse_kinematics(pose.astype("f4"), "base_link", near=q)
        np.testing.assert_allclose(single, q, atol=1e-4)
        far = pose.copy()
        far[:3, 3] = [5.0, 0.0, 0.0]
        self.assertIsNone(arm.inverse_kinematics(far, "base_link"))


if __name__ == "__main__":
    unittest.main()
