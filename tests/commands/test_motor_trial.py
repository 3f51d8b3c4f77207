"""A trial with motors as a user makes and reads it, on a prism whose upper triangle is wound."""

import re
import tomllib
from dataclasses import replace
from shutil import copytree

import numpy as np
import pytest

from command_line import printed_by, refusal_of, run
from pipelines import pipeline_of
from plan_edits import PLANS, replaced
from tensegraph import Status, Trial, open_trial, reconstruct, simulate
from tensegraph.factors.tendon import TautCables
from tensegraph.live.feeds import replay_feed, twin_feed
from tensegraph.models.evaluation.metrics import node_rmse_m
from tensegraph.models.values.readings import NaturalLengthReading, arrival_s
from trial_edits import rewritten, rows_at

pytestmark = pytest.mark.usefixtures("undrawn")

MOTORS = """[[motor]]
tendons = [3, 4, 5]
strip_length_m = 0.1
at_s = [1.5, 3.5]
change_m = [-0.012, 0.0]
speed_m_per_s = 0.02
rate_hz = 50.0
noise_m = 0.00005
drum_sigma = 0.01
"""


@pytest.fixture(scope="module")
def trial(tmp_path_factory) -> Trial:
    folder = tmp_path_factory.mktemp("motors")
    text = PLANS["prism"].read_text()
    text = replaced(text[: text.index("[[load.press]]")], ("duration_s = 30.0", "duration_s = 4.0"))
    (folder / "prism.toml").write_text(replaced(text, ("seconds = 2.0 ", "seconds = 1.0 ")) + MOTORS)
    return simulate(folder / "prism.toml", folder / "prism_01")


def error_mm(trial: Trial, method: str) -> tuple[float, tuple[Status, ...]]:
    truth = trial.truth()
    result = reconstruct(trial, method)
    return 1e3 * node_rmse_m(result, truth.t_s, truth.node_position_m), result.status


def test_natural_lengths_that_are_told_are_followed(trial, tmp_path) -> None:
    """Live, by the command line; the same trial with a file that tells of no motion is wrong, and not `ok`."""
    assert trial.files()[-1] == "natural_length0.csv"
    result = printed_by("reconstruct", trial.path, "--live", "--figures", "none", "--out", "told", cwd=tmp_path)
    assert "absurd" not in result
    told_mm, status = error_mm(trial, "live")
    assert f"{told_mm:.2f} mm" in result
    assert told_mm < 1.5
    assert status.count(Status.OK) > 0.9 * len(status)

    path = trial.path / "natural_length0.csv"
    rows = path.read_text()
    rest_m = {row.split(",")[1]: row.split(",")[2] for row in rows.splitlines()[1:4]}
    still = [row.split(",") for row in rows.splitlines()[1:]]
    path.write_text("\n".join([rows.splitlines()[0], *(f"{t},{e},{rest_m[e]},0.00005" for t, e, _, _ in still)]) + "\n")
    untold_mm, status = error_mm(open_trial(trial.path), "live")
    path.write_text(rows)
    assert untold_mm > 2 * told_mm
    wound = status[125:170]  # held at -12 mm
    assert wound.count(Status.OK) < 0.2 * len(wound)


def test_a_replay_and_the_twin_have_the_motors_too(trial) -> None:
    """Live from the trial, and straight from the plan: the same rows as in the file, each before its frame."""
    told = [reading for reading in trial.readings() if isinstance(reading, NaturalLengthReading)]
    assert len(told) == 3 * 200
    shares: list[float] = []
    twin = twin_feed(trial.path.parent / "prism.toml", 1e6, None, shares.append)
    for feed in (replay_feed(trial.path, 1e6, None), twin):
        with feed as live:
            readings = list(live.rows)
        rows = [reading for reading in readings if isinstance(reading, NaturalLengthReading)]
        assert [row.tendon for row in rows] == [row.tendon for row in told]
        assert [row.t_s for row in rows] == pytest.approx([row.t_s for row in told])
        assert [row.natural_length_m for row in rows] == pytest.approx([row.natural_length_m for row in told], abs=6e-6)
        assert [arrival_s(reading) for reading in readings] == sorted(arrival_s(reading) for reading in readings)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0, abs=0.1)


def test_a_replay_with_motors_is_recorded_again(trial, tmp_path) -> None:
    printed_by("live", "--replay", trial.path, "--speed", 4, "--record", "again", "--out", "live", cwd=tmp_path)
    for name in ("natural_length0.csv", "board0.csv"):
        first, again = ((folder / name).read_text().splitlines() for folder in (trial.path, tmp_path / "again"))
        assert len(again) == len(first)
    again = open_trial(tmp_path / "again").description.motors
    assert [motor.tendons for motor in again] == [motor.tendons for motor in trial.description.motors]


def test_a_motor_on_a_stiff_cable_is_refused_in_one_line(trial, tmp_path) -> None:
    cable = tmp_path / "cable"
    copytree(trial.path, cable)
    told = (cable / "trial.toml").read_text()
    stiff = ("tendon_stiffness_n_per_m = 400", "push_back = 0.0\ntendon_stiffness_n_per_m = 20400")
    (cable / "trial.toml").write_text(replaced(told, stiff))
    refused = refusal_of("reconstruct", cable, "--live", "--figures", "none", cwd=tmp_path)
    assert "motor[0].tendons: expected no stiff cable, got tendon 3" in refused


def test_rows_that_are_missing_are_counted_live_as_offline(trial, tmp_path) -> None:
    """No row of the motors from 2 to 3.5 s: each tendon is without its natural length from 0.5 s after the last row."""
    gap = tmp_path / "gap"
    copytree(trial.path, gap)
    rewritten(gap / "natural_length0.csv", rows_at(lambda t_s: not 2.0 < t_s < 3.5))
    offline = run("reconstruct", gap, "--live", "--figures", "none", "--out", "offline", cwd=tmp_path)
    live = run("live", "--replay", gap, "--speed", 1000, "--out", "live", cwd=tmp_path)
    told = []
    for done in (offline, live):
        assert done.returncode == 0, done.stderr
        rows = tomllib.loads((tmp_path / done.args[-1] / "run.toml").read_text())["rows"]
        told.append({name: n for name, n in rows.items() if "motor" in name})
        for tendon in (3, 4, 5):
            name = f"motor of tendon {tendon}: frames without its rows"
            assert rows[name] == pytest.approx(50, abs=2)
            assert re.search(rf"{name} +│ {rows[name]}", done.stdout)
    assert told[0] == told[1]


@pytest.mark.parametrize("has_motors", [True, False])
def test_beside_motors_cables_are_slack_by_their_lengths_alone(has_motors, trial) -> None:
    """The tension that a cable has with the natural lengths of the rest says nothing once a motor has wound others."""
    told = trial.description
    assert told.mechanics is not None
    is_cable = np.arange(len(told.structure.tendons)) == 7
    mechanics = replace(
        told.mechanics,
        stiffness_n_per_m=np.where(is_cable, 2e4, 400.0),
        push_back=np.where(is_cable, 0.0, 0.1),
        stiff_cables=np.flatnonzero(is_cable),
    )
    told = replace(told, mechanics=mechanics, motors=told.motors if has_motors else ())
    (cables,) = pipeline_of(told).factors
    assert isinstance(cables, TautCables)
    assert (cables.statics is None) == has_motors
