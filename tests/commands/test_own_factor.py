"""A factor of another package, `[[factor]]`: the draw-wire sensor of `examples/own_parts` on the example trial."""

import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest

import tensegraph as tg
from command_line import refusal_of, run
from installed import install
from roll import roll
from tensegraph.io.trial_directory import open_trial
from tensegraph.models.own_factor import OwnFactor
from tensegraph.models.structure.reconstruction import Reconstruction
from tensegraph.models.values.readings import FactorRows
from trial_edits import replaced, rewritten

pytestmark = pytest.mark.usefixtures("undrawn")

NODES = (2, 8)
"""An anchor, and a node that is pressed from 2.6 s on."""
SIGMA_M = 0.0005


def with_tape(trial: Path, offset_m: float = 0.0, edit=lambda text: text) -> Path:
    """Add a tape between two nodes to a trial: the truth, noise and an offset, fifty times a second."""
    truth = open_trial(trial).truth()
    apart_m = np.linalg.norm(np.subtract(*(truth.node_position_m[:, n] for n in NODES)), axis=1)
    t_s = np.arange(truth.t_s[0], truth.t_s[-1] + 0.02, 0.02)
    noise_m = SIGMA_M * np.random.default_rng(1).standard_normal(len(t_s))
    distance_m = np.interp(t_s, truth.t_s, apart_m) + noise_m + offset_m
    rows = [f"{t:.3f},{d:.5f},{SIGMA_M}\n" for t, d in zip(t_s, distance_m, strict=True)]
    (trial / "tape.csv").write_text(edit("".join(["t_s,distance_m,sigma_m\n", *rows])))
    with (trial / "trial.toml").open("a") as file:
        file.write(f'\n[[factor]]\nname = "tape"\nfile = "tape.csv"\nnodes = {list(NODES)}\n')
    return trial


def without_mechanics(text: str) -> str:
    """Lengths alone hardly see one motion of the whole, which a tape sees."""
    return text[: text.index("[mechanics]")] + text[text.index("[rest]") :]


def pressed_node(result: Reconstruction, trial: Path) -> tuple[float, float, float]:
    """Return RMSE, mean sigma and coverage at 95 % of the pressed node."""
    truth, node = open_trial(trial).truth(), NODES[1]
    true_m = np.stack([np.interp(result.t_s, truth.t_s, x) for x in truth.node_position_m[:, node].T], axis=1)
    error_m = result.node_position_m[:, node] - true_m
    nees = np.einsum("ti,tij,tj->t", error_m, np.linalg.inv(result.node_covariance_m2[:, node]), error_m)
    return np.sqrt(np.mean(np.sum(error_m**2, 1))), result.node_sigma_m[:, node].mean(), np.mean(nees < 7.815)


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_tape_tells_what_lengths_do_not(method, own_parts, trial_copy) -> None:
    """Without the balance of forces, in a press: 1.9 to 5 mm become 1 mm; the smaller sigma holds, without a doubt."""
    plain = trial_copy(rows=200, name="plain", trial=without_mechanics)
    taped = with_tape(trial_copy(rows=200, name="taped", trial=without_mechanics))
    rmse_m, sigma_m, _ = pressed_node(tg.reconstruct(plain, method), plain)
    result = tg.reconstruct(taped, method)
    with_tape_rmse_m, with_tape_sigma_m, coverage = pressed_node(result, taped)
    assert rmse_m > 0.0019
    assert with_tape_rmse_m < 0.6 * rmse_m
    assert with_tape_sigma_m < 0.7 * sigma_m
    assert coverage > 0.95
    assert np.mean([doubt is None for doubt in result.doubts]) > 0.95


@pytest.mark.parametrize("method", ["live", "batch"])
def test_a_tape_that_is_wrong_is_doubted(method, own_parts, trial_copy) -> None:
    """By 50 mm, where forces are known: it is left out nearly, and every frame says so."""
    plain = trial_copy(rows=50, name="plain")
    wrong = with_tape(trial_copy(rows=50, name="wrong"), 0.05)
    result, without = tg.reconstruct(wrong, method), tg.reconstruct(plain, method)
    assert {str(doubt) for doubt in result.doubts} == {"factor"}
    assert {str(status) for status in result.status} == {"doubt"}
    assert np.abs(result.node_position_m - without.node_position_m).max() < 0.001
    np.testing.assert_allclose(result.node_sigma_m, without.node_sigma_m, rtol=0.1)


