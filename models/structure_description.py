"""The description of a structure: the tables that tell its members, rigid bodies, mechanics and rest shape."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .structure.floor import GRAVITY_M_PER_S2
from .structure.lengths import member_length_m
from .structure.mechanics import Mechanics
from .structure.rest_shape import GeometrySigma
from .structure.structure import Structure
from .values.errors import InputError
from .values.tables import Fraction, NotNegative, Positive, Sigma, parse_table

_TOLD = GeometrySigma()
MOST_OF_ROD = 0.2
"""Radius of an end cap or a hub, or error of the geometry, over the length of the shortest rod, at most."""
FLAT = 0.05
"""Share of its extent by which a rigid body is thick, at least: the fixed distances of a flat one let it bend."""
MOST_PULL = 1e4
"""Ratio of the pull of the stiffest tendon, stretched by a tenth, to the weight of the structure, above which one of
them is in another unit. Strips of rubber on the paper's structure give 4, steel ropes of a millimetre 1000."""
LEAST_PULL = 0.01
"""The same below which one of them is, as grams for kilograms: tendons would stretch to many times their length."""
STIFF_N_PER_M = 5000.0
"""Stiffness from which the tension of a cable does not follow from its length: 0.3 mm are 1.5 N, as much as a press."""
MOST_OFF = 0.5
"""Share of its length by which a rod may differ from it in the shape where the search for the rest shape starts."""
MOST_OFF_MEASURED = 0.1
"""The same in the measured rest shape."""
AT_ONE_PLACE_M = 1e-6
"""Length of a tendon below which it has no direction."""


@dataclass(frozen=True, slots=True)
class BodyTable:
    """`[[body]]`: a rigid body, whose nodes keep the distances that they have in the positions that are told."""

    nodes: list[int]
    mass_kg: NotNegative = 0.0
    """Mass, evenly on its nodes."""

    def position_m(self, here: str, node_position_m: NDArray[np.float64] | None) -> NDArray[np.float64]:
        """Return (body nodes, 3) the positions of its nodes among those of (nodes, 3) all.

        Args:
            here: name of the table, for the error text.
            node_position_m: those of `[structure]`, or of `[rest]`.

        Raises:
            InputError: for nodes that are no rigid body, or without positions.
        """
        nodes = self.nodes
        if node_position_m is None:
            raise InputError(f"{here}: expected structure.node_position_m, which tells its distances, got none")
        if len(set(nodes)) != len(nodes) or len(nodes) < 3:
            raise InputError(f"{here}.nodes: expected three different nodes or more, got {nodes}")
        if not (min(nodes) >= 0 and max(nodes) < len(node_position_m)):
            raise InputError(f"{here}.nodes: expected nodes from 0 to {len(node_position_m) - 1}, got {nodes}")
        position_m = node_position_m[nodes]
        _check_thick(here, position_m)
        return position_m


def _check_thick(here: str, position_m: NDArray[np.float64]) -> None:
    """Raise InputError for nodes whose distances do not keep them rigid."""
    extent_m = np.linalg.svd(position_m - position_m.mean(axis=0), compute_uv=False)
    if extent_m[1] < FLAT * extent_m[0]:
        raise InputError(f"{here}: its nodes lie on one line, about which it turns: expected one more beside it")
    if len(position_m) > 3 and extent_m[2] < FLAT * extent_m[0]:
        raise InputError(
            f"{here}: its nodes lie in one plane, in which fixed distances do not keep them: expected one node more, "
            "off the plane"
        )


