"""Structures that are none of tensegrities, but may be described: each is estimated, without a warning."""

import numpy as np
import pytest
import tomli_w

from command_line import run
from tensegraph import load

HEIGHT_M = float(np.sqrt(0.3**2 - 0.1**2))
DEGENERATE = {
    "all tendons join anchors": {
        "rods": [[0, 1], [0, 2], [0, 3]],
        "tendons": [[1, 2], [2, 3], [1, 3]],
        "anchors": [1, 2, 3],
        "at_m": [[0, 0, HEIGHT_M], [0.1, 0, 0], [-0.05, 0.05 * 3**0.5, 0], [-0.05, -0.05 * 3**0.5, 0]],
    },
    "all nodes hang on one vertical": {
        "rods": [[0, 2]],
        "tendons": [[0, 1], [1, 2]],
        "anchors": [1, 2],
        "at_m": [[0, 0, 0], [0, 0, 0.6], [0, 0, 0.3]],
    },
    "all weight is on the line of the anchors": {
        "rods": [[0, 2]],
        "tendons": [[0, 1], [1, 2]],
        "anchors": [0, 2],
        "at_m": [[0, 0, 0.3], [0.15, 0, 0.1], [0.3, 0, 0.3]],
    },
    "two rods across one another": {
        "rods": [[0, 1], [2, 3]],
        "tendons": [[0, 2], [0, 3], [1, 2], [1, 3]],
        "anchors": [0, 1, 2],
        "at_m": [[0, 0, 0], [0.3, 0, 0], [0.15, 0.15, 0], [0.15, -0.15, 0]],
    },
}


@pytest.mark.parametrize("method", ["live", "batch"])
@pytest.mark.parametrize("name", DEGENERATE)
def test_it_is_estimated_without_a_warning(tmp_path, name, method) -> None:
    described = DEGENERATE[name]
    x = np.array(described["at_m"], dtype=np.float64)
    lengths_m = [float(np.linalg.norm(x[a] - x[b])) for a, b in described["tendons"]]
    structure = {
        "rods": described["rods"],
        "tendons": described["tendons"],
        "rod_length_m": 0.3,
        "natural_length_m": [0.9 * length_m for length_m in lengths_m],
        "anchors": described["anchors"],
        "anchor_position_m": x[described["anchors"]].tolist(),
    }
    trial = {
        "format": 1,
        "structure": structure,
        "rest": {"seconds": 0.2, "node_position_m": x.tolist()},
        "mechanics": {"tendon_stiffness_n_per_m": 400.0, "rod_mass_kg": 0.03},
        "lengths": {"file": "lengths.csv"},
    }
    (tmp_path / "trial.toml").write_text(tomli_w.dumps(trial))
    rng = np.random.default_rng(1)
    rows = [[0.02 * k, *(length_m + 3e-4 * rng.standard_normal() for length_m in lengths_m)] for k in range(60)]
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(len(lengths_m)))])
    np.savetxt(tmp_path / "lengths.csv", rows, delimiter=",", header=header, comments="", fmt="%.6f")
    done = run("reconstruct", ".", "--method", method, "--figures", "none", "--out", "out", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    result = load(tmp_path / "out")
    assert np.abs(result.node_position_m - x).max() < 0.5
    assert np.isfinite(result.node_sigma_m).all()
