"""Writes drawn measurements, and what other implementations find in them.

    python3 -m venv venv && venv/bin/pip install opencv-python-headless==4.14.0.94 scipy==1.17.1
    venv/bin/python crates/robotics/calibration/tests/golden/make.py

`fixed.json`, `wrist.json` and `points.json` are files that the program reads: 12 poses of a board, on the flange and
beside the robot, and 12 touched points, with noise of 1 mm and 0.2 degrees (standard deviations, per axis).

`golden.json` has for each file the true pose of the camera and, as the rows of a 4x4 matrix one after the other:
  opencv_park, opencv_tsai  `cv2.calibrateHandEye` with CALIB_HAND_EYE_PARK and CALIB_HAND_EYE_TSAI
  scipy                     `scipy.optimize.least_squares` on the differences between the board's measured and predicted
                            poses, 0.2 degrees counted as 1 mm; of points `scipy.spatial.transform.Rotation.align_vectors`
and the residuals at scipy's minimum.
"""

import json
import os

import cv2
import numpy as np
import scipy
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

HERE = os.path.dirname(os.path.abspath(__file__))
SEED = 7
N = 12
NOISE_M = 0.001
NOISE_RAD = np.radians(0.2)
METERS_PER_RADIAN = 0.001 / np.radians(0.2)

rng = np.random.default_rng(SEED)


def matrix(position, rotation):
    pose = np.eye(4)
    pose[:3, :3] = rotation.as_matrix()
    pose[:3, 3] = position
    return pose


def noisy(pose):
    turn = Rotation.from_rotvec(rng.normal(0.0, NOISE_RAD, 3))
    moved = pose[:3, 3] + rng.normal(0.0, NOISE_M, 3)
    return matrix(moved, Rotation.from_matrix(pose[:3, :3]) * turn)


def fields(pose):
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return {
        "position_m": [round(float(x), 9) for x in pose[:3, 3]],
        "quaternion_xyzw": [round(float(x), 12) for x in quaternion],
    }


def read(pose):
    return matrix(pose["position_m"], Rotation.from_quat(pose["quaternion_xyzw"]))


def write(name, value):
    with open(os.path.join(HERE, name), "w") as file:
        json.dump(value, file, indent=1)
        file.write("\n")


def flange():
    """A pose of the flange above a table, pointing down, tilted by up to 40 degrees."""
    position = rng.uniform([0.3, -0.2, 0.3], [0.6, 0.2, 0.6])
    tilt = Rotation.from_rotvec(rng.uniform(-np.radians(40.0), np.radians(40.0), 3))
    return matrix(position, Rotation.from_rotvec([np.pi, 0.0, 0.0]) * tilt)


def tuples(poses):
    return [pose[:3, :3] for pose in poses], [pose[:3, 3] for pose in poses]


def opencv(robot, board, method):
    rotation, offset = cv2.calibrateHandEye(*tuples(robot), *tuples(board), method=method)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, offset[:, 0]
    return pose


def gaps(robot, board, x, y):
    """Offsets and rotation vectors between the board by the camera and by the other poses."""
    for a, b in zip(robot, board):
        seen = a @ x @ b
        turn = Rotation.from_matrix(y[:3, :3].T @ seen[:3, :3]).as_rotvec()
        yield seen[:3, 3] - y[:3, 3], turn


def minimum(robot, board, start):
    def poses(numbers):
        return [matrix(part[:3], Rotation.from_rotvec(part[3:])) for part in (numbers[:6], numbers[6:])]

    def residuals(numbers):
        parts = [np.concatenate([o, t * METERS_PER_RADIAN]) for o, t in gaps(robot, board, *poses(numbers))]
        return np.concatenate(parts)

    def vector(pose):
        return np.concatenate([pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_rotvec()])

    first = np.concatenate([vector(start), vector(robot[0] @ start @ board[0])])
    found = least_squares(residuals, first, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
    return poses(found.x)


def flat(pose):
    return [float(x) for x in pose.ravel()]


def hand_eye(camera, true_x, true_y):
    entries = []
    for _ in range(N):
        base_from_flange = flange()
        a = np.linalg.inv(base_from_flange) if camera == "fixed" else base_from_flange
        camera_from_board = noisy(np.linalg.inv(a @ true_x) @ true_y)
        entries.append({"base_from_flange": fields(base_from_flange), "camera_from_board": fields(camera_from_board)})
    write(f"{camera}.json", {"camera": camera, "poses": entries})
    robot = [read(entry["base_from_flange"]) for entry in entries]
    robot = [np.linalg.inv(pose) for pose in robot] if camera == "fixed" else robot
    board = [read(entry["camera_from_board"]) for entry in entries]
    park = opencv(robot, board, cv2.CALIB_HAND_EYE_PARK)
    x, y = minimum(robot, board, park)
    rest = list(gaps(robot, board, x, y))
    return {
        "true": flat(true_x),
        "opencv_park": flat(park),
        "opencv_tsai": flat(opencv(robot, board, cv2.CALIB_HAND_EYE_TSAI)),
        "scipy": flat(x),
        "scipy_board": flat(y),
        "offsets_m": [float(np.linalg.norm(offset)) for offset, _ in rest],
        "rotations_rad": [float(np.linalg.norm(turn)) for _, turn in rest],
    }


def points(true_x):
    entries = []
    for _ in range(N):
        in_base = rng.uniform([0.3, -0.3, 0.0], [0.7, 0.3, 0.25])
        in_camera = (np.linalg.inv(true_x) @ np.append(in_base, 1.0))[:3] + rng.normal(0.0, NOISE_M, 3)
        entries.append({
            "in_base_m": [round(float(x), 9) for x in in_base],
            "in_camera_m": [round(float(x), 9) for x in in_camera],
        })
    write("points.json", {"points": entries})
    base = np.array([entry["in_base_m"] for entry in entries])
    camera = np.array([entry["in_camera_m"] for entry in entries])
    rotation, _ = Rotation.align_vectors(base - base.mean(0), camera - camera.mean(0))
    offset = base.mean(0) - rotation.apply(camera.mean(0))
    rest = base - rotation.apply(camera) - offset
    return {
        "true": flat(true_x),
        "scipy": flat(matrix(offset, rotation)),
        "offsets_m": [float(x) for x in np.linalg.norm(rest, axis=1)],
    }


def main():
    # A camera above a table that looks at the robot, and one on the flange.
    fixed = matrix([1.1, 0.1, 0.8], Rotation.from_euler("ZYX", [95.0, 3.0, -140.0], degrees=True))
    wrist = matrix([0.06, -0.02, 0.05], Rotation.from_euler("ZYX", [88.0, -4.0, 3.0], degrees=True))
    on_flange = matrix([0.0, 0.03, 0.08], Rotation.from_rotvec([0.1, -0.2, 0.4]))
    still = matrix([0.5, 0.0, 0.01], Rotation.from_rotvec([0.0, 0.0, 0.7]))
    golden = {
        "versions": {"opencv": cv2.__version__, "scipy": scipy.__version__, "numpy": np.__version__},
        "fixed": hand_eye("fixed", fixed, on_flange),
        "wrist": hand_eye("wrist", wrist, still),
        "points": points(fixed),
    }
    write("golden.json", golden)


main()
