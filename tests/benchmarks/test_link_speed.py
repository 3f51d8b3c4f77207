"""Speed of what stands between a port and the disk. Not part of the default run, see test_speed.py."""

import numpy as np

from tensegraph import BoardReading, open_trial
from tensegraph.io.boards.protocol import FrameDecoder, LineDecoder, Row, frame, line
from tensegraph.io.boards.recorder import Recorder

ROWS = [Row(0, 0, k, 20_000 * k, tuple((37 * k + 101 * c) % 1024 for c in range(12))) for k in range(1000)]


def test_1000_frames(benchmark) -> None:
    data = b"".join(map(frame, ROWS))
    assert len(benchmark(lambda: FrameDecoder().feed(data))) == 1000


def test_1000_lines(benchmark) -> None:
    data = b"\n" + b"".join(map(line, ROWS))
    assert len(benchmark(lambda: LineDecoder().feed(data))) == 1000


def test_1000_rows_recorded(benchmark, tmp_path, example) -> None:
    rows = [BoardReading(0, 0.02 * r.seq, r.seq, r.device_us, np.array(r.codes)) for r in ROWS]
    with Recorder(tmp_path / "trial", open_trial(example).toml) as recorder:
        benchmark(lambda: [recorder.add(row) for row in rows])
