"""Trials on disk: what is read, and what is refused and how."""

import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from tensegraph import InputError, open_trial
from tensegraph.pipeline import reconstruct
from trial_edits import cell, lines, replaced, rewritten, stamped

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
    ("trial", replaced("anchors =", "hub_radius_m = 8.0\nanchors ="), r"hub_radius_m: expected at most 0.06, .* got 8: is t"),
    ("trial", replaced("anchors =", "anchor_sigma_m = 2.0\nanchors ="), r"anchor_sigma_m: expected at most 0.06, .* got 2: "),
    ("trial", replaced("rod_mass_kg", "push_back = 2.0\nrod_mass_kg"), r"mechanics.push_back: .*at most 1.*2.0"),
    ("trial", replaced("bits = 10", "bits = 99"), r"trial.toml: adc.bits: expected 1 to 24, got 99"),
    ("trial", replaced('sensor_side = "ground"', 'sensor_side = "left"'), r"adc.sensor_side: .*got 'left'"),
    ("trial", replaced('file = "board1.csv"', 'file = "board2.csv"'), r"board2.csv: no such file"),
    ("trial", replaced('file = "board1.csv"', 'file = "./board0.csv"'), r"board\[1\].file: .*, that of board\[0\]$"),
    ("trial", replaced('file = "board1.csv"', 'file = "trial.toml"'), r"board\[1\].file: .*, that of the description$"),
    ("trial", replaced("[[board]]", "[[bord]]"), r"expected one of \[\[board\]\], \[resistance\], \[lengths\], got none"),
    ("trial", replaced("[0, 1], [1, 2]", "[0, 1], [1, 0]"), r"trial.toml: tendon 1 \(1-0\): joins the same nodes as tendon 0"),
    ("trial", replaced("natural_resistance_ohm = [", "natural_resistance_ohm = [5, "), r"expected 24 finite numbers, got 25"),
    ("trial", replaced("[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]", "[0, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]"), r"is wired to"),
    ("trial", replaced("[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]", "[]"), r"board\[0\].tendon_of_channel: expected the .* none$"),
    ("trial", replaced("format = 1", "recorded_utc = 2024-01-01"), r"recorded_utc: expected text between quotes, got 2024"),
    ("trial", replaced("[rest]", "[rest"), r"trial.toml: cannot be read as TOML"),
    ("trial", replaced("[0.18379, -0.00004, -0.00004]", "[0.18379, -0.00004, 0.02]"), r"node_position_m\[1\]: .* 0.020 m away$"),
    ("trial", replaced("seconds = 2.0", "seconds = -2.0"), r"rest.seconds: .*got -2.0"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "edit", "message"), REFUSED)
def test_what_can_not_be_read_is_refused_in_one_line(trial_copy, file, edit, message) -> None:
    path = trial_copy(rows=30, trial=lambda text: text) if file != "trial" else trial_copy(rows=30)
    target = path / ("trial.toml" if file == "trial" else f"{file}.csv")
    rewritten(target, edit)
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


def test_what_is_no_trial_is_said(tmp_path, trial_copy) -> None:
    path = trial_copy(rows=5)
    with pytest.raises(InputError, match=r"trial.toml: expected a trial directory, got a file"):
        open_trial(path / "trial.toml")
    (tmp_path / "result").mkdir()
    (tmp_path / "result/run.toml").write_text("format = 1\n")
    with pytest.raises(InputError, match=r"result: expected a trial directory, got a result"):
        open_trial(tmp_path / "result")


def test_an_empty_trial_is_refused(trial_copy) -> None:
    path = trial_copy(rows=0)
    with pytest.raises(InputError, match=r"holds no readings: expected at least one row in board0.csv, board1.csv"):
        reconstruct(path)


def test_half_a_line_at_the_end_is_left_out_and_counted(trial_copy) -> None:
    path = trial_copy(rows=60, board0=lambda text: text + "1.2345,60,43")
    trial = open_trial(path)
    rows = list(trial.readings())
    assert trial.half_lines == 1
    assert sum(row.board == 0 for row in rows) == 60


def test_each_look_at_the_readings_reads_the_files_from_the_start(trial_copy) -> None:
    """What was left out counts once, and that it is evaluated changes no count."""
    path = trial_copy(rows=60, board0=lambda text: text + "1.2345,60,43")
    trial = open_trial(path)
    first, second = list(trial.readings()), list(trial.readings())
    assert [row.host_s for row in first] == [row.host_s for row in second]
    trial.dropped_rows = 3
    assert trial.truth_of(trial.truth()).start_s == first[0].host_s
    assert (trial.half_lines, trial.dropped_rows) == (1, 3)


def test_a_name_is_printable(trial_copy) -> None:
    """A sign that would colour the terminal is escaped; letters of any language stay."""
    path = trial_copy(rows=5, trial=replaced('name = "press_01"', r'name = "\u001b[31mgr\u00fcn"'))
    assert open_trial(path).name == r"\x1b[31mgrün"


def test_unknown_keys_of_a_trial_are_named_not_refused(trial_copy) -> None:
    path = trial_copy(rows=5, trial=lambda text: text.replace("[rest]", "[rest]\nmeasured_by = 'us'"))
    assert open_trial(path).description.ignored_keys == ("rest.measured_by",)


