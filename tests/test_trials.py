"""Trials on disk: what is read, what is handled and counted, what is refused and how."""

import numpy as np
import pytest

from tensegraph import Flag, InputError, Settings, open_trial
from tensegraph.io.csv import CsvFile
from tensegraph.io.recording_files import read_recording, read_recordings
from tensegraph.io.toml import read_settings
from tensegraph.models.calibration.strip_rig import StripRig
from tensegraph.pipeline import Pipeline, reconstruct


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


REFUSED = [
    ("board0", cell(7, 5, "abc"), r"board0.csv: row 7, column adc2: expected a finite number, got 'abc'"),
    ("board0", cell(7, 5, "inf"), r"board0.csv: row 7, column adc2: expected a finite number, got 'inf'"),
    ("board0", cell(7, 5, "nan"), r"board0.csv: row 7, column adc2: expected a finite number, got 'nan'"),
    ("board0", cell(7, 5, ""), r"board0.csv: row 7, column adc2: expected a finite number, got ''"),
    ("board0", cell(7, 5, "5.5"), r"board0.csv: row 7, column adc2: expected an integer, got 5.5"),
    ("board1", cell(9, 0, "x"), r"board1.csv: row 9, column host_s"),
    ("board1", lines(lambda r: [*r[:8], r[8].replace("\n", ",7\n"), *r[9:]]), r"row 9: expected 15 fields, got 16"),
    ("board1", lines(lambda r: [*r[:8], "1,2,3\n", *r[9:]]), r"row 9: expected 15 fields, got 3"),
    ("board1", replaced("adc11", "adc12"), r"board1.csv: row 1: column 'adc11' is missing"),
    ("board1", replaced("device_us", "device"), r"board1.csv: row 1: column 'device_us' is missing"),
    ("board1", lambda text: "", r"board1.csv: is empty"),
    ("trial", replaced("rod_length_m = 0.3", "rod_length_m = -0.3"), r"trial.toml: rod_length_m\[0\]: expected a positive"),
    ("trial", replaced("bits = 10", "bits = 99"), r"trial.toml: adc.bits: expected 1 to 24, got 99"),
    ("trial", replaced('sensor_side = "ground"', 'sensor_side = "left"'), r"adc.sensor_side: .*got 'left'"),
    ("trial", replaced('file = "board1.csv"', 'file = "board2.csv"'), r"board2.csv: no such file"),
    ("trial", replaced("[[board]]", "[[bord]]"), r"expected one of \[\[board\]\], \[resistance\], \[lengths\], got none"),
    ("trial", replaced("[0, 1], [1, 2]", "[0, 1], [1, 0]"), r"trial.toml: tendon 1 \(1-0\): joins the same nodes as tendon 0"),
    ("trial", replaced("natural_resistance_ohm = [", "natural_resistance_ohm = [5, "), r"expected 24 finite numbers, got 25"),
    ("trial", replaced("[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]", "[0, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]"), r"is wired to"),
    ("trial", replaced("[rest]", "[rest"), r"trial.toml: cannot be read as TOML"),
    ("trial", replaced("seconds = 2.0", "seconds = -2.0"), r"rest.seconds: .*got -2.0"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "edit", "message"), REFUSED)
def test_what_can_not_be_read_is_refused_in_one_line(trial_copy, file, edit, message) -> None:
    path = trial_copy(rows=30, trial=lambda text: text) if file != "trial" else trial_copy(rows=30)
    target = path / ("trial.toml" if file == "trial" else f"{file}.csv")
    target.write_text(edit(target.read_text()))
    with pytest.raises(InputError, match=message) as error:
        reconstruct(path, "frame")
    assert "\n" not in str(error.value)


def test_missing_files_are_refused(tmp_path, trial_copy) -> None:
    with pytest.raises(InputError, match=r"trial.toml: no such file"):
        open_trial(tmp_path / "nothing")
    path = trial_copy(rows=5)
    (path / "board0.csv").unlink()
    with pytest.raises(InputError, match=r"board0.csv: no such file"):
        open_trial(path)


