"""The files of motors, and what is refused in them and in trial.toml."""

import pytest

from command_line import refusal_of
from tensegraph import Flag, InputError, open_trial, reconstruct
from tensegraph.models.values.readings import NaturalLengthReading
from trial_edits import replaced

TABLE = '[[motor]]\nfile = "natural_length.csv"\ntendons = [3, 7]\nstrip_length_m = 0.12\n\n[truth]'
ROWS = "t_s,tendon,natural_length_m,sigma_m\n0.0,3,0.17,0.0001\n0.0,7,0.17,0.0001\n0.02,3,0.169,0.0002\n"


@pytest.fixture
def wound(trial_copy):
    """Makes a trial with a file of motors."""

    def make(rows: str = ROWS, table: str = TABLE):
        path = trial_copy(rows=60, trial=replaced("[truth]", table))
        (path / "natural_length.csv").write_text(rows)
        return path

    return make


def test_rows_are_read_in_order_of_time_before_lengths_of_the_same_instant(wound) -> None:
    trial = open_trial(wound())
    readings = list(trial.readings())
    told = [reading for reading in readings if isinstance(reading, NaturalLengthReading)]
    assert [(r.t_s, r.tendon, r.natural_length_m, r.sigma_m) for r in told] == [
        (0.0, 3, 0.17, 0.0001),
        (0.0, 7, 0.17, 0.0001),
        (0.02, 3, 0.169, 0.0002),
    ]
    assert readings[:2] == told[:2]
    assert "natural_length.csv" in trial.hashes()


def test_half_a_line_at_the_end_is_left_out_and_counted(wound) -> None:
    trial = open_trial(wound(ROWS + "0.04,3,0.16"))
    assert sum(isinstance(reading, NaturalLengthReading) for reading in trial.readings()) == 3
    assert trial.half_lines == 1


REFUSED_ROWS = {
    "row 4, column tendon: expected one of 3, 7, as trial.toml says, got 5": ROWS.replace("0.02,3", "0.02,5"),
    "row 4, column natural_length_m: expected a positive number, got -0.169": ROWS.replace("0.169", "-0.169"),
    "row 4, column sigma_m: expected a positive number, got 0.0": ROWS.replace("0.0002", "0.0"),
    "row 4, column t_s: expected a stamp not before 0.0, got -0.02": ROWS.replace("0.02,3", "-0.02,3"),
    "row 4, column t_s: expected a stamp later than 0.0, the last of tendon 3": ROWS.replace("0.02,3", "0.0,3"),
    "row 4, column natural_length_m: expected a finite number, got 'x'": ROWS.replace("0.169", "x"),
    "column 'sigma_m' is missing": ROWS.replace("sigma_m", "sigma"),
}


@pytest.mark.parametrize("message", REFUSED_ROWS)
def test_a_row_that_cannot_be_is_refused(message, wound) -> None:
    trial = open_trial(wound(REFUSED_ROWS[message]))
    with pytest.raises(InputError, match=r"natural_length\.csv") as refused:
        list(trial.readings())
    assert message in str(refused.value)


MILLIMETRES = "t_s,tendon,natural_length_m,sigma_m\n0.0,3,170,0.1\n0.0,7,170,0.1\n0.02,3,169,0.2\n"


def test_centimetres_are_refused_where_strips_were_wound_up_a_little(wound) -> None:
    with pytest.raises(InputError, match=r"got 16.5 m: is the unit right"):
        list(open_trial(wound(MILLIMETRES.replace("170", "16.5").replace("169", "16.4"))).readings())


def test_millimetres_are_refused_in_one_line_that_asks_for_the_unit(wound) -> None:
    path = wound(MILLIMETRES)
    result = refusal_of("reconstruct", path.name, "--figures", "none", cwd=path.parent)
    assert "natural_length.csv: column natural_length_m: expected lengths like that of tendon 3 at rest" in result
    assert "got 170 m: is the unit right?" in result


@pytest.mark.parametrize("rows", [ROWS.replace("0.17,", "170,", 1), ROWS.replace(",0.1", ",10.1")])
def test_a_single_wrong_row_and_an_encoder_with_another_zero_are_no_other_unit(wound, rows) -> None:
    """Of tendons of 0.17 m, one row of 170 m among others, or all of them 10 m longer."""
    readings = list(open_trial(wound(rows)).readings())
    assert sum(isinstance(reading, NaturalLengthReading) for reading in readings) == 3


REFUSED_TABLES = {
    "motor[0].tendons: expected tendons from 0 to 23, got 24": TABLE.replace("[3, 7]", "[3, 24]"),
    "motor[0].strip_length_m: expected at most the natural length of tendon 3": TABLE.replace("0.12", "0.5"),
    "motor[1].tendons: tendon 3 has a motor already": TABLE.replace("[truth]", TABLE.replace("natural", "other")),
    "motor[0].strip_length_m: is missing": TABLE.replace("strip_length_m = 0.12\n", ""),
}


@pytest.mark.parametrize("message", REFUSED_TABLES)
def test_a_table_that_cannot_be_is_refused_in_one_line(message, wound) -> None:
    path = wound(table=REFUSED_TABLES[message])
    assert message in refusal_of("reconstruct", path.name, "--figures", "none", cwd=path.parent)


def test_a_missing_file_is_named(wound) -> None:
    path = wound()
    (path / "natural_length.csv").unlink()
    with pytest.raises(InputError, match=r"natural_length\.csv: no such file"):
        open_trial(path)


def test_a_file_that_ends_never_stops_the_estimate(wound) -> None:
    """No rows after 0.02 s: while the structure rests, its natural lengths are known all the same."""
    result = reconstruct(wound(), "live")
    assert len(result) > 50
    assert not (result.flags[:, [3, 7]] & Flag.MISSING).any()
