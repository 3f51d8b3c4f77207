"""What surrounds the training: files of any rig, the split, taring, baselines, scores, the bending fit."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tensegraph import InputError
from tensegraph.io.calibration_output import CalibrationPaths
from tensegraph.io.recording_files import read_recording, read_recordings, read_rig, rig_text
from tensegraph.models.calibration.bending_fit import fit_bending
from tensegraph.models.calibration.rate_curve_fit import fit_rate_curve
from tensegraph.models.calibration.recordings import Recording, Split
from tensegraph.models.calibration.strip_baselines import PolynomialEstimator, StaticEstimator
from tensegraph.models.calibration.strip_gains import StripGain, StripGainSearch, tare_strips
from tensegraph.models.calibration.strip_rig import StripRig
from tensegraph.models.calibration.strip_scores import StripScore, by_speed, correlation_time_s
from tensegraph.models.calibration.strips import StripRun, run_strips
from tensegraph.models.sensor.bending import COEFFICIENTS, FoldedPolynomial
from tensegraph.models.sensor.gauge import StaticGauge
from tensegraph.models.sensor.rate_curve import RateCurve, product_indices
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.sensor.stretching import Extrapolation
from tensegraph.models.values.correlation import autocorrelation_of, correlation_samples

T_S = np.arange(0, 60, 0.05)


def triangle(name: str, speed: float, high: float = 0.2, t_s=T_S, gain: float = 1.0, offset: float = 0.0) -> Recording:
    """Strain up and down at one speed; dR/R = offset + gain strain."""
    strain = np.sign(high) * np.abs((speed * t_s + abs(high)) % (2 * abs(high)) - abs(high))
    return Recording(name, t_s, strain, offset + gain * strain)


class TestRig:
    def folder(self, tmp_path, rig: str, rows: str, name: str = "a.csv"):
        (tmp_path / "rig.toml").write_text(rig)
        (tmp_path / name).write_text(rows)
        return tmp_path / name, read_rig(tmp_path / "rig.toml")

    def test_its_text_makes_the_same_rig(self, tmp_path) -> None:
        rig = read_rig(Path(__file__).parent.parent / "examples" / "cb_silicone_rig.toml")
        (tmp_path / "rig.toml").write_text(rig_text(rig))
        assert rig.gauge_length_mm == 40
        assert read_rig(tmp_path / "rig.toml") == rig

    def test_no_header_two_clocks_displacement_by_hand(self, tmp_path) -> None:
        """4 mm of 40 mm is 0.1; read 0.5 s after the resistance, at 10 Hz: half a row between, in interpolation."""
        rig = """gauge_length_mm = 40.0
            natural_resistance_ohm = "start"
            magnitude = true
            [columns]
            time = 1
            resistance = 2
            strain_time = 3
            displacement = 4
            [units]
            time = "ms"
            resistance = "kohm"
            """
        rows = "".join(f"{100 * k},-{1 + 0.001 * k},{100 * k + 50},{-0.01 * k}\n" for k in range(400))
        recording = read_recording(*self.folder(tmp_path, rig, rows))
        assert recording.t_s[0] == pytest.approx(0.1)  # at 0 s the strain is not known yet
        assert recording.strain[0] == pytest.approx(0.005 / 40)
        assert recording.strain[-1] == pytest.approx(3.985 / 40)
        first_second = np.mean([1 + 0.001 * k for k in range(1, 12)])
        assert recording.change[9] == pytest.approx(1.010 / first_second - 1)

    def test_mean_of_pairs_takes_an_alternating_source_out(self, tmp_path) -> None:
        rows = "t_s,strain,resistance_ohm\n" + "".join(f"{0.1 * k},0.1,{100 + (-1) ** k}\n" for k in range(400))
        rig = 'average = 2\nnatural_resistance_ohm = 50.0\n[units]\nstrain = "%"\n'
        recording = read_recording(*self.folder(tmp_path, rig, rows))
        np.testing.assert_allclose(recording.change[1:], 1.0)
        np.testing.assert_allclose(recording.strain, 0.001)

    @pytest.mark.parametrize(
        ("rig", "message"),
        [
            ("[columns]\ntimee = 'x'", "rig.toml: columns.timee: is no key of a rig"),
            ("[units]\ntime = 'h'", "rig.toml: units.time: "),
            ("[columns]\ndisplacement = 'd'", "rig.toml: gauge_length_mm: is missing"),
            ("[columns]\ntime = 1", "expected all by name or all by number"),
            ("average = 0", "rig.toml: average: "),
        ],
    )
    def test_a_rig_that_can_not_be_is_one_line(self, tmp_path, rig, message) -> None:
        (tmp_path / "rig.toml").write_text(rig)
        with pytest.raises(InputError) as error:
            read_rig(tmp_path / "rig.toml")
        assert message in str(error.value)
        assert "\n" not in str(error.value)

    @pytest.mark.parametrize(
        ("edit", "message"),
        [
            (lambda rows: rows[1:], "a.csv: row 1: expected '# natural_resistance_ohm = NUMBER'"),
            (lambda rows: [rows[0].replace("100", "-1"), *rows[1:]], "a.csv: row 1: natural_resistance_ohm: expected"),
            (
                lambda rows: [*rows[:9], "0.7,0.1,x\n", *rows[10:]],
                "a.csv: row 10, column resistance_ohm: expected a fin",
            ),
            (lambda rows: [*rows[:9], "0.1,0.1,9\n", *rows[10:]], "a.csv: row 10, column t_s: expected a later stamp"),
            (
                lambda rows: [*rows[:9], "0.7,0.1,0\n", *rows[10:]],
                "a.csv: row 10, column resistance_ohm: expected a res",
            ),
            (
                lambda rows: [rows[0], rows[1].replace("strain", "s"), *rows[2:]],
                "a.csv: row 2: column 'strain' is miss",
            ),
            (lambda rows: rows[:40], "a.csv: expected at least 30 s of resistance and strain, got 3.7"),
        ],
    )
    def test_a_bad_file_is_named_with_row_and_column(self, tmp_path, edit, message) -> None:
        rows = ["# natural_resistance_ohm = 100\n", "t_s,strain,resistance_ohm\n"]
        rows += [f"{0.1 * k:.1f},0.1,100\n" for k in range(400)]
        (tmp_path / "a.csv").write_text("".join(edit(rows)))
        with pytest.raises(InputError, match=r"a\.csv") as error:
            read_recording(tmp_path / "a.csv", StripRig())
        assert message in str(error.value)

    def test_one_good_file_of_ten_serves_and_nine_are_named(self, tmp_path) -> None:
        good = "# natural_resistance_ohm = 100\nt_s,strain,resistance_ohm\n"
        good += "".join(f"{0.1 * k:.1f},0.1,100\n" for k in range(400))
        for k in range(10):
            (tmp_path / f"r{k}.csv").write_text(good if k == 3 else good.replace("# natural", "natural"))
        found = read_recordings(tmp_path, StripRig())
        assert [r.name for r in found.recordings] == ["r3"]
        assert list(found.sha256) == ["r3.csv"]
        assert [line.split("/")[-1].split(":")[0] for line in found.left_out] == [
            f"r{k}.csv" for k in range(10) if k != 3
        ]


class TestSplit:
    def test_speed_of_a_recording(self) -> None:
        assert triangle("a", 0.05).speed_per_s == pytest.approx(0.05)
        rng = np.random.default_rng(0)
        wandering = Recording("b", T_S, np.interp(T_S, np.arange(61), rng.uniform(0, 0.2, 61)), T_S)
        assert np.isnan(wandering.speed_per_s)

    def test_the_middle_speed_is_held_out_whole(self) -> None:
        recordings = [triangle(f"s{speed}_{k}", speed) for speed in (0.01, 0.05, 0.2) for k in range(2)]
        split = Split.by_recordings(recordings)
        assert [r.name for r in split.held_out] == ["s0.05_0", "s0.05_1"]
        assert not {r.name for r in split.training} & {r.name for r in split.held_out}

    def test_one_recording_is_split_in_time(self) -> None:
        """70 % of 60 s train and validate, the last 15 % of these validate; no sample does two things."""
        split = Split.by_recordings([triangle("only", 0.05)])
        (training,), (validation,), (held_out,) = split.training, split.validation, split.held_out
        assert training.t_s[-1] <= validation.scored_from_s < validation.t_s[-1] <= held_out.scored_from_s
        assert held_out.scored_from_s == pytest.approx(0.7 * 60, abs=0.1)
        assert validation.scored_from_s == pytest.approx(0.85 * 0.7 * 60, abs=0.1)

    @given(st.integers(1, 30), st.integers(1, 4))
    def test_no_recording_is_used_twice(self, irregular: int, speeds: int) -> None:
        rng = np.random.default_rng(irregular)
        t_s = np.arange(0, 40, 0.5)
        recordings = [
            Recording(f"r{k:02}", t_s, np.interp(t_s, np.arange(41), rng.uniform(0, 0.2, 41)), t_s)
            for k in range(irregular)
        ]
        recordings += [triangle(f"s{k}", 0.01 * 2**k, t_s=t_s) for k in range(speeds)]
        split = Split.by_recordings(recordings)
        for r in split.held_out:
            before = [x for x in (*split.training, *split.validation) if x.name == r.name]
            assert all(x.t_s[-1] <= r.scored_from_s for x in before)
        for r in split.validation:
            assert all(x.t_s[-1] <= r.scored_from_s for x in split.training if x.name == r.name)
        assert split.training
        assert split.held_out

    def test_a_pattern_that_fits_nothing_is_refused(self) -> None:
        with pytest.raises(InputError, match=r"--hold-out x\*: fits no recording"):
            Split.by_name([triangle("a", 0.05)], ["x*"])
        with pytest.raises(InputError, match="no recording of stretching to train on"):
            Split.by_name([triangle("a", 0.05)], ["a"])


class TestTare:
    gauge = StaticGauge(np.array([0.0, 0.2]), np.array([0.0, 0.2]), 0.05, 0.003)

    def test_sigma_left_by_hand(self) -> None:
        """d strain / d (gain, offset) = (y, 1) / slope: with y = 0.1, slope 2, sigmas 0.04 and 0.003: 0.0025."""
        tare = StripGain(np.array([1.0, 0.0]), np.diag([0.04**2, 0.003**2]))
        assert tare.sigma(np.array(0.1), np.array(2.0)) == pytest.approx(np.hypot(0.004, 0.003) / 2)

    @given(st.floats(0.9, 1.1), st.floats(-0.005, 0.005))
    def test_first_seconds_tell_gain_and_offset(self, gain: float, offset: float) -> None:
        """A static strip on its own curve: found to within three sigmas, and sigma is less than before."""
        estimator = StaticEstimator(np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), 0.002)
        tare = tare_strips(estimator, [triangle("a", 0.1, gain=gain, offset=offset)], self.gauge)["a"]
        sigma = np.sqrt(np.diag(tare.covariance))
        assert (sigma < [0.05, 0.003]).all()
        assert (np.abs(tare.gain_and_offset - [gain, offset]) < 3 * sigma).all()

    def test_a_step_that_makes_things_worse_is_halved(self) -> None:
        """atan(x) = 0 from x = 2: Newton's step leads to -3.5, and on to -13.9, 280, ..."""
        search = StripGainSearch(StripGain(np.array([2.0, 0.0]), np.eye(2)))
        for _ in range(30):
            x, y = 20 * search.next_try  # so that the limit on a step does not hide it
            error, slopes = np.array([np.arctan(x), y]), 20 * np.array([1 / (1 + x**2), 1.0])
            search.take(float(error @ error), slopes * error, np.diag(slopes**2))
        np.testing.assert_allclose(search.best.gain_and_offset, 0, atol=1e-6)

    def test_what_was_trained_on_keeps_its_tare_and_early_samples_do_not_score(self) -> None:
        estimator = StaticEstimator(np.array([-0.5, 0.5]), np.array([-0.5, 0.5]), 0.002)
        r = triangle("a", 0.1, gain=1.2)
        known = {"a": StripGain(np.array([1.2, 0.0]), np.zeros((2, 2)))}
        (run,) = run_strips(estimator, [r], self.gauge, known)
        np.testing.assert_allclose(run.error, 0, atol=1e-12)
        np.testing.assert_allclose(run.sigma, 0.002)
        assert run.t_s[0] == pytest.approx(10.0)


