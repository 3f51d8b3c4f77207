"""The mechanical properties of a structure: stiffness, natural lengths and masses."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .structure import Structure

CABLE_CUT_M = 0.0003
"""Standard deviation of the length to which a cable is cut."""
CABLE_PULL_N = 10.0
"""Standard deviation of its tension, by which it is longer."""


@dataclass(frozen=True, slots=True, eq=False)
class Mechanics:
    """The properties of a structure that its balance of forces depends on."""

    stiffness_n_per_m: NDArray[np.float64]
    """(tendons,) k of each tendon when stretched."""
    natural_length_m: NDArray[np.float64]
    """(tendons,) L0."""
    rod_mass_kg: NDArray[np.float64] | float
    """(rods,) or one for all; uniform along the rod. That of a rigid body is on its distances alike."""
    push_back: NDArray[np.float64] | float
    """p, the ratio of the stiffness of a bent tendon to that of a stretched one; (tendons,) or one for all."""
    offset_n: NDArray[np.float64] | float = 0.0
    """(nodes, 3) force added at each node: what the rest shape leaves unbalanced where tendons end on hubs."""
    tendon_mass_kg: NDArray[np.float64] | float = 0.0
    """(tendons,) or one for all."""
    knot_mass_kg: NDArray[np.float64] | float = 0.0
    """(nodes,) or one for all: what a node has beside its members, such as a motor."""
    stiff_cables: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """(stiff cables,) tendons that go slack, and so stiff that their tension does not follow from their length."""

    @property
    def cable_sigma_m(self) -> NDArray[np.float64]:
        """(stiff cables,) standard deviation of the length of a taut cable about its natural length."""
        return np.hypot(CABLE_CUT_M, CABLE_PULL_N / self.stiffness_n_per_m[self.stiff_cables])

    def node_mass_kg(self, structure: Structure) -> NDArray[np.float64]:
        """Return (nodes,) the mass at each node: its own, and half that of each rod and tendon that ends there."""
        mass_kg = np.zeros(structure.node_count)
        for members, member_kg in ((structure.rods, self.rod_mass_kg), (structure.tendons, self.tendon_mass_kg)):
            np.add.at(mass_kg, members, np.broadcast_to(0.5 * np.asarray(member_kg), len(members))[:, None])
        return mass_kg + self.knot_mass_kg