def test_the_command_names_it_and_what_it_says(own_parts, trial_copy, tmp_path) -> None:
    """Half of the frames have no reading, and a reading that is wrong is in status.csv."""
    with_tape(trial_copy(rows=100, name="press"), 0.05, lambda text: text[: text.index("\n1.000,") + 1])
    done = run("reconstruct", "press", "--figures", "none", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    result = tmp_path / "results" / "press"
    made = tomllib.loads((result / "run.toml").read_text())
    assert made["plug_ins"]["factors"]["tape"]["package"] == "own-parts"
    assert "tape.csv" in made["inputs"]
    with (result / "status.csv").open() as file:
        doubts = [row["doubt"] for row in csv.DictReader(file)]
    unread = made["rows"]["factor[0] tape: frames without a reading"]
    assert 0.4 * len(doubts) < unread < 0.6 * len(doubts)
    assert made["rows"]["factor[0] tape: frames in which it contradicts all else"] == doubts.count("factor") > 50
    assert doubts[-1] == "none"
    assert "factor[0] tape: frames without a reading" in done.stdout
    assert "a factor of your own, or a stiff cable, contradicts lengths" in " ".join(
        done.stdout.replace("│", " ").split()
    )
    again = run("reconstruct", "press", "--figures", "none", cwd=tmp_path)
    assert "up to date" in again.stdout


def test_live_uses_it_and_records_it_not(own_parts, trial_copy, tmp_path) -> None:
    with_tape(trial_copy(rows=30, name="press"), 0.05)
    done = run("live", "--replay", "press", "--speed", "100", "--out", "shown", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    made = tomllib.loads((tmp_path / "shown" / "run.toml").read_text())
    assert made["plug_ins"]["factors"]["tape"]["version"] == "1.0"
    assert made["rows"]["factor[0] tape: frames in which it contradicts all else"] == made["frames"]
    refused = refusal_of("live", "--replay", "press", "--record", "again", cwd=tmp_path)
    assert refused == "tensegraph: press: has [[factor]], whose readings cannot be recorded again\n"


def test_methods_that_use_no_factor_say_so(own_parts, trial_copy, tmp_path) -> None:
    with_tape(trial_copy(rows=30, name="press"))
    refused = refusal_of("reconstruct", "press", "--method", "rest-held", cwd=tmp_path)
    assert refused.endswith(
        "method 'rest-held': expected one of batch, live, frame, which use the trial's [[factor]]\n"
    )
    done = run("compare", "press", "--method", "least-squares", "--method", "live", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "least squares: not run: method 'least-squares': expected one of batch, live, frame" in done.stdout
    with (tmp_path / "results/comparison/comparison.csv").open() as file:
        nodes_rmse_m = {row["method"]: row["nodes_rmse_m"] for row in csv.DictReader(file) if row["trial"] == "press"}
    assert nodes_rmse_m["graph, live"] not in ("", "nan")
    assert nodes_rmse_m["least squares"] in ("", "nan")


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (replaced('name = "tape"', 'name = "laser"'), "factor[0]: name: expected one of tape, got 'laser'"),
        (replaced('name = "tape"\n', ""), "factor[0]: name: is missing"),
        (replaced('"tape.csv"', '"../tape.csv"'), "factor[0]: file: expected a file in the directory "),
        (replaced('"tape.csv"', '"other.csv"'), "other.csv: no such file"),
        (replaced("nodes = [2, 8]\n", ""), "factor[0]: nodes: is missing"),
        (replaced("nodes = [2, 8]", "node = [2, 8]"), "factor[0]: node: expected one of the keys name, file, nodes"),
        (replaced("[2, 8]", "[2, 12]"), "factor[0]: nodes: expected two different nodes from 0 to 11, got [2, 12]"),
    ],
)
def test_a_table_that_is_wrong_is_one_line(edit, message, own_parts, trial_copy, tmp_path) -> None:
    toml = with_tape(trial_copy(rows=10, name="press")) / "trial.toml"
    rewritten(toml, edit)
    assert message in refusal_of("reconstruct", "press", cwd=tmp_path)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (replaced("0.020,", "0.000,"), "tape.csv: row 3: expected a later t_s than before, and sigma_m above 0"),
        (replaced("0.020,", "x,"), "tape.csv: row 3, column t_s: expected a finite number, got 'x'"),
    ],
)
def test_the_factor_s_own_line_is_passed_on(edit, message, own_parts, trial_copy, tmp_path) -> None:
    with_tape(trial_copy(rows=10, name="press"), edit=edit)
    refused = refusal_of("reconstruct", "press", cwd=tmp_path)
    assert refused == f"tensegraph: {(tmp_path / 'press' / message).relative_to(tmp_path)}\n"


