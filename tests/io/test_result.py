"""Results, written."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import InputError, Reconstruction, open_trial, stream
from tensegraph.io.result import RESULT_FILES, result_directory, write_tables
from tensegraph.io.whole import check_replaceable
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


def test_a_table_of_the_user_is_not_replaced_by_a_result(tmp_path) -> None:
    """It has the name of one of ours, beside which there would be a run.toml."""
    (tmp_path / "shape.csv").write_text("sphere,1.5")
    with pytest.raises(InputError, match=r"a directory with shape\.csv and run\.toml"):
        check_replaceable(tmp_path, RESULT_FILES)


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
