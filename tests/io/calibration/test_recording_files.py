"""Calibration recordings of any rig."""

from pathlib import Path

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.io.calibration.recording_files import read_recording, read_recordings, read_rig, rig_text
from tensegraph.models.calibration.strip_rig import StripRig


class TestRig:
    def folder(self, tmp_path, rig: str, rows: str, name: str = "a.csv"):
        (tmp_path / "rig.toml").write_text(rig)
        (tmp_path / name).write_text(rows)
        return tmp_path / name, read_rig(tmp_path / "rig.toml")

    def test_its_text_makes_the_same_rig(self, tmp_path) -> None:
        rig = read_rig(Path(__file__).parents[3] / "examples" / "cb_silicone_rig.toml")
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

    @pytest.mark.parametrize(("together", "refused"), [(1, False), (2, True), (20, True)])
    def test_stamps_in_bursts_are_refused(self, tmp_path, together: int, refused: bool) -> None:
        """A computer reads a serial port every so often, and stamps what has come since."""
        stamps = [0.1 * (k // together * together) + 1e-4 * (k % together) for k in range(400)]
        rows = "t_s,strain,resistance_ohm\n" + "".join(f"{t:.4f},0.1,{100 + k % 2}\n" for k, t in enumerate(stamps))
        told = self.folder(tmp_path, "natural_resistance_ohm = 50.0\n", rows)
        if refused:
            with pytest.raises(InputError, match=r"a\.csv: expected stamps .*, got bursts: .* their mean is 0\."):
                read_recording(*told)
        else:
            assert len(read_recording(*told).t_s) == 400

    def test_a_start_of_hardly_any_rows_is_refused(self, tmp_path) -> None:
        """Milliseconds that are taken for seconds, or a pause after the first row."""
        for stamps in (50.0 * np.arange(400), np.append(0.0, 20 + 0.1 * np.arange(400))):
            rows = "t_s,strain,resistance_ohm\n" + "".join(f"{t:.2f},0.1,100\n" for t in stamps)
            with pytest.raises(InputError, match=r"a\.csv: expected 5 rows or more in the first 10 s, got 1: "):
                read_recording(*self.folder(tmp_path, "natural_resistance_ohm = 50.0\n", rows))

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
            (
                lambda rows: [row.replace(",0.1,", ",10.0,") for row in rows],
                "a.csv: expected strain up to 5, got 10: is",
            ),
            (
                lambda rows: [*rows[:2], *(row.rpartition(",")[0] + ",100\n" for row in rows[2:])],
                "a.csv: column resistance_ohm: expected a resistance that changes, got 100 ohm in all rows",
            ),
            (lambda rows: rows[:40], "a.csv: expected at least 30 s of resistance and strain, got 3.7"),
        ],
    )
    def test_a_bad_file_is_named_with_row_and_column(self, tmp_path, edit, message) -> None:
        rows = ["# natural_resistance_ohm = 100\n", "t_s,strain,resistance_ohm\n"]
        rows += [f"{0.1 * k:.1f},0.1,{100 + k % 2}\n" for k in range(400)]
        (tmp_path / "a.csv").write_text("".join(edit(rows)))
        with pytest.raises(InputError, match=r"a\.csv") as error:
            read_recording(tmp_path / "a.csv", StripRig())
        assert message in str(error.value)

    def test_one_good_file_of_ten_serves_and_nine_are_named(self, tmp_path) -> None:
        good = "# natural_resistance_ohm = 100\nt_s,strain,resistance_ohm\n"
        good += "".join(f"{0.1 * k:.1f},0.1,{100 + k % 2}\n" for k in range(400))
        for k in range(10):
            (tmp_path / f"r{k}.csv").write_text(good if k == 3 else good.replace("# natural", "natural"))
        found = read_recordings(tmp_path, StripRig())
        assert [r.name for r in found.recordings] == ["r3"]
        assert list(found.sha256) == ["r3.csv"]
        assert [line.split("/")[-1].split(":")[0] for line in found.left_out] == [
            f"r{k}.csv" for k in range(10) if k != 3
        ]


class TestCalibrationRecordings:
    def write(self, folder, text, name="a.csv"):
        (folder / name).write_text(text)
        return folder / name

    def test_are_read(self, tmp_path) -> None:
        rows = "".join(f"{10 * k},{0.025 * k},{100 + 3 * k}\n" for k in (0, 0.1, 0.3, 0.5, 0.7, 4))
        self.write(tmp_path, f"# natural_resistance_ohm = 100\nt_s,strain,resistance_ohm\n{rows}")
        (recording,) = read_recordings(tmp_path, StripRig()).recordings
        assert recording.name == "a"
        np.testing.assert_allclose(recording.change, [0, 0.003, 0.009, 0.015, 0.021, 0.12])

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

    @pytest.mark.parametrize(
        ("t_s", "ohm", "message"),
        [
            (
                np.arange(0, 60, 0.05),
                0.001,
                "column resistance_ohm: expected about the natural resistance of 1e.06 ohm, ",
            ),
            (
                np.r_[0:30:0.05, 1830:1860:0.05],
                1.0,
                r"expected at most 60 s between two rows, got 1.8e.03 s after t = 29.95",
            ),
        ],
        ids=["kilo-ohm", "pause"],
    )
    def test_other_units_and_pauses_are_refused(self, tmp_path, t_s, ohm, message) -> None:
        strain = 0.1 - 0.1 * np.cos(t_s)
        rows = "".join(f"{t:.3f},{e:.5f},{1e6 * ohm * (1 + e):.6g}\n" for t, e in zip(t_s, strain, strict=True))
        text = f"# natural_resistance_ohm = 1e6\nt_s,strain,resistance_ohm\n{rows}"
        with pytest.raises(InputError, match=message):
            read_recording(self.write(tmp_path, text), StripRig())

    def test_an_empty_folder_is_refused(self, tmp_path) -> None:
        with pytest.raises(InputError, match="holds no recordings"):
            read_recordings(tmp_path, StripRig())
