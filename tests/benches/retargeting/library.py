"""dex-retargeting as the judge: its reference values, its objective, and hands of `pipeline` in its coordinates."""

import contextlib
import os
import re
import tempfile
from pathlib import Path

import numpy as np
import torch
from dex_retargeting.retargeting_config import RetargetingConfig

import pipeline

torch.set_num_threads(1)
NONE = np.array([])


def load(path, urdfs):
    """The library by a file, with its filter off: that is in no objective."""
    RetargetingConfig.set_default_urdf_dir(str(urdfs))
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        with contextlib.redirect_stderr(nowhere):
            return RetargetingConfig.load_from_file(path, override={"low_pass_alpha": 1}).build()


def reference(optimizer, frame):
    indices = optimizer.target_link_human_indices
    if optimizer.retargeting_type == "POSITION":
        return frame[indices].astype(np.float32)
    return (frame[indices[1]] - frame[indices[0]]).astype(np.float32)


def objective(optimizer, wanted, x, before):
    """The library's loss at `x`, and what its gradient adds for motion."""
    loss = optimizer.get_objective_function(wanted, NONE, before)(x, NONE)
    return loss + optimizer.norm_delta * np.sum((x - before) ** 2)


def without_filter(path, load):
    """What `load` makes of the file with its filter off."""
    text = re.sub(r"low_pass_alpha: .*", "low_pass_alpha: 1", Path(path).read_text())
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / Path(path).name
        plain.write_text(text)
        return load(plain)


class Ours:
    """A hand of `pipeline` in the coordinates of the library's optimizer."""

    def __init__(self, path, urdfs, optimizer, slack=0.0):
        pipeline.Retargeter(path, urdf_folder=urdfs)  # unchanged
        self.hand = without_filter(
            path, lambda plain: pipeline.Retargeter(plain, urdf_folder=urdfs, limit_slack=slack)
        )
        names = optimizer.target_joint_names
        self.has_root = names[0].startswith("dummy")
        self.order = [
            self.hand.joint_names.index(name) for name in names if not name.startswith("dummy")
        ]
        self.limits = np.array([self.hand.lower[self.order], self.hand.upper[self.order]])

    def start(self):
        middle = 0.5 * (self.hand.lower + self.hand.upper)[self.order]
        return np.concatenate([np.zeros(6), middle]) if self.has_root else middle

    def coordinates(self, q, palm, before):
        """Joint positions, and the root's six: of its angles, those nearest to the frame before."""
        if not self.has_root:
            return q[self.order]
        turn = palm[:3, :3]
        middle = np.arcsin(np.clip(turn[0, 2], -1.0, 1.0))
        first = np.arctan2(-turn[1, 2], turn[2, 2])
        last = np.arctan2(-turn[0, 1], turn[0, 0])
        both = np.array([[first, middle, last], [first + np.pi, np.pi - middle, last + np.pi]])
        both += 2 * np.pi * np.round((before[3:6] - both) / (2 * np.pi))
        nearest = np.argmin(np.sum((both - before[3:6]) ** 2, axis=1))
        return np.array([*palm[:3, 3], *both[nearest], *q[self.order]])