def test_an_empty_trial_is_refused(trial_copy) -> None:
    path = trial_copy(rows=0)
    with pytest.raises(InputError, match=r"holds no readings: expected at least one row in board0.csv, board1.csv"):
        reconstruct(path)


@pytest.mark.parametrize("method", ["batch", "live", "frame"])
def test_a_trial_of_one_row_a_board_is_one_frame(trial_copy, method) -> None:
    result = reconstruct(trial_copy(rows=1), method)
    assert 1 <= len(result) <= 3
    assert np.isfinite(result.node_position_m).all()


def test_one_board_alone_is_enough(trial_copy) -> None:
    path = trial_copy(rows=60)
    header = (path / "board1.csv").read_text().splitlines()[0]
    (path / "board1.csv").write_text(header + "\n")
    result = reconstruct(path, "live")
    assert (result.flags[:, 12:] & Flag.MISSING).all()
    assert not (result.flags[5:, :12] & Flag.MISSING).any()


def test_half_a_line_at_the_end_is_left_out_and_counted(trial_copy) -> None:
    path = trial_copy(rows=60, board0=lambda text: text + "1.2345,60,43")
    trial = open_trial(path)
    rows = list(trial.readings())
    assert trial.half_lines == 1
    assert sum(row.board == 0 for row in rows) == 60


def test_a_board_that_counts_past_its_end_goes_on(trial_copy) -> None:
    """16-bit rows and 32-bit microseconds wrap in the middle; the result is the same to the microsecond."""

    def shifted(rows):
        out = rows[:1]
        for row in rows[1:]:
            host_s, seq, device_us, *codes = row.split(",")
            out.append(
                ",".join(
                    [
                        host_s,
                        str((int(seq) + 65_500) % 2**16),
                        str((int(device_us) + 2**32 - 4_300_000) % 2**32),
                        *codes,
                    ]
                )
            )
        return out

    plain, wrapped = (
        reconstruct(trial_copy(), "live"),
        reconstruct(trial_copy(name="wrapped", board0=lines(shifted)), "live"),
    )
    np.testing.assert_allclose(wrapped.node_position_m, plain.node_position_m, atol=1e-6)


def test_rows_out_of_order_are_dropped_and_counted(trial_copy) -> None:
    path = trial_copy(board0=lines(lambda rows: [*rows[:50], rows[51], rows[50], *rows[52:]]))
    trial = open_trial(path)
    pipeline = pipeline_of(trial)
    frames = list(pipeline.lengths(trial.readings()))
    assert pipeline.boards.counts[0].dropped_rows == 1
    assert len(frames) > 100


def pipeline_of(trial, model=None) -> Pipeline:
    from tensegraph.io.model_file import read_sensor_model

    return Pipeline(trial.description, Settings(), model or read_sensor_model())


def test_absurd_codes_are_left_out_and_named(trial_copy) -> None:
    path = trial_copy(
        board0=lines(
            lambda rows: [cell(1, 6, row.split(",")[6] if k == 0 else "-7")(row) for k, row in enumerate(rows)]
        )
    )
    result = reconstruct(path, "live")
    assert (result.flags[:, 3] & Flag.MISSING).all()
    assert (result.flags[:-1, 3] & Flag.OUT_OF_RANGE).all()
    assert np.isfinite(result.node_position_m).all()


def test_an_open_circuit_and_a_spike_are_named_and_do_not_stop(trial_copy) -> None:
    def broken(rows):
        for k in range(60, len(rows)):
            rows[k] = cell(1, 8, "1023")(rows[k])
        rows[40] = cell(1, 4, "900")(rows[40])
        return rows

    result = reconstruct(trial_copy(board1=lines(broken)), "live")
    assert result.flags[100, 17] & Flag.SATURATED
    assert result.flags[100, 17] & Flag.MISSING
    assert (result.flags[:, 13] & Flag.OUTLIER).any()
    assert not (result.flags[:, 13] & Flag.MISSING).any()
    assert result.status[100] == "partial"