class TestBaselines:
    def test_static_curve_is_monotone_and_undoes_a_square(self) -> None:
        strain = 0.1 - 0.1 * np.cos(0.5 * T_S)
        curve = StaticEstimator.fit([Recording("a", T_S, strain, strain**2)], signed=False)
        assert (np.diff(curve.strain) >= 0).all()
        np.testing.assert_allclose(np.interp(0.01, curve.change, curve.strain), 0.1, atol=2e-3)

    def test_polynomial_knows_rates(self) -> None:
        """dR/R = strain + 0.3 d(strain)/dt: a static curve can not, the polynomial can."""
        strain = 0.1 - 0.05 * np.cos(0.7 * T_S) - 0.05 * np.cos(1.9 * T_S)
        r = Recording("a", T_S, strain, strain + 0.3 * np.gradient(strain, T_S))
        static, polynomial = (kind.fit([r], signed=False) for kind in (StaticEstimator, PolynomialEstimator))
        assert polynomial.sigma < 0.2 * static.sigma
        followed = polynomial.follow(r.change[:, None], np.full((len(T_S), 1), 0.05))
        settled = r.settled
        assert np.std(followed.strain[settled, 0] - strain[settled]) == pytest.approx(polynomial.sigma, rel=1e-6)


class TestRateCurve:
    gauge = StaticGauge(np.array([0.0, 0.1, 0.4]), np.array([0.0, 0.1, 0.3]), 0.05, 0.003)

    def fitted(self) -> tuple[Recording, RateCurve]:
        strain = 0.1 - 0.05 * np.cos(0.7 * T_S) - 0.05 * np.cos(1.9 * T_S)
        r = Recording("a", T_S, strain, strain + 0.3 * np.gradient(strain, T_S))
        return r, fit_rate_curve([r], self.gauge, np.array([0.3, 2.0]), signed=False)

    def test_knows_rates(self) -> None:
        r, curve = self.fitted()
        error = (curve.strain(r.change, r.running_means(curve.memory_s)) - r.strain)[r.settled]
        assert np.std(error) < 0.2 * np.std((self.gauge.stretched_strain(r.change) - r.strain)[r.settled])

    def test_one_coefficient_by_hand(self) -> None:
        """Of the products of 1, y and y - m, only the one of y - m counts: 0.5 (y - m) / 0.2; w = 1."""
        products = product_indices(2).tolist()
        coefficients = np.zeros(len(products) + 1)
        coefficients[products.index([0, 0, 2])], coefficients[-1] = 0.5, 1.0
        curve = RateCurve(
            self.gauge,
            np.array([2.0]),
            np.array([1.0, 0.2]),
            np.array([[0.0, -1.0], [0.3, 1.0]]),
            coefficients,
            np.diag(0.01 * (coefficients > 0)),
        )
        assert curve.sigma(np.array(0.2), np.array([0.16])) == pytest.approx(np.hypot(0.01 * 0.2, 0.01 * 0.25))
        assert curve.strain(np.array(0.2), np.array([0.16])) == pytest.approx(0.25 + 0.1)

    def test_is_unsure_where_no_recording_reached(self) -> None:
        r, curve = self.fitted()
        means = r.running_means(curve.memory_s)
        inside = curve.sigma(r.change, means)[r.settled]
        assert curve.sigma(np.array(0.1), np.array([0.4, 0.4])) > 10 * np.median(inside)

    @given(st.floats(0.01, 0.2))
    def test_goes_on_as_the_static_curve_does_beyond_its_range(self, farther: float) -> None:
        _, curve = self.fitted()
        end = curve.range[1, 0]
        means = np.full(2, end)
        beyond = curve.strain(np.array(end + farther), means + farther) - curve.strain(np.array(end), means)
        static = self.gauge.stretched_strain(end + farther) - self.gauge.stretched_strain(end)
        assert beyond == pytest.approx(static, abs=1e-9)


