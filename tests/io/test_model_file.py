"""Model files: the same bytes, and what is refused."""

import hashlib
import json
import os
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from tensegraph import InputError
from tensegraph.io.model_file import read_sensor_model, write_sensor_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.sensor.sensor_model import SensorModel

CALIBRATION = Path(__file__).parents[2] / "examples" / "calibration"


SHIPPED = Path(__file__).parents[2] / "models" / "data" / "stretching.safetensors"


def stored(path):
    """Return the tensors and the metadata of a model file as they stand."""
    with safe_open(path, framework="numpy") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, json.loads(file.metadata()["tensegraph"])  # noqa: SIM118


class TestModelFile:
    def test_file_gives_the_same_bytes_and_values(self, model: SensorModel, tmp_path) -> None:
        for name in ("a", "b"):
            write_sensor_model(model, tmp_path / name)
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
        again = read_sensor_model(tmp_path / "a")
        assert again.provenance == model.provenance
        assert again.ranges == model.ranges
        np.testing.assert_array_equal(again.network.weights.weight_ih, model.network.weights.weight_ih)

    def test_the_shipped_file_is_written_again_to_the_byte(self, model: SensorModel, tmp_path) -> None:
        write_sensor_model(model, tmp_path / "m")
        assert (tmp_path / "m").read_bytes() == SHIPPED.read_bytes()

    def test_shipped_one_says_how_it_was_made(self, model: SensorModel) -> None:
        assert stored(SHIPPED)[1]["units"]["change"] == "dR/R, fraction"
        provenance = model.provenance
        assert provenance.recipe["seed"] == 0
        assert "random_small_s5" in provenance.held_out
        for path in sorted(CALIBRATION.glob("*.csv")):  # it is made of what examples/ holds
            assert provenance.data_sha256[path.name] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert provenance.recipe == json.loads(json.dumps(asdict(TrainingSettings())))
        assert "random_small_s5" not in provenance.trained_on

    @pytest.mark.parametrize(
        ("name", "value", "message"),
        [
            ("weight_hh", None, "'weight_hh' is missing"),
            ("bias", np.full(64, np.nan), "not finite"),
            ("weight_ih", np.zeros((64, 2)), r"expected the shape \(4 hidden, features\) = \(64, 6\), got \(64, 2\)"),
            ("weight_hh", np.zeros(64), r"tensor 'weight_hh': expected the shape"),
            ("bias", np.zeros(64, dtype=np.int64), "expected floating-point numbers, got int64"),
            ("head_bias", np.full(2, 1e300), "magnitudes of at most 1e"),
            ("curve_factor", np.zeros((20, 20)), r"\(terms, terms\) = \(21, 21\), got \(20, 20\)"),
            ("curve_scale", np.array([1.0, 1e-308, 1.0]), "expected at least 1e-06, got 1e-308"),
            ("curve_scale", np.ones(9), "expected 1 to 4 numbers, got 9"),
            ("curve_range", np.ones((2, 3)) * [[1], [0]], "the least values in the first row"),
            ("curve_coefficients", np.full(21, 100.0), "its curve gives strains from"),
            ("curve_factor", 1e3 * np.eye(21), "its curve gives a sigma of strain of"),
            ("mode_change", np.zeros(599), "each greater than the one before"),
            ("strain_knots", 1e3 * np.arange(8.0), "expected 0 to about ranges.strain, 0.689, got 0 to 7e"),
            ("bending_covariance", -np.eye(6), "without a negative eigenvalue"),
            (
                "bending",
                -np.eye(6)[4],
                "sensor model: bending curve: expected",
            ),
            ("golden_input", np.zeros((20, 6)), "its golden vector is off by"),
        ],
    )
    def test_unsound_files_are_refused(self, tmp_path, name, value, message) -> None:
        tensors, metadata = stored(SHIPPED)
        del tensors[name]
        if value is not None:
            tensors[name] = value
        save_file(tensors, tmp_path / "m", {"tensegraph": json.dumps(metadata)})
        with pytest.raises(InputError, match=message):
            read_sensor_model(tmp_path / "m")

    @pytest.mark.parametrize(
        ("name", "factor"),
        [("curve_coefficients", 2.2), ("curve_factor", 30.0), ("strain_knots", 0.25)],
    )
    def test_what_few_recordings_leave_uncertain_is_sound(self, tmp_path, name, factor) -> None:
        """Strips that are seldom stretched far, or not all of which stay stretched, give such curves."""
        tensors, metadata = stored(SHIPPED)
        save_file(tensors | {name: factor * tensors[name]}, tmp_path / "m", {"tensegraph": json.dumps(metadata)})
        assert read_sensor_model(tmp_path / "m").unified is False

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            ("memory_s", [2.0, -1.0, 50.0], r"metadata: memory_s\[1\]: .*greater than 0, got -1"),
            ("memory_s", [2.0, 10.0], r"= \(64, 5\), got \(64, 6\)"),
            ("lag_s", float("inf"), "metadata: lag_s: .*at most 60, got inf"),
            ("sigma_scale", [0.0, 0.0], r"sigma_scale\[0\]"),
            ("scaling", {"change": 0.0}, "scaling.change: .*greater than 0"),
            ("scaling", {"change_middle": float("nan")}, "scaling.change_middle: .*, got nan"),
            ("ranges", {"change": [1, 0], "rate_per_s": 1, "strain": [0, 1], "step_s": [0.01, 0.1]}, "ranges.change"),
            (
                "ranges",
                {"change": [0, 1], "rate_per_s": 1, "strain": [0, 0], "step_s": [0.01, 0.1]},
                "ranges.strain, 0,",
            ),
            ("format", 3, "metadata: expected a table with format = 2, got 3"),
        ],
    )
    def test_unsound_metadata_is_refused(self, tmp_path, key, value, message) -> None:
        tensors, metadata = stored(SHIPPED)
        save_file(tensors, tmp_path / "m", {"tensegraph": json.dumps(metadata | {key: value})})
        with pytest.raises(InputError, match=message) as error:
            read_sensor_model(tmp_path / "m")
        assert "\n" not in str(error.value)

    @pytest.mark.parametrize("text", ["[]", "null", "{}", "{", "[" * 100_000, "1" * 5000])
    def test_metadata_that_is_no_table_is_refused(self, tmp_path, text) -> None:
        save_file({"a": np.zeros(1)}, tmp_path / "m", {"tensegraph": text})
        with pytest.raises(InputError, match=r"is no model file: expected JSON|expected a table with format = 2, got"):
            read_sensor_model(tmp_path / "m")

    def test_a_file_too_large_to_be_a_model_is_not_mapped(self, tmp_path) -> None:
        path = tmp_path / "model.safetensors"
        path.touch()
        os.truncate(path, 1 << 30)
        with pytest.raises(InputError, match=r"expected at most 64 MiB, got 1024 MiB"):
            read_sensor_model(path)

    def test_what_is_no_model_is_refused(self, tmp_path) -> None:
        (tmp_path / "m").write_text("no model")
        with pytest.raises(InputError, match="is no model file"):
            read_sensor_model(tmp_path / "m")
        with pytest.raises(InputError, match="no such file"):
            read_sensor_model(tmp_path / "none")
        save_file({"a": np.zeros(1)}, tmp_path / "other")
        with pytest.raises(InputError, match="is no model file: expected the metadata 'tensegraph'"):
            read_sensor_model(tmp_path / "other")
