"""The sensor equations: divider, eq. (9), the LSTM of eqs. (10)-(15), taring, and the front end as a whole."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import save_file

from tensegraph import Flag, InputError, Mode
from tensegraph.io.model_file import read_sensor_model, write_sensor_model
from tensegraph.models.calibration.recipe import TrainingSettings
from tensegraph.models.sensor.bending import BendingCurve, FoldedPolynomial
from tensegraph.models.sensor.divider import Divider
from tensegraph.models.sensor.drift import DriftSettings, ReferenceTendons
from tensegraph.models.sensor.front_end import FrontEnd, FrontEndSettings
from tensegraph.models.sensor.gauge import StaticGauge
from tensegraph.models.sensor.lstm import Lstm, LstmState, LstmWeights
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.sensor.stretching import StrainSpread, StretchingSensors
from tensegraph.models.sensor.taring import Taring
from tensegraph.models.values.readings import ResistanceFrame, RestLengths

KNOWN_OHM = 5.8e6
CALIBRATION = Path(__file__).parents[1] / "examples" / "calibration"
SHIPPED = Path(__file__).parents[1] / "models" / "data" / "stretching.safetensors"


class TestDivider:
    def test_by_hand(self) -> None:
        """Code 511 of 1024: 511.5 / 512.5 to ground, its inverse to the supply; sigma (R + Rk)^2 / (Rk N sqrt 12)."""
        ground, supply = Divider(10, KNOWN_OHM, "ground"), Divider(10, KNOWN_OHM, "supply")
        codes = np.array([511])
        assert ground.resistance_ohm(codes)[0] == pytest.approx(KNOWN_OHM * 511.5 / 512.5)
        assert supply.resistance_ohm(codes)[0] == pytest.approx(KNOWN_OHM * 512.5 / 511.5)
        assert ground.sigma_ohm(np.array([KNOWN_OHM]))[0] == pytest.approx(4 * KNOWN_OHM / (1024 * np.sqrt(12)))

    @given(st.integers(1, 1022), st.sampled_from(["ground", "supply"]))
    def test_resistance_lies_in_its_bounds(self, code: int, side) -> None:
        divider = Divider(10, KNOWN_OHM, side)
        low, high = divider.bounds_ohm(np.array([code]))
        assert low[0] < divider.resistance_ohm(np.array([code]))[0] < high[0]

    @given(st.floats(0.01, 100))
    def test_code_of_a_resistance_gives_it_back(self, ratio: float) -> None:
        divider = Divider(16, KNOWN_OHM, "ground")
        code = np.array([int(ratio / (1 + ratio) * divider.codes)])
        error = divider.resistance_ohm(code)[0] - ratio * KNOWN_OHM
        assert abs(error) <= np.sqrt(12) * divider.sigma_ohm(np.array([ratio * KNOWN_OHM]))[0]

    def test_end_codes_are_bounds_on_one_side(self) -> None:
        divider = Divider(10, KNOWN_OHM, "ground")
        codes = np.array([0, 1, 1022, 1023])
        assert divider.saturated(codes).tolist() == [True, False, False, True]
        low, high = divider.bounds_ohm(codes)
        assert low[0] == 0
        assert np.isfinite(high[0])
        assert np.isinf(high[3])
        assert np.isfinite(low[3])

    @pytest.mark.parametrize("arguments", [(0, 1.0, "ground"), (10, 0.0, "ground"), (10, np.nan, "supply")])
    def test_impossible_ones_are_refused(self, arguments) -> None:
        with pytest.raises(InputError, match="expected"):
            Divider(*arguments)


class TestBending:
    def test_fold_by_hand(self) -> None:
        """x_c solves f' = 0 and y_c = f(x_c): -0.0300747 and 0.0063545, less f(0) = -0.0016."""
        polynomial = FoldedPolynomial()
        assert polynomial.x_fold == pytest.approx(-0.0300747283, abs=1e-9)
        assert polynomial.y_fold - 0.0016 == pytest.approx(0.0063544826, abs=1e-9)

    @given(st.floats(-1.0, -0.0301))
    def test_inverse_undoes_it(self, x: float) -> None:
        polynomial = FoldedPolynomial()
        assert polynomial.inverse(polynomial.value(x)) == pytest.approx(x, abs=1e-9)

    def test_slope(self, check_jacobian) -> None:
        polynomial, x = FoldedPolynomial(), np.linspace(-0.95, -0.05, 9)
        check_jacobian(polynomial.value, np.diag(polynomial.slope(x)), x)

    def test_sigma_is_finite_at_the_fold_and_linear_away_from_it(self) -> None:
        curve = BendingCurve()
        _, sigma = curve.strain(np.array([-0.5, curve.polynomial.y_fold]), 0.004)
        assert sigma[0] == pytest.approx(0.004 / curve.polynomial.slope(curve.polynomial.inverse(-0.5)), rel=1e-6)
        assert sigma[1] == pytest.approx(np.sqrt(0.004 / 8.23), rel=1e-3)

    @pytest.mark.parametrize("abscissa", ["strain", "resistance"])
    def test_both_readings_go_there_and_back(self, abscissa) -> None:
        curve, strain = BendingCurve(abscissa), np.array([-0.8, -0.4, -0.1])
        np.testing.assert_allclose(curve.strain(curve.change(strain), 0.001)[0], strain, atol=1e-6)

    def test_the_two_readings_differ(self) -> None:
        """At dR/R = -0.5: strain -0.434 (x = strain) and -0.574 (x = dR/R), up to the constant term."""
        assert BendingCurve("strain").strain(-0.5, 0.01)[0] == pytest.approx(-0.434, abs=2e-3)
        assert BendingCurve("resistance").strain(-0.5, 0.01)[0] == pytest.approx(-0.574, abs=2e-3)

    def test_range(self) -> None:
        assert BendingCurve().in_range([-0.94, -0.95]).tolist() == [True, False]


