"""The program in the wheel is the one that cargo builds, and needs neither a compiler nor a clone."""

import json
import os
import signal
import subprocess
import sys
import unittest

import numpy as np

import lab
import pipeline
from lab import run, setting

# Without these, the stage's motions depend on the landmarks alone, as the module's.
IN_THE_AIR = {"object_weight": 0.0, "table_weight": 0.0, "contact_weight": 0.0}


class Program(unittest.TestCase):
    def setUp(self):
        self.lab = lab.new()

    def query(self, sql: str) -> list[dict]:
        asked = run("query", sql, "--format", "json", cwd=self.lab)
        self.assertEqual(asked.returncode, 0, asked.stderr)
        return [json.loads(line) for line in asked.stdout.splitlines()]

    def test_commands_and_kinds_are_those_of_cargos_build(self):
        built = os.environ.get("PIPELINE_PROGRAM")
        if built is None:
            self.skipTest("`PIPELINE_PROGRAM` names no program that cargo built")
        for words in [["--help"], ["--version"], ["stages"], ["stages", "train"], ["run", "--nonsense"]]:
            here = run(*words, cwd=self.lab)
            there = run(*words, cwd=self.lab, program=built)
            self.assertEqual(
                (here.returncode, here.stdout, here.stderr),
                (there.returncode, there.stdout, there.stderr),
            )

    def test_the_main_job_runs_in_a_new_project(self):
        lab.done()
        again = run("run", "pipelines/cgf.toml", cwd=self.lab)
        self.assertIn("nothing to run", again.stderr)
        runs = self.query("select count(*) as n from executions")
        self.assertGreater(runs[0]["n"], 0)

    def test_processes_of_a_run_are_those_of_the_wheel(self):
        words = ["--lake", "other", "run", "pipelines/cgf.toml", "--until", "ingest", "--processes"]
        ran = run(*words, cwd=self.lab)
        self.assertEqual(ran.returncode, 0, ran.stderr)

    def test_motions_are_those_of_the_stage_bit_for_bit(self):
        values = [f"retarget.{key}={value}" for key, value in IN_THE_AIR.items()]
        until = ["--until", "retarget", *setting(values)]
        ran = run("run", "pipelines/cgf.toml", *until, cwd=self.lab)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        columns = "sequence, step, time_s"
        shown = self.query(f"select {columns}, keypoints_m from demonstrations order by sequence, step")
        moved = self.query(f"select {columns}, q_rad from trajectories order by sequence, step")
        hand = pipeline.Retargeter(self.lab / "data/hands/allegro_right.toml", options=IN_THE_AIR)
        sequences = sorted({row["sequence"] for row in moved})
        self.assertGreater(len(sequences), 3)
        for sequence in sequences:
            steps = [row for row in shown if row["sequence"] == sequence]
            landmarks = np.array([row["keypoints_m"] for row in steps]).reshape(-1, 21, 3)
            motion = hand.retarget([row["time_s"] for row in steps], landmarks)
            expected = np.array([row["q_rad"] for row in moved if row["sequence"] == sequence])
            np.testing.assert_array_equal(motion.q, expected)

    def test_ctrl_c_ends_a_run_at_once(self):
        started = subprocess.Popen(
            ["pipeline", "--lake", "interrupted", "run", "pipelines/cgf.toml"],
            cwd=self.lab,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert started.stderr is not None
        with started.stderr:
            for line in started.stderr:
                if "retarget" in line:
                    break
            started.send_signal(signal.SIGINT)
            started.stderr.read()
        self.assertEqual(started.wait(timeout=60), 130)

    def test_import_needs_no_numpy_before_the_first_array(self):
        code = "import sys, pipeline; sys.exit('numpy' in sys.modules)"
        subprocess.run([sys.executable, "-c", code], check=True)


if __name__ == "__main__":
    unittest.main()
