"""How smooth a motion is, by the definitions of `schemas/src/smoothness.rs`."""

import numpy as np

STANDING = 1e-6
ORDERS = ("position", "velocity", "acceleration")


def variation(course, step_time):
    """Total variation of a course (step, channel) and of its rates over its net motion; nothing if it has none."""
    net = np.linalg.norm(course[-1] - course[0])
    if not net > STANDING:
        return None
    found = []
    for _ in ORDERS:
        found.append(np.linalg.norm(np.diff(course, axis=0), axis=1).sum() / net)
        course = np.gradient(course, step_time, axis=0)
    return np.array(found)


def of_channels(course, step_time):
    """The mean over the channels that move."""
    moving = [variation(course[:, [channel]], step_time) for channel in range(course.shape[1])]
    moving = [one for one in moving if one is not None]
    return sum(moving) / len(moving) if moving else np.zeros(3)


def of_vector(course, step_time):
    """That of all channels as one vector."""
    found = variation(course, step_time)
    return np.zeros(3) if found is None else found


def misread(palm):
    """Poses whose angles about their own x, y and z are taken for a rotation vector, as the released code does."""
    x, y, z, w = palm[:, 3:].T
    r02, r12 = 2 * (x * z + y * w), 2 * (y * z - x * w)
    r22, r01, r00 = 1 - 2 * (x * x + y * y), 2 * (x * y - z * w), 1 - 2 * (y * y + z * z)
    vector = np.stack([np.arctan2(-r12, r22), np.arcsin(np.clip(r02, -1, 1)), np.arctan2(-r01, r00)], axis=1)
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    axis = np.divide(vector, angle, out=np.zeros_like(vector), where=angle > 0)
    return np.concatenate([palm[:, :3], axis * np.sin(angle / 2), np.cos(angle / 2)], axis=1)


def columns(motion, origins):
    """The 18 columns; `origins(palm, q)` are the coordinates of all links' origins, the root's first."""
    n = len(motion.time_s)
    own, released = 1 / max(n - 1, 1), 1 / n
    course = lambda palms: np.array([origins(palm, q) for palm, q in zip(palms, motion.q)])
    links, wrong = course(motion.palm), course(misread(motion.palm))
    found = {
        ("paper", "joints"): of_channels(motion.q, own),
        ("paper", "cartesian"): of_channels(links, own),
        ("released", "joints"): of_channels(np.concatenate([motion.palm[:, :3], motion.q], axis=1), released),
        ("released", "cartesian"): of_channels(np.concatenate([wrong, wrong[:, :3]], axis=1), released),
        ("robust", "joints"): of_vector(motion.q, own),
        ("robust", "cartesian"): of_vector(links, own),
    }
    # A motion that ends where it began has no measure.
    return {f"{how}_{space}_{order}": float(number) if three[0] > 0 else None for (how, space), three in found.items()
            for order, number in zip(ORDERS, three)}
