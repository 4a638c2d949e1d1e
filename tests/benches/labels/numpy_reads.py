"""Prints how many microseconds numpy takes to read the landmarks and poses of a label file.

The files' paths come on stdin, one on each line. Every file is read three times; the fastest counts.
"""

import sys
import time

import numpy

paths = sys.stdin.read().splitlines()


def read(path):
    with numpy.load(path) as arrays:
        return arrays["joint_3d"], arrays["pose_y"]


def seconds():
    started = time.perf_counter()
    for path in paths:
        read(path)
    return time.perf_counter() - started


print(min(seconds() for _ in range(3)) / len(paths) * 1e6)
