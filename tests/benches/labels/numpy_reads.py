"""Prints how many microseconds numpy takes to read the landmarks and poses of a label file.

The files' paths come on stdin, as one line of JSON.
"""

import json
import sys
import time

import numpy

paths = json.loads(sys.stdin.readline())


def read(path):
    with numpy.load(path) as arrays:
        return arrays["joint_3d"], arrays["pose_y"]


started = time.perf_counter()
for path in paths:
    read(path)
print((time.perf_counter() - started) / len(paths) * 1e6)
