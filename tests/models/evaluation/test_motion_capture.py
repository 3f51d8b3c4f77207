"""Markers laid onto an estimate: which is which node, when, and where."""

from dataclasses import replace

import numpy as np
import pytest

from capture_files import OFFSET_S, RATE_PPM, take_of
from four_nodes import estimate_of
from tensegraph import InputError
from tensegraph.io.reports.evaluation_tables import _capture_facts
from tensegraph.models.evaluation.marker_assignment import largest_reach_m
from tensegraph.models.evaluation.motion_capture import farther_apart_m, lay_onto, node_positions, other_offset_s
from tensegraph.models.evaluation.truth import MarkedNode, marked_nodes
from tensegraph.models.trial_tables import TruthTable
from tensegraph.models.values.tables import parse_table, unknown_keys
from tensegraph.models.values.tracks import MarkerTracks

NODES = [7, 3, 11, 0, 5, 2, 9, 1]


def tracks_of(take) -> MarkerTracks:
    return MarkerTracks(take.t_s, tuple(take.names), 1e-3 * take.position_mm)


@pytest.fixture(scope="module")
def estimate(true_positions, example_structure):
    """The true shapes at half their rate, off by half a millimetre."""
    t_s, position_m = true_positions
    noise_m = 0.0003 * np.random.default_rng(5).standard_normal(position_m[::2].shape)
    return estimate_of(example_structure, position_m[::2] + noise_m, t_s=t_s[::2])


@pytest.fixture(scope="module")
def take(true_positions):
    return take_of(*true_positions, NODES, ghosts=2)


@pytest.mark.parametrize(("late_s", "told_s"), [(0.0, np.nan), (0.08, np.nan), (0.6, -0.6), (-4.3, 4.3)])
def test_positions_on_another_clock(estimate, true_positions, late_s: float, told_s: float) -> None:
    """To a step of the search, 0.05 s; a single moment, or what does not move, tells nothing."""
    t_s, position_m = true_positions
    assert other_offset_s(t_s + late_s, position_m, estimate) == pytest.approx(told_s, abs=0.05, nan_ok=True)
    assert np.isnan(other_offset_s(t_s[:2] + late_s, position_m[:2], estimate))
    assert np.isnan(other_offset_s(np.append(t_s[:-1], 1e9) + late_s, position_m, estimate))  # a stamp that jumps
    still_m = np.repeat(position_m[:1], len(t_s), axis=0)
    assert np.isnan(other_offset_s(t_s + late_s, still_m, estimate))


def test_markers_clock_and_axes_are_found(take, estimate, true_positions) -> None:
    positions, fit = lay_onto(tracks_of(take), estimate)
    assert fit.found
    assert {mark.marker: mark.node for mark in fit.markers} == dict(zip(take.names, NODES, strict=False))
    assert fit.ignored == tuple(take.names[-2:])
    assert fit.clock.offset_s == pytest.approx(OFFSET_S + 1e-6 * RATE_PPM * fit.clock.middle_s, abs=0.002)
    assert fit.misfit_m < 0.0006 < 0.002 < fit.next_misfit_m
    true_m = np.stack(
        [np.interp(positions.t_s, true_positions[0], true_positions[1][:, 3, axis]) for axis in range(3)], axis=-1
    )
    error_m = (positions.node_position_m[:, 3] - true_m)[50:-50]
    assert np.sqrt(np.nanmean(error_m**2)) < 0.0005
    assert np.isnan(positions.node_position_m[:, [4, 6, 8, 10]]).all()


def test_what_is_told_is_used(take, estimate) -> None:
    marked = tuple(MarkedNode(name, node) for name, node in zip(take.names[:3], NODES, strict=False))
    positions, fit = lay_onto(tracks_of(take), estimate, marked=marked, offset_s=1.371)
    assert not fit.found
    assert fit.markers == marked
    assert fit.ignored == tuple(take.names[3:])
    assert (fit.clock.offset_s, fit.clock.offset_sigma_s, fit.clock.rate_ppm) == (1.371, 0.0, 0.0)
    assert np.flatnonzero(np.isfinite(positions.node_position_m).any(axis=(0, 2))).tolist() == [3, 7, 11]


