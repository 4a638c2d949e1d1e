"""The program in the wheel is the one that cargo builds, and needs neither a compiler nor a clone."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import pipeline

# What makes the whole job small.
SMALL = [
    "train.network.points=64",
    "train.training.epochs=20",
    "sample.per_object=16",
    "screen.robustness.trials=2",
    "screen.pose_errors_per_object=1",
]
# Without these, the stage's motions depend on the landmarks alone, as the module's.
IN_THE_AIR = {"object_weight": 0.0, "table_weight": 0.0, "contact_weight": 0.0}


def run(*words: str, cwd: Path, program: str = "pipeline") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *words], cwd=cwd, capture_output=True, text=True)


class Program(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        made = run("new", "lab", cwd=cls.folder)
        assert made.returncode == 0, made.stderr
        cls.lab = cls.folder / "lab"
        recipe = cls.lab / "data/sample/recipe.toml"
        text = re.sub(r"sequences_per_object = .*", "sequences_per_object = 1", recipe.read_text())
        recipe.write_text(re.sub(r"subjects = .*", "subjects = 2", text))

    def query(self, sql: str) -> list[dict]:
        asked = run("query", sql, "--format", "json", cwd=self.lab)
        self.assertEqual(asked.returncode, 0, asked.stderr)
        return [json.loads(line) for line in asked.stdout.splitlines()]

    def test_commands_and_kinds_are_those_of_cargos_build(self):
        built = os.environ.get("PIPELINE_PROGRAM")
        if built is None:
            self.skipTest("`PIPELINE_PROGRAM` names no program that cargo built")
        for words in [["--help"], ["--version"], ["stages"], ["stages", "train"], ["run", "--nonsense"]]:
            here = run(*words, cwd=self.folder)
            there = run(*words, cwd=self.folder, program=built)
            self.assertEqual(
                (here.returncode, here.stdout, here.stderr),
                (there.returncode, there.stdout, there.stderr),
            )

    def test_the_main_job_runs_in_a_new_project(self):
        values = [word for value in SMALL for word in ("--set", value)]
        ran = run("run", "pipelines/cgf.toml", *values, cwd=self.lab)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        self.assertIn("done", ran.stderr)
        again = run("run", "pipelines/cgf.toml", *values, cwd=self.lab)
        self.assertIn("nothing to run", again.stderr)
        runs = self.query("select count(*) as n from executions")
        self.assertGreater(runs[0]["n"], 0)

    def test_processes_of_a_run_are_those_of_the_wheel(self):
        words = ["--lake", "other", "run", "pipelines/cgf.toml", "--until", "ingest", "--processes"]
        ran = run(*words, cwd=self.lab)
        self.assertEqual(ran.returncode, 0, ran.stderr)

    def test_motions_are_those_of_the_stage_bit_for_bit(self):
        values = [f"retarget.{key}={value}" for key, value in IN_THE_AIR.items()]
        words = [word for value in values for word in ("--set", value)]
        ran = run("run", "pipelines/cgf.toml", "--until", "retarget", *words, cwd=self.lab)
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
