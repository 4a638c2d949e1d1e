"""Retargets a recording in one call at each line of input, and answers with its seconds."""

import json
import sys
import time

import numpy as np

import pipeline

about = json.loads(sys.stdin.readline())
hand = pipeline.Retargeter(about["hand"], urdf_folder=about["urdfs"])
landmarks = np.load(about["landmarks"])
seconds = np.arange(len(landmarks)) / 30.0
print("ready", flush=True)
for _ in sys.stdin:
    started = time.perf_counter()
    hand.retarget(seconds, landmarks)
    print(time.perf_counter() - started, flush=True)
