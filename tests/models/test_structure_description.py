"""What describes a structure, and what is refused of it."""

import numpy as np
import pytest

from structures import PLATE_M, plate, plate_tables
from tensegraph import InputError
from tensegraph.models.structure_description import describe_structure


def test_a_body_is_all_distances_between_its_nodes() -> None:
    told = plate()
    assert told.own_rods == 0
    assert told.bodies == ((0, 1, 2, 3, 4),)
    assert len(told.structure.rods) == 10
    expected = np.linalg.norm(PLATE_M[told.structure.rods[:, 0]] - PLATE_M[told.structure.rods[:, 1]], axis=1)
    np.testing.assert_allclose(told.structure.rod_length_m, expected)


@pytest.mark.parametrize(
    ("stiffness_n_per_m", "push_back", "cables"),
    [(400.0, 0.0, []), (2e4, 0.02, []), (2e4, 0.0, list(range(8))), ([400.0] * 7 + [5e3], 0.0, [7])],
)
def test_stiff_tendons_that_do_not_push_are_stiff_cables(stiffness_n_per_m, push_back, cables: list[int]) -> None:
    """The sigma of their length: 0.3 mm as cut, and 10 N over the stiffness."""
    told = plate(tendon_stiffness_n_per_m=stiffness_n_per_m, push_back=push_back).mechanics
    assert told.stiff_cables.tolist() == cables
    by_pull_m = 10.0 / np.broadcast_to(stiffness_n_per_m, 8)[cables]
    np.testing.assert_allclose(told.cable_sigma_m, np.hypot(0.0003, by_pull_m))


def changed(table: str, **changes) -> dict:
    tables = plate_tables()
    tables[table] = [tables["body"][0] | changes] if table == "body" else tables[table] | changes
    return tables


FLAT_M = PLATE_M.copy()
FLAT_M[4] = [0.0, 0.0, 0.25]

REFUSED = {
    "plate: structure.rod_length_sigma_m: expected a number of at least 1e-06": changed(
        "structure", rod_length_sigma_m=1e-12
    ),
    "plate: structure.anchor_sigma_m: expected a number of at least 1e-06": changed("structure", anchor_sigma_m=1e-7),
    "plate: body[0]: its nodes lie in one plane": changed("structure", node_position_m=FLAT_M.tolist()),
    "plate: body[0]: expected structure.node_position_m": changed("structure", node_position_m=None),
    "plate: body[0].nodes: expected three different nodes or more, got [0, 1, 1]": changed("body", nodes=[0, 1, 1]),
    "plate: body[0].nodes: expected nodes from 0 to 12, got [0, 1, 99]": changed("body", nodes=[0, 1, 99]),
    "plate: mechanics.push_back: expected one finite number or 8, got 3": changed("mechanics", push_back=[0, 0, 0]),
    "plate: mechanics.knot_mass_kg: expected one finite number or 13, got 2": changed("mechanics", knot_mass_kg=[1, 1]),
    "plate: mechanics.rod_mass_kg: expected one finite number or 0, got 2": changed("mechanics", rod_mass_kg=[1, 1]),
    "plate: mechanics.rod_mass_kg: expected a number of at least 0": changed("mechanics", rod_mass_kg=-1),
    "plate: unsensed[0]: tendon 8 out of range": changed("structure", unsensed=[8]),
    "plate: node_position_m: expected 13 finite rows": changed(
        "structure", node_position_m=[*PLATE_M.tolist(), [0, 0, 0]]
    ),
    "plate: body[0]: its nodes lie on one line": changed("body", nodes=[9, 10, 11])
    | {"structure": plate_tables()["structure"] | {"node_position_m": [[0.1 * k, 0, 0] for k in range(13)]}},
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_refused(message: str) -> None:
    with pytest.raises(InputError) as refused:
        describe_structure(REFUSED[message], "plate")
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)
