"""Objects, functions, refinement and physics from Python are those of the stages, bit for bit."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np

import lab
import pipeline

DATA = Path(__file__).parents[3] / "data"
ARRAYS = [
    "times", "palm", "q", "velocity", "acceleration", "palm_velocity", "palm_acceleration",
    "table_from_object", "codes", "residuals",
]
MEASURES = {
    "lift": "lift_m",
    "slip": "slip_m",
    "displacement": "displacement_m",
    "penetration": "penetration_m",
    "finger_penetration": "finger_penetration_m",
    "contacts": "contacts_n",
}


def box(half: tuple[float, float, float]) -> np.ndarray:
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    return corners * half


class Grasping(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        project = lab.done()
        before = os.getcwd()
        os.chdir(project)
        cls.addClassCleanup(os.chdir, before)
        cls.lake = pipeline.Lake("data/lake")
        cls.hand = pipeline.Hand("data/hands/allegro_right.toml")
        names = cls.lake.query("select distinct object from rollouts where success order by object")
        cls.object = cls.lake.object(texts(names)[0])
        cls.function = cls.lake.function()

    def options(self, stage: str) -> dict:
        return pipeline.options("pipelines/cgf.toml", stage)

    def same(self, found: pipeline.Candidates, expected: pipeline.Candidates):
        self.assertEqual(found.names, expected.names)
        self.assertEqual(found.joint_names, expected.joint_names)
        for array in ARRAYS:
            np.testing.assert_array_equal(getattr(found, array), getattr(expected, array), array)

    def test_drawn_refined_and_screened_motions_are_those_of_the_stages(self):
        name = self.object.name
        drawn = self.function.sample(self.object, 16, options=self.options("sample"))
        self.same(drawn, self.lake.candidates(name, stage="sample"))
        refined = self.hand.refine(self.object, drawn, options=self.options("refine"))
        self.same(refined, self.lake.candidates(name, stage="refine"))
        judged = self.hand.screen(self.object, refined, options=self.options("screen"))
        columns = ", ".join(["candidate_id", "reason", *MEASURES.values()])
        rows = self.lake.query(f"select {columns} from rollouts where object = '{name}'")
        self.assertEqual(judged.names, refined.names)
        self.assertEqual(len(judged), len(rows))
        ids = self.lake.query(
            f"select candidate_id, reason from rollouts where object = '{name}'"
        )
        self.assertEqual(list(zip(judged.names, judged.reasons)), pairs(ids))
        for measure, column in MEASURES.items():
            np.testing.assert_array_equal(getattr(judged, measure), rows.column(column), column)
        np.testing.assert_array_equal(judged.success, [why == "held" for why in judged.reasons])
        self.assertGreater(judged.success.sum(), 0)

    def test_motions_drawn_again_are_those_of_the_stage(self):
        # In a copy, where another run is not the newest for other tests.
        shutil.copytree("data/lake", "drawn_lake")
        lake = pipeline.Lake("drawn_lake")
        lake.run("pipelines/cgf.toml", set={"sample.draws": 3}, until="sample")
        options = {**self.options("sample"), "draws": 3}
        drawn = self.function.sample(self.object, 16, hand=self.hand, options=options)
        self.same(drawn, lake.candidates(self.object.name, stage="sample"))

    def test_a_motion_alone_has_the_verdict_that_it_has_among_others(self):
        options = self.options("screen")
        motions = self.lake.candidates(self.object.name, stage="refine")
        judged = self.hand.screen(self.object, motions, options=options)
        for number in range(len(motions)):
            alone = self.hand.screen(self.object, motions[number], options=options)
            self.assertEqual(alone.reasons, judged.reasons[number : number + 1])

    def test_a_rollout_has_every_step_and_lifts_what_is_held(self):
        options = self.options("screen")
        motions = self.lake.candidates(self.object.name, stage="refine")
        judged = self.hand.screen(self.object, motions, options=options)
        held = int(np.flatnonzero(judged.success)[0])
        rollout = self.hand.rollout(self.object, motions, held, options=options)
        self.assertEqual(rollout.reason, "held")
        self.assertEqual(rollout.q.shape, (len(rollout), len(self.hand.joint_names)))
        rise = rollout.object[-1, 2, 3] - rollout.object[0, 2, 3]
        # A verdict alone ends once the object has rested in the hand for a while.
        self.assertAlmostEqual(rise, judged.lift[held], places=3)
        links, points, forces = rollout.contacts(len(rollout) - 1)
        self.assertGreaterEqual(len(links), 2)
        self.assertEqual(points.shape, forces.shape)
        # Gravity and the hand's forces leave the object nearly at rest.
        weight = 9.81 * self.object.mass
        self.assertLess(abs(forces.sum(axis=0)[2] - weight), 0.5 * weight + 0.5)
        with tempfile.TemporaryDirectory() as folder:
            scenes = [Path(folder) / "rollout.glb", Path(folder) / "motion.glb"]
            rollout.export_glb(scenes[0])
            motions.export_glb(scenes[1], self.hand, self.object, held)
            for scene in scenes:
                self.assertEqual(scene.read_bytes()[:4], b"glTF")

    def test_derivatives_are_those_of_the_function_at_any_time(self):
        codes = np.random.default_rng(0).normal(size=(4, self.function.latent))
        # Single precision in the network: the step is large, and so is the tolerance.
        middle, step = np.array([0.4, 0.75, 1.1]), 0.02
        times = np.sort(np.concatenate([middle - step, middle, middle + step]))
        motions = self.function.decode(self.object, codes, times)
        q, velocity, acceleration = motions.q, motions.velocity, motions.acceleration
        before, at, after = (q[:, k::3] for k in range(3))
        inside = (self.hand.lower < at) & (at < self.hand.upper)
        slope = (after - before) / (2 * step)
        self.assertLess(np.abs(slope - velocity[:, 1::3])[inside].max(), 0.05 + 0.1 * np.abs(slope).max())
        bend = (after - 2 * at + before) / step**2
        self.assertLess(np.abs(bend - acceleration[:, 1::3])[inside].max(), 0.5 + 0.1 * np.abs(bend).max())
        np.testing.assert_array_equal(motions.times, [times] * 4)

    def test_codes_of_a_sample_decode_to_it(self):
        drawn = self.function.sample(self.object, 8)
        first = np.flatnonzero([
            np.array_equal(placed, self.object.resting_poses[0]) for placed in drawn.table_from_object
        ])
        drawn = drawn[first]
        decoded = self.function.decode(self.object, drawn.codes, drawn.times[0])
        np.testing.assert_allclose(decoded.q, drawn.q, atol=1e-5)
        np.testing.assert_allclose(decoded.palm, drawn.palm, atol=1e-5)

    def test_the_rest_of_many_motions_is_left_at_a_signal(self):
        codes = np.zeros((4_000, self.function.latent))
        times = np.linspace(0, 1.5, 40)
        for call in [
            lambda: self.function.sample(self.object, len(codes)),
            lambda: self.function.decode(self.object, codes, times),
        ]:
            started = time.monotonic()
            call()
            whole = time.monotonic() - started
            started = time.monotonic()
            with self.assertRaises(lab.Interrupted), lab.interrupting(0.05):
                call()
            self.assertLess(time.monotonic() - started, 0.5 * whole)

    def test_an_object_of_a_mesh_is_the_one_that_ingest_makes(self):
        mesh = Path("extra.obj")
        faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
        corners = [(0, 0, 0), (0.08, 0, 0), (0, 0.07, 0), (0, 0, 0.06)]
        mesh.write_text(
            "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
            + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
        )
        other = pipeline.Lake("other_lake")
        values = {"ingest.meshes.extra.file": str(mesh), "ingest.meshes.extra.mass_kg": 0.2}
        self.assertTrue(other.run("pipelines/cgf.toml", set=values, until="ingest"))
        expected, found = other.object("extra"), pipeline.Object.from_mesh(mesh, 0.2)
        for array in [
            "center_of_mass", "inertia", "vertices", "triangles", "points", "normals",
            "resting_poses", "resting_probabilities",
        ]:
            np.testing.assert_array_equal(getattr(found, array), getattr(expected, array), array)
        self.assertEqual(found.name, "extra")
        self.assertEqual(len(found.resting_poses), 4)
        np.testing.assert_allclose(found.center_of_mass, np.mean(corners, axis=0), atol=1e-9)
        self.assertAlmostEqual(found.distance([0.01, 0.01, -0.01]), 0.01, places=3)

    def test_points_on_a_box_make_that_box(self):
        half = (0.02, 0.03, 0.05)
        found = pipeline.Object.from_points(box(half), 0.3, name="box")
        np.testing.assert_allclose(found.center_of_mass, 0, atol=1e-9)
        sides = 4 * np.square(half)
        expected = 0.3 / 12 * (sides.sum() - sides)
        np.testing.assert_allclose(found.inertia, np.diag(expected), atol=1e-9)
        inside = found.distance([[0.015, 0, 0], [0.03, 0, 0]])
        np.testing.assert_allclose(inside, [-0.005, 0.01], atol=1e-4)
        self.assertAlmostEqual(found.resting_probabilities.sum(), 1, places=1)

    def test_shapes_are_compared_over_size_and_rotation(self):
        carton, longer = [
            pipeline.Object.from_points(box(half), 0.3, name="box")
            for half in [(0.02, 0.03, 0.05), (0.02, 0.03, 0.1)]
        ]
        turned = pipeline.Object.from_points(1.5 * box((0.03, 0.05, 0.02)), 0.3, name="turned")
        self.assertLess(turned.mean_distance(carton), 1e-4)
        self.assertGreater(longer.mean_distance(carton), 0.003)

    def test_own_motions_are_screened(self):
        given = self.lake.candidates(self.object.name, stage="refine")
        own = pipeline.Candidates(
            self.object, given.joint_names, given.times[0], given.palm, given.q,
            table_from_object=given.table_from_object,
        )
        np.testing.assert_array_equal(own.q, given.q)
        np.testing.assert_allclose(own.palm, given.palm, atol=1e-12)
        middle = (own.q[:, 2:] - own.q[:, :-2]) / (own.times[:, 2:] - own.times[:, :-2])[..., None]
        np.testing.assert_allclose(own.velocity[:, 1:-1], middle, atol=1e-9)
        judged = self.hand.screen(self.object, own, options=self.options("screen"))
        self.assertGreater(judged.success.sum(), 0)

    def test_a_hand_that_knows_an_object_keeps_out_of_it(self):
        half = (0.03, 0.03, 0.08)
        block = pipeline.Object.from_points(box(half), 0.3, name="block")
        # A person's hand whose fingers go through the block.
        landmarks = lab.recording(0)["landmarks"] + np.array([-0.09, 0.0, 0.0])
        file = "data/hands/allegro_right.toml"
        robot = pipeline.Robot("data/robots/allegro_right.urdf")
        depths = []
        for hand in [pipeline.Retargeter(file), pipeline.Retargeter(file, object=block)]:
            motion = hand.retarget(lab.recording(0)["times"], landmarks)
            links = robot.forward_kinematics(motion.q)[..., :3, 3]
            points = np.einsum("nij,nkj->nki", motion.palm[:, :3, :3], links) + motion.palm[:, None, :3, 3]
            depths.append(block.distance(points.reshape(-1, 3)).min())
        self.assertLess(depths[0], -0.01)
        self.assertGreater(depths[1], -0.002)
        live = pipeline.Retargeter(file, object=block)
        for points in landmarks[:10]:
            q, palm, _ = live.step(points)
            there = (palm @ robot.forward_kinematics(q))[:, :3, 3]
            self.assertGreater(block.distance(there).min(), -0.002)
        for wrong in [
            {"table_from_object": np.eye(4)}, {"object": block, "table_from_object": np.eye(3)},
        ]:
            with self.assertRaises(pipeline.Error):
                pipeline.Retargeter(file, **wrong)

    def test_retargeted_motions_are_near_those_of_the_stage_whose_object_stood_a_little_off(self):
        options = self.options("retarget")
        columns = "sequence, step, time_s"
        shown = self.lake.query(
            f"select {columns}, keypoints_m from demonstrations where object = '{self.object.name}' "
            "order by sequence, step"
        )
        try:
            import polars
        except ModuleNotFoundError:
            self.skipTest("there is no polars")
        moved = polars.DataFrame(self.lake.query(f"select {columns}, q_rad from trajectories"))
        rest = self.object.resting_poses[0]
        hand = pipeline.Retargeter(
            "data/hands/allegro_right.toml", object=self.object, table_from_object=rest, options=options
        )
        for (sequence,), rows in polars.DataFrame(shown).group_by("sequence"):
            stored = moved.filter(polars.col("sequence") == sequence).sort("step")
            landmarks = np.array(rows["keypoints_m"].to_list()).reshape(-1, 21, 3)
            motion = hand.retarget(rows["time_s"].to_numpy(), landmarks)
            # The person's object stood a little off its resting pose.
            difference = np.abs(motion.q - np.array(stored["q_rad"].to_list()))
            self.assertLess(np.median(difference), 0.02)

    def test_plans_are_within_the_limits_and_end_at_the_grasp(self):
        motions = self.lake.candidates(self.object.name, stage="refine")[:4]
        free = self.hand.plan(self.object, motions, options=self.options("dispatch"))
        self.assertEqual(len(free), 4)
        self.assertTrue(any(plan.reason is None for plan in free))
        for plan, motion in zip(free, motions.q):
            if plan.reason is not None:
                with self.assertRaisesRegex(pipeline.Error, "infeasible"):
                    plan.finger_q
                continue
            speed = np.abs(np.diff(plan.finger_q, axis=0)) / np.diff(plan.finger_times)[:, None]
            self.assertLess(speed.max(), 20)
            self.assertTrue((plan.finger_q >= self.hand.lower - 0.01).all())
            near = np.abs(plan.finger_q - motion[-1]).max(axis=1).min()
            self.assertLess(near, 1e-6)
            self.assertEqual(plan.palm_poses.shape, (len(plan.palm_times), 4, 4))
            with self.assertRaisesRegex(pipeline.Error, "no arm"):
                plan.arm_q
        arm = pipeline.options("pipelines/arm.toml", "dispatch")
        arm["arm"]["robot"] = "data/robots/xarm6_allegro.urdf"
        carried = self.hand.plan(self.object, motions, options=arm)
        feasible = [plan for plan in carried if plan.reason is None]
        self.assertGreater(len(feasible), 0)
        for plan in feasible:
            self.assertEqual(plan.arm_q.shape, (len(plan.arm_times), 6))
            self.assertEqual(len(plan.arm_names), 6)

    def test_some_motions_are_chosen_as_from_a_list(self):
        motions = self.lake.candidates(self.object.name, stage="sample")
        np.testing.assert_array_equal(motions[-1].q, motions.q[-1:])
        np.testing.assert_array_equal(motions[::2].q, motions.q[::2])
        np.testing.assert_array_equal(motions[np.array([3, 1])].q, motions.q[[3, 1]])
        for wrong in [16, -17]:
            with self.assertRaises(IndexError):
                motions[wrong]
        mask = np.arange(16) % 3 == 0
        np.testing.assert_array_equal(motions[mask].q, motions.q[mask])
        np.testing.assert_array_equal(motions[mask.tolist()].q, motions.q[mask])
        self.assertEqual(len(motions[[]]), 0)
        for wrong in [True, mask[:3], [0.5], "0", None]:
            with self.assertRaises(pipeline.Error):
                motions[wrong]

    def test_what_is_wrong_is_said_with_its_remedy(self):
        motions = self.lake.candidates(self.object.name, stage="refine")
        cube = pipeline.Object.from_points(box((0.02, 0.02, 0.02)), 0.1, name="cube")
        twice = pipeline.Object.from_points(box((0.04, 0.04, 0.04)), 0.1, name="cube")
        q, palm, times = np.zeros((2, 16)), np.tile(np.eye(4), (2, 1, 1)), [0.0, 1.0]
        joints = self.hand.joint_names
        other = pipeline.Candidates(self.object, ["a"] + joints[1:], times, palm, q)
        for call, what in [
            (lambda: self.hand.refine(cube, motions), "motions are to `.*the object is `cube`"),
            (lambda: self.hand.screen(self.object, other), "not for the hand"),
            (lambda: self.hand.screen(twice, self.function.sample(cube, 2)), "another `cube`"),
            (lambda: pipeline.Candidates(twice, joints, times, palm, q, table_from_object=np.eye(4)), "-0.040 m above"),
            (lambda: pipeline.Candidates(cube, joints, [1.0, 2.0], palm, q), "from 0"),
            (lambda: self.function.sample(cube, -1), "`n` is -1"),
            (lambda: self.hand.rollout(self.object, motions, -1), "`number` is -1"),
            (lambda: motions.export_glb("/proc/nowhere/x.glb", self.hand, self.object), "folder that can be written"),
            (lambda: self.hand.refine(self.object, motions, options={"drawz": 4}), "`drawz`.*\n.*`draws`"),
            (lambda: self.hand.refine(self.object, motions, options={"draws": 0}), "`draws` is 0"),
            (lambda: self.function.sample(cube, 0), "`per_object` is 0"),
            (lambda: self.function.sample(cube, options={"draws": 2}), "there is no hand"),
            (lambda: self.function.decode(cube, [[0.0]], times), "`codes` has the shape"),
            (lambda: self.function.decode(cube, np.zeros(self.function.latent), [2.0]), "takes 1.5 s"),
            (lambda: pipeline.Object.from_mesh("nowhere.obj", 0.1), "nowhere.obj"),
            (lambda: pipeline.Object.from_points(np.zeros((9, 3)), 0.1), "span no body"),
            (lambda: pipeline.Object.from_points(1000 * box((0.1, 0.1, 0.1)), 0.1), "meters"),
            (lambda: pipeline.Object.from_points(box((0.1, 0.1, 0.1)), -1), "`mass` is -1"),
            (lambda: pipeline.Candidates(cube, joints, times, palm[:, :3], q), "`palm` has the shape"),
            (lambda: pipeline.Candidates(cube, joints, [0.0, 0.0], palm, q), "time"),
            (lambda: pipeline.Function.load("nowhere"), "nowhere"),
            (lambda: self.lake.object("mugg"), "no partition `mugg`"),
            (lambda: self.lake.candidates(self.object.name), "several stages"),
            (lambda: self.lake.candidates(self.object.name, stage="screem"), "screem"),
            (lambda: pipeline.options("pipelines/cgf.toml", "screem"), "no stage `screem`\n.*`screen`"),
            (lambda: pipeline.options("nowhere.toml", "screen"), "nowhere.toml"),
        ]:
            with self.subTest(what), self.assertRaisesRegex(pipeline.Error, what) as raised:
                call()
            self.assertTrue(raised.exception.hint)


class Lakes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.lake = pipeline.Lake(lab.done() / "data/lake")

    def test_recordings_tell_their_messages_one_after_another(self):
        recordings = self.lake.recordings("rollouts")
        self.assertGreater(len(recordings), 0)
        for recording in recordings:
            n = 0
            last = {}
            for topic, time, message in recording:
                self.assertIsInstance(message, dict)
                self.assertGreaterEqual(time, last.get(topic, time))
                last[topic] = time
                n += 1
            self.assertEqual((n, sum(recording.topics.values())), (len(recording),) * 2)
            states = list(recording.messages("/joint_states"))
            self.assertEqual(len(states), recording.topics["/joint_states"])
            _, _, first = states[0]
            self.assertEqual(len(first["name"]), len(first["position"]))
            with self.assertRaisesRegex(pipeline.Error, "/joint_states"):
                recording.messages("/nowhere")
        self.assertEqual(recording.about["schema"].split("/")[0], "rollouts")
        self.assertEqual(pipeline.Recording(recording.path).about, recording.about)

    def test_lineage_leads_from_a_verdict_to_the_recordings(self):
        object = pairs(self.lake.query("select object from rollouts limit 1"))[0][0]
        up = self.lake.lineage("screen.rollouts", object)
        members = up["members"]
        self.assertEqual(members[0]["output"], "screen.rollouts")
        self.assertTrue(any(one["output"] == "ingest.demonstrations" for one in members))
        self.assertTrue(members[0]["made"]["program"].startswith("pipeline "))
        down = self.lake.lineage("ingest.objects", object, down=True)
        self.assertTrue(any(one["output"] == "screen.rollouts" for one in down["members"]))
        with self.assertRaisesRegex(pipeline.Error, "no artifact `screen.rolouts`"):
            self.lake.lineage("screen.rolouts")

    def test_a_stored_session_is_ingested_and_retargeted(self):
        project = lab.done()
        before = os.getcwd()
        os.chdir(project)
        self.addCleanup(os.chdir, before)
        half = (0.03, 0.03, 0.05)
        box_there = pipeline.Object.from_points(box(half), 0.3, name="box")
        shown = lab.recording(0)["landmarks"][:60]
        # The hand comes from above, rests for a third of a second, and lifts the box.
        above = np.concatenate([np.linspace(0.25, 0, 40), np.zeros(10), np.linspace(0.01, 0.1, 10)])
        landmarks = 0.9 * shown[:, :, [0, 1, 2]] + np.array([-0.08, 0.0, 0.06])
        landmarks = landmarks + above[:, None, None] * np.array([0, 0, 1])
        poses = np.tile(np.eye(4), (60, 1, 1))
        poses[:, 2, 3] = half[2] + np.where(np.arange(60) < 50, 0, above)
        for sequence in ["first", "second"]:
            pipeline.save_recording(
                "sessions", "ann", sequence, box_there, landmarks, poses, rate=30.0, table=np.eye(4)
            )
        lake = pipeline.Lake("sessions_lake")
        values = {
            "ingest.root": "sessions",
            "ingest.format": "tracks",
            "ingest.masses_kg.box": 0.3,
            "retarget.max_keypoint_error_m": 1.0,
        }
        self.assertTrue(lake.run("pipelines/cgf.toml", set=values, until="retarget"))
        stored = lake.query("select keypoints_m from demonstrations where sequence like '%first%' order by step")
        self.assertGreater(len(stored), 11)
        trajectories = lake.query("select distinct sequence from trajectories")
        self.assertEqual(len(trajectories), 2)
        for wrong in [("..", "a"), ("ann", "a/b"), ("models", "a")]:
            with self.assertRaisesRegex(pipeline.Error, "letters"):
                pipeline.save_recording("sessions", *wrong, box_there, landmarks, poses)
        with self.assertRaisesRegex(pipeline.Error, "there is a recording"):
            pipeline.save_recording("sessions", "ann", "first", box_there, landmarks, poses)
        other = pipeline.Object.from_points(box((0.02, 0.02, 0.02)), 0.3, name="box")
        with self.assertRaisesRegex(pipeline.Error, "another object of this name"):
            pipeline.save_recording("sessions", "ann", "third", other, landmarks, poses)


class Runs(unittest.TestCase):
    def setUp(self):
        project = lab.new()
        before = os.getcwd()
        os.chdir(project)
        self.addCleanup(os.chdir, before)

    def test_events_of_a_run_are_told_and_a_second_one_makes_nothing(self):
        lake, events = pipeline.Lake("events_lake"), []
        self.assertTrue(lake.run("pipelines/cgf.toml", until="ingest", progress=events.append))
        done = [event for event in events if event["event"] == "unit_done"]
        self.assertGreater(len(done), 8)
        self.assertTrue(all(event["made_now"] for event in done))
        self.assertEqual(events[0]["event"], "run_started")
        events.clear()
        lake.run("pipelines/cgf.toml", until="ingest", progress=events.append)
        self.assertFalse(any(event.get("made_now") for event in events))
        self.assertGreater(len(lake.query("select * from objects")), 3)

    def test_what_is_raised_meanwhile_ends_the_run_and_keeps_what_was_made(self):
        lake, made = pipeline.Lake("raised_lake"), []

        def progress(event: dict) -> None:
            if event["event"] == "unit_done":
                made.append(event)
                if len(made) == 3:
                    raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            lake.run("pipelines/cgf.toml", progress=progress)
        events: list[dict] = []
        lake.run("pipelines/cgf.toml", until="ingest", progress=events.append)
        cached = [event for event in events if event["event"] == "unit_done" and not event["made_now"]]
        self.assertGreaterEqual(len(cached), 3)

    def test_a_run_that_fails_says_why_and_what_to_do(self):
        lake = pipeline.Lake("failed_lake")
        for values, what in [({"train.epoks": 1}, "epoks"), ({"ingest.root": "nowhere"}, "nowhere")]:
            with self.assertRaisesRegex(pipeline.Error, what) as raised:
                lake.run("pipelines/cgf.toml", set=values)
            self.assertTrue(raised.exception.hint)
        with self.assertRaisesRegex(pipeline.Error, "nowhere.toml"):
            lake.run("nowhere.toml")
        with self.assertRaises(pipeline.Error):
            lake.run("--help")
        Path("broken.toml").write_text("[stages.x")
        for call in [lake.run, lambda file: pipeline.options(file, "x")]:
            with self.assertRaisesRegex(pipeline.Error, "broken.toml:1"):
                call("broken.toml")

    def test_values_are_given_as_python_has_them(self):
        lake = pipeline.Lake("values_lake")
        values = {"ingest": {"points_n": np.int64(100), "objects": []}}
        self.assertTrue(lake.run("pipelines/cgf.toml", set=values, until="ingest"))
        name = lake.query("select object from objects").column("object")[0]
        self.assertEqual(len(lake.object(name).points), 100)

    def test_a_run_ends_with_the_process_that_started_it(self):
        code = "import pipeline; pipeline.Lake('orphan_lake').run('pipelines/cgf.toml')"
        parent = subprocess.Popen([sys.executable, "-c", code])
        children = f"/proc/{parent.pid}/task/{parent.pid}/children"
        for _ in range(600):
            if found := Path(children).read_text().split():
                break
            time.sleep(0.05)
        # It has to have come as far as to ask for it.
        while not Path("orphan_lake").exists():
            time.sleep(0.05)
        parent.kill()
        parent.wait()
        for _ in range(600):
            if not Path(f"/proc/{found[0]}").exists():
                return
            time.sleep(0.1)
        self.fail("the run goes on")


def texts(table: pipeline.Table) -> list[str]:
    """The first column, of texts."""
    return list(table.column(table.column_names[0]))


def pairs(table: pipeline.Table) -> list[tuple]:
    return list(zip(*(table.column(name) for name in table.column_names)))


if __name__ == "__main__":
    unittest.main()
