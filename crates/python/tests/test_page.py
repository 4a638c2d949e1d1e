"""The page's examples run as they are printed, in a project that the wheel made."""

import contextlib
import io
import os
import re
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

import lab
from lab import recording

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

    def test_every_example_runs_and_prints_a_line(self):
        self.assertGreaterEqual(len(EXAMPLES), 3)
        before = os.getcwd()
        self.addCleanup(os.chdir, before)
        os.chdir(self.lab)
        for example in EXAMPLES:
            said = io.StringIO()
            with self.subTest(example), contextlib.redirect_stdout(said):
                exec(compile(example, "README.md", "exec"), {"__name__": "__main__"})
            self.assertRegex(said.getvalue(), r"\d+ (mm|%)")

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