@dataclass(frozen=True, slots=True)
class StructureTable:
    """`[structure]`, see `Structure`."""

    rods: list[tuple[int, int]]
    tendons: list[tuple[int, int]]
    rod_length_m: float | list[float]
    natural_length_m: float | list[float]
    anchors: list[int]
    anchor_position_m: list[tuple[float, float, float]]
    unsensed: list[int] = field(default_factory=list)
    """Tendons without a sensor: they pull, and nothing measures their lengths."""
    node_position_m: list[tuple[float, float, float]] | None = None
    """x, y, z of every node, about as at rest: the search for the rest shape starts there. The distances in rigid
    bodies are exactly theirs."""
    rod_length_sigma_m: Sigma = _TOLD.rod_length_m
    """Standard deviation of a rod's length."""
    anchor_sigma_m: Sigma = _TOLD.anchor_m
    """Standard deviation of an anchor's position, per axis."""
    hub_radius_m: NotNegative = _TOLD.hub_radius_m
    """Distance from a rod's end at which its tendons end, in an unknown direction."""

    def structure(self, bodies: Sequence[BodyTable] = (), shape_m: NDArray[np.float64] | None = None) -> Structure:
        """Return the structure that the table describes, with the distances in rigid bodies as further rods.

        Args:
            bodies: `[[body]]`.
            shape_m: (nodes, 3) positions that tell the distances in rigid bodies; None where there are none.

        Raises:
            InputError: when the tables do not describe a tensegrity, see `Structure`.
        """
        fixed_m = _fixed_distances(bodies, shape_m)
        rod_m = np.array(self.rod_length_m, dtype=np.float64)
        if fixed_m:
            rod_m = np.append(_numbers("rod_length_m", rod_m, len(self.rods)), list(fixed_m.values()))
        return Structure(
            rods=np.array([*self.rods, *fixed_m]),
            tendons=np.array(self.tendons),
            rod_length_m=rod_m,
            natural_length_m=np.array(self.natural_length_m),
            anchors=np.array(self.anchors),
            anchor_position_m=np.array(self.anchor_position_m),
            unsensed=np.array(self.unsensed, dtype=np.int64),
        )

    def geometry(self) -> GeometrySigma:
        """Return how exactly the geometry is known.

        Raises:
            InputError: for what is not small beside the shortest rod, as in another unit.
        """
        shortest_m = float(np.min(self.rod_length_m, initial=np.inf))
        for name in ("rod_length_sigma_m", "anchor_sigma_m", "hub_radius_m"):
            check_small(f"structure.{name}", getattr(self, name), shortest_m)
        return GeometrySigma(self.rod_length_sigma_m, self.anchor_sigma_m, self.hub_radius_m)


def check_small(name: str, size_m: float, rod_length_m: float) -> None:
    """Check that a part is small beside the shortest rod.

    Raises:
        InputError: for more than `MOST_OF_ROD`, as in another unit.
    """
    if size_m > MOST_OF_ROD * rod_length_m:
        raise InputError(
            f"{name}: expected at most {MOST_OF_ROD * rod_length_m:.3g}, a fifth of the shortest rod, got {size_m:g}: "
            "is the unit right?"
        )


def geometry_keys(told: GeometrySigma) -> dict[str, float]:
    """Return the keys of `[structure]` that tell how exactly the geometry is known, but for those that are as usual."""
    keys = {
        "rod_length_sigma_m": (told.rod_length_m, _TOLD.rod_length_m),
        "anchor_sigma_m": (told.anchor_m, _TOLD.anchor_m),
        "hub_radius_m": (told.hub_radius_m, _TOLD.hub_radius_m),
    }
    return {name: value for name, (value, usual) in keys.items() if value != usual}


def _fixed_distances(bodies: Sequence[BodyTable], shape_m: NDArray[np.float64] | None) -> dict[tuple[int, int], float]:
    """Return the distances that are fixed in rigid bodies, by their node pairs; bodies may share nodes."""
    fixed_m: dict[tuple[int, int], float] = {}
    for number, body in enumerate(bodies):
        position_m = body.position_m(f"body[{number}]", shape_m)
        for one, other in combinations(range(len(body.nodes)), 2):
            pair = (min(body.nodes[one], body.nodes[other]), max(body.nodes[one], body.nodes[other]))
            fixed_m.setdefault(pair, float(np.linalg.norm(position_m[one] - position_m[other])))
    return fixed_m


