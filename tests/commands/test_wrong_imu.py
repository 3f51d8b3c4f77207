"""An inertial sensor that is told wrongly, on the shipped trial of a robot that is tipped: as a user meets it."""

import csv
from pathlib import Path

import numpy as np
import pytest

from command_line import printed_by
from roll import roll, soon_tipped


def told(folder: Path, change, edit=lambda text: text, *, make=soon_tipped) -> Path:
    """Copy the trial with its inertial sensor's rates and forces changed, and trial.toml edited."""
    trial = make(folder / "trial", edit=edit)
    header, *rows = (trial / "imu0.csv").read_text().splitlines()
    t_s, *values = np.loadtxt(rows, delimiter=",").T
    changed = np.column_stack([t_s, *change(np.array(values[:3]), np.array(values[3:]))])
    np.savetxt(trial / "imu0.csv", changed, fmt="%.4f", delimiter=",", header=header, comments="")
    return trial


def reconstructed(trial: Path, *options: str) -> tuple[str, list[dict[str, str]]]:
    """Return the summary of `reconstruct` in one line, and the rows of status.csv."""
    ended = printed_by("reconstruct", trial, *options, "--figures", "none", "--out", "result", cwd=trial.parent)
    with (trial.parent / "result" / "status.csv").open() as lines:
        return " ".join(ended.replace("│", " ").split()), list(csv.DictReader(lines))


@pytest.mark.parametrize(
    ("scale", "got"), [(1 / 9.81, "1.011"), (1000 / 9.81, "1011"), (0, "0")], ids=["g", "mg", "none"]
)
def test_gravity_in_another_unit_is_named_and_the_sensor_is_not_used(tmp_path, scale, got) -> None:
    """In mg no sample is one that a sensor can have measured, so that the robot is followed as without the sensor."""
    trial = told(tmp_path, lambda rate, force: [*rate, *scale * force])
    text, frames = reconstructed(trial, "--live", "--to", "1")
    assert f"specific force at rest: expected 9.81 m/s^2, got {got}: unit?" in text
    assert {frame["doubt"] for frame in frames} == ({"imu"} if scale < 1 else {"none"})


def test_an_axis_that_is_not_the_rod_contradicts_gravity_at_rest(tmp_path) -> None:
    trial = told(
        tmp_path, lambda rate, force: [*rate, *force], lambda text: text.replace("axis = [0, 0, 1]", "axis = [1, 0, 0]")
    )
    _, frames = reconstructed(trial, "--live", "--to", "1.4")
    assert frames[-1]["doubt"] == "imu"


@pytest.mark.parametrize(
    ("make", "tips_s", "options", "doubted"),
    [(roll, 3.5, ["--live"], 0.02), (soon_tipped, 1.5, [], 1.0)],
    ids=["live", "batch"],
)
def test_rates_of_the_other_sign_are_found_at_the_first_tip(tmp_path, make, tips_s, options, doubted) -> None:
    """Live from the contradiction on, in batch in all frames, as all of them rest on the sensor."""
    trial = told(tmp_path, lambda rate, force: [*-rate, *force], make=make)
    _, frames = reconstructed(trial, *options, "--to", f"{tips_s + 0.22:.2f}")
    assert frames[-1]["doubt"] == "imu"
    assert np.mean([frame["doubt"] == "imu" for frame in frames]) >= doubted
    assert all(frame["doubt"] == "imu" for frame in frames if float(frame["t_s"]) > tips_s + 0.18)
