"""Describe a structure of your own, simulate a short trial of it, and reconstruct that.

python examples/03_own_structure.py

The structure is a prism of three struts: nodes 0 to 2 are held, nodes 3 to 5 move. Needs `pip install ".[twin]"`.
"""

import tomllib
from pathlib import Path

import numpy as np
import tomli_w

import tensegraph as tg

SIDE_M = 0.2
STRUT_M = 0.35
PRESS_N = 3.0

# The rest shape: two triangles, the upper one turned by 150 degrees, on struts that lean.
corner = np.deg2rad([0.0, 120.0, 240.0])
radius_m = SIDE_M / np.sqrt(3)
height_m = np.sqrt(STRUT_M**2 - 2 * radius_m**2 * (1 - np.cos(np.deg2rad(150.0))))
base = np.column_stack([radius_m * np.cos(corner), radius_m * np.sin(corner), np.zeros(3)])
turned = corner + np.deg2rad(150.0)
top = np.column_stack([radius_m * np.cos(turned), radius_m * np.sin(turned), np.full(3, height_m)])
position_m = np.concatenate([base, top])

# Who is joined to whom; natural lengths such that triangles are stretched by 8 %, and the sides by more, as they have
# to be for forces to balance with tendons that are all alike.
tendons = np.array([(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (0, 5), (1, 3), (2, 4)])
length_m = np.linalg.norm(position_m[tendons[:, 1]] - position_m[tendons[:, 0]], axis=1)
pulled = 0.08 / 1.08 * np.repeat([1.0, np.sqrt(3)], [6, 3])
prism = tg.Structure(  # refuses, by name, what is no structure
    rods=np.array([(0, 3), (1, 4), (2, 5)]),
    tendons=tendons,
    rod_length_m=np.array(STRUT_M),
    natural_length_m=length_m * (1 - pulled),
    anchors=np.array([0, 1, 2]),
    anchor_position_m=base,
)

# A plan for the digital twin: the sensors and boards of an example, this structure, and one press on all upper nodes.
plan = tomllib.loads((Path(__file__).parent / "plans" / "prism.toml").read_text())
plan["duration_s"] = 6.0
plan["structure"] = {
    name: getattr(prism, name).tolist()
    for name in ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors", "anchor_position_m")
}
press = {"at_s": 2.5, "ramp_s": 0.8, "hold_s": 1.5, "nodes": [3, 4, 5], "force_n": PRESS_N, "direction": [0, 0, -1]}
plan["load"] = {"press": [press]}
del plan["fault"]
Path("own_prism.toml").write_text(tomli_w.dumps(plan))

# Simulated, it is a trial like any other.
trial = tg.simulate("own_prism.toml", "own_prism_result")
result = tg.reconstruct(trial, "batch")
while_pressed = (result.t_s > 3.6) & (result.t_s < 4.6)
moved_m = result.node_position_m[while_pressed].mean(axis=0) - result.node_position_m[result.t_s < 2.0].mean(axis=0)
print(f"{len(result)} shapes of {prism.node_count} nodes; nodes 3 to 5 sink by {np.round(-1e3 * moved_m[3:, 2], 1)} mm")

# What pushes along a strut that stands on an anchor ends in the anchor; the part across it is seen.
along = (top - base) / STRUT_M
across_n = PRESS_N * np.linalg.norm([0, 0, -1] + along[:, 2:] * along, axis=1)
seen_n = np.linalg.norm(result.loads.force_n[while_pressed, 3:].mean(axis=0), axis=1)
print(f"pressed across the struts with {np.round(across_n, 2)} N, seen are {np.round(seen_n, 2)} N")