@dataclass(frozen=True, slots=True)
class MechanicsTable:
    """`[mechanics]`: the properties that the balance of forces depends on, see `Mechanics`."""

    tendon_stiffness_n_per_m: Positive | list[Positive]
    rod_mass_kg: NotNegative | list[NotNegative]
    push_back: Fraction | list[Fraction] = 0.02
    """Ratio of the stiffness of a bent tendon to that of a stretched one. A strip that bows out has a few per cent of
    its stiffness; a cable goes slack and has 0. One with 0 and 5000 N/m or more is a stiff cable: it has its natural
    length while it is taut, and an unknown tension."""
    tendon_mass_kg: NotNegative | list[NotNegative] = 0.0
    """Mass of each tendon, half of it at either end."""
    knot_mass_kg: NotNegative | list[NotNegative] = 0.0
    """What each node has beside its members, such as a motor."""

    def mechanics(self, structure: Structure, bodies: Sequence[BodyTable]) -> Mechanics:
        """Return the mechanics of a structure with these rigid bodies.

        Raises:
            InputError: for lists of another length than there are rods, tendons or nodes.
        """
        tendons, fixed = len(structure.tendons), len(_fixed_pairs([body.nodes for body in bodies]))
        rod_kg = _numbers("mechanics.rod_mass_kg", self.rod_mass_kg, len(structure.rods) - fixed)
        knot_kg = _numbers("mechanics.knot_mass_kg", self.knot_mass_kg, structure.node_count)
        for body in bodies:
            knot_kg[body.nodes] += body.mass_kg / len(body.nodes)
        stiffness = _numbers("mechanics.tendon_stiffness_n_per_m", self.tendon_stiffness_n_per_m, tendons)
        push_back = _numbers("mechanics.push_back", self.push_back, tendons)
        return Mechanics(
            stiffness_n_per_m=stiffness,
            natural_length_m=structure.natural_length_m,
            rod_mass_kg=np.append(rod_kg, np.zeros(fixed)),
            push_back=push_back,
            tendon_mass_kg=_numbers("mechanics.tendon_mass_kg", self.tendon_mass_kg, tendons),
            knot_mass_kg=knot_kg,
            stiff_cables=np.flatnonzero((push_back == 0) & (stiffness >= STIFF_N_PER_M)),
        )


def _fixed_pairs(bodies: Iterable[Sequence[int]]) -> set[frozenset[int]]:
    """Return the pairs of nodes whose distance is fixed in rigid bodies, from the nodes of each."""
    return {frozenset(pair) for nodes in bodies for pair in combinations(nodes, 2)}


@dataclass(frozen=True, slots=True)
class RestTable:
    """`[rest]`: how long the structure stands unloaded at the start, and its shape there, if it was measured."""

    seconds: NotNegative = 0.0
    node_position_m: list[tuple[float, float, float]] | None = None


@dataclass(frozen=True, slots=True)
class StructureFile:
    """The tables of a structure file; a trial.toml has them, too."""

    structure: StructureTable
    body: list[BodyTable] = field(default_factory=list)
    mechanics: MechanicsTable | None = None
    rest: RestTable = field(default_factory=RestTable)


@dataclass(frozen=True, slots=True, eq=False)
class DescribedStructure:
    """A structure with what is known of its mechanics and its shape."""

    structure: Structure
    """With the distances in rigid bodies as its last rods."""
    bodies: tuple[tuple[int, ...], ...]
    """The nodes of each rigid body."""
    mechanics: Mechanics | None
    """None where it was not told."""
    node_position_m: NDArray[np.float64] | None
    """(nodes, 3) about its shape at rest, from which the search for it starts; None where it was not told."""
    rest_position_m: NDArray[np.float64] | None
    """(nodes, 3) its measured rest shape; None where it was not measured."""
    geometry: GeometrySigma
    """How exactly rods, anchors and the ends of tendons are known."""

    @property
    def own_rods(self) -> int:
        """The number of rods that are not distances in rigid bodies; they come first."""
        return len(self.structure.rods) - len(_fixed_pairs(self.bodies))


