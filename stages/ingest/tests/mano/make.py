"""Makes `models.zip` and `golden.json`: hand models of MANO's form with made-up numbers.

Run once, with `numpy` and `scipy`: `python make.py`. Nothing here comes from the licensed files:
every number is a small closed form, exact in single precision so that every way to store it is
the same model. The landmarks in `golden.json` are computed by the plainest reading of Loper et
al., "SMPL", 2015: all 778 vertices, homogeneous matrices, loops, rotations by the matrix
exponential.
"""

import io
import json
import pickle
import struct
import sys
import types
import zipfile
from pathlib import Path

import numpy as np
import scipy
from scipy.linalg import expm

HERE = Path(__file__).parent
PARENTS = [-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14]
RIGHT_TIPS = [745, 317, 444, 556, 673]
LEFT_TIPS = [745, 317, 445, 556, 673]
ORDER = [0, 13, 14, 15, 16, 1, 2, 3, 17, 4, 5, 6, 18, 10, 11, 12, 19, 7, 8, 9, 20]
UNIT = 2.0**-13  # About 0.12 mm.

# Right hand, palm toward -z, in units of 2^-13 m: the wrist, then index, middle, little, ring
# finger and thumb.
JOINTS = np.array(
    [
        [48, -16, 32],
        [800, 208, 32], [1136, 240, 32], [1328, 256, 32],
        [800, 32, 48], [1168, 32, 48], [1392, 32, 48],
        [672, -288, 0], [944, -352, 0], [1088, -384, 0],
        [736, -144, 32], [1072, -176, 32], [1280, -192, 32],
        [272, 224, -96], [544, 432, -144], [736, 560, -176],
    ],
    dtype=float,
)
TIPS = np.array(
    [[896, 656, -208], [1472, 272, 16], [1568, 32, 32], [1440, -208, 16], [1216, -416, -16]], dtype=float
)


def wave(shape, *steps):
    """Whole numbers from -8 to 8 that repeat at different rates along the axes."""
    grid = np.indices(shape)
    return sum(int(s) * g for s, g in zip(steps, grid)) % 17 - 8.0