def a_run(error, sigma=0.01, speed: float = float("nan"), name: str = "a") -> StripRun:
    error = np.asarray(error, dtype=np.float64)
    n = len(error)
    strain, zeros = np.linspace(0, 0.1, n), np.zeros(n)
    sigmas = np.full(n, sigma)
    flags = np.zeros(n, dtype=bool)
    t_s = 0.1 * np.arange(n)
    return StripRun(name, speed, t_s, strain, strain, zeros, strain + error, sigmas, zeros, sigmas, zeros, flags)


class TestScores:
    def test_by_hand(self) -> None:
        """Errors 0, 0.01, -0.02, 0.03 at sigma 0.011: RMSE sqrt(0.0014 / 4), two inside one sigma, three in 1.96."""
        score = StripScore.of([a_run([0, 0.01, -0.02, 0.03], 0.011)])
        assert score.rmse == pytest.approx(np.sqrt(0.0014 / 4))
        assert score.coverage_68 == 0.5
        assert score.coverage_95 == 0.75
        assert score.r2 == pytest.approx(1 - (0.0014 / 4) / np.var(np.linspace(0, 0.1, 4)))

    def test_correlation_time_of_a_decaying_error(self) -> None:
        """An AR(1) error of phi = exp(-0.1 / 2) at 0.1 s is down to 1/e after 2 s."""
        rng, error = np.random.default_rng(1), np.zeros(20000)
        for k in range(1, len(error)):
            error[k] = np.exp(-0.05) * error[k - 1] + rng.standard_normal()
        assert correlation_time_s(a_run(error)) == pytest.approx(2.0, rel=0.15)

    def test_groups_go_by_speed(self) -> None:
        runs = [a_run([0.0, 1.0], name="x"), a_run([0.0, 1.0], speed=0.2), a_run([0.0, 1.0], speed=0.0501)]
        assert list(by_speed(runs)) == ["speed 0.05 /s", "speed 0.2 /s", "irregular motion"]

    def test_autocorrelation_against_its_definition(self) -> None:
        x = np.random.default_rng(2).standard_normal(50)
        expected = [np.sum(x[: 50 - k] * x[k:]) / np.sum(x**2) for k in range(50)]
        np.testing.assert_allclose(autocorrelation_of(x), expected, atol=1e-12)
        assert correlation_samples(np.ones(100)) == pytest.approx(100)