def test_a_mapping_that_is_wrong_does_not_fit(take, estimate, example_structure) -> None:
    """With two of five markers exchanged they are further from their nodes than any marker may be."""
    names = [take.names[k] for k in (1, 0, 2, 3, 4)]
    marked = tuple(MarkedNode(name, node) for name, node in zip(names, NODES, strict=False))
    _, fit = lay_onto(tracks_of(take), estimate, marked=marked, offset_s=OFFSET_S)
    assert fit.misfit_m > largest_reach_m(example_structure) == pytest.approx(0.03)
    fact = dict(_capture_facts(fit, example_structure))["markers = nodes"]
    assert "far off: are they assigned rightly, or its axes mirrored?" in fact


def test_a_capture_in_another_unit_is_refused_by_that_word(take, estimate) -> None:
    """Metres that are told as millimetres: before the clock is searched for, which they do not tell either."""
    tracks = tracks_of(take)
    with pytest.raises(InputError, match=r"motion capture: expected nodes .* hold them, got .*: is the unit right\?"):
        lay_onto(replace(tracks, position_m=1e-3 * tracks.position_m), estimate)


def test_markers_that_are_exchanged_are_told_by_their_rods_where_the_clock_is_not_known(take, estimate) -> None:
    """The markers of nodes 7 and 3 are exchanged, in the first second, in which nothing moves: rod 0-3 tells it."""
    exchanged = [take.names[k] for k in (1, 0, 2, 3, 4)]
    marked = tuple(MarkedNode(name, node) for name, node in zip(exchanged, NODES, strict=False))
    tracks, still = tracks_of(take), slice(0, int(np.searchsorted(take.t_s, take.t_s[0] + 1.0)))
    at_rest = MarkerTracks(tracks.t_s[still], tracks.names, tracks.position_m[still])
    with pytest.raises(InputError, match=r"motion capture: nodes 0 and 3: expected as far apart as their rod is long"):
        lay_onto(at_rest, estimate, marked=marked)


def test_two_markers_that_are_told_to_be_one_node_are_refused(take, estimate) -> None:
    marked = (*(MarkedNode(name, node) for name, node in zip(take.names, NODES[:3], strict=False)),)
    twice = (*marked, MarkedNode(take.names[4], NODES[0]))
    with pytest.raises(InputError, match=r"expected pieces of one track at node 7, got two markers 0\.\d+ m apart"):
        lay_onto(tracks_of(take), estimate, marked=twice, offset_s=OFFSET_S)


def test_pieces_of_a_lost_marker_are_one_node(take, estimate) -> None:
    """Half of the take under one name, the other half under another."""
    middle = len(take.t_s) // 2
    position_m = np.concatenate([1e-3 * take.position_mm, 1e-3 * take.position_mm[:, :1]], axis=1)
    position_m[middle:, 0] = position_m[:middle, -1] = np.nan
    tracks = MarkerTracks(take.t_s, (*take.names, "again"), position_m)
    _, fit = lay_onto(tracks, estimate, offset_s=OFFSET_S)
    assert {mark.marker for mark in fit.markers if mark.node == NODES[0]} == {take.names[0], "again"}


def test_two_fits_alike_are_named(true_positions, estimate) -> None:
    """Three markers fit in two ways to half a millimetre."""
    take = take_of(*true_positions, [0, 4, 8], ghosts=0, noise_mm=2.0)
    with pytest.raises(
        InputError, match=r"two assignments .* mm: Unlabeled 1000 = .*; .* mm: .*: tell it in \[truth.markers\]"
    ):
        lay_onto(tracks_of(take), estimate, offset_s=OFFSET_S)


