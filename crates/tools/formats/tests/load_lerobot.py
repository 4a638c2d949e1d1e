"""Prints every frame of a dataset, as `lerobot`'s loader gives it, as JSON."""

import json
import os
import sys

os.environ["HF_HUB_OFFLINE"] = "1"
from lerobot.datasets.lerobot_dataset import LeRobotDataset

root = sys.argv[1]
dataset = LeRobotDataset("local/exported", root=root)
plain = lambda value: value if isinstance(value, str) else value.tolist()
frames = [{key: plain(value) for key, value in dataset[idx].items()} for idx in range(len(dataset))]
step = 1 / dataset.fps
windowed = LeRobotDataset("local/exported", root=root, delta_timestamps={"action": [-step, 0.0, step]})
first_end = dataset.meta.episodes[0]["dataset_to_index"] - 1
json.dump({
    "fps": dataset.fps,
    "episodes": dataset.num_episodes,
    "features": dataset.meta.features,
    "frames": frames,
    "window_is_pad": windowed[first_end]["action_is_pad"].tolist(),
}, sys.stdout)