class TestBendingFit:
    T_S = np.arange(0, 200, 0.05)

    def recording(self, noise: float = 0.0, seed: int = 0) -> Recording:
        """A static strip that follows eq. (9), less its constant, bent by 0.8 and back."""
        strain = triangle("bend", 0.02, high=-0.8, t_s=self.T_S).strain
        change = np.polyval([*COEFFICIENTS[:-1], 0.0], strain)
        return Recording(
            "bend", self.T_S, strain, change + noise * np.random.default_rng(seed).standard_normal(len(change))
        )

    def test_eq_9_is_found_again(self) -> None:
        """Up to the lag that is undone but was not there, 0.2 s of 0.02 /s: the curve runs between the branches."""
        recording = self.recording()
        fit = fit_bending([recording], [recording])
        assert fit is not None
        strain = np.linspace(-0.8, 0, 50)
        expected = np.polyval([*COEFFICIENTS[:-1], 0.0], strain)
        np.testing.assert_allclose(np.polyval(fit.coefficients, strain), expected, atol=0.005)
        assert fit.r2 > 0.9995
        assert fit.held_out_r2 == pytest.approx(fit.r2, abs=1e-6)
        assert fit.curve().polynomial.x_fold == pytest.approx(FoldedPolynomial().x_fold, abs=0.01)

    def test_covariance_is_no_less_than_what_noise_does(self) -> None:
        """Against the spread of the coefficients over 40 noisy recordings."""
        fits = [fit_bending([self.recording(0.01, seed)], []) for seed in range(40)]
        coefficients, covariances = zip(*[(fit.coefficients, fit.covariance) for fit in fits if fit], strict=True)
        spread = np.std(coefficients, axis=0)
        expected = np.mean([np.sqrt(np.diag(covariance)) for covariance in covariances], axis=0)
        assert (expected > 0.8 * spread).all()
        assert (expected < 4 * spread).all()

    def test_without_bending_there_is_none(self) -> None:
        assert fit_bending([triangle("a", 0.05)], []) is None

    def test_a_curve_without_a_fold_inverts_up_to_zero(self) -> None:
        straight = FoldedPolynomial([0, 0, 0, 0, 2.0, 0])
        assert straight.x_fold == 0
        assert straight.inverse(-0.5) == pytest.approx(-0.25, abs=1e-6)


