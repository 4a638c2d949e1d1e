"""Retargets frames with dex_retargeting, chunk by chunk, as stdin asks.

The first line is one JSON object: the URDF and the links that follow. Each later line is a list of
frames, each a list of points, one per link. The answer to each is one JSON object: the thread
CPU time of each frame in seconds, and its coordinates.
"""

import json
import os
import sys
import time

# Whatever the libraries print must not end up among the answers.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import numpy
import torch
from dex_retargeting.retargeting_config import RetargetingConfig

torch.set_num_threads(1)
problem = json.loads(sys.stdin.readline())
retargeting = RetargetingConfig(
    type="position",
    urdf_path=problem["urdf"],
    add_dummy_free_joint=True,
    target_link_names=problem["links"],
    target_link_human_indices=numpy.arange(len(problem["links"])),
    low_pass_alpha=1,
).build()


def answer(value):
    answers.write(json.dumps(value) + "\n")
    answers.flush()


answer({"joints": retargeting.joint_names})
for line in sys.stdin:
    seconds, coordinates = [], []
    for frame in json.loads(line):
        frame = numpy.array(frame)
        started = time.thread_time()
        found = retargeting.retarget(frame)
        seconds.append(time.thread_time() - started)
        coordinates.append(found.tolist())
    answer({"seconds": seconds, "coordinates": coordinates})
