"""The description of a trial: the content of trial.toml, checked and converted to a structure, sensors and boards."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .own_factor import FactorKeys, FactorTable
from .pose.robot import FreeStandingRobot, HangingRobot
from .sensor.clock import ClockSettings
from .sensor.divider import Divider
from .sensor.resistance import CountConverter
from .structure.floor import Floor
from .structure.mechanics import Mechanics
from .structure.natural_lengths import Motors
from .structure.rest_shape import GeometrySigma
from .structure.structure import Structure
from .structure.suspension import Suspension
from .structure_description import DescribedStructure, StructureFile, described
from .trial_tables import BoardTable, GroundTable, ImuTable, MotorTable, RangeTable, TrialTable
from .values.aids import Imu
from .values.errors import InputError
from .values.tables import parse_table, unknown_keys

FAR_FROM_ANCHOR_M = 0.01
"""Distance of a node's measured rest position from its anchor, beyond which they are told in different frames."""
IN_ONE_PLANE = 1e-3
"""Ratio of the least extent of a shape to its largest one, below which its nodes are in one plane."""
FAR_FROM_FLOOR_M = 0.01
"""Distance of the lowest node of the measured rest shape from standing on the floor, beyond which it does not stand."""
ASKEW_RAD = 0.2
"""Angle by which the centre of mass is away from hanging, beyond which a structure cannot be at rest: 11 degrees."""

MOST_RANGE_PAIRS = 500
"""Largest number of pairs of a beacon and a node: each has an offset in the state, and a frame takes its square."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialDescription:
    """What is known of a trial before its first reading."""

    structure: Structure
    geometry: GeometrySigma
    """How exactly rods, anchors and the ends of the tendons are known."""
    mechanics: Mechanics | None
    """The nominal mechanics; None where the trial does not give them, and then the balance of forces is not used."""
    rest_seconds: float
    """How long the structure stands at its rest shape at the start."""
    rest_position_m: NDArray[np.float64] | None
    """(nodes, 3) the measured rest shape; None where it was not measured."""
    near_position_m: NDArray[np.float64] | None
    """(nodes, 3) about the rest shape, from which the search for it starts; None where it was not told."""
    source: Literal["counts", "resistance", "lengths"]
    """The kind of measurements in the trial's files."""
    natural_resistance_ohm: NDArray[np.float64]
    """(tendons,) R0, nan for tendons without a sensor; empty when the source is lengths."""
    divider: Divider | None
    """The voltage divider; None unless the source is counts."""
    tendons_of_board: tuple[NDArray[np.int64], ...]
    """(channels,) for each board, the tendon of each channel; empty unless the source is counts. Reference strips have
    the numbers after those of the tendons."""
    reference_strips: int
    """Number of the strips that are tied to no tendon and keep their length: what they read is drift."""
    imus: tuple[Imu, ...]
    """The inertial sensors, in the order of their numbers."""
    robot: FreeStandingRobot | HangingRobot | None
    """What the structure stands on or hangs from, and carries; None where three anchors or more, or a hand, hold it."""
    beacon_position_m: tuple[NDArray[np.float64], ...]
    """(beacons, 3) for each recording of distances."""
    own_frames: tuple[int, ...]
    """Numbers of the recordings of positions that are in a frame of their own."""
    world_positions: tuple[int, ...]
    """Numbers of the recordings of positions that are in the world."""
    motors: tuple[Motors, ...]
    """What each recording of natural lengths tells."""
    factors: tuple[FactorTable, ...]
    """The factors of other packages."""
    ignored_keys: tuple[str, ...]
    """Dotted names in trial.toml that are not read."""

    @property
    def floor(self) -> Floor | None:
        """The floor that the structure stands on; None where anchors or a hand hold it."""
        return self.robot.floor if isinstance(self.robot, FreeStandingRobot) else None

    @property
    def has_aids(self) -> bool:
        """Whether other sensors than those of tendons tell how the structure stands: inertial, ranges, positions."""
        return bool(self.imus or self.beacon_position_m or self.own_frames or self.world_positions)

    @property
    def board_of_tendon(self) -> NDArray[np.int64] | None:
        """(tendons,) number of the board that reads each sensor, -1 for none; None where no boards are told."""
        if not self.tendons_of_board:
            return None
        board = np.full(len(self.structure.tendons), -1)
        for number, tendons in enumerate(self.tendons_of_board):
            board[tendons[tendons < len(board)]] = number
        return board

    def boards(self, settings: ClockSettings) -> CountConverter:
        """Return the converter from rows of the trial's boards to readings of resistance.

        Raises:
            InputError: when the source is not counts.
        """
        if self.divider is None:
            raise InputError(f"a trial of {self.source} has no boards")
        return CountConverter(self.divider, self.tendons_of_board, settings)


