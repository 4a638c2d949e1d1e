"""Convex parts of an object, apart from those that `ingest` makes, as a program for `kind = "program"`.

Reads `objects`; makes a table with one row for each part, the corners of a convex hull. CoACD splits the mesh (X. Wei
et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree search", 2022). Hulls keep
all their corners, so that the object stands in the poses in which its mesh stands. Equal meshes and options give equal
parts.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

# One thread: the units of a stage run side by side.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import coacd
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

OPTIONS = {
    # Greatest concavity of a part, as a share of half the object's longest side: parts stick out of bowls and mugs by up
    # to 2.4 mm, those of `ingest` by 2 mm. CoACD's default, 0.05, lets them stick out by 3.9 mm.
    "threshold": 0.03,
    # Of CoACD's tree search. An option, so that a pipeline's seed changes no object.
    "seed": 0,
}
# As the mesh is, and where CoACD ends without parts because the mesh intersects itself, remeshed first.
WAYS = [{"preprocess_mode": "off"}, {"preprocess_mode": "on", "decimate": True}]
# A thinner sliver is no body for MuJoCo, in cubic meters.
SMALLEST_M3 = 1e-10


def split(way, mesh, found):
    """Writes the parts of a mesh into a file."""
    coacd.set_log_level("error")
    given = np.load(mesh)
    options = json.loads(str(given["options"]))
    made = coacd.run_coacd(coacd.Mesh(given["vertices"], given["triangles"]), **options, **WAYS[way])
    np.savez(found, *[np.asarray(points, float) for points, triangles in made if volume(points, triangles) > SMALLEST_M3])


def volume(points, triangles):
    a, b, c = (np.asarray(points)[np.asarray(triangles)[:, corner]] for corner in range(3))
    return abs(np.einsum("ij,ij->", a - a.mean(0), np.cross(b - a.mean(0), c - a.mean(0)))) / 6


def parts(vertices, triangles, options, folder):
    """The corners of each part; the library runs in a process of its own, which it may abort."""
    mesh, found = folder / "mesh.npz", folder / "parts.npz"
    np.savez(mesh, vertices=vertices, triangles=triangles, options=json.dumps(options))
    for way in range(len(WAYS)):
        ended = subprocess.run([sys.executable, "-B", __file__, str(way), str(mesh), str(found)])
        if ended.returncode == 0:
            made = np.load(found)
            if made.files:
                return [made[name] for name in made.files]
    sys.exit("CoACD splits this mesh neither as it is nor remeshed")


def main():
    job = json.loads(Path("job.json").read_text())
    unknown = set(job["options"]) - set(OPTIONS)
    if unknown:
        sys.exit(f"`options` has {', '.join(sorted(unknown))}: this program knows {', '.join(OPTIONS)}")
    (part,) = job["inputs"]["objects"]
    (row,) = pq.read_table(part["files"]["part.parquet"]).to_pylist()
    vertices, triangles = np.array(row["vertices_m"], float), np.array(row["triangles"], int).reshape(-1, 3)
    made = parts(vertices, triangles, OPTIONS | job["options"], Path(os.environ.get("TMPDIR", "tmp")))
    rows = [{"part_idx": idx, "points_m": points.ravel().tolist()} for idx, points in enumerate(made)]
    columns = pq.read_schema(job["output"]["template"])
    pq.write_table(pa.Table.from_pylist(rows, schema=columns), job["output"]["table"])


if __name__ == "__main__":
    if len(sys.argv) > 1:
        split(int(sys.argv[1]), *sys.argv[2:])
    else:
        main()
