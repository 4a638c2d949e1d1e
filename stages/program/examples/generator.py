"""Samples grasps in a simple way, as a program for `kind = "program"`: a hand that comes straight from the side or from
above and wraps its fingers around the middle of the object. Nothing is learned, nothing is optimized.

Reads `objects`; makes `candidates` of the Allegro hand, `options.draws` for each object.
"""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

# Palm frame of the hand: x out of the palm, z to the fingertips, y to the thumb. Joints 0 to 15: index, middle,
# ring, thumb; of each finger the first spreads and the others flex.
JOINTS = [f"joint_{number}.0" for number in range(16)]
FLEXING = [1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15]
# The grasped part lies before the palm, this far from its origin towards the fingertips; the palm is a box.
REACH_M, HALF_PALM_M, FINGERS_M = 0.0275, 0.0565, 0.12
# A motion: so many steps of so many seconds, the last quarter of which closes the fingers.
STEPS, STEP_S, CLOSING = 41, 0.02, 0.75
APPROACH_M, OPEN_RAD = 0.15, 0.4


def turn_to_z(up):
    """The shortest turn that takes a direction to +z, as a quaternion with w last."""
    axis = np.cross(up, [0, 0, 1])
    if np.linalg.norm(axis) < 1e-9:
        return np.array([0, 0, 0, 1.0]) if up[2] > 0 else np.array([1.0, 0, 0, 0])
    half = np.arctan2(np.linalg.norm(axis), up[2]) / 2
    return np.array([*(np.sin(half) * axis / np.linalg.norm(axis)), np.cos(half)])


def matrix(q):
    x, y, z, w = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def quaternion(m):
    """Of a rotation matrix, w last and not negative, from the best of four conditioned forms."""
    four = 1 + np.array([m[0, 0] - m[1, 1] - m[2, 2], m[1, 1] - m[0, 0] - m[2, 2], m[2, 2] - m[0, 0] - m[1, 1],
                         m[0, 0] + m[1, 1] + m[2, 2]])
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    q = np.array([[four[0], d, e, a], [d, four[1], f, b], [e, f, four[2], c], [a, b, c, four[3]]][np.argmax(four)])
    q /= np.linalg.norm(q)
    return q if q[3] >= 0 else -q


def drawn(rng, row):
    """One motion: how the object lies, palm poses in the object's frame, and joint positions, step by step."""
    shares = np.array(row["rest_probability"]) + 1e-9
    rest = rng.choice(len(shares), p=shares / shares.sum())
    turn = turn_to_z(np.array(row["rest_up"][rest]))
    place = np.array([0, 0, row["rest_height_m"][rest]])
    table_from_object = matrix(turn)
    points = np.array(row["points_m"]) @ table_from_object.T + place
    middle, top = (points.min(axis=0) + points.max(axis=0)) / 2, points[:, 2].max()
    up = np.array([0, 0, 1.0])
    angle = rng.uniform(0, 2 * np.pi)
    level = np.array([np.cos(angle), np.sin(angle), 0])
    if top > 2 * HALF_PALM_M and rng.random() < 0.7:
        normal, thumb = level, up
        middle[2] = max(middle[2], HALF_PALM_M + 0.01) + rng.uniform(0, 0.02)
    else:
        normal, thumb = -up, level
    fingers = np.cross(normal, thumb)
    gap_m = rng.uniform(0.014, 0.028)
    surface_m = ((points - middle) @ -normal).max()
    palm = middle - normal * (surface_m + gap_m) - fingers * (REACH_M + rng.uniform(-0.015, 0.015))
    if normal[2] < 0:
        # Curled fingers reach this far below the palm, and the table is there.
        palm[2] = max(palm[2], FINGERS_M + rng.uniform(0, 0.02))
    closed = np.zeros(16)
    closed[FLEXING[:9]] = np.tile(rng.uniform([0.5, 0.7, 0.5], [1.0, 1.2, 0.9]), 3)
    closed[12], closed[13], closed[FLEXING[9:]] = 1.3, rng.uniform(0.2, 0.8), rng.uniform(0.3, 0.9, 2)
    # The thumb waits where it will press: opened, it would hang into the table.
    opened = closed.copy()
    opened[FLEXING[:9]] = np.maximum(closed[FLEXING[:9]] - OPEN_RAD, 0)
    shares = np.linspace(0, 1, STEPS)
    smooth = lambda s: s * s * (3 - 2 * s)
    arriving = smooth(np.clip(shares / CLOSING, 0, 1))[:, None]
    closing = smooth(np.clip((shares - CLOSING) / (1 - CLOSING), 0, 1))[:, None]
    palms = palm - normal * APPROACH_M * (1 - arriving)
    object_from_table = table_from_object.T
    in_object = (palms - place) @ table_from_object
    palm_turn = quaternion(object_from_table @ np.stack([normal, thumb, fingers], axis=1))
    poses = np.concatenate([in_object, np.tile(palm_turn, (STEPS, 1))], axis=1)
    return np.concatenate([place, turn]), poses, opened + closing * (closed - opened)


def rates(course):
    """Velocities and accelerations of a course of steps."""
    velocity = np.gradient(course, STEP_S, axis=0)
    return velocity, np.gradient(velocity, STEP_S, axis=0)


def main():
    with open("job.json") as file:
        job = json.load(file)
    rng = np.random.default_rng(job["seed"])
    (part,) = job["inputs"]["objects"]
    (row,) = pq.read_table(part["files"]["part.parquet"]).to_pylist()
    rows = []
    for number in range(job["options"]["draws"]):
        table_from_object, poses, q = drawn(rng, row)
        palm_rates = [np.concatenate([of, np.zeros((STEPS, 3))], axis=1) for of in rates(poses[:, :3])]
        joint_rates = rates(q)
        rows.append({
            "candidate_id": f"{part['partition']}-{number:04}", "generator": "straight", "draw_n": 1,
            "origin": "prior", "demonstration": "", "object_split": "", "depth_m": None,
            "residual_m2": None, "latent": [], "table_from_object": table_from_object.tolist(),
            "limit_excess_rad": 0.0, "time_s": (STEP_S * np.arange(STEPS)).tolist(),
            "object_from_palm": poses.tolist(), "q_rad": q.ravel().tolist(),
            "q_velocity_rad_per_s": joint_rates[0].ravel().tolist(),
            "q_acceleration_rad_per_s2": joint_rates[1].ravel().tolist(),
            "palm_velocity": palm_rates[0].tolist(), "palm_acceleration": palm_rates[1].tolist(),
        })
    columns = pq.read_schema(job["output"]["template"])
    columns = columns.with_metadata({**columns.metadata, b"joints": ",".join(JOINTS).encode()})
    pq.write_table(pa.Table.from_pylist(rows, schema=columns), job["output"]["table"])


if __name__ == "__main__":
    main()
