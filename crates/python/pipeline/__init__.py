"""Robot hands that learn grasping from people: retargeting, grasping functions, physics, and the program `pipeline`.

Arrays are numpy's, of float64; lengths are in meters, angles in radians, masses in kilograms.
"""

import os as _os

from pipeline._pipeline import (
    Candidates,
    Error,
    Function,
    Hand,
    Lake,
    Motion,
    Object,
    Plan,
    Recording,
    Retargeter,
    Robot,
    Rollout,
    Rollouts,
    Table,
    __version__,
    options,
    save_recording,
)
from pipeline._pipeline import after_fork as _after_fork

__all__ = [
    "Candidates",
    "Error",
    "Function",
    "Hand",
    "Lake",
    "Motion",
    "Object",
    "Plan",
    "Recording",
    "Retargeter",
    "Robot",
    "Rollout",
    "Rollouts",
    "Table",
    "__version__",
    "options",
    "save_recording",
]

# Of one that a program raises itself.
Error.hint = None

if hasattr(_os, "register_at_fork"):
    _os.register_at_fork(after_in_child=_after_fork)