class TestLstm:
    def test_one_step_by_hand(self) -> None:
        """One unit, weights 0, biases (i, f, g, o) = (0, 0, 1, 0): c = c/2 + tanh(1)/2, h = tanh(c)/2."""
        lstm = Lstm(
            LstmWeights(
                np.zeros((4, 1)), np.zeros((4, 1)), np.array([0, 0, 1.0, 0]), np.array([[2.0]]), np.array([3.0])
            )
        )
        output, state = lstm.step(np.array([[7.0]]), LstmState(np.array([[0.1]]), np.array([[0.4]])))
        c = 0.2 + 0.5 * np.tanh(1)
        assert state.c[0, 0] == pytest.approx(c)
        assert output[0, 0] == pytest.approx(2 * 0.5 * np.tanh(c) + 3)

    def test_equals_torch(self) -> None:
        torch = pytest.importorskip("torch")
        torch.manual_seed(3)
        reference, head = torch.nn.LSTM(3, 5, batch_first=True).double(), torch.nn.Linear(5, 2).double()
        weights = {name: p.detach().numpy() for name, p in reference.named_parameters()}
        lstm = Lstm(
            LstmWeights(
                weights["weight_ih_l0"],
                weights["weight_hh_l0"],
                weights["bias_ih_l0"] + weights["bias_hh_l0"],
                head.weight.detach().numpy(),
                head.bias.detach().numpy(),
            )
        )
        x = np.random.default_rng(4).standard_normal((6, 50, 3))
        with torch.no_grad():
            expected = head(reference(torch.tensor(x))[0]).numpy()
        state, outputs = lstm.initial_state(6), []
        for k in range(50):
            output, state = lstm.step(x[:, k], state)
            outputs.append(output)
        np.testing.assert_allclose(np.stack(outputs, axis=1), expected, atol=1e-12)


def stored(path):
    """Return the tensors and the metadata of a model file as they stand."""
    with safe_open(path, framework="numpy") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, json.loads(file.metadata()["tensegraph"])  # noqa: SIM118