def model(side):
    """The dictionary of a made-up hand, as plain arrays."""
    mirror = np.array([1.0 if side == "right" else -1.0, 1.0, 1.0])
    vertices = wave((778, 3), 5, 3) * 16
    for joint, at in enumerate(JOINTS):  # Four vertices around each joint.
        for k, by in enumerate([(16, 0, 0), (-16, 0, 0), (0, 16, 8), (0, -16, -8)]):
            vertices[40 * joint + 10 * k] = at + by
    for tips in (RIGHT_TIPS, LEFT_TIPS):
        vertices[tips] = TIPS
    vertices[445 if side == "right" else 444] += 7  # The vertex that is not the tip.
    regressor = np.zeros((16, 778))
    for joint in range(16):
        regressor[joint, [40 * joint + 10 * k for k in range(4)]] = 0.25
    weights = np.zeros((778, 16))
    for vertex in range(778):
        weights[vertex, vertex % 16] += 0.625
        weights[vertex, vertex // 16 % 16] += 0.25
        weights[vertex, (vertex + 5) % 16] += 0.125
    mean = np.zeros((15, 3))
    mean[:12, 1] = [0.375, 0.625, 0.25] * 4  # Fingers point along x, the palm's side is -z.
    mean[:, 0] = 0.0625 * (np.arange(15) % 3)
    if side == "left":  # Angles mirrored in the plane x = 0.
        mean[:, 1:] *= -1
    components = np.zeros((45, 45))
    for k in range(45):
        components[k, (7 * k + 3) % 45] = 1.25 if k % 2 else -1.25
        components[k, (7 * k + 4) % 45] += 0.25
    template = vertices * UNIT * mirror
    long = np.concatenate([wave((778, 3, 10), 3, 5, 11) * 2.0**-12, wave((778, 3, 10), 1, 1, 1)], axis=2)
    return {
        "hands_components": components,
        "f": np.zeros((1538, 3), dtype=np.uint32),
        "J": regressor @ template,
        "hands_coeffs": np.zeros((1554, 45)),
        "kintree_table": np.asfortranarray(np.array([[2**32 - 1] + PARENTS[1:], list(range(16))])),
        "weights": weights,
        "posedirs": wave((778, 3, 135), 5, 7, 3) * 2.0**-12,
        "hands_mean": mean.ravel(),
        "v_template": template,
        "shapedirs": long,  # Twenty directions, of which the first ten count.
        "J_regressor": regressor,
        "bs_style": "lbs",
        "bs_type": "lrotmin",
    }


# --- landmarks ---


def rotation(axis_angle):
    x, y, z = axis_angle
    return expm(np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def landmarks(m, side, betas, pose):
    """The 21 landmarks, by the whole surface."""
    directions = m["shapedirs"][:, :, :10]
    shaped = m["v_template"] + np.einsum("vak,k->va", directions, betas)
    joints = m["J_regressor"] @ shaped
    angles = np.concatenate([pose[:3], m["hands_mean"] + pose[3:48] @ m["hands_components"]]).reshape(16, 3)
    turns = [rotation(a) for a in angles]
    feature = np.concatenate([(r - np.eye(3)).ravel() for r in turns[1:]])
    posed = shaped + m["posedirs"] @ feature
    world = []
    for j, parent in enumerate(PARENTS):
        local = np.eye(4)
        local[:3, :3] = turns[j]
        local[:3, 3] = joints[j] - (joints[parent] if parent >= 0 else 0)
        world.append(local if parent < 0 else world[parent] @ local)
    surface = np.zeros((778, 3))
    for v in range(778):
        for j in range(16):
            back = np.eye(4)
            back[:3, 3] = -joints[j]
            surface[v] += m["weights"][v, j] * (world[j] @ back @ np.append(posed[v], 1.0))[:3]
    tips = RIGHT_TIPS if side == "right" else LEFT_TIPS
    all_points = np.concatenate([[w[:3, 3] for w in world], surface[tips]])
    return all_points[ORDER] + pose[48:]


def cases():
    rng = np.random.default_rng(7)
    yield np.zeros(10), np.zeros(51)
    yield rng.normal(size=10), np.zeros(51)
    for _ in range(6):
        pose = np.concatenate([rng.normal(size=3) * 1.5, rng.normal(size=45) * 0.6, rng.normal(size=3)])
        yield rng.normal(size=10), pose


# --- pickles ---


def stub(module, name):
    """A class that only has a name and attributes."""
    kind = type(name, (object,), {})
    kind.__module__ = module
    place = sys.modules.setdefault(module, types.ModuleType(module))
    setattr(place, name, kind)
    return kind


Ch = stub("chumpy.ch", "Ch")
Select = stub("chumpy.reordering", "Select")
SparseOfPython2 = stub("scipy.sparse.csc", "csc_matrix")


class Python2Pickler(pickle._Pickler):
    """Writes protocol 2 as Python 2 did: strings are bytes with a length of one or four."""

    dispatch = pickle._Pickler.dispatch.copy()

    def save_string(self, text):
        raw = text if isinstance(text, bytes) else text.encode("ascii")
        if len(raw) < 256:
            self.write(b"U" + bytes([len(raw)]) + raw)
        else:
            self.write(b"T" + struct.pack("<i", len(raw)) + raw)
        self.memoize(text)

    def save_global(self, obj, name=None):
        module = obj.__module__.replace("numpy._core", "numpy.core").replace("builtins", "__builtin__")
        self.write(f"c{module}\n{name or obj.__name__}\n".encode())
        self.memoize(obj)

    dispatch[bytes] = save_string
    dispatch[str] = save_string
    dispatch[type] = save_global
    dispatch[types.FunctionType] = save_global
    dispatch[types.BuiltinFunctionType] = save_global


def with_state(kind, **state):
    thing = kind()
    thing.__dict__.update(state)
    return thing


def sparse_parts(matrix):
    sparse = scipy.sparse.csc_matrix(matrix)
    return {
        "_shape": matrix.shape,
        "maxprint": 50,
        "data": sparse.data,
        "indices": sparse.indices.astype(np.int32),
        "indptr": sparse.indptr.astype(np.int32),
    }


def as_published(m):
    """The dictionary as Python 2 had it: `chumpy` and `scipy` objects."""
    places = np.arange(778 * 3 * 20).reshape(778, 3, 20)[:, :, :10].ravel()
    shapedirs = with_state(
        Select,
        a=with_state(Ch, x=m["shapedirs"], _dirty_vars=set(), _itr=None),
        idxs=places,
        preferred_shape=(778, 3, 10),
    )
    sparse = with_state(SparseOfPython2, **sparse_parts(m["J_regressor"]))
    return dict(m, shapedirs=shapedirs, J_regressor=sparse)


def python2(value):
    out = io.BytesIO()
    Python2Pickler(out, protocol=2).dump(value)
    return out.getvalue()


def single(m):
    """Single precision and Fortran order; ten directions only, a dense regressor, no `J`."""
    small = {
        key: np.asfortranarray(value.astype(np.float32))
        if isinstance(value, np.ndarray) and value.dtype == float
        else value
        for key, value in m.items()
        if key != "J"
    }
    small["shapedirs"] = np.asfortranarray(small["shapedirs"][:, :, :10])
    return small


def saved_again(m, protocol):
    """As Python 3 saves the dictionary, without `chumpy`; big endian once."""
    again = dict(m, J_regressor=scipy.sparse.csc_matrix(m["J_regressor"]))
    again["weights"] = again["weights"].astype(">f8")
    return pickle.dumps(again, protocol=protocol)


def main():
    right, left = model("right"), model("left")
    files = {
        "right.pkl": python2(as_published(right)),
        "left.pkl": python2(as_published(left)),
        "right_single.pkl": python2(single(right)),
        **{f"right_protocol_{p}.pkl": saved_again(right, p) for p in (2, 3, 4, 5)},
    }
    with zipfile.ZipFile(HERE / "models.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED, 9)
    golden = [
        {
            "side": side,
            "betas": betas.tolist(),
            "pose": pose.tolist(),
            "keypoints_m": landmarks(m, side, betas, pose).tolist(),
        }
        for side, m in (("right", right), ("left", left))
        for betas, pose in cases()
    ]
    # The coefficients that cancel the mean pose: a flat hand.
    flat = [
        {"side": side, "coefficients": np.linalg.solve(m["hands_components"].T, -m["hands_mean"]).tolist()}
        for side, m in (("right", right), ("left", left))
    ]
    made_with = f"numpy {np.__version__}, scipy {scipy.__version__}"
    text = json.dumps({"made_with": made_with, "flat": flat, "cases": golden})
    (HERE / "golden.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