def describe_structure(tables: Mapping[str, Any], where: str) -> DescribedStructure:
    """Return the structure that the tables of a file describe; other tables are not read.

    Args:
        tables: as in a structure file or in trial.toml.
        where: name of the file for the error text.

    Raises:
        InputError: the text names the file and the key.
    """
    try:
        return described(parse_table(StructureFile, tables, where))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(where) else f"{where}: {text}") from error


def described(tables: StructureFile) -> DescribedStructure:
    """Return the structure that parsed tables describe.

    Raises:
        InputError: the text names the key.
    """
    about_m, rest_m = (
        None if given is None else np.array(given).reshape(-1, 3)
        for given in (tables.structure.node_position_m, tables.rest.node_position_m)
    )
    structure = tables.structure.structure(tables.body, rest_m if about_m is None else about_m)
    for name, position_m, most_off in (
        ("node_position_m", about_m, MOST_OFF),
        ("rest.node_position_m", rest_m, MOST_OFF_MEASURED),
    ):
        if position_m is not None:
            _check_shape(name, position_m, structure, most_off)
    mechanics = tables.mechanics.mechanics(structure, tables.body) if tables.mechanics else None
    if mechanics is not None:
        _check_stiffness(mechanics, structure)
    return DescribedStructure(
        structure=structure,
        bodies=tuple(tuple(body.nodes) for body in tables.body),
        mechanics=mechanics,
        node_position_m=about_m,
        rest_position_m=rest_m,
        geometry=tables.structure.geometry(),
    )


def _check_shape(name: str, position_m: NDArray[np.float64], structure: Structure, most_off: float) -> None:
    """Raise InputError for positions that are no shape of a structure, with rods as long as told within a share."""
    if position_m.shape != (structure.node_count, 3) or not np.isfinite(position_m).all():
        raise InputError(
            f"{name}: expected {structure.node_count} finite rows of x, y, z, got shape {position_m.shape}"
        )
    structure.check_unit(name, position_m)
    tendon_m = member_length_m(position_m, structure.tendons)
    for tendon in np.flatnonzero(tendon_m < AT_ONE_PLACE_M)[:1]:
        a, b = structure.tendons[tendon]
        raise InputError(f"{name}: nodes {a} and {b}, which tendon {tendon} joins, are at one place")
    rod_m = member_length_m(position_m, structure.rods)
    for rod in np.flatnonzero(np.abs(rod_m - structure.rod_length_m) > most_off * structure.rod_length_m)[:1]:
        told_m = structure.rod_length_m[rod]
        raise InputError(f"{name}: expected rod {rod} to be {told_m:g} m long, got {rod_m[rod]:g} m")


def _check_stiffness(mechanics: Mechanics, structure: Structure) -> None:
    """Raise InputError where the stiffness of a tendon and the weight of the structure cannot both be in their unit."""
    weight_n = GRAVITY_M_PER_S2 * float(mechanics.node_mass_kg(structure).sum())
    if weight_n == 0 or not len(structure.tendons):
        return
    pull_n = 0.1 * mechanics.stiffness_n_per_m * mechanics.natural_length_m
    ratio = pull_n / weight_n
    tendon = int(ratio.argmax())
    if not LEAST_PULL < ratio[tendon] < MOST_PULL:
        raise InputError(
            f"mechanics.tendon_stiffness_n_per_m: expected a pull of {LEAST_PULL:g} to {MOST_PULL:g} times the "
            f"weight of the structure in a tendon stretched by a tenth, got {pull_n[tendon]:.3g} N in tendon {tendon}, "
            f"and {weight_n:.3g} N by mechanics.rod_mass_kg and others: is the unit of each right?"
        )


def _numbers(name: str, value: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return (count,) numbers, of which there may be one for all."""
    numbers = np.array(value, dtype=np.float64)
    if numbers.shape not in ((), (count,)) or not np.isfinite(numbers).all():
        raise InputError(f"{name}: expected one finite number or {count}, got {numbers.size}")
    return np.broadcast_to(numbers, (count,)).copy()
