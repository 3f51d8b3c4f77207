"""Plots on axes that are given, or made."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform

import tensegraph as tg


@pytest.fixture
def result(loaded):
    """Two seconds in which the structure rises by 50 mm."""
    loaded.node_position_m[..., 2] += 0.05 * np.linspace(0, 1, len(loaded))[:, None]
    return loaded


def test_a_shape_on_given_axes(result) -> None:
    figure = Figure()
    axis = figure.add_subplot(projection="3d")
    assert tg.plot.shape(result, 1.0, axis) is axis
    figure.draw_without_rendering()
    drawn = [line for part in axis.collections if isinstance(part, Line3DCollection) for line in part.get_segments()]
    for ends in (*result.structure.rods, *result.structure.tendons):
        now_mm = 1e3 * result[1.0].node_position_m[ends]
        seen = np.column_stack(proj_transform(*now_mm.T, axis.get_proj())[:2])
        assert any(np.allclose(line, seen) for line in drawn)
    assert axis.get_title() == "t = 1.00 s, ellipsoids × 20"
    low_mm, high_mm = axis.get_zlim()
    assert low_mm < 1e3 * result.node_position_m[..., 2].min()
    assert high_mm > 1e3 * result.node_position_m[..., 2].max()


def test_a_length_on_given_axes(result) -> None:
    figure = Figure()
    tg.plot.length(result, 3, figure.add_subplot())
    (axis,) = figure.axes
    measured, estimated = (line.get_ydata() for line in axis.get_lines())
    np.testing.assert_allclose(measured, 180)
    np.testing.assert_allclose(estimated, 1e3 * result.predicted_m[:, 3])


def test_on_axes_of_their_own(result) -> None:
    before = plt.get_fignums()
    assert tg.plot.shape(result, 0.5).name == "3d"
    assert tg.plot.length(result, 0).get_xlabel() == "time [s]"
    made = [number for number in plt.get_fignums() if number not in before]
    assert len(made) == 2
    for number in made:
        plt.close(number)


@pytest.mark.parametrize(
    ("plot", "message"),
    [
        (lambda result: tg.plot.shape(result, 9.0), "expected a time from 0.0000 to 1.9800 s"),
        (lambda result: tg.plot.shape(result, 1.0, Figure().add_subplot()), "ax: expected axes with projection='3d'"),
        (lambda result: tg.plot.length(result, 24), "tendon: expected a whole number from 0 to 23, got 24"),
        (lambda result: tg.plot.length(result, 4.0), "tendon: expected a whole number from 0 to 23, got 4.0"),
        (lambda result: tg.plot.length(result, "0"), "tendon: expected a whole number from 0 to 23, got '0'"),
    ],
)
def test_what_is_refused(result, plot, message) -> None:
    with pytest.raises(tg.InputError) as error:
        plot(result)
    assert message in str(error.value)
    assert not plt.get_fignums()
