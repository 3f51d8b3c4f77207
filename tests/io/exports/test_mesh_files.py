"""PLY and glTF of one frame, read back by trimesh."""

import numpy as np
import pytest
from scipy.stats import chi2

import tensegraph as tg
from tensegraph.io.exports.solids import axes_along, carried_along, unit_mesh

Y_UP = [0, 2, 1]
"""Our axes in the order of glTF's: its y is our z, its z our -y."""


@pytest.mark.parametrize(
    "direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -2, 0], [0.3, -0.4, 0.5], [1e-9, 0, -1], [0, 0, 0]]
)
def test_axes_along_a_direction(direction) -> None:
    axes = axes_along(np.array(direction, dtype=float))
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(axes[:, 2] * np.linalg.norm(direction), direction, atol=1e-12)


def test_axes_carried_along_a_direction() -> None:
    """Through the horizontal, once around, and where nothing is carried: right-handed, and no jump."""
    turn = np.linspace(0, 2 * np.pi, 400)
    directions = np.stack([0.3 * np.cos(turn), 0.1 + 0 * turn, 0.3 * np.sin(turn)], axis=1)
    axes = [axes_along(directions[0])]
    for direction in directions:
        axes.append(carried_along(axes[-1], direction))
        np.testing.assert_allclose(axes[-1].T @ axes[-1], np.eye(3), atol=1e-12)
        assert np.linalg.det(axes[-1]) == pytest.approx(1)
        np.testing.assert_allclose(axes[-1][:, 2] * np.linalg.norm(direction), direction, atol=1e-12)
    assert np.abs(np.diff(axes, axis=0)).max() < 0.02
    np.testing.assert_array_equal(carried_along(np.eye(3), np.zeros(3)), np.eye(3))
    np.testing.assert_array_equal(carried_along(np.eye(3), np.array([2.0, 0, 0])), axes_along(np.array([1.0, 0, 0])))


@pytest.mark.parametrize(("kind", "volume"), [("cylinder", 2 * np.pi), ("sphere", 4 / 3 * np.pi)])
def test_a_mesh_is_closed_and_turned_outward(kind, volume) -> None:
    """The divergence theorem: a sixth of the sum of triple products, positive if triangles face outward."""
    mesh = unit_mesh(kind, sides=200)
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=2e-3)
    edges = np.concatenate([mesh.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    assert {tuple(edge) for edge in edges} == {(b, a) for a, b in edges}


def test_a_gltf_scene(short_run, tmp_path) -> None:
    """An ellipsoid reaches as far along each axis as its variance along that axis says."""
    trimesh = pytest.importorskip("trimesh")
    (path,) = tg.export(short_run, tmp_path / "run.glb", at_s=0.2, probability=0.9)
    shape = short_run[0.2]
    scene = trimesh.load(path)
    names = set(scene.graph.nodes_geometry)
    assert len(names) == 6 + 24 + 9
    assert "tendon 3 (0-7)" in names
    turn, geometry = scene.graph.get("ellipsoid of node 7")
    points = trimesh.transform_points(scene.geometry[geometry].vertices, turn)
    half_m = 0.5 * np.ptp(points, axis=0)
    variance_m2 = np.diag(shape.node_covariance_m2[7])
    np.testing.assert_allclose(half_m, np.sqrt(chi2.ppf(0.9, 3) * variance_m2)[Y_UP], rtol=0.02)
    np.testing.assert_allclose(turn[:3, 3], shape.node_position_m[7][Y_UP] * [1, 1, -1], atol=1e-6)
    turn, _ = scene.graph.get("rod 2 (1-6)")
    ends = trimesh.transform_points([[0, 0, -1], [0, 0, 1]], turn)
    np.testing.assert_allclose(ends, shape.node_position_m[[1, 6]][:, Y_UP] * [1, 1, -1], atol=1e-6)


def test_a_ply_mesh(short_run, tmp_path) -> None:
    trimesh = pytest.importorskip("trimesh")
    (path,) = tg.export(short_run, tmp_path / "run.ply", at_s=0.2)
    mesh = trimesh.load(path, process=False)
    assert mesh.is_watertight
    assert mesh.body_count == 6 + 24 + 9
    low, high = short_run[0.2].node_position_m.min(axis=0), short_run[0.2].node_position_m.max(axis=0)
    np.testing.assert_allclose(mesh.bounds, [low, high], atol=0.01)
    assert tuple(mesh.visual.vertex_colors[0]) == (0, 0, 0, 255)
    assert mesh.visual.vertex_colors[-1][3] == round(0.4 * 255)
    assert b"comment t_s = 0.2" in path.read_bytes()[:400]


@pytest.mark.parametrize(
    ("name", "at_s", "message"),
    [
        ("run.ply", None, "run.ply: holds one frame: expected its time, --at or at_s, from 0.00 to 0.48 s"),
        ("run.glb", 7.0, "expected its time, --at or at_s, from 0.00 to 0.48 s"),
        ("run.glb", float("nan"), "expected its time, --at or at_s, from 0.00 to 0.48 s"),
        ("run.PLY", 0.2, "run.PLY: expected a name that ends in"),
        ("run.npz", 0.2, ".npz holds all frames: expected no time"),
        ("run.stl", None, "run.stl: expected a name that ends in .mat, .npz"),
    ],
)
def test_what_is_refused(short_run, tmp_path, name, at_s, message) -> None:
    with pytest.raises(tg.InputError) as error:
        tg.export(short_run, tmp_path / name, at_s=at_s)
    assert message in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("probability", [0, 1, 95, float("nan")])
def test_ellipsoids_of_no_probability_are_refused(short_run, tmp_path, probability) -> None:
    with pytest.raises(tg.InputError, match="probability: expected a number between 0 and 1, got "):
        tg.export(short_run, tmp_path / "run.npz", probability=probability)
    assert not list(tmp_path.iterdir())