def describe_trial(table: Mapping[str, Any], where: str) -> tuple[TrialTable, TrialDescription]:
    """Return the tables of trial.toml, and the description that they give.

    Args:
        table: the parsed file.
        where: path of the file.

    Raises:
        InputError: the text names the file and the key.
    """
    parsed = parse_table(TrialTable, table, where)
    try:
        return parsed, _describe(
            parsed, tuple(key.name + key.hint for key in unknown_keys(TrialTable, table)), Path(where)
        )
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _describe(table: TrialTable, ignored_keys: tuple[str, ...], path: Path) -> TrialDescription:
    told = described(StructureFile(table.structure, table.body, table.mechanics, table.rest))
    structure = told.structure
    if told.rest_position_m is not None:
        _check_anchors(structure, told.rest_position_m)
    given = [name for name in ("board", "resistance", "lengths") if getattr(table, name)]
    if len(given) != 1:
        raise InputError(f"expected one of [[board]], [resistance], [lengths], got {', '.join(given) or 'none'}")
    source: Literal["counts", "resistance", "lengths"] = "counts"
    if table.resistance or table.lengths:
        source = "resistance" if table.resistance else "lengths"
    if structure.is_held:  # its anchors tell where it is
        unused = (kind for kind in ("range", "position") if getattr(table, kind))
        ignored_keys += tuple(f"{kind}: anchors hold the structure" for kind in unused)
    imus = tuple(_imu(number, imu, structure) for number, imu in enumerate(table.imu))
    _check_files(table)
    _check_boards_of_imus(table)
    tendons_of_board = _wiring(table.board, structure) if source == "counts" else ()
    return TrialDescription(
        structure=structure,
        geometry=told.geometry,
        mechanics=told.mechanics,
        rest_seconds=table.rest.seconds,
        rest_position_m=told.rest_position_m,
        near_position_m=told.node_position_m,
        source=source,
        natural_resistance_ohm=_natural_resistance(table, structure) if source != "lengths" else np.empty(0),
        divider=_divider(table) if source == "counts" else None,
        tendons_of_board=tendons_of_board,
        reference_strips=sum(int(np.sum(tendons >= len(structure.tendons))) for tendons in tendons_of_board),
        imus=imus,
        robot=_robot(table, told, imus),
        beacon_position_m=tuple(_beacons(number, ranges) for number, ranges in enumerate(table.range)),
        own_frames=_own_frames(table),
        world_positions=tuple(number for number, position in enumerate(table.position) if position.frame != "own"),
        motors=_motors(table.motor, structure),
        factors=tuple(_factor(number, keys, path) for number, keys in enumerate(table.factor)),
        ignored_keys=ignored_keys,
    )


def _check_anchors(structure: Structure, rest_m: NDArray[np.float64]) -> None:
    """Raise InputError for a measured rest shape of which an anchor is elsewhere, as in another frame."""
    for index, (node, anchor_m) in enumerate(zip(structure.anchors, structure.anchor_position_m, strict=True)):
        apart_m = float(np.linalg.norm(rest_m[node] - anchor_m))
        if apart_m > FAR_FROM_ANCHOR_M:
            raise InputError(
                f"rest.node_position_m[{node}]: expected structure.anchor_position_m[{index}], got a position "
                f"{apart_m:.3f} m away"
            )


def _check_files(table: TrialTable) -> None:
    """Raise InputError for a file that is named twice: the rows of two could not be told apart."""
    owner = {PurePath("trial.toml"): "the description"}
    for kind in ("board", "imu", "range", "position", "motor"):
        for number, part in enumerate(getattr(table, kind)):
            name = f"{kind}[{number}]"
            if part.file is not None and owner.setdefault(PurePath(part.file), name) != name:
                other = owner[PurePath(part.file)]
                raise InputError(f"{name}.file: expected one of its own, got '{part.file}', that of {other}")


