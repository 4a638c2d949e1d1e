"""The page's examples run as they are printed, in a project that the wheel made."""

import contextlib
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

import lab
import pipeline
from lab import recording

os.environ.setdefault("MPLBACKEND", "agg")

CRATE = Path(__file__).parents[1]
PAGE = (CRATE / "README.md").read_text()
EXAMPLES = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.lab = lab.done()
        np.savez(cls.lab / "landmarks.npz", **recording(0))
        (cls.lab / "recordings").mkdir(exist_ok=True)
        for seed in range(3):
            np.savez(cls.lab / "recordings" / f"{seed}.npz", **recording(seed))
        lake = pipeline.Lake(cls.lab / "data/lake")
        name = lake.query("select distinct object from rollouts where success").column("object")[0]
        motions, mug = lake.candidates(name, stage="refine"), lake.object(name)
        np.savez(cls.lab / "grasps.npz", times=motions.times[0], palm=motions.palm, q=motions.q)
        lines = [f"v {x} {y} {z}" for x, y, z in mug.vertices]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mug.triangles]
        (cls.lab / "mug.obj").write_text("\n".join(lines))

    def test_every_example_runs_and_prints_a_line(self):
        self.assertGreaterEqual(len(EXAMPLES), 3)
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        os.chdir(self.lab)
        for example in EXAMPLES:
            if "matplotlib" in example and importlib.util.find_spec("matplotlib") is None:
                continue
            said = io.StringIO()
            with self.subTest(example), contextlib.redirect_stdout(said):
                exec(compile(example, "README.md", "exec"), {"__name__": "__main__"})
            self.assertRegex(said.getvalue(), r"\d+ (mm|%)")

    def test_the_notebook_draws_a_grasp(self):
        if importlib.util.find_spec("matplotlib") is None:
            self.skipTest("there is no matplotlib")
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        os.chdir(self.lab)
        cells = json.loads((CRATE / "grasp.ipynb").read_text())["cells"]
        names: dict = {}
        for cell in cells:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), "grasp.ipynb", "exec"), names)
        self.assertEqual(names["rollout"].reason, "held")
        import matplotlib.pyplot as plt

        drawn = plt.imread("grasp.png")[..., :3]
        self.assertGreater((drawn < 0.9).any(axis=2).mean(), 0.05)

    def test_every_example_has_the_types_of_the_stubs(self):
        for idx, example in enumerate(EXAMPLES):
            (self.lab / f"example_{idx}.py").write_text(example)
        mypy = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports"]
        checked = subprocess.run(
            [*mypy, *self.lab.glob("example_*.py")], capture_output=True, text=True
        )
        if "No module named mypy" in checked.stderr:
            self.skipTest("there is no mypy")
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def test_stubs_are_those_of_the_module(self):
        compared = subprocess.run(
            [sys.executable, "-m", "mypy.stubtest", "pipeline", "--ignore-missing-stub"],
            capture_output=True,
            text=True,
            cwd=self.lab,
        )
        if "No module named" in compared.stderr:
            self.skipTest("there is no mypy")
        self.assertEqual(compared.returncode, 0, compared.stdout + compared.stderr)


if __name__ == "__main__":
    unittest.main()