def as_resistance(path, trial) -> None:
    """Rewrite a trial of counts as one of resistance."""
    pipeline = pipeline_of(trial)
    readings = [pipeline.boards.reading(row) for row in trial.readings()]
    both = {}
    for reading in readings:
        both.setdefault(round(reading.t_s * 50), np.full(24, np.nan))[reading.tendon] = reading.resistance_ohm
    header = ",".join(["t_s", *(f"r{e}_ohm" for e in range(24))])
    rows = [",".join([f"{k / 50:.3f}", *(f"{v:.0f}" if v == v else "" for v in both[k])]) for k in sorted(both)]
    (path / "resistance.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    text = text[: text.index("[[board]]")] + '[resistance]\nfile = "resistance.csv"\n'
    (path / "trial.toml").write_text(text)


def test_resistance_stands_in_for_counts(trial_copy) -> None:
    path = trial_copy(rows=150)
    counts = reconstruct(path, "live")
    as_resistance(path, open_trial(path))
    resistance = reconstruct(path, "live")
    error = np.abs(resistance.node_position_m[-20:].mean(axis=0) - counts.node_position_m[-20:].mean(axis=0))
    assert error.max() < 0.003


def test_lengths_stand_in_for_counts(trial_copy) -> None:
    path = trial_copy(rows=150)
    counts = reconstruct(path, "live")
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(24)), *(f"s{e}_m" for e in range(24))])
    rows = [
        ",".join(repr(float(value)) for value in (t, *length, *sigma))
        for t, length, sigma in zip(counts.t_s, counts.length_m, counts.sigma_m, strict=True)
    ]
    (path / "lengths.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    lengths = reconstruct(path, "live")
    # what part of sigma is the rest shape's is not in the file, so weights differ a little
    np.testing.assert_allclose(lengths.node_position_m, counts.node_position_m, atol=0.0015)


def test_lengths_without_sigma_with_gaps_and_with_stamps_that_go_back(trial_copy) -> None:
    path = trial_copy(rows=5)
    header = ",".join(["t_s", *(f"l{e}_m" for e in range(24))])
    good = ",".join(["0.184"] * 24)
    rows = [
        f"0.00,{good}",
        f"0.02,{good.replace('0.184', '', 1)}",
        f"0.01,{good}",
        f"0.05,{good.replace('0.184', '-1', 1)}",
    ]
    (path / "lengths.csv").write_text("\n".join([header, *rows, ""]))
    text = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(text[: text.index("[adc]")] + '[lengths]\nfile = "lengths.csv"\n')
    trial = open_trial(path)
    result = reconstruct(trial, "live")
    assert result.t_s.tolist() == [0.0, 0.02, 0.05]
    assert trial.dropped_rows == 1
    assert result.flags[:, 0].tolist() == [0, Flag.MISSING, Flag.OUT_OF_RANGE]
    np.testing.assert_allclose(result.sigma_m[0], Settings().noise.unstated_m)


def test_unknown_keys_of_a_trial_are_named_not_refused(trial_copy) -> None:
    path = trial_copy(rows=5, trial=lambda text: text.replace("[rest]", "[rest]\nmeasured_by = 'us'"))
    assert open_trial(path).description.ignored_keys == ("rest.measured_by",)


def test_truth_never_reaches_the_estimate(trial_copy) -> None:
    with_truth = trial_copy()
    without = trial_copy(name="blind", trial=lambda text: text[: text.index("[truth]")])
    (without / "truth.csv").unlink()
    (without / "loads.csv").unlink()
    for method in ("batch", "live"):
        a, b = reconstruct(with_truth, method), reconstruct(without, method)
        np.testing.assert_array_equal(a.node_position_m, b.node_position_m)
        np.testing.assert_array_equal(a.covariance_m2, b.covariance_m2)
    assert open_trial(with_truth).hashes() == open_trial(without).hashes()


class TestSettings:
    def test_a_file_changes_what_it_names(self, tmp_path) -> None:
        path = tmp_path / "config.toml"
        path.write_text('probability = 0.9\n[noise]\nrod_m = 0.001\nrobust = "huber"\nshape_prior_m = inf\n')
        settings = read_settings(path)
        assert (settings.probability, settings.noise.rod_m, settings.noise.robust) == (0.9, 0.001, "huber")
        assert settings.front_end == Settings().front_end

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("[noise]\nrods_m = 1\n", r"config.toml: noise.rods_m: is no setting"),
            ("speed = 1\n", r"speed: is no setting"),
            ("[noise]\nrod_m = -1\n", r"noise.rod_m: .*greater than 0.*got -1"),
            ("[noise]\nrod_m = nan\n", r"noise.rod_m: .*got nan"),
            ("[noise]\nrobust = 'hard'\n", r"noise.robust: .*got 'hard'"),
            ("probability = 95\n", r"probability: .*got 95"),
            ("[smoother]\nlag = 1\n", r"smoother.lag: .*got 1"),
            ("probability = \n", r"cannot be read as TOML"),
            ("[frames]\nrate_hz = 0\n", r"frames.rate_hz: .*got 0"),
        ],
    )
    def test_what_is_no_setting_is_refused(self, tmp_path, text, message) -> None:
        path = tmp_path / "config.toml"
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_settings(path)

    def test_no_file_means_the_defaults(self, tmp_path) -> None:
        assert read_settings(None) == Settings()
        with pytest.raises(InputError, match="no such file"):
            read_settings(tmp_path / "none.toml")