def test_unknown_columns_are_named_not_refused(trial_copy) -> None:
    """But for a blank name, as of the numbers that a program gives its rows."""
    path = trial_copy(rows=5, board0=lines(lambda rows: [",boots," + rows[0], *(f"0,1,{row}" for row in rows[1:])]))
    trial = open_trial(path)
    assert len(list(trial.readings())) == 10
    assert trial.ignored_columns == {"board0.csv": ["boots"]}


@pytest.mark.parametrize(
    ("kind", "keys"),
    [("position", ""), ("range", "beacon_position_m = [[1.0, 0.0, 0.0]]\n")],
    ids=["position", "range"],
)
def test_what_tells_where_a_structure_on_anchors_is_is_named_as_not_used(trial_copy, kind, keys) -> None:
    path = trial_copy(rows=5, trial=lambda text: f'{text}\n[[{kind}]]\nfile = "told.csv"\n{keys}')
    (path / "told.csv").write_text("t_s,node,x_m,y_m,z_m\n")
    assert open_trial(path).description.ignored_keys == (f"{kind}: anchors hold the structure",)


def test_a_table_that_is_mistyped_is_named_with_the_one_that_is_meant(trial_copy) -> None:
    path = trial_copy(rows=5, trial=lambda text: text.replace("[mechanics]", "[mechanic]"))
    assert open_trial(path).description.ignored_keys == ("mechanic: did you mean mechanics?",)


class TestFaults:
    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("tendon = 24", r"truth\.fault\[0\]\.tendon: expected a tendon from 0 to 23, got 24"),
            ("board = 2", r"truth\.fault\[0\]\.board: expected one of the trial's 2 boards, got 2"),
            ("", r"truth\.fault\[0\]: expected either tendon or board"),
            ("tendon = 1\nboard = 1", r"truth\.fault\[0\]: expected either tendon or board"),
        ],
    )
    def test_faults_that_can_not_be(self, trial_copy, line, message) -> None:
        table = f'\n[[truth.fault]]\nkind = "stuck"\nfrom_s = 1.0\nuntil_s = 2.0\n{line}\n'
        trial = open_trial(trial_copy(trial=lambda text: text + table))
        with pytest.raises(InputError, match=message):
            trial.faults()

    def test_a_board_s_fault_spoils_its_tendons(self, trial_copy) -> None:
        table = '\n[[truth.fault]]\nkind = "unplugged"\nfrom_s = 1.0\nuntil_s = 2.0\nboard = 1\n'
        (fault,) = open_trial(trial_copy(trial=lambda text: text + table)).faults()
        assert fault.where == "board 1"
        np.testing.assert_array_equal(fault.tendons, np.arange(12, 24))


def test_stamps_that_a_result_cannot_tell_apart_are_one(example, tmp_path) -> None:
    """Rows 40 microseconds apart, and 20 nanoseconds on two sides of a rounding: tables have 0.1 milliseconds."""
    table = tomllib.loads((example / "trial.toml").read_text())
    kept = {name: table[name] for name in ("structure", "mechanics", "rest")} | {"lengths": {"file": "lengths.csv"}}
    (tmp_path / "trial.toml").write_text(tomli_w.dumps(kept))
    lengths = ",".join(map(str, table["structure"]["natural_length_m"]))
    names = ",".join(f"l{tendon}_m" for tendon in range(24))
    stamps = (0.0, 0.02, 0.02004, 0.0201, 0.04, 0.06014999, 0.06015001)
    (tmp_path / "lengths.csv").write_text("\n".join([f"t_s,{names}", *(f"{t},{lengths}" for t in stamps), ""]))
    trial = open_trial(tmp_path)
    assert [reading.t_s for reading in trial.readings()] == [0.0, 0.02, 0.0201, 0.04, 0.06014999]
    assert trial.dropped_rows == 2


def test_dates_and_times_of_a_user_are_hashed_too(example, tmp_path) -> None:
    """TOML has them; keys that are not known are told, and kept."""
    shutil.copytree(example, tmp_path / "press")
    toml = tmp_path / "press" / "trial.toml"
    text = toml.read_text()
    hashes = []
    for hour in (8, 9):
        toml.write_text(f"recorded = 2026-11-24T0{hour}:00:00\n{text}")
        hashes.append(open_trial(tmp_path / "press").hashes()["trial.toml"])
    assert hashes[0] != hashes[1]


def test_boards_on_two_clocks_are_refused(example, tmp_path) -> None:
    """Frames of one would be 54 years after those of the other."""
    shutil.copytree(example, tmp_path / "press")
    rewritten(tmp_path / "press" / "board1.csv", stamped(lambda host_s: 1.7e9 + host_s))
    message = r"board0\.csv and board1\.csv: expected first rows at most 600 s apart, got 1\.7e\+09 s: is host_s of one clock in all, and is its unit right"
    with pytest.raises(InputError, match=message):
        next(open_trial(tmp_path / "press").readings())


def test_nodes_at_one_place_were_not_seen(example) -> None:
    """As programs write what was out of sight: all zero."""
    trial = open_trial(example)
    positions = trial.truth()
    position_m = positions.node_position_m.copy()
    position_m[3, [4, 7]] = 0.0
    seen = trial.truth_of(replace(positions, node_position_m=position_m)).node_position_m
    assert np.argwhere(np.isnan(seen).any(axis=-1)).tolist() == [[3, 4], [3, 7]]
    np.testing.assert_array_equal(seen[:3], positions.node_position_m[:3])
