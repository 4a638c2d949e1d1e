"""Times one frame a call from Python: `pipeline`, dexi-rs and dex-retargeting by the same files, in turns.

    python tests/benches/retargeting/live.py CONFIGS URDFS LANDMARKS

The arguments are those of `dex_retargeting_files.py`. Each follows the whole recording of a right hand, a chunk of
frames at a time, before it is the next one's turn; times are wall time of a call on one thread. The library's objective
judges all, each from its own answer before; `converged` is the least objective that SLSQP finds from our answer.
"""

import sys
import time
from pathlib import Path

import dexi_rs
import library
import nlopt
import numpy as np
import yaml

import pipeline

configs, urdfs, landmarks = sys.argv[1:4]
FRAMES = np.load(landmarks).astype(np.float32).astype(float)
HANDS = ["allegro_hand_right", "leap_hand_right", "shadow_hand_right"]
FILES = [f"offline/{hand}" for hand in HANDS]
FILES += [f"teleop/{hand}{kind}" for kind in ("", "_dexpilot") for hand in HANDS]
CHUNK = 27


def timed(call, arguments):
    answers, us = [], []
    for argument in arguments:
        started = time.perf_counter_ns()
        answer = call(argument)
        us.append(1e-3 * (time.perf_counter_ns() - started))
        answers.append(answer)
    return answers, us


def dexi(path):
    config = yaml.safe_load(Path(path).read_text())["retargeting"]
    return dexi_rs.load_config({**config, "urdf_dir": urdfs, "low_pass_alpha": 1}).build()


def converged(optimizer, wanted, x, before, limits):
    """The least objective near an answer, within limits."""
    loss = optimizer.get_objective_function(wanted, library.NONE, before.astype(np.float32))

    def whole(x, gradient):
        value = loss(x, gradient)
        return value + optimizer.norm_delta * np.sum((x - before) ** 2)

    search = nlopt.opt(nlopt.LD_SLSQP, len(x))
    free = len(x) - limits.shape[1]
    search.set_lower_bounds([-10.0] * free + limits[0].tolist())
    search.set_upper_bounds([10.0] * free + limits[1].tolist())
    search.set_min_objective(whole)
    search.set_xtol_rel(1e-9)
    search.set_maxeval(500)
    at = whole(x, library.NONE)
    try:
        return min(at, whole(search.optimize(x), library.NONE))
    except RuntimeError:
        return at


def race(path):
    retargeting = library.load(path, urdfs)
    optimizer = retargeting.optimizer
    names = optimizer.target_joint_names
    hand = library.Ours(path, urdfs, optimizer)
    other = dexi(path)
    order = [other.joint_names.index(name) for name in names]
    wanted = [library.reference(optimizer, frame) for frame in FRAMES]
    lists = [one.astype(float).ravel().tolist() for one in wanted]
    us, answers = ([], [], []), ([], [], [])
    for start in range(0, len(FRAMES), CHUNK):
        chunk = slice(start, start + CHUNK)
        for lane, (call, arguments) in enumerate(
            [(hand.hand.step, FRAMES[chunk]), (other.retarget, lists[chunk]), (retargeting.retarget, wanted[chunk])]
        ):
            found, times = timed(call, list(arguments))
            us[lane].extend(times)
            answers[lane].extend(found)
    ours = []
    for q, palm, _ in answers[0]:
        ours.append(hand.coordinates(q, palm, ours[-1] if ours else hand.start()))
    theirs = [np.asarray(q)[[retargeting.joint_names.index(name) for name in names]] for q in answers[2]]
    lanes = [ours, [np.asarray(q)[order] for q in answers[1]], theirs]
    judge = library.load(path, urdfs).optimizer
    values, least = np.zeros((3, len(FRAMES))), []
    befores = [hand.start()] * 3
    for idx, one in enumerate(wanted):
        for lane, found in enumerate(lanes):
            values[lane, idx] = library.objective(judge, one, found[idx].astype(float), befores[lane])
        least.append(converged(judge, one, ours[idx], befores[0], hand.limits))
        befores = [found[idx].astype(float) for found in lanes]
    return [np.median(times) for times in us], values.mean(axis=1), np.mean(least)


def alone(path):
    """Microseconds of a frame: the median of a loop of steps, and the mean of a batch call, with velocities."""
    hand = pipeline.Retargeter(path, urdf_folder=urdfs)
    seconds = np.arange(len(FRAMES)) / 30.0
    steps, batches = [], []
    for _ in range(20):
        hand.reset()
        steps.extend(timed(hand.step, list(FRAMES))[1])
        started = time.perf_counter_ns()
        hand.retarget(seconds, FRAMES)
        batches.append(1e-3 * (time.perf_counter_ns() - started) / len(FRAMES))
    return np.median(steps), min(batches)


COLUMNS = ["file", "us: `pipeline`", "dexi-rs", "dex-retargeting", "times", "times", "F: `pipeline`", "converged"]
print(f"| {' | '.join([*COLUMNS, 'dexi-rs', 'dex-retargeting'])} |")
print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
for name in FILES:
    path = Path(configs) / f"{name}.yml"
    us, values, least = race(path)
    faster = f"{us[1] / us[0]:.0f} | {us[2] / us[0]:.0f}"
    costs = f"{values[0]:.6f} | {least:.6f} | {values[1]:.6f} | {values[2]:.6f}"
    print(f"| {name} | {us[0]:.1f} | {us[1]:.0f} | {us[2]:.0f} | {faster} | {costs} |", flush=True)
step, batch = alone(Path(configs) / f"{FILES[0]}.yml")
print(f"\nalone, {FILES[0]}: {step:.1f} us a step (median), {batch:.1f} us a frame of a batch call (least mean)")
