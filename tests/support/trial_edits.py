"""Edits of the files of a trial, for `trial_copy`, and of those of any other."""

from collections.abc import Iterable
from pathlib import Path

from numpy.typing import NDArray


def cut(trial: Path, until_s: float) -> None:
    """Leave of a trial's readings, truth and loads only what comes before a time."""
    for file in trial.glob("*.csv"):
        header, *rows = file.read_text().splitlines(keepends=True)
        file.write_text("".join([header, *(row for row in rows if float(row.split(",")[0]) < until_s)]))


def shifted(trial: Path, by_s: float) -> None:
    """Shift the stamps of a trial's readings, truth and loads, the first column of each file."""
    for file in trial.glob("*.csv"):
        header, *rows = file.read_text().splitlines(keepends=True)
        later = (f"{float(t_s) + by_s:.6f},{rest}" for t_s, rest in (row.split(",", 1) for row in rows))
        file.write_text("".join([header, *later]))


def write_positions(file: Path, t_s: Iterable[float], node_position_m: NDArray, nodes: Iterable[int]) -> None:
    """Write a file of `[[position]]`, of some nodes of (frames, nodes, 3) positions."""
    rows = [
        f"{t:.4f},{node},{','.join(f'{value:.5f}' for value in x[node])}"
        for t, x in zip(t_s, node_position_m, strict=True)
        for node in nodes
    ]
    file.write_text("\n".join(["t_s,node,x_m,y_m,z_m", *rows, ""]))


def lines(edit):
    """An edit of a file's list of lines."""
    return lambda text: "".join(edit(text.splitlines(keepends=True)))


def cell(row: int, column: int, value: str):
    """An edit of one cell; row 1 is the header."""

    def edit(rows):
        cells = rows[row - 1].rstrip("\n").split(",")
        cells[column] = value
        rows[row - 1] = ",".join(cells) + "\n"
        return rows

    return lines(edit)


def replaced(old: str, new: str):
    def edit(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return edit
