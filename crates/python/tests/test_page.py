"""The page's examples run as they are printed, in a project that the wheel made."""

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

CRATE = Path(__file__).parents[1]
PAGE = (CRATE / "README.md").read_text()
EXAMPLES = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def recording(seed: int) -> dict[str, np.ndarray]:
    """A hand that opens and closes beside the origin."""
    times = np.arange(90) / 60
    fingers, joints = np.divmod(np.arange(20), 4)
    open_hand = np.zeros((21, 3))
    open_hand[1:, 0] = 0.06 + 0.02 * joints
    open_hand[1:, 1] = 0.04 - 0.02 * fingers
    bend = np.zeros_like(open_hand)
    bend[1:, 2] = 0.01 * joints
    phase = np.sin(2 * times + seed)[:, None, None]
    return {"times": times, "landmarks": open_hand + phase * bend}


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        subprocess.run(["pipeline", "new", "lab"], cwd=folder.name, check=True, capture_output=True)
        cls.lab = Path(folder.name) / "lab"
        np.savez(cls.lab / "landmarks.npz", **recording(0))
        (cls.lab / "recordings").mkdir()
        for seed in range(3):
            np.savez(cls.lab / "recordings" / f"{seed}.npz", **recording(seed))

    def test_every_example_runs_and_prints_a_line(self):
        self.assertGreaterEqual(len(EXAMPLES), 3)
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        os.chdir(self.lab)
        for example in EXAMPLES:
            said = io.StringIO()
            with self.subTest(example), contextlib.redirect_stdout(said):
                exec(compile(example, "README.md", "exec"), {"__name__": "__main__"})
            self.assertRegex(said.getvalue(), r"\d+ mm")

    def test_every_example_has_the_types_of_the_stubs(self):
        for idx, example in enumerate(EXAMPLES):
            (self.lab / f"example_{idx}.py").write_text(example)
        mypy = [sys.executable, "-m", "mypy", "--strict"]
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
