"""Results, read back as they were written."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import InputError, Reconstruction, open_trial, stream
from tensegraph.io.result import read_estimate, result_directory, write_tables
from tensegraph.models.evaluation.estimate import Estimate
from tensegraph.models.values.slip import Slip


@pytest.fixture(scope="module")
def first_second(example):
    trial = open_trial(example)
    readings = (row for row in trial.readings() if row.host_s < 1.0)
    return Reconstruction.of(trial.description.structure, stream(readings, trial.description))


def test_an_evaluation_is_not_replaced_by_a_result(tmp_path) -> None:
    """Both have a run.toml."""
    for name in ("run.toml", "evaluation.json"):
        (tmp_path / name).write_text("")
    with pytest.raises(InputError, match="exists and is no earlier result"), result_directory(tmp_path):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["evaluation.json", "run.toml"]


def test_slips_have_a_row_each(first_second, tmp_path) -> None:
    frames = len(first_second)
    slip = Slip(0.5, 7, np.array([0.003, 0.0, -0.004]), 0.002)
    slips = ((),) * (frames - 1) + ((slip,),)
    on_floor = replace(first_second, contacts=np.ones((frames, 12)), slips=slips)
    write_tables(on_floor, 0.95, tmp_path)
    assert (tmp_path / "slips.csv").read_text().splitlines() == [
        "t_s,node,distance_m,sigma_m,x_m,y_m,z_m",
        "0.5000,7,0.005000,0.002000,0.003000,0.000000,-0.004000",
    ]


class TestResultsAreReadBack:
    @pytest.fixture
    def saved(self, first_second, tmp_path):
        write_tables(first_second, 0.95, tmp_path)
        return first_second, tmp_path

    def test_as_they_were_written(self, saved) -> None:
        result, path = saved
        read, kept = read_estimate(path, result.structure), Estimate.of(result)
        np.testing.assert_allclose(read.t_s, kept.t_s, atol=1e-4)
        np.testing.assert_allclose(read.node_position_m, kept.node_position_m, atol=1e-6)
        np.testing.assert_allclose(read.node_covariance_m2, kept.node_covariance_m2, rtol=1e-8, atol=1e-16)
        np.testing.assert_array_equal(read.flags, kept.flags)
        for name in ("length_m", "sigma_m", "innovation_sigma_m"):
            np.testing.assert_allclose(getattr(read, name), getattr(kept, name), atol=1e-6)

    @pytest.mark.parametrize(
        ("file", "old", "new", "message"),
        [
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
    def test_or_refused(self, saved, file, old, new, message) -> None:
        result, path = saved
        text = (path / file).read_text()
        assert old in text
        (path / file).write_text(text.replace(old, new, 1))
        with pytest.raises(InputError) as error:
            read_estimate(path, result.structure)
        assert message in str(error.value)

    def test_an_infinite_load_is_refused(self, saved) -> None:
        """Unknown is nan; the figures have no place for an infinite one."""
        result, path = saved
        loads = path / "estimated_loads.csv"
        header, first, *rows = loads.read_text().splitlines()
        cells = first.split(",")
        cells[2] = "-inf"
        loads.write_text("\n".join([header, ",".join(cells), *rows, ""]))
        with pytest.raises(InputError, match=r"row 2, column fx_n: expected a finite number or nan, got '-inf'"):
            read_estimate(path, result.structure)

    def test_what_is_no_covariance_is_refused(self, saved) -> None:
        result, path = saved
        rows = (path / "ellipsoids.csv").read_text().splitlines()
        fields = rows[4].split(",")
        rows[4] = ",".join([*fields[:5], "-0.4", *fields[6:]])
        (path / "ellipsoids.csv").write_text("\n".join(rows) + "\n")
        with pytest.raises(InputError, match=r"ellipsoids\.csv: row 5, columns cxx_m2 to czz_m2: .* variance -0\.4 m2"):
            read_estimate(path, result.structure)

    def test_with_loads(self, saved) -> None:
        result, path = saved
        read = read_estimate(path, result.structure).loads
        free = result.structure.free_nodes
        np.testing.assert_allclose(read.force_n[:, free], result.loads.force_n[:, free], atol=1e-4)
        np.testing.assert_allclose(read.sigma_n[:, free], result.loads.sigma_n[:, free], atol=1e-4)
        assert np.isnan(read.force_n[:, result.structure.anchors]).all()
        (path / "estimated_loads.csv").unlink()  # as a result without [mechanics]
        assert read_estimate(path, result.structure).loads is None
