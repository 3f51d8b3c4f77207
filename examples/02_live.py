"""Shapes while readings come, as the program of a robot would use them.

python examples/02_live.py [TRIAL]

Any iterator of readings will do: rows of boards, resistances or lengths. Here the rows of a recorded trial come four
times faster than they came then; on a robot they would come from its own electronics. For our boards there is
`tensegraph live --rig RIG.toml`.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import tensegraph as tg

SPEED = 4.0
SECONDS = 6.0
TOO_MUCH_N = 1.0


def arriving(trial: tg.Trial) -> Iterator[tg.BoardReading]:
    """Yield the first rows of a trial when they are due."""
    begin_s = time.monotonic()
    for row in trial.readings():
        if row.host_s > SECONDS:
            return
        time.sleep(max(begin_s + row.host_s / SPEED - time.monotonic(), 0.0))
        yield row


trial = tg.open_trial(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "press_01")
structure = trial.description.structure
next_line_s = 0.0
is_pressed = False

# The loop of the robot: each shape is there as soon as every board has passed the end of its frame.
for shape in tg.stream(arriving(trial), trial.description):
    if shape.t_s >= next_line_s:
        next_line_s += 1.0
        sigma_mm = 1e3 * shape.node_sigma_m[structure.free_nodes]
        print(f"{shape.t_s:5.2f} s: {shape.status.name}, largest sigma of a node {sigma_mm.max():.1f} mm")
    if shape.loads is not None:
        load_n = np.nan_to_num(np.linalg.norm(shape.loads.force_n, axis=1))
        if load_n.max() > TOO_MUCH_N and not is_pressed:
            print(f"{shape.t_s:5.2f} s: node {load_n.argmax()} is pressed with more than {TOO_MUCH_N:g} N")
        is_pressed = bool(load_n.max() > TOO_MUCH_N)