class TestExtrapolation:
    def test_widens_at_once_and_forgets_slowly(self, model: SensorModel) -> None:
        """Twice the fastest trained rate doubles sigma; after 3 s of rest 1 + 1/e is left of that."""
        outside, still = Extrapolation(model, 1), np.zeros(1)
        factor, extra, beyond = outside.step(still, np.array([2 * model.ranges.rate_per_s]), still, 0.1)
        assert factor[0] == pytest.approx(2.0)
        assert beyond[0]
        assert extra[0] == 0
        factor, _, beyond = outside.step(still, still, still, 3.0)
        assert factor[0] == pytest.approx(1 + np.exp(-1))
        assert not beyond[0]

    def test_strain_faster_than_trained_adds_the_lag_times_the_excess(self, model: SensorModel) -> None:
        """Steady strain at the fastest trained rate and 0.1 /s more: sigma 0.4 s * 0.1 /s on top."""
        outside, still, rate = Extrapolation(model, 1), np.zeros(1), model.ranges.strain_rate_per_s + 0.1
        for k in range(200):
            factor, extra, beyond = outside.step(still, still, np.array([rate * 0.02 * k]), 0.02)
        assert factor[0] == 1
        assert extra[0] == pytest.approx(0.04, rel=0.01)
        assert beyond[0]

    def test_grows_with_the_distance_beyond_the_trained_change(self, model: SensorModel) -> None:
        outside, still = Extrapolation(model, 1), np.zeros(1)
        far = np.array([model.ranges.change[1] + 0.3])
        strain = model.gauge.stretched_strain(far)
        _, extra, beyond = outside.step(far, still, strain, 0.02)
        assert beyond[0]
        assert extra[0] == pytest.approx(0.3 / model.gauge.slope(strain)[0])


class TestOutput:
    def test_nothing_is_half_written(self, tmp_path) -> None:
        paths = CalibrationPaths(tmp_path / "m.safetensors")
        paths.checkpoint.write_text("state")
        with pytest.raises(RuntimeError, match="stop"), paths.written_whole() as inside:  # noqa: PT012
            inside.card.write_text("half")
            raise RuntimeError("stop")
        assert [p.name for p in tmp_path.iterdir()] == ["m.checkpoint"]
        with paths.written_whole() as inside:
            inside.card.write_text("card")
            inside.model.write_text("model")
        assert sorted(p.name for p in tmp_path.iterdir()) == ["m.md", "m.safetensors", "m_figures"]

    def test_what_is_not_ours_is_not_replaced(self, tmp_path) -> None:
        (tmp_path / "m_figures").mkdir()
        (tmp_path / "m_figures" / "thesis.txt").write_text("mine")
        for name, message in [
            ("m.safetensors", "holds more"),
            ("m.pt", r"ends in \.safetensors"),
            ("x/m.safetensors", "no such"),
        ]:
            with pytest.raises(InputError, match=message):
                CalibrationPaths(tmp_path / name).check()
