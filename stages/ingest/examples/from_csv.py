"""Converts a csv of motion capture to tracks: python from_csv.py take.csv 025_mug right DATASET/anna/take_1"""
import csv, json, pathlib, sys
import numpy as np

source, mesh, side, folder = sys.argv[1:5]
with open(source, newline="") as file:
    rows = list(csv.DictReader(file))
number = lambda row, name: float(row[name] or "nan")  # an empty cell is what was not seen
hands = np.array([[[number(row, f"hand{k}_{axis}") for axis in "xyz"] for k in range(21)] for row in rows])
pose = ["object_x", "object_y", "object_z", "object_qx", "object_qy", "object_qz", "object_qw"]
objects = np.array([[number(row, name) for name in pose] for row in rows])
hands[np.isnan(hands).any(axis=(1, 2))] = -1
objects[np.isnan(objects).any(axis=1)] = 0

folder = pathlib.Path(folder)
folder.mkdir(parents=True)
np.savez(folder / "track.npz", keypoints_mm=hands, world_from_object=objects)
about = {"object": mesh, "hand": side, "images": len(rows), "unit": "mm"}
about["table_plane"] = [0.0, 0.0, 1.0, 0.0]  # the way up, and how far along it the surface is from the origin
(folder / "track.yml").write_text(json.dumps(about))