def test_two_poor_fits_may_be_markers_beyond_their_nodes(true_positions, estimate, example_structure) -> None:
    """All ways to turn the six rods fit to about 12 mm."""
    take = beyond(take_of(*true_positions, list(range(12)), ghosts=0), example_structure, 12.0)
    with pytest.raises(
        InputError, match=r"two assignments .* alike .*: tell it, and beyond_m where markers stand"
    ) as e:
        lay_onto(tracks_of(take), estimate, offset_s=OFFSET_S)
    assert str(e.value).count(", and 9 more") == 2


def test_what_fits_nowhere(take, estimate) -> None:
    tracks = MarkerTracks(take.t_s, tuple(take.names), 3e-3 * take.position_mm)
    with pytest.raises(InputError, match="no assignment of its 10 markers to nodes fits the shape to 30 mm"):
        lay_onto(tracks, estimate)


def test_times_at_which_two_markers_are_seen(take, estimate) -> None:
    """Nothing is told of them; the markers are assigned where more are seen."""
    tracks = tracks_of(take)
    position_m = tracks.position_m.copy()
    position_m[: len(position_m) // 2, 2:] = np.nan
    _, fit = lay_onto(replace(tracks, position_m=position_m), estimate)
    assert {mark.marker: mark.node for mark in fit.markers} == dict(zip(take.names, NODES, strict=False))


def test_what_cannot_be_told(take, estimate) -> None:
    tracks, marks = tracks_of(take), [MarkedNode(name, node) for name, node in zip(take.names, NODES, strict=False)]
    with pytest.raises(InputError, match="no marker is called 'A': expected one of Unlabeled 1000, "):
        lay_onto(tracks, estimate, marked=(MarkedNode("A", 0),))
    still = tuple(mark for mark in marks if mark.node in (0, 1, 2))
    with pytest.raises(
        InputError, match=r"the motion does not show the offset of the capture's clock .*: give --offset"
    ):
        lay_onto(tracks, estimate, marked=still)
    with pytest.raises(InputError, match="markers are on one line"):
        lay_onto(tracks, estimate, marked=still[:1], offset_s=OFFSET_S)
    with pytest.raises(InputError, match="covers no frame of the estimate"):
        lay_onto(tracks, estimate, marked=still, offset_s=100.0)


def test_a_marker_beyond_its_node_by_hand(example_structure) -> None:
    """Rod 0-3 upright with markers 10 and 20 mm beyond its ends: the nodes are at 0 and 0.3 m."""
    tracks = MarkerTracks(np.zeros(1), ("a", "b"), np.array([[[0, 0, -0.01], [0, 0, 0.32]]]))
    marked = (MarkedNode("a", 0, 0.01), MarkedNode("b", 3, 0.02))
    node_m = node_positions(tracks, marked, example_structure)
    np.testing.assert_allclose(node_m[0, [0, 3]], [[0, 0, 0], [0, 0, 0.3]], atol=1e-12)


def beyond(take, structure, beyond_mm: float):
    """The same take, with every marker beyond its node; the other end of its rod is a marker, too."""
    other = dict(structure.rods.tolist()) | {b: a for a, b in structure.rods.tolist()}
    place = {node: k for k, node in enumerate(take.node.tolist())}
    along_mm = np.stack(
        [take.position_mm[:, place[n]] - take.position_mm[:, place[other[n]]] for n in take.node.tolist()], axis=1
    )
    along_mm /= np.linalg.norm(along_mm, axis=-1, keepdims=True)
    return replace(take, position_mm=take.position_mm + beyond_mm * along_mm)


@pytest.mark.parametrize(
    ("excess_mm", "farther_mm"),
    [
        ([24, 23, 25], 24),
        ([24, 24, np.nan], 24),
        ([2, 2, 3], np.nan),  # as far as rods are measured
        ([24, 4, 14], np.nan),  # the rods differ by 20 mm: a marker is at another node
        ([150, 150, 150], np.nan),  # 75 mm from each node is no marker of it
        ([np.nan, np.nan, np.nan], np.nan),
    ],
)
def test_rods_whose_markers_are_farther_apart_by_hand(example_structure, excess_mm, farther_mm) -> None:
    """Of three rods both ends are seen, of which one is at the origin; in one of three times something jumps."""
    node_m = np.full((3, 12, 3), np.nan)
    rods, rod_m = example_structure.rods, example_structure.rod_length_m
    for (a, b), length_m, excess in zip(rods, rod_m, excess_mm, strict=False):
        node_m[:, a] = 0.0
        node_m[:, b] = [length_m + 1e-3 * excess, 0, 0]
    node_m[1] *= 2
    assert 1e3 * farther_apart_m(node_m, example_structure) == pytest.approx(farther_mm, nan_ok=True)


@pytest.mark.parametrize(
    ("told_m", "words"), [(0.0, "beyond_m = 0.012 in"), (0.004, "beyond_m larger by 0.008 in"), (0.012, None)]
)
def test_markers_beyond_their_nodes_are_told(true_positions, estimate, example_structure, told_m, words) -> None:
    """12 mm beyond both ends of two rods, 0-3 and 2-9: 24 mm farther apart; nothing is corrected."""
    take = beyond(take_of(*true_positions, [0, 3, 2, 9], ghosts=0), example_structure, 12.0)
    marked = tuple(MarkedNode(name, node, told_m) for name, node in zip(take.names, take.node.tolist(), strict=True))
    positions, fit = lay_onto(tracks_of(take), estimate, marked=marked, offset_s=OFFSET_S)
    said = dict(_capture_facts(fit, example_structure)).get("markers of a rod")
    apart_m = np.linalg.norm(np.diff(positions.node_position_m[:, [0, 3]], axis=1), axis=-1)
    assert np.nanmedian(apart_m) == pytest.approx(0.3 + 2 * (0.012 - told_m), abs=0.0005)
    assert said is None if words is None else f"farther apart than it is long, on average: {words}" in said


def test_the_table_of_markers(example_structure) -> None:
    def nodes(structure=example_structure, **markers):
        return marked_nodes(parse_table(TruthTable, {"file": "a.csv", "markers": markers}, "t"), structure, "t")

    assert nodes(a={"node": 0, "beyond_m": 0.01}, b={"node": 3}) == (MarkedNode("a", 0, 0.01), MarkedNode("b", 3))
    with pytest.raises(InputError, match=r"t: truth.markers.a.node: expected a node from 0 to 11, got 12"):
        nodes(a={"node": 12})
    with pytest.raises(
        InputError, match=r"a.beyond_m: expected a marker at node 3 too, .*: without it, leave this marker out of truth"
    ):
        nodes(a={"node": 0, "beyond_m": 0.01})
    with pytest.raises(InputError, match=r"t: truth.markers.a.beyond_m: .*, 0.3 m, got 12: is the unit right\?"):
        nodes(a={"node": 0, "beyond_m": 12.0}, b={"node": 3, "beyond_m": 12.0})
    without_a_rod = replace(
        example_structure, rods=example_structure.rods[1:], rod_length_m=example_structure.rod_length_m[1:]
    )
    assert nodes(without_a_rod, a={"node": 0}) == (MarkedNode("a", 0),)
    with pytest.raises(InputError, match=r"t: truth.markers.a.beyond_m: expected a node of a rod, .*, got 0"):
        nodes(without_a_rod, a={"node": 0, "beyond_m": 0.01}, b={"node": 3})
    table = {"file": "a.csv", "markers": {"a": {"node": 0, "colour": 1}}}
    assert [key.name for key in unknown_keys(TruthTable, table)] == ["markers.a.colour"]
