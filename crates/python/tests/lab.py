"""A project that the wheel made, in which the small main job has run: one for all tests."""

import atexit
import contextlib
import functools
import re
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

# What makes the whole job small.
SMALL = """
extends = "full.toml"

[stages.train]
network.points = 64
training.epochs = 20

[stages.sample]
per_object = 16

[stages.screen]
robustness.trials = 2
pose_errors_per_object = 1
"""


def run(*words: str, cwd: Path, program: str = "pipeline") -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *words], cwd=cwd, capture_output=True, text=True)


class Interrupted(Exception):
    """What the handler of a signal raises."""


@contextlib.contextmanager
def interrupting(after: float) -> Iterator[None]:
    """Raises `Interrupted` in what runs so many seconds later, as Ctrl-C would."""

    def handle(*_):
        raise Interrupted

    before = signal.signal(signal.SIGALRM, handle)
    signal.setitimer(signal.ITIMER_REAL, after)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def setting(values: list[str]) -> list[str]:
    return [word for value in values for word in ("--set", value)]


@functools.cache
def new() -> Path:
    """A new project of one recording for each object, in which nothing has run."""
    folder = tempfile.TemporaryDirectory()
    atexit.register(folder.cleanup)
    made = run("new", "lab", cwd=Path(folder.name))
    assert made.returncode == 0, made.stderr
    project = Path(folder.name) / "lab"
    recipe = project / "data/sample/recipe.toml"
    text = re.sub(r"sequences_per_object = .*", "sequences_per_object = 1", recipe.read_text())
    recipe.write_text(re.sub(r"subjects = .*", "subjects = 2", text))
    pipelines = project / "pipelines"
    (pipelines / "cgf.toml").rename(pipelines / "full.toml")
    (pipelines / "cgf.toml").write_text(SMALL)
    return project


@functools.cache
def done() -> Path:
    """The project with the lake of its main job."""
    project = new()
    ran = run("run", "pipelines/cgf.toml", cwd=project)
    assert ran.returncode == 0, ran.stderr
    assert "done" in ran.stderr, ran.stderr
    return project


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
