"""Follows a recorded hand by every configuration file that dex-retargeting ships, with `pipeline` and the library.

    python tests/benches/retargeting/dex_retargeting_files.py CONFIGS URDFS LANDMARKS

CONFIGS is the library's folder `src/dex_retargeting/configs`, URDFS the folder `robots/hands` of dex-urdf, LANDMARKS a
recording `(n, 21, 3)` of a right hand in meters, along the wrist's axes; left hands follow its mirror image.

Both follow the whole recording, each from its own answer before. The library's objective judges both: its loss, as it
computes it, and the squared motion that it weighs in its gradient. The library widens limits by 1e-3, so that there are
two comparisons: on the same wider limits (`limit_slack=1e-3`), and within the URDF's, to which every joint of the
library's answers is moved.
"""

import sys
from pathlib import Path

import library
import numpy as np

import pipeline

configs, urdfs, landmarks = sys.argv[1:4]
SLACK = 1e-3  # of the library's limits, in radians or meters
SINGLE = 1e-6  # relative difference within which objectives are equal: the library works in single precision
right = np.load(landmarks).astype(np.float32).astype(float)
left = right * [1.0, -1.0, 1.0]


def theirs(retargeting, limits, frames):
    """Mean objectives of the library's answers, and of those answers within limits."""
    optimizer = retargeting.optimizer
    n_root = len(retargeting.joint_limits) - limits.shape[1]
    values, inside = [], []
    for frame in frames:
        wanted = library.reference(optimizer, frame)
        lower, upper = retargeting.joint_limits.T
        before = np.clip(retargeting.last_qpos, lower, upper)
        retargeting.retarget(wanted)
        x = retargeting.last_qpos.astype(float)
        values.append(library.objective(optimizer, wanted, x, before))
        x[n_root:] = np.clip(x[n_root:], *limits)
        inside.append(library.objective(optimizer, wanted, x, before))
    return np.mean(values), np.mean(inside)


def ours(hand, optimizer, frames):
    before, values = hand.start(), []
    for frame in frames:
        q, palm, _ = hand.hand.step(frame)
        x = hand.coordinates(q, palm, before)
        wanted = library.reference(optimizer, frame)
        values.append(library.objective(optimizer, wanted, x, before))
        before = x
    return np.mean(values)


print("| file | dex-retargeting | `pipeline` | ratio | within limits: dex-retargeting | `pipeline` | ratio |")
print("| --- | --- | --- | --- | --- | --- | --- |")
loaded, no_higher = 0, np.zeros(2, int)
paths = sorted(Path(configs).glob("*/*.yml"))
for path in paths:
    frames = left if "left" in path.name else right
    name = f"{path.parent.name}/{path.stem}"
    retargeting = library.load(path, urdfs)
    optimizer = retargeting.optimizer
    try:
        wide, strict = [library.Ours(path, urdfs, optimizer, slack) for slack in (SLACK, 0.0)]
    except pipeline.Error as err:
        print(f"| {name} | refused: {err} |")
        continue
    loaded += 1
    peers = theirs(retargeting, strict.limits, frames)
    found = [ours(hand, library.load(path, urdfs).optimizer, frames) for hand in (wide, strict)]
    no_higher += np.less_equal(found, np.multiply(peers, 1.0 + SINGLE))
    pairs = [f"{peer:.6f} | {one:.6f} | {one / peer:.4f}" for peer, one in zip(peers, found)]
    print(f"| {name} | {' | '.join(pairs)} |", flush=True)
print(f"\n{loaded} of {len(paths)} load; {no_higher[0]} have an objective no higher than the library's on its", end=" ")
print(f"limits, {no_higher[1]} within those of the URDF")
