"""Robot hands that learn grasping from people: kinematics, retargeting, lakes, and the program `pipeline`.

Arrays are numpy's, of float64; lengths are in meters, angles in radians, masses in kilograms.
"""

import os as _os

from pipeline._pipeline import Error, Lake, Motion, Retargeter, Robot, Table, __version__
from pipeline._pipeline import after_fork as _after_fork

__all__ = ["Error", "Lake", "Motion", "Retargeter", "Robot", "Table", "__version__"]

# Of one that a program raises itself.
Error.hint = None

if hasattr(_os, "register_at_fork"):
    _os.register_at_fork(after_in_child=_after_fork)
