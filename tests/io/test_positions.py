"""Node positions of other systems."""

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.io.positions import read_positions


class TestPositions:
    def test_files_of_other_systems(self, tmp_path) -> None:
        """Only some nodes, in any order, with blank cells where a marker was hidden."""
        path = tmp_path / "mocap.csv"
        path.write_text("n1_z_m,t_s,n1_x_m,n1_y_m\n3,0.0,1,2\n,0.1,,\n")
        positions = read_positions(path, 3)
        np.testing.assert_array_equal(positions.t_s, [0.0, 0.1])
        np.testing.assert_array_equal(positions.node_position_m[:, 1], [[1, 2, 3], [np.nan] * 3])
        assert np.isnan(positions.node_position_m[:, [0, 2]]).all()

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("t_s,x\n0,1\n1,1\n", "holds no node: expected columns as n0_x_m"),
            ("n0_x_m\n0\n1\n", "column 't_s' is missing"),
            ("t_s,n0_x_m\n0,1\n", "expected at least two rows, got 1"),
            ("t_s,n0_x_m\n0,1\n1,1\n1,2\n", "row 4, column t_s: expected more than 1.0, got 1.0"),
            ("# a\n# a\nt_s,n0_x_m\n0,1\n1,1\n1,2\n", "row 6, column t_s: expected more than 1.0, got 1.0"),
            ("t_s,n0_x_m\n0,1\n1,left\n", "row 3, column n0_x_m: expected a finite number, got 'left'"),
        ],
    )
    def test_files_that_are_none(self, tmp_path, text, message) -> None:
        path = tmp_path / "mocap.csv"
        path.write_text(text)
        with pytest.raises(InputError) as error:
            read_positions(path, 3)
        assert message in str(error.value)