def _robot(
    table: TrialTable, told: DescribedStructure, imus: tuple[Imu, ...]
) -> FreeStandingRobot | HangingRobot | None:
    structure = told.structure
    beacons = sum(len(ranges.beacon_position_m) for ranges in table.range)
    if beacons * structure.node_count > MOST_RANGE_PAIRS:
        raise InputError(
            f"range: expected at most {MOST_RANGE_PAIRS} pairs of a beacon and a node in all [[range]] tables, "
            f"got {beacons} beacons for {structure.node_count} nodes"
        )
    pairs = tuple(
        (recording, beacon, node)
        for recording, ranges in enumerate(table.range)
        for beacon in range(len(ranges.beacon_position_m))
        for node in range(structure.node_count)
    )
    rest_seconds, own_frames = table.rest.seconds, len(_own_frames(table))
    if structure.is_held:
        return None
    if not structure.is_free_standing:
        _check_hangs(table, told)
        anchor_m = table.structure.anchor_sigma_m
        return HangingRobot(
            imus=imus, range_pairs=pairs, rest_seconds=rest_seconds, own_frames=own_frames, anchor_m=anchor_m
        )
    if table.ground is None:
        aids = [name for name in ("imu", "range", "position") if getattr(table, name)]
        if aids:
            raise InputError(f"[[{aids[0]}]]: expected [ground], the floor on which a robot that carries it stands")
        return None
    if table.rest.node_position_m is None or table.rest.seconds <= 0:
        raise InputError(
            "rest: expected seconds above 0 and node_position_m with [ground]: a structure without anchors is where "
            "it stands at the start"
        )
    if told.rest_position_m is not None:
        _check_has_faces(told.rest_position_m)
    floor = _floor(table, table.ground, told)
    return FreeStandingRobot(
        floor=floor, imus=imus, range_pairs=pairs, rest_seconds=rest_seconds, own_frames=own_frames
    )


def _check_has_faces(rest_m: NDArray[np.float64]) -> None:
    """Raise InputError for a rest shape that no floor carries on one of several faces."""
    across_m = np.linalg.svd(rest_m - rest_m.mean(axis=0), compute_uv=False)
    if len(rest_m) < 4 or across_m[2] < IN_ONE_PLANE * across_m[0]:
        raise InputError("rest.node_position_m: expected nodes that are not all in one plane with [ground]")


def _check_stands(floor: Floor, rest_m: NDArray[np.float64]) -> None:
    """Raise InputError for a rest shape that does not stand on the floor."""
    lowest_m = float(floor.clearance_m(rest_m).min())
    if abs(lowest_m) > FAR_FROM_FLOOR_M:
        raise InputError(
            f"rest.node_position_m: expected the lowest node to stand on the floor, at ground.height_m = "
            f"{floor.height_m:g} m, got {abs(lowest_m):.3g} m {'above' if lowest_m > 0 else 'below'} that"
        )


def _floor(table: TrialTable, ground: GroundTable, told: DescribedStructure) -> Floor:
    """Return the floor; one whose normal is estimated is where the structure stands on it at rest."""
    floor, rest_m = ground.floor(float(told.structure.rod_length_m.min())), told.rest_position_m
    if rest_m is None:
        return floor
    if floor.normal_sigma_rad == 0:
        _check_stands(floor, rest_m)
        return floor
    if not table.imu and not table.position:
        raise InputError(
            "ground.normal_sigma_rad: expected [[imu]] or [[position]], which tell gravity apart from the floor, got "
            "neither"
        )
    return floor.under(rest_m)


def _own_frames(table: TrialTable) -> tuple[int, ...]:
    return tuple(number for number, position in enumerate(table.position) if position.frame == "own")


def _check_hangs(table: TrialTable, told: DescribedStructure) -> None:
    """Raise InputError for what does not hang from its one or two anchors at rest."""
    structure, rest_m = told.structure, told.rest_position_m
    if table.ground is not None:
        raise InputError("ground: expected none with one or two anchors: a robot that hangs must not touch a floor")
    if rest_m is None or table.rest.seconds <= 0:
        raise InputError(
            "rest: expected seconds above 0 and node_position_m with one or two anchors: a structure that hangs is "
            "turned at the start as its nodes tell"
        )
    mass_kg = told.mechanics.node_mass_kg(structure) if told.mechanics else None
    askew_rad = Suspension.of(structure, mass_kg).askew_rad(rest_m)
    if askew_rad > ASKEW_RAD:
        raise InputError(
            f"rest.node_position_m: expected the centre of mass below the anchors, with gravity along -z, got one "
            f"{np.rad2deg(askew_rad):.0f} degrees from it"
        )


