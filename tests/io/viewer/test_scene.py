"""What the viewer shows, as numbers and colours."""

from dataclasses import replace

import numpy as np
import pytest

from tensegraph import Status
from tensegraph.io.figures.style import GREY, ORANGE, SKY_BLUE
from tensegraph.io.viewer.curves import status_changes
from tensegraph.io.viewer.scene import bytes_of, ghost_columns, space_columns, tendon_colors
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.shape import Covariances, Reason


def test_a_tendon_has_the_colour_of_its_strain(loaded) -> None:
    """Half way from 0 to 10 %: half way from #56B4E9 to #0072B2."""
    strain = loaded.predicted_m[0] / loaded.structure.natural_length_m - 1
    natural_m = loaded.predicted_m[0] / 1.05
    natural_m[0] = loaded.predicted_m[0, 0]
    stretched = replace(loaded, structure=replace(loaded.structure, natural_length_m=natural_m))
    colors = tendon_colors(stretched)[0]
    assert colors[0].tolist() == bytes_of(SKY_BLUE).tolist()
    np.testing.assert_array_equal(colors[1:], np.tile([0x2B, 0x93, 0xCD, 0xFF], (len(strain) - 1, 1)))


def test_bent_and_dead_tendons_have_colours_of_their_own(loaded) -> None:
    mode, length_m = loaded.mode.copy(), loaded.length_m.copy()
    mode[3, [4, 5]] = 1
    length_m[3, 5] = np.nan
    colors = tendon_colors(replace(loaded, mode=mode, length_m=length_m))
    assert colors[3, 4].tolist() == bytes_of(ORANGE).tolist()
    assert colors[3, 5].tolist() == bytes_of(GREY).tolist()
    assert colors[2, 4].tolist() == colors[3, 3].tolist()


def test_only_certain_loads_are_shown() -> None:
    """At a sigma of 0.2 N, 0.39 N is hidden noise of two sigmas; 0.3 N at 0.1 N is below a threshold of 0.35 N."""
    loads = ExternalLoads(
        np.array([[0, 0, 0.39], [0, 0, 0.41], [0, 0, 0.3], [np.nan] * 3]), np.array([0.2, 0.2, 0.1, np.inf])
    )
    assert loads.is_certain(0.1).tolist() == [False, True, True, False]
    assert loads.is_certain(0.35).tolist() == [False, True, False, False]


def test_a_status_is_told_where_it_changes(loaded) -> None:
    status = [Status.OK] * 100
    status[10:20] = [Status.DOUBT] * 10
    doubts = [None] * 10 + [Reason.MOTION] * 5 + [Reason.SENSORS] * 5 + [None] * 80
    run = replace(loaded, status=tuple(status), doubts=tuple(doubts))
    t_s, texts = status_changes(run, "")
    assert texts == ["ok", "doubt: motion", "doubt: sensors", "ok"]
    np.testing.assert_allclose(t_s, [0, 0.2, 0.3, 0.4])
    assert status_changes(run, "ok")[1] == texts[1:]


def test_an_arrow_of_a_load_ends_at_its_node(loaded) -> None:
    """2 N downward at node 5: 60 mm; 200 N would be 6 m, and are one rod long."""
    rerun = pytest.importorskip("rerun")
    heavy = replace(loaded, loads=ExternalLoads(100 * loaded.loads.force_n, loaded.loads.sigma_n))
    for run, length_m in ((loaded, 0.06), (heavy, 0.3)):
        arrows = space_columns(rerun, run, 0.95, 0.2)["loads"]
        parts = {column.component_descriptor().component: column.as_arrow_array() for column in arrows}
        tail_m, push_m = (np.array(parts[f"Arrows3D:{name}"][50].as_py()) for name in ("origins", "vectors"))
        np.testing.assert_allclose(push_m, [[0, 0, -length_m]], rtol=1e-6)
        np.testing.assert_allclose(tail_m + push_m, run.node_position_m[50, [5]], atol=1e-6)
        assert len(parts["Arrows3D:origins"][0]) == 0  # nothing is loaded in the first frame


def test_a_hidden_node_takes_its_rod_and_tendons_from_the_ghost(loaded) -> None:
    rerun = pytest.importorskip("rerun")
    position_m = loaded.node_position_m[:3].copy()
    position_m[1, 7] = np.nan
    ghost = ghost_columns(rerun, loaded.structure, position_m)
    for name, pairs in (("rods", loaded.structure.rods), ("tendons", loaded.structure.tendons)):
        strips = next(c for c in ghost[name] if "strips" in c.component_descriptor().component).as_arrow_array()
        seen = len(pairs) - int((pairs == 7).any(axis=1).sum())
        assert [len(frame) for frame in strips] == [len(pairs), seen, len(pairs)]


def test_a_run_without_covariance_has_no_ellipsoids(loaded) -> None:
    rerun = pytest.importorskip("rerun")
    unknown = Covariances.of_nodes(np.full_like(loaded.node_covariance_m2, np.nan))
    columns = space_columns(rerun, replace(loaded, covariances=unknown), 0.95, 0.2)
    assert set(columns) == {"rods", "tendons", "marked_tendons", "nodes", "loads"}
