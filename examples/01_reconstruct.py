"""Reconstruct a recorded trial, read numbers off the result, and save it.

python examples/01_reconstruct.py [TRIAL]
"""

import sys
from pathlib import Path

import numpy as np

import tensegraph as tg

# A trial is a directory: trial.toml describes the structure, its sensors and its boards, CSV files hold the readings.
path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "press_01"
trial = tg.open_trial(path)
structure = trial.description.structure
print(f"{trial.name}: {len(structure.rods)} rods, {len(structure.tendons)} tendons, {trial.row_count()} rows")

# "live" makes each shape from the past alone; "batch" takes longer and uses the whole trial for each.
result = tg.reconstruct(trial, "live")
print(f"{len(result)} shapes from {result.t_s[0]:.2f} to {result.t_s[-1]:.2f} s")

# (frames, nodes, 3) positions in metres, in the frame of the anchors, and how sure each of them is.
node = int(structure.free_nodes[-1])
height_m = result.node_position_m[:, node, 2]
print(f"node {node} is between {1e3 * height_m.min():.1f} and {1e3 * height_m.max():.1f} mm high")
largest_m = result.ellipsoids(0.95).semi_axis_m[:, structure.free_nodes].max()
print(f"the longest semi-axis of any 95 % ellipsoid is {1e3 * largest_m:.1f} mm")

# Where the stiffness of the tendons is known, the external force at each node comes with the shape.
if result.loads is not None:
    size_n = np.nan_to_num(np.linalg.norm(result.loads.force_n, axis=-1))
    frame, node = np.unravel_index(size_n.argmax(), size_n.shape)
    print(f"the largest load is {size_n.max():.2f} N, at node {node}, {result.t_s[frame]:.2f} s after the start")

# Tables, figures and settings, as `tensegraph reconstruct` writes them.
tg.save(result, f"{trial.name}_result")
print(f"written to {trial.name}_result")