class TestSensorModel:
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

    def test_a_changed_weight_is_noticed(self, model: SensorModel) -> None:
        weights = replace(model.network.weights, bias=model.network.weights.bias + 1e-3)
        with pytest.raises(InputError, match="golden vector is off"):
            replace(model.network, weights=weights)

    @pytest.mark.parametrize(
        ("name", "value", "message"),
        [
            ("weight_hh", None, "'weight_hh' is missing"),
            ("bias", np.full(64, np.nan), "not finite"),
            ("weight_ih", np.zeros((64, 2)), "do not fit together"),
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

    def test_what_is_no_model_is_refused(self, tmp_path) -> None:
        (tmp_path / "m").write_text("no model")
        with pytest.raises(InputError, match="is no model file"):
            read_sensor_model(tmp_path / "m")
        with pytest.raises(InputError, match="no such file"):
            read_sensor_model(tmp_path / "none")
        save_file({"a": np.zeros(1)}, tmp_path / "other")
        with pytest.raises(InputError, match="expected format"):
            read_sensor_model(tmp_path / "other")

    def test_settled_sensors_stay(self, model: SensorModel) -> None:
        sensors, change = StretchingSensors(model, 2), np.array([0.05, 0.12])
        settled = sensors.settle(change, np.array([True, True]), 0.1)
        for _ in range(200):
            strain, sigma = sensors.step(change, np.zeros(2), 0.1)
        np.testing.assert_allclose(strain, settled, atol=5e-4)
        assert (sigma > 0).all()

    def test_same_motion_at_any_rate_gives_the_same_strain(self, model: SensorModel) -> None:
        """The true time step is an input: a slow stretch read at 10, 25 and 100 Hz ends at about the same strain."""
        ends = []
        for rate_hz in (10, 25, 100):
            sensors, step_s = StretchingSensors(model, 1), 1 / rate_hz
            sensors.settle(np.array([0.05]), np.array([True]), step_s)
            for t_s in np.arange(0, 4, step_s):
                strain, _ = sensors.step(np.array([0.05 + 0.015 * t_s]), np.array([0.015]), step_s)
            ends.append(strain[0])
        assert np.ptp(ends) < 0.004

    def test_spread_is_a_running_deviation(self) -> None:
        spread = StrainSpread(1)
        values = [spread.step(np.array([x]), 0.1)[0] for x in np.tile([0.0, 0.1], 5000)]
        assert values[0] == 0
        assert values[-1] == pytest.approx(0.05, rel=0.01)


def a_gauge() -> StaticGauge:
    return StaticGauge(np.array([0.0, 0.1, 0.2]), np.array([0.0, 0.1, 0.3]), 0.06, 0.003)


class TestTaring:
    def test_splits_between_gain_and_offset_by_hand(self) -> None:
        """At strain 0.1, g = 0.1: gain variance 0.006^2, offset 0.003^2, strain 0, so 4/5 of 0.02 is gain."""
        taring = Taring(a_gauge(), BendingCurve(), RestLengths(1.0, np.array([1.1]), np.array([1e-9])), np.array([1.0]))
        common = taring.common_change(0.0, np.array([0.12]))
        assert taring.gain[0] == pytest.approx(1 + 0.016 / 0.1)
        assert taring.offset[0] == pytest.approx(0.004)
        assert common[0] == pytest.approx(0.1)

    def test_learns_at_rest_only_and_skips_gaps(self) -> None:
        taring = Taring(a_gauge(), BendingCurve(), RestLengths(1.0, np.full(2, 1.1), np.full(2, 1e-4)), np.ones(2))
        taring.common_change(10.0, np.array([0.11, np.nan]))
        assert taring.tared.tolist() == [True, False]
        gain = taring.gain.copy()
        taring.common_change(11.5, np.array([0.5, 0.5]))
        np.testing.assert_array_equal(taring.gain, gain)
        assert taring.gain[1] == 1

    def test_untared_sensors_are_trusted_less(self) -> None:
        gauge, bending = a_gauge(), BendingCurve()
        tared = Taring(gauge, bending, RestLengths(1.0, np.array([1.1]), np.array([1e-4])), np.array([1.0]))
        tared.common_change(0.0, np.array([0.1]))
        untared = Taring(gauge, bending, None, np.array([1.0]))
        strain, change = np.array([0.1]), np.array([0.1])
        assert tared.sigma(strain, change)[0] < untared.sigma(strain, change)[0]
        assert untared.sigma(strain, change)[0] == pytest.approx(np.hypot(0.006, 0.003) / 2)

    def test_exchanged_sensors_are_named_with_their_pair(self) -> None:
        """Natural resistances of 5 to 7 MOhm, all at strain 0.1; the channels of tendons 1 and 2 are exchanged."""
        rest = RestLengths(1.0, np.full(5, 1.1), np.full(5, 1e-4))
        taring, natural_ohm = Taring(a_gauge(), BendingCurve(), rest, np.ones(5)), 1e6 * np.array([5, 6, 7, 6, 5])
        read_ohm = 1.1 * natural_ohm[[0, 2, 1, 3, 4]]
        taring.common_change(0.0, read_ohm / natural_ohm - 1)
        assert np.flatnonzero(taring.misfit).tolist() == [1, 2]
        assert taring.exchanged(natural_ohm) == [(1, 2)]
        taring = Taring(a_gauge(), BendingCurve(), rest, np.ones(5))
        taring.common_change(0.0, np.array([0.1, 0.3, 0.09, 0.1, 0.1]))  # 1.3 of 6 MOhm is not 1.1 of 7
        assert np.flatnonzero(taring.misfit).tolist() == [1]
        assert taring.exchanged(natural_ohm) == []

    def test_a_structure_that_did_not_rest_names_no_sensor(self) -> None:
        rest = RestLengths(1.0, np.full(4, 1.1), np.full(4, 1e-4))
        taring = Taring(a_gauge(), BendingCurve(), rest, np.ones(4))
        taring.common_change(0.0, np.array([0.1, 0.3, 0.3, 0.02]))
        assert taring.in_doubt
        assert not taring.misfit.any()


def front_end(model: SensorModel, count: int = 4, rest_strain: float | None = 0.08, **kwargs) -> FrontEnd:
    rest = (
        None
        if rest_strain is None
        else RestLengths(1.0, np.full(count, 0.17 * (1 + rest_strain)), np.full(count, 3e-4))
    )
    references = ReferenceTendons(np.empty(0, dtype=np.int64), DriftSettings())
    lengths_m = np.full(count, 0.17)
    return FrontEnd(model, np.full(count, 6e6), lengths_m, rest, FrontEndSettings(**kwargs), 0.02, references)


def frame(k: int, change, flags=0) -> ResistanceFrame:
    change = np.broadcast_to(np.asarray(change, dtype=float), (4,))
    flags = np.where(np.isnan(change), int(Flag.MISSING), 0) | flags
    return ResistanceFrame(0.02 * k, 6e6 * (1 + change), np.full(4, 6e3), flags)


class TestFrontEnd:
    def test_rest_is_where_it_is_said_to_be(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(200):
            lengths = end.step(frame(k, [0.07, 0.08, 0.085, 0.1]))
        np.testing.assert_allclose(lengths.length_m, 0.17 * 1.08, atol=2e-4)
        assert (lengths.mode == Mode.STRETCHING).all()
        assert (lengths.flags == 0).all()

    def test_bending_is_found_and_left_again(self, model: SensorModel) -> None:
        end = front_end(model)
        path = np.concatenate([np.full(100, 0.08), np.linspace(0.08, -0.3, 100), np.full(150, -0.3)])
        path = np.concatenate([path, np.linspace(-0.3, 0.08, 100), np.full(300, 0.08)])
        lengths = [end.step(frame(k, y)) for k, y in enumerate(path)]
        assert (lengths[340].mode == Mode.BENDING).all()
        expected = BendingCurve().strain(-0.3, 0.01)[0]
        np.testing.assert_allclose(lengths[340].length_m / 0.17 - 1, expected, atol=0.03)
        assert (lengths[-1].mode == Mode.STRETCHING).all()

    def test_sigma_spans_both_modes_near_zero_strain(self, model: SensorModel) -> None:
        end = front_end(model, rest_strain=0.05)
        sure = [end.step(frame(k, 0.043)) for k in range(60)][-1]
        doubtful = [end.step(frame(k, -0.003)) for k in range(60, 160)][-1]
        assert (doubtful.flags & Flag.AMBIGUOUS).all()
        assert (doubtful.sigma_m > 3 * sure.sigma_m).all()

    @pytest.mark.parametrize("bad", [[np.nan], [np.nan] * 10, [np.nan] * 60])
    def test_gaps_never_poison_the_state(self, model: SensorModel, bad) -> None:
        clean, hurt = front_end(model), front_end(model)
        path = np.concatenate([np.full(100, 0.08), 0.08 + 0.03 * np.sin(np.linspace(0, 9, 600))])
        for k, y in enumerate(path):
            expected = clean.step(frame(k, y))
            change = np.full(4, y)
            if 300 <= k < 300 + len(bad):
                change[1] = np.nan
            lengths = hurt.step(frame(k, change))
            if np.isnan(change[1]):
                assert np.isnan(lengths.length_m[1])
                assert np.isinf(lengths.sigma_m[1])
                assert lengths.flags[1] & Flag.MISSING
        assert np.isfinite(lengths.length_m).all()
        assert abs(lengths.length_m[1] - expected.length_m[1]) < 0.0005
        np.testing.assert_allclose(lengths.length_m[[0, 2, 3]], expected.length_m[[0, 2, 3]], atol=1e-12)

    def test_a_sensor_back_from_a_long_gap_warms_up(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(100):
            end.step(frame(k, 0.08))
        for k in range(100, 200):
            end.step(frame(k, [0.08, np.nan, 0.08, 0.08]))
        back = end.step(frame(200, 0.08))
        assert back.flags[1] & Flag.WARMING_UP
        assert back.sigma_m[1] > 2 * back.sigma_m[0]
        assert back.flags[0] == 0

    def test_readings_beyond_training_are_flagged_and_widened(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(60):
            usual = end.step(frame(k, 0.08))
        beyond = [end.step(frame(k, y)) for k, y in enumerate(np.linspace(0.08, 2.6, 200), start=60)][-1]
        assert (beyond.flags & Flag.OUT_OF_RANGE).all()
        assert (beyond.sigma_m > 10 * usual.sigma_m).all()

    def test_too_fast_is_flagged_and_widened(self, model: SensorModel) -> None:
        end = front_end(model)
        for k in range(60):
            usual = end.step(frame(k, 0.08))
        fast = end.step(frame(60, 0.15))
        assert (fast.flags & Flag.TOO_FAST).all()
        assert (fast.sigma_m > 1.5 * usual.sigma_m).all()

    def test_without_rest_shape_all_sensors_warm_up(self, model: SensorModel) -> None:
        end = front_end(model, rest_strain=None)
        first, last = end.step(frame(0, 0.08)), [end.step(frame(k, 0.08)) for k in range(1, 600)][-1]
        assert (first.flags & Flag.WARMING_UP).all()
        assert not (last.flags & Flag.WARMING_UP).any()
        assert (last.sigma_m < first.sigma_m).all()

    def test_a_unified_network_measures_bent_tendons_too(self, model: SensorModel) -> None:
        """The same weights called unified: bent, the length is no longer the polynomial's; stretched it is the same."""
        unified = replace(model, unified=True)
        split_end, unified_end = front_end(model), front_end(unified)
        for k, y in enumerate(np.linspace(0.08, -0.4, 200)):
            split, one = split_end.step(frame(k, y)), unified_end.step(frame(k, y))
            if k == 20:
                np.testing.assert_array_equal(split.length_m, one.length_m)
        assert (one.mode == Mode.BENDING).all()
        assert (np.abs(split.length_m - one.length_m) > 1e-3).all()

    def test_a_model_without_bending_recordings_uses_the_paper_s_curve(self, model: SensorModel) -> None:
        bare = replace(model, bending=None)
        paper, own = bare.bending_curve("strain"), model.bending_curve("strain")
        assert paper.change(-0.4) == BendingCurve().change(-0.4)
        assert own.change(-0.4) != paper.change(-0.4)
        np.testing.assert_allclose(own.change([-0.2, -0.4, -0.7]), paper.change([-0.2, -0.4, -0.7]), atol=0.02)

    def test_both_readings_of_eq_9_run(self, model: SensorModel) -> None:
        ends = []
        for abscissa in ("strain", "resistance"):
            end = front_end(model, bending_abscissa=abscissa)
            ends.append([end.step(frame(k, y)) for k, y in enumerate(np.linspace(0.08, -0.5, 300))][-1].length_m[0])
        assert abs(ends[0] - ends[1]) > 0.005

    @settings(max_examples=15, deadline=None)
    @given(st.lists(st.floats(-0.99, 5.0) | st.just(float("nan")), min_size=5, max_size=60))
    def test_whatever_comes_lengths_are_finite_or_missing(self, path) -> None:
        end = front_end(read_sensor_model())
        for k, y in enumerate(path):
            lengths = end.step(frame(k, y))
            assert np.isfinite(lengths.length_m[0]) == np.isfinite(y)
            assert not np.isnan(lengths.sigma_m).any()
            assert (lengths.sigma_m > 0).all()
