"""Tables of numbers."""

import numpy as np

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