class TestCsv:
    def test_columns_come_in_the_order_asked_for(self, tmp_path) -> None:
        path = tmp_path / "a.csv"
        path.write_text("\ufeffb, a ,c\r\n1,2,3\r\n")
        assert list(CsvFile(path, ["a", "b"])) == [[2.0, 1.0]]

    def test_absent_optional_columns_are_nan(self, tmp_path) -> None:
        path = tmp_path / "a.csv"
        path.write_text("a\n1\n")
        (row,) = CsvFile(path, ["a"], optional=["z"])
        assert row[0] == 1
        assert np.isnan(row[1])


class TestCalibrationRecordings:
    def write(self, folder, text, name="a.csv"):
        (folder / name).write_text(text)
        return folder / name

    def test_are_read(self, tmp_path) -> None:
        self.write(tmp_path, "# natural_resistance_ohm = 100\nt_s,strain,resistance_ohm\n0.0,0.0,100\n40,0.1,112\n")
        (recording,) = read_recordings(tmp_path, StripRig()).recordings
        assert recording.name == "a"
        np.testing.assert_allclose(recording.change, [0, 0.12])

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("t_s,strain,resistance_ohm\n0,0,1\n1,0,1\n", "row 1: expected '# natural_resistance_ohm"),
            ("# natural_resistance_ohm = 1\nt_s,strain\n0,0\n", "row 2: column 'resistance_ohm' is missing"),
            ("# natural_resistance_ohm = 1\nt_s,strain,resistance_ohm\n0,0,x\n", "row 3, column resistance_ohm"),
            ("# natural_resistance_ohm = 1\nt_s,strain,resistance_ohm\n0,0,1\n0,0,1\n", "row 4, column t_s"),
            ("# natural_resistance_ohm = 1\nt_s,strain,resistance_ohm\n0,0,1\n", "at least two rows"),
        ],
    )
    def test_bad_ones_are_refused_by_row_and_column(self, tmp_path, text, message) -> None:
        with pytest.raises(InputError, match=message):
            read_recording(self.write(tmp_path, text), StripRig())

    def test_an_empty_folder_is_refused(self, tmp_path) -> None:
        with pytest.raises(InputError, match="holds no recordings"):
            read_recordings(tmp_path, StripRig())