MODULE = """
import numpy as np
from tensegraph.models.values.readings import FactorRows


class Mine:
    def __init__(self, table, structure):
        if table.keys.get("broken"):
            raise KeyError("sensor")

    def rows(self, t_s, node_position_m):
        lead = node_position_m.shape[:-2]
        {body}
"""
HEIGHT = "jacobian = np.zeros((*lead, 1, 36)); jacobian[..., 26] = 1; residual = node_position_m[..., 8, 2:] - 0.25"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("raise ValueError('no\\nreading')", "ValueError: no reading"),
        (
            "return FactorRows(np.zeros((*lead, 2)), np.zeros((*lead, 2, 3)), np.ones((*lead, 2)))",
            "expected residual (frames, rows), jacobian (frames, rows, 3 nodes) and sigma (frames, rows) of () frames",
        ),
        (f"{HEIGHT}; return FactorRows(residual, jacobian, 0 * residual)", "expected sigmas above 0, got 0"),
        (
            f"{HEIGHT}; return FactorRows(residual, np.nan * jacobian, 1e-3 + 0 * residual)",
            "expected a finite jacobian of each row that was read",
        ),
        ("return 3", "AttributeError: 'int' object has no attribute 'residual'"),
    ],
)
def test_a_factor_that_fails_is_one_line(body, message, site, trial_copy, tmp_path) -> None:
    install("mine", "0.1", {"tensegraph.factors": {"mine": "own_mine:Mine"}}, site)
    (site / "own_mine.py").write_text(MODULE.format(body=body))
    trial = trial_copy(rows=10, name="press")
    with (trial / "trial.toml").open("a") as file:
        file.write('\n[[factor]]\nname = "mine"\n')
    refused = refusal_of("reconstruct", "press", cwd=tmp_path)
    assert f"press/trial.toml: factor[0]: factor 'mine' of package mine 0.1: {message}" in refused
    with (trial / "trial.toml").open("a") as file:
        file.write("broken = true\n")
    refused = run("reconstruct", "press", cwd=tmp_path)
    assert refused.stderr.endswith("factor[0]: factor 'mine' of package mine 0.1 cannot be made: KeyError: 'sensor'\n")


def test_a_robot_without_base_takes_what_depends_on_its_shape(own_parts, site, tmp_path) -> None:
    """A tape that is 30 mm wrong is doubted on a robot that stands free; a height is refused."""
    trial = with_tape(roll(tmp_path / "roll", 0.8), 0.03)
    result = tg.reconstruct(trial, "live")
    assert [str(doubt) for doubt in result.doubts].count("factor") > 0.9 * len(result)
    install("mine", "0.1", {"tensegraph.factors": {"mine": "own_mine:Mine"}}, site)
    (site / "own_mine.py").write_text(
        MODULE.format(body=f"{HEIGHT}; return FactorRows(residual, jacobian, 1 + residual)")
    )
    toml = trial / "trial.toml"
    toml.write_text(toml.read_text().replace('"tape"\nfile = "tape.csv"\nnodes = [2, 8]', '"mine"'))
    with pytest.raises(tg.InputError, match="expected a factor that depends on the shape alone, for a structure that"):
        tg.reconstruct(trial, "live")


def test_a_rig_has_none(tmp_path) -> None:
    rig = (Path(__file__).parents[2] / "examples" / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(f'{rig}\n[[factor]]\nname = "tape"\n')
    refused = refusal_of("live", "--rig", "rig.toml", cwd=tmp_path)
    assert refused == "tensegraph: rig.toml: [[factor]]: comes from no board: expected a rig without it\n"


def test_a_row_that_was_not_read_needs_no_jacobian(structure) -> None:
    """Its residual is nan, or its sigma inf."""

    class Silent:
        def rows(self, t_s, node_position_m):
            unknown = np.full((2, 3 * structure.node_count), np.nan)
            return FactorRows(np.array([0.0, np.nan]), unknown, np.array([np.inf, 0.001]))

    factor = OwnFactor(None, "trial.toml: factor 0", Silent(), structure)
    assert np.isnan(factor.rows(np.array(0.0), np.zeros((structure.node_count, 3))).jacobian).all()
