"""Result directories, loaded as what they were saved from; frames by their time."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import tensegraph as tg
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.floor import EstimatedNormal
from tensegraph.models.structure.shape import OtherShape, Reason
from tensegraph.models.values.slip import Slip


@pytest.fixture(scope="module")
def kept(example):
    """Half a second of the example in batch, of which frame 3 has another shape."""
    trial = tg.open_trial(example)
    readings = (row for row in trial.readings() if row.host_s < 0.5)
    result = tg.Reconstruction.of(trial.description.structure, tg.stream(readings, trial.description, "batch"))
    others = [None] * len(result)
    others[3] = OtherShape(np.round(result.node_position_m[3] + 0.01, 6), 1.25)
    doubts = (Reason.MOTION, *result.doubts[1:])
    return replace(result, others=tuple(others), doubts=doubts)


@pytest.fixture
def saved(kept, tmp_path):
    tg.save(kept, tmp_path / "run", figures=None)
    return tmp_path / "run"


class TestLoad:
    def test_returns_what_was_saved(self, kept, saved) -> None:
        read = tg.load(saved)
        np.testing.assert_allclose(read.t_s, kept.t_s, atol=1e-4)
        np.testing.assert_allclose(read.node_position_m, kept.node_position_m, atol=1e-6)
        np.testing.assert_allclose(read.node_covariance_m2, kept.node_covariance_m2, rtol=1e-8, atol=1e-16)
        for name in ("innovation_sigma_m", "mechanism_sigma_m", "length_m", "sigma_m", "drift"):
            np.testing.assert_allclose(getattr(read, name), getattr(kept, name), atol=1e-6, err_msg=name)
        np.testing.assert_array_equal(read.flags, kept.flags)
        free = kept.structure.free_nodes
        np.testing.assert_allclose(read.loads.force_n, kept.loads.force_n, atol=1e-4)
        np.testing.assert_allclose(read.loads.sigma_n[:, free], kept.loads.sigma_n[:, free], atol=1e-4)
        assert np.isnan(read.loads.force_n[:, kept.structure.anchors]).all()
        assert (read.status, read.doubts) == (kept.status, kept.doubts)
        np.testing.assert_array_equal(read.others[3].node_position_m, kept.others[3].node_position_m)
        assert [k for k, other in enumerate(read.others) if other] == [3]
        assert read.others[3].log_ratio == 1.25

    def test_one_frame_is_a_run(self, kept, tmp_path) -> None:
        tg.save(kept[0.2:0.21], tmp_path / "one", figures=None)
        read = tg.load(tmp_path / "one")
        assert len(read) == 1
        np.testing.assert_allclose(read.node_position_m[0], kept[0.2].node_position_m, atol=1e-6)

    def test_the_loads_of_a_frame_that_failed_are_not_known(self, kept, tmp_path) -> None:
        force_n, sigma_n = kept.loads.force_n.copy(), kept.loads.sigma_n.copy()
        force_n[2], sigma_n[2] = np.nan, np.inf
        tg.save(replace(kept, loads=ExternalLoads(force_n, sigma_n)), tmp_path / "failed", figures=None)
        read = tg.load(tmp_path / "failed").loads
        assert np.isnan(read.force_n[2]).all()
        assert np.isinf(read.sigma_n[2]).all()
        np.testing.assert_allclose(read.force_n[3], force_n[3], atol=1e-4)

    def test_without_loads(self, kept, tmp_path) -> None:
        tg.save(replace(kept, loads=None), tmp_path / "run", figures=None)
        assert tg.load(tmp_path / "run").loads is None

    def test_does_not_invent_covariances_between_nodes(self, saved) -> None:
        read = tg.load(saved)
        assert np.isnan(read.covariance_m2[:, 0:3, 3:6]).all()
        assert np.isfinite(read.covariance_m2[:, 9:12, 9:12]).all()
        assert np.isnan(read.centroid_covariance_m2).all()

    def test_needs_no_trial(self, kept, saved, tmp_path) -> None:
        shutil.move(saved, tmp_path / "elsewhere")
        structure = tg.load(tmp_path / "elsewhere").structure
        for name in ("rods", "tendons", "rod_length_m", "natural_length_m", "anchors", "anchor_position_m"):
            np.testing.assert_array_equal(getattr(structure, name), getattr(kept.structure, name))

    def test_saved_again_is_the_same(self, saved, tmp_path) -> None:
        tg.save(tg.load(saved), tmp_path / "again", figures=None)
        for name in ("shape.csv", "estimated_loads.csv", "other_shape.csv", "sensor_drift.csv"):
            assert (tmp_path / "again" / name).read_bytes() == (saved / name).read_bytes(), name

    def test_slips_are_those_of_their_frames(self, kept, tmp_path) -> None:
        slip = Slip(float(kept.t_s[4]), 7, np.array([0.003, 0.0, -0.004]), 0.002)
        slips = tuple((slip,) if frame == 4 else () for frame in range(len(kept)))
        tg.save(replace(kept, contacts=np.ones((len(kept), 12)), slips=slips), tmp_path / "run", figures=None)
        read = tg.load(tmp_path / "run")
        assert [len(found) for found in read.slips] == [len(found) for found in slips]
        (found,) = read.slips[4]
        assert (found.node, found.sigma_m, found.way_m.tolist()) == (7, 0.002, [0.003, 0.0, -0.004])
        tg.save(read, tmp_path / "again", figures=None)
        assert (tmp_path / "again" / "slips.csv").read_bytes() == (tmp_path / "run" / "slips.csv").read_bytes()

    def test_the_normal_of_a_floor(self, kept, tmp_path) -> None:
        normal = EstimatedNormal((0.06, 0.0, 0.998), 0.004)
        tg.save(replace(kept, floor_normal=normal), tmp_path / "run", figures=None)
        tg.save(tg.load(tmp_path / "run"), tmp_path / "again", figures=None)
        read = tg.load(tmp_path / "again").floor_normal
        assert (read.direction, read.sigma_rad) == (normal.direction, normal.sigma_rad)
        run = tmp_path / "run" / "run.toml"
        run.write_text(run.read_text().replace("sigma_rad = 0.004", 'sigma_rad = "small"'))
        with pytest.raises(tg.InputError, match=r"run\.toml: floor_normal: sigma_rad: .* got 'small'"):
            tg.load(tmp_path / "run")

    @pytest.mark.parametrize("row", ["0.0001,7", "0.0,12", "0.0,0.5"])
    def test_a_slip_that_cannot_be_is_refused(self, kept, row, tmp_path) -> None:
        tg.save(replace(kept, contacts=np.ones((len(kept), 12))), tmp_path / "run", figures=None)
        with (tmp_path / "run" / "slips.csv").open("a") as file:
            file.write(f"{row},0.005,0.002,0.003,0.0,-0.004\n")
        with pytest.raises(tg.InputError, match=r"slips\.csv: expected nodes from 0 to 11 at times of shape\.csv"):
            tg.load(tmp_path / "run")

    @pytest.mark.parametrize(
        "name", ["contacts.csv", "track.csv", "slips.csv", "estimated_loads.csv", "sensor_drift.csv"]
    )
    def test_a_table_that_is_gone_is_missed(self, kept, name, tmp_path) -> None:
        tg.save(replace(kept, contacts=np.ones((len(kept), 12))), tmp_path / "run", figures=None)
        (tmp_path / "run" / name).unlink()
        with pytest.raises(tg.InputError, match=rf"{name}: is missing: run\.toml names it"):
            tg.load(tmp_path / "run")

    def test_a_track_whose_covariance_is_none_is_refused(self, kept, tmp_path) -> None:
        tg.save(replace(kept, contacts=np.ones((len(kept), 12))), tmp_path / "run", figures=None)
        track = tmp_path / "run" / "track.csv"
        header, first, second, *rows = track.read_text().splitlines()
        cells = second.split(",")
        cells[header.split(",").index("cyy_m2")] = "-1.0"
        track.write_text("\n".join([header, first, ",".join(cells), *rows, ""]))
        with pytest.raises(tg.InputError, match=r"track\.csv: row 3, columns .*: expected a covariance, got one with"):
            tg.load(tmp_path / "run")

    def test_a_run_that_is_cut_off_is_refused(self, saved) -> None:
        run = (saved / "run.toml").read_text()
        (saved / "run.toml").write_text(run[: run.index("[structure]")])
        with pytest.raises(tg.InputError, match=r"run\.toml: structure: is missing"):
            tg.load(saved)

    def test_drift_that_was_known_only_later(self, kept, tmp_path) -> None:
        known = np.arange(len(kept))[:, None] >= 2
        later = replace(
            kept, drift=np.where(known, kept.drift, np.nan), drift_sigma=np.where(known, kept.drift_sigma, np.nan)
        )
        tg.save(later, tmp_path / "later")
        drift = tg.load(tmp_path / "later").drift
        assert np.isnan(drift[:2]).all()
        np.testing.assert_allclose(drift[2:], kept.drift[2:], atol=1e-6)

    @pytest.mark.parametrize(
        ("file", "old", "new", "message"),
        [
            ("run.toml", "[structure]", "[structur]", "run.toml: structure: is missing"),
            ("run.toml", "[structure]", "[[structure]]", "run.toml: structure: expected a table, got [{"),
            ("run.toml", "rods = [[0, 3]", "rods = [[0, 0]", "run.toml: rod 0 (0-0): expected two different nodes"),
            ("run.toml", "rods = [[0, 3]", "rods = [[0]", "run.toml: structure: rods[0]"),
            ("status.csv", ",ok,", ",fine,", "column status: expected one of ok, partial, two_shapes"),
            ("status.csv", ",motion", ",tired", "column doubt: expected one of none, sensors, motion"),
            ("status.csv", "0.0200,", "0.0201,", "status.csv: expected one row for each row of shape.csv"),
            ("other_shape.csv", "0.0600,", "0.0800,", "other_shape.csv: expected one row for each frame of"),
            ("sensor_drift.csv", "0.0200,3,", "0.0200,4,", "expected 24 rows (tendon 0 to 23)"),
            (
                "lengths.csv",
                "stretching,,",
                "stretching,asleep,",
                "column flags: expected names of flags joined by |, got",
            ),
            ("lengths.csv", ",stretching,", ",x,stretching,", "row 2: expected 8 fields, got 9"),
            ("ellipsoids.csv", "0.0000,3,", "0.0000,4,", "expected 12 rows (node 0 to 11) for each row of shape.csv"),
            ("lengths.csv", ",stretching,", ",flying,", "column mode: expected stretching or bending, got 'flying'"),
            ("estimated_loads.csv", "0.0000,3,", "0.0000,2,", "expected 9 rows (node 3 to 11) for each row of"),
            ("shape.csv", ",0.18", ",18.", "ellipsoids.csv: expected the positions of shape.csv in the middle of"),
            ("shape.csv", "n11_z_m", "n12_z_m", "shape.csv: expected the positions of all 12 nodes"),
        ],
    )
    def test_refuses_what_does_not_fit(self, saved, file, old, new, message) -> None:
        text = (saved / file).read_text()
        assert old in text
        (saved / file).write_text(text.replace(old, new, 1))
        with pytest.raises(tg.InputError) as error:
            tg.load(saved)
        assert message in str(error.value)
        assert "\n" not in str(error.value)

    def test_an_infinite_load_is_refused(self, saved) -> None:
        """Unknown is nan; the figures have no place for an infinite one."""
        loads = saved / "estimated_loads.csv"
        header, first, *rows = loads.read_text().splitlines()
        cells = first.split(",")
        cells[2] = "-inf"
        loads.write_text("\n".join([header, ",".join(cells), *rows, ""]))
        with pytest.raises(tg.InputError, match=r"row 2, column fx_n: expected a finite number or nan, got '-inf'"):
            tg.load(saved)

    @pytest.mark.parametrize(
        ("file", "column"),
        [
            ("lengths.csv", "length_m"),
            ("lengths.csv", "sigma_m"),
            ("lengths.csv", "innovation_sigma_m"),
            ("estimated_loads.csv", "sigma_n"),
            ("status.csv", "mechanism_sigma_m"),
        ],
    )
    def test_what_cannot_be_negative_is_refused(self, saved, file, column) -> None:
        header, *rows = (saved / file).read_text().splitlines()
        cells = rows[1].split(",")
        cells[header.split(",").index(column)] = "-0.1"
        (saved / file).write_text("\n".join([header, rows[0], ",".join(cells), *rows[2:], ""]))
        with pytest.raises(tg.InputError, match=f"row 3, column {column}.*: expected a number that is not negative"):
            tg.load(saved)

    def test_what_is_no_covariance_is_refused(self, saved) -> None:
        rows = (saved / "ellipsoids.csv").read_text().splitlines()
        fields = rows[4].split(",")
        rows[4] = ",".join([*fields[:5], "-0.4", *fields[6:]])
        (saved / "ellipsoids.csv").write_text("\n".join(rows) + "\n")
        with pytest.raises(
            tg.InputError, match=r"ellipsoids\.csv: row 5, columns cxx_m2 to czz_m2: .* variance -0\.4 m2"
        ):
            tg.load(saved)


class TestFramesByTime:
    def test_the_nearest(self, kept) -> None:
        assert kept[0.1234].t_s == pytest.approx(0.12)
        assert kept[0.1301].t_s == pytest.approx(0.14)
        assert kept[0].t_s == kept.t_s[0]
        np.testing.assert_array_equal(kept[0.1234].covariance_m2, kept.covariance_m2[6])
        assert kept[0.06].other is kept.others[3]

    def test_those_from_a_time_to_before_another(self, kept) -> None:
        part = kept[0.05:0.1]
        np.testing.assert_allclose(part.t_s, [0.06, 0.08])
        assert part.others[0] is kept.others[3]
        np.testing.assert_array_equal(part.loads.force_n, kept.loads.force_n[3:5])
        np.testing.assert_array_equal(part.mechanism_sigma_m, kept.mechanism_sigma_m[3:5])
        assert len(kept[:0.1]) + len(kept[0.1:]) == len(kept) == len(kept[:])

    def test_a_part_of_what_was_loaded(self, saved) -> None:
        read = tg.load(saved)
        np.testing.assert_array_equal(read[0.05:0.1].innovation_sigma_m, read.innovation_sigma_m[3:5])

    @pytest.mark.parametrize(
        ("key", "message"),
        [
            (-0.5, "result[-0.5]: expected a time from 0.0000 to 0.4800 s"),
            (float("nan"), "result[nan]: expected a time"),
            ("0.1", "result['0.1']: expected a time"),
            (np.zeros(9, dtype=np.bool_), "result[ndarray]: expected a time"),
            (slice(0.2, 0.1), "result[0.2:0.1]: holds no frame: the run is from 0.0000 to 0.4800 s"),
            (slice(0.0, 0.2, 2), "expected two times in seconds"),
            (slice("a", None), "expected two times in seconds"),
        ],
    )
    def test_or_an_error_that_says_which_there_are(self, kept, key, message) -> None:
        with pytest.raises(tg.InputError) as error:
            kept[key]
        assert message in str(error.value)


def test_what_is_printed_is_short(kept) -> None:
    assert len(repr(kept)) < 250
    assert "25, from 0.00 to 0.48 s" in repr(kept)
    assert "12 nodes, 24 tendons" in repr(kept)
    assert "t = 0.10 s" in repr(kept[0.1])
    assert len(repr(kept[0.1])) < 120
    assert kept._repr_html_().count("<tr>") == 5


class TestSettingsOfPython:
    def test_a_table_in_place_of_its_part_is_named(self) -> None:
        with pytest.raises(tg.InputError, match=r"settings.noise: expected NoiseSettings\(force_n=0.2\), got dict"):
            tg.Settings(noise={"force_n": 0.2})

    def test_what_is_no_settings_is_named(self, example) -> None:
        with pytest.raises(tg.InputError, match=r"settings: expected Settings\(...\) with probability, .*, got dict"):
            tg.reconstruct(example, settings={"noise": {"force_n": 0.2}})

    def test_a_value_that_is_not_allowed_is_named(self, example) -> None:
        with pytest.raises(tg.InputError, match=r"settings: probability: expected a number less than 1, got 95"):
            tg.reconstruct(example, settings=tg.Settings(probability=95))

    def test_a_path_in_place_of_a_model_is_named(self, example) -> None:
        with pytest.raises(tg.InputError, match=r"model: expected a SensorModel, as read_sensor_model\('m'\) returns"):
            tg.reconstruct(example, model="m")


def test_the_version_is_that_of_the_distribution() -> None:
    from importlib.metadata import version

    assert tg.__version__ == version("tensegraph")
