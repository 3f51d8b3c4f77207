"""Edits of the files of a trial, for `trial_copy`, and of those of any other."""

from collections.abc import Callable, Iterable
from pathlib import Path

from numpy.typing import NDArray

Edit = Callable[[str], str]
"""An edit of the text of a file."""


def rewritten(file: Path, edit: Edit) -> None:
    """Write a file anew, edited."""
    file.write_text(edit(file.read_text()))


def cut(trial: Path, until_s: float) -> None:
    """Leave of a trial's readings, truth and loads only what comes before a time."""
    for file in trial.glob("*.csv"):
        rewritten(file, rows_at(lambda t_s: t_s < until_s))


def rows_at(holds: Callable[[float], bool]) -> Edit:
    """An edit of a table that leaves the rows of some times, the first column."""
    return lines(lambda rows: rows[:1] + [row for row in rows[1:] if holds(float(row.split(",")[0]))])


def stamped(stamp: Callable[[float], float]) -> Edit:
    """An edit of the times of a table, the first column."""

    def edit(rows):
        cells = (row.split(",", 1) for row in rows[1:])
        return rows[:1] + [f"{stamp(float(t_s)):.6f},{rest}" for t_s, rest in cells]

    return lines(edit)


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