def _imu(number: int, table: ImuTable, structure: Structure) -> Imu:
    if not 0 <= table.rod < len(structure.rods):
        raise InputError(f"imu[{number}].rod: expected a rod from 0 to {len(structure.rods) - 1}, got {table.rod}")
    axis = np.array(table.axis)
    length = float(np.linalg.norm(axis))
    if not np.isfinite(length) or abs(length - 1) > 0.01:
        raise InputError(f"imu[{number}].axis: expected a unit vector, got {list(table.axis)}")
    if not 0 <= table.fraction <= 1:
        raise InputError(f"imu[{number}].fraction: expected a number from 0 to 1, got {table.fraction}")
    return Imu(table.rod, table.fraction, axis / length)


def _check_boards_of_imus(table: TrialTable) -> None:
    """Refuse an inertial sensor without a source, on a board that does not exist, or that another table names."""
    places: set[tuple[int, int]] = set()
    for number, imu in enumerate(table.imu):
        if imu.board is None:
            if imu.file is None:
                raise InputError(f"imu[{number}]: expected file, or the board that reads it, got neither")
            continue
        if not 0 <= imu.board < len(table.board):
            raise InputError(
                f"imu[{number}].board: expected the number of one of {len(table.board)} boards, got {imu.board}"
            )
        if not 0 <= imu.sensor <= 255 or (imu.board, imu.sensor) in places:
            raise InputError(
                f"imu[{number}].sensor: expected a number from 0 to 255, each once on a board, got {imu.sensor}"
            )
        places.add((imu.board, imu.sensor))


def _beacons(number: int, table: RangeTable) -> NDArray[np.float64]:
    position_m = np.array(table.beacon_position_m).reshape(-1, 3)
    if not len(position_m) or not np.isfinite(position_m).all():
        raise InputError(f"range[{number}].beacon_position_m: expected finite rows of x, y, z")
    return position_m


def _motors(tables: list[MotorTable], structure: Structure) -> tuple[Motors, ...]:
    motors = tuple(table.motors(number, structure) for number, table in enumerate(tables))
    seen: set[int] = set()
    for number, one in enumerate(motors):
        if twice := seen.intersection(one.tendons):
            raise InputError(f"motor[{number}].tendons: tendon {min(twice)} has a motor already")
        seen.update(one.tendons)
    return motors


def _factor(number: int, keys: dict[str, Any], path: Path) -> FactorTable:
    parse_table(FactorKeys, keys, f"factor[{number}]")
    return FactorTable(keys, path.parent, f"{path}: factor[{number}]")


def _natural_resistance(table: TrialTable, structure: Structure) -> NDArray[np.float64]:
    """Return (tendons,) R0 of each sensor, nan for tendons without one."""
    if table.sensors is None:
        raise InputError("sensors.natural_resistance_ohm: is missing")
    given = np.array(table.sensors.natural_resistance_ohm)
    count = int(structure.is_sensed.sum())
    if len(given) != count or not np.isfinite(given).all():
        raise InputError(f"sensors.natural_resistance_ohm: expected {count} finite numbers, got {len(given)}")
    resistance = np.full(len(structure.tendons), np.nan)
    resistance[structure.is_sensed] = given
    return resistance


def _divider(table: TrialTable) -> Divider:
    if table.adc is None:
        raise InputError("adc: is missing")
    return table.adc.divider()


def _wiring(boards: list[BoardTable], structure: Structure) -> tuple[NDArray[np.int64], ...]:
    tendons = len(structure.tendons)
    wired: dict[int, str] = {}
    sensors: list[list[int]] = []
    strips = count(tendons)
    for b, board in enumerate(boards):
        sensors.append([])
        if not board.tendon_of_channel:
            raise InputError(f"board[{b}].tendon_of_channel: expected the tendon of one channel or more, got none")
        for channel, tendon in enumerate(board.tendon_of_channel):
            here = f"board[{b}].tendon_of_channel[{channel}]"
            if tendon == "reference":
                sensors[b].append(next(strips))
                continue
            if isinstance(tendon, str) or not 0 <= tendon < tendons:
                raise InputError(f"{here}: expected a tendon from 0 to {tendons - 1} or 'reference', got {tendon!r}")
            if tendon in structure.unsensed:
                raise InputError(f"{here}: tendon {tendon} has no sensor, by structure.unsensed")
            if tendon in wired:
                raise InputError(f"{here}: tendon {tendon} is wired to {wired[tendon]} already")
            wired[tendon] = here
            sensors[b].append(tendon)
    return tuple(np.array(board, dtype=np.int64) for board in sensors)
