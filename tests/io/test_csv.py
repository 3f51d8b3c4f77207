"""Tables of numbers."""

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.io.csv import CsvFile


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

    @pytest.mark.parametrize("numbered", [False, True])
    def test_equal_comment_lines_do_not_shift_the_rows(self, tmp_path, numbered) -> None:
        """Rows are counted by lines, not by the names in the comments."""
        path = tmp_path / "a.csv"
        path.write_text("# made by hand\n# made by hand\n" + ("" if numbered else "1\n") + "5\nx\n")
        file = CsvFile(path, ["1"], numbered=numbered)
        assert next(iter(file)) == [5.0]
        with pytest.raises(
            InputError, match=f"row {4 if numbered else 5}, column 1: expected a finite number, got 'x'"
        ):
            list(file)


def test_an_error_shows_the_beginning_of_a_long_cell(tmp_path) -> None:
    (tmp_path / "a.csv").write_text(f"t_s\n{'9' * 5000}\n")
    with pytest.raises(InputError, match=r"row 2, column t_s: expected a finite number, got '9{60}\.\.\.'$"):
        list(CsvFile(tmp_path / "a.csv", ["t_s"]))


@pytest.mark.parametrize("cell", ["0.1_3889", "1_000", "_", "0x1F", "1e", "--1"])
def test_what_is_a_number_to_a_program_alone_is_none(tmp_path, cell) -> None:
    (tmp_path / "a.csv").write_text(f"t_s\n{cell}\n")
    with pytest.raises(InputError, match=f"row 2, column t_s: expected a finite number, got '{cell}'"):
        list(CsvFile(tmp_path / "a.csv", ["t_s"]))


def test_a_number_that_may_be_infinite_has_a_range_too(tmp_path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("fx_n\n-inf\n-4e305\n")
    rows = iter(CsvFile(path, ["fx_n"], words={"fx_n": float}))
    assert next(rows) == [-np.inf]
    with pytest.raises(InputError, match=r"row 3, column fx_n: expected a magnitude of at most 1e\+07, got -4e\+305"):
        next(rows)


def test_an_infinite_value_is_a_missing_one_only_where_that_is_told(tmp_path) -> None:
    """A resistance of an open circuit, as MATLAB writes it; an infinite sigma of a length would be none told."""
    (tmp_path / "table.csv").write_text("r,s\nInf,1\n2,-inf\n")
    file = CsvFile(tmp_path / "table.csv", ["r"], blank=["r", "s"], infinite=["r"])
    np.testing.assert_array_equal(list(file), [[np.nan], [2]])
    with pytest.raises(InputError, match="row 3, column s: expected a finite number, got '-inf'"):
        list(CsvFile(tmp_path / "table.csv", ["r", "s"], blank=["r", "s"], infinite=["r"]))


def test_only_a_last_line_without_its_end_is_half(tmp_path) -> None:
    """A carriage return alone ends a line, too: rows after it are not lost."""
    (tmp_path / "mac.csv").write_bytes(b"a,b\r1,2\r3,4\r5,")
    file = CsvFile(tmp_path / "mac.csv", ["a", "b"])
    assert list(file) == [[1.0, 2.0], [3.0, 4.0]]
    assert file.half_lines == 1
    (tmp_path / "mixed.csv").write_bytes(b"a,b\r\n1,2\r \n3,4\r\n")
    with pytest.raises(InputError, match="row 3: expected 2 fields, got a blank line"):
        list(CsvFile(tmp_path / "mixed.csv", ["a", "b"]))


def test_a_table_as_spreadsheets_and_r_write_it(tmp_path) -> None:
    """Names and words in quotes, and blank lines at the end."""
    path = tmp_path / "r.csv"
    path.write_text('"t_s","mode"\n0.5,"bent"\n\n  \n')
    words = {"mode": lambda cell: float(["straight", "bent"].index(cell))}
    assert list(CsvFile(path, ["t_s", "mode"], words=words)) == [[0.5, 1.0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a;b\n1;2\n", "row 1: expected columns with commas between, got a;b"),
        ("a,b\n1,2\n\n3,4\n", "row 3: expected 2 fields, got a blank line"),
        ("a,b\n1,5,2,5\n", r"row 2: expected 2 fields, got 4: is a decimal point a comma\?"),
        ("a\n", "row 1: column 'b' is missing: got a"),
        ("a,b,a\n1,2,3\n", "row 1: column 'a': expected once, got it twice or more"),
    ],
)
def test_what_is_no_table_is_said(tmp_path, content, message) -> None:
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        list(CsvFile(tmp_path / "a.csv", ["b"] if content == "a\n" else ["a", "b"]))


def test_another_encoding_is_said(tmp_path) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n", encoding="utf-16")
    with pytest.raises(InputError, match="cannot be read: expected text in UTF-8"):
        list(CsvFile(tmp_path / "a.csv", ["a", "b"]))
