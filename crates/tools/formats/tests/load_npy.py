"""Prints the dictionary that an `.npy` file holds, as JSON."""

import json
import sys

import numpy as np

loaded = np.load(sys.argv[1], allow_pickle=True).item()
arrays = [value for value in loaded.values() if isinstance(value, np.ndarray)]
plain = lambda value: value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
found = {key: plain(value) for key, value in loaded.items()}
json.dump(found | {"dtypes": " ".join(sorted({str(array.dtype) for array in arrays}))}, sys.stdout)
