"""The tables of trial.toml, as a user writes them: names, types and what each number may be by itself."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from .sensor.divider import Divider
from .structure.floor import USUAL_CAP_M, Floor
from .structure.natural_lengths import Motors
from .structure.structure import Structure
from .structure_description import MOST_OF_ROD, BodyTable, MechanicsTable, RestTable, StructureTable, check_small
from .values.errors import InputError
from .values.tables import AtLeastOne, FileName, NotNegative, Positive

LEAST_TOLD_RAD = 0.3
"""Largest standard deviation of the floor's normal, 17 degrees: beyond it, others may stand than the lowest nodes."""


@dataclass(frozen=True, slots=True)
class GroundTable:
    """`[ground]`: the floor that a structure without anchors stands on, see `Floor`."""

    height_m: float
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    normal_sigma_rad: NotNegative = 0.0
    """Standard deviation of the normal's direction as told; above 0, it is estimated."""
    cap_radius_m: NotNegative | None = None

    def floor(self, rod_length_m: float) -> Floor:
        """Return the floor.

        Args:
            rod_length_m: of the shortest rod, much longer than the radius of its caps.

        Raises:
            InputError: for a height, a normal or a radius that is none, or a normal that is hardly told.
        """
        normal = np.array(self.normal)
        length = float(np.linalg.norm(normal))
        if not np.isfinite(normal).all() or abs(length - 1) > 0.01 or normal[2] <= 0:
            raise InputError(f"ground.normal: expected a unit vector upward, got {list(self.normal)}")
        if not np.isfinite(self.height_m):
            raise InputError(f"ground.height_m: expected a finite number, got {self.height_m}")
        if self.normal_sigma_rad > LEAST_TOLD_RAD:
            raise InputError(
                f"ground.normal_sigma_rad: expected at most {LEAST_TOLD_RAD} rad, got {self.normal_sigma_rad}"
            )
        cap_radius_m = self.cap_radius_m
        if cap_radius_m is None:
            is_radius = 0 <= self.height_m <= MOST_OF_ROD * rod_length_m
            cap_radius_m = self.height_m if is_radius else USUAL_CAP_M
        else:
            check_small("ground.cap_radius_m", cap_radius_m, rod_length_m)
        return Floor(self.height_m, normal / length, self.normal_sigma_rad, cap_radius_m=cap_radius_m)


@dataclass(frozen=True, slots=True)
class ImuTable:
    """`[[imu]]`, see `Imu`."""

    rod: int
    axis: tuple[float, float, float]
    fraction: float = 0.5
    file: FileName | None = None
    board: int | None = None
    sensor: int = 0


@dataclass(frozen=True, slots=True)
class RangeTable:
    """`[[range]]`: one recording of distances between beacons and nodes."""

    file: FileName
    beacon_position_m: list[tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class PositionTable:
    """`[[position]]`: one recording of positions of some nodes."""

    file: FileName
    frame: Literal["world", "own"] = "world"


@dataclass(frozen=True, slots=True)
class MotorTable:
    """`[[motor]]`: one recording of the natural lengths of tendons that motors wind, see `Motors`."""

    file: FileName
    tendons: list[int]
    strip_length_m: Positive

    def motors(self, number: int, structure: Structure) -> Motors:
        """Return the motors of the table with this number.

        Raises:
            InputError: for tendons or a strip that the structure cannot have.
        """
        motors = Motors(tuple(self.tendons), self.strip_length_m)
        try:
            motors.check(structure)
        except InputError as error:
            raise InputError(f"motor[{number}].{error}") from error
        return motors


@dataclass(frozen=True, slots=True)
class AdcTable:
    """`[adc]`, see `Divider`."""

    bits: int
    known_resistor_ohm: Positive
    sensor_side: Literal["ground", "supply"]
    supply_volt: float | None = None

    def divider(self) -> Divider:
        """Return the divider.

        Raises:
            InputError: for a resolution or resistor that is impossible.
        """
        return Divider(self.bits, self.known_resistor_ohm, self.sensor_side)


@dataclass(frozen=True, slots=True)
class SensorsTable:
    """`[sensors]`: the resistance of each sensor at its natural length."""

    natural_resistance_ohm: list[Positive]


@dataclass(frozen=True, slots=True)
class BoardTable:
    """`[[board]]`: one recording of one board, and the tendon wired to each of its channels."""

    file: FileName
    tendon_of_channel: list[int | str]
    board_id: str | int | None = None
    firmware: str | None = None


@dataclass(frozen=True, slots=True)
class LinkTable:
    """`[link]`: how the boards are read."""

    baud: AtLeastOne = 500_000
    """Baud rate of the serial ports; the default is that of the project's firmware."""
    ports: list[str] = field(default_factory=list)
    """Serial ports at which to look for boards; an empty list means every USB serial port."""


@dataclass(frozen=True, slots=True)
class ResistanceTable:
    """`[resistance]`: one file that replaces the boards."""

    file: FileName


@dataclass(frozen=True, slots=True)
class LengthsTable:
    """`[lengths]`: one file, or one topic of a bag, that replaces the boards."""

    file: FileName
    topic: str | None = None
    strips: bool = True
    """Whether strips have told them, which remember how they were moved; of encoders, say, it is false."""


@dataclass(frozen=True, slots=True)
class FaultTable:
    """`[[truth.fault]]`: a known fault of a tendon's sensor or of a board, for evaluation only."""

    kind: str
    from_s: float
    until_s: float
    tendon: int | None = None
    board: int | None = None


@dataclass(frozen=True, slots=True)
class MarkerTable:
    """A marker in `[truth.markers]`, by its name in the motion capture."""

    node: int
    beyond_m: NotNegative = 0.0
    """Distance of the marker's centre beyond the node, along the rod, which needs a marker at its other end too."""


@dataclass(frozen=True, slots=True)
class TruthTable:
    """`[truth]`: the files of true positions and loads, for evaluation only, never an input to an estimator."""

    file: FileName | None = None
    """None where `evaluate --truth` names it."""
    loads: FileName | None = None
    contacts: FileName | None = None
    markers: dict[str, MarkerTable] = field(default_factory=dict)
    fault: list[FaultTable] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class TrialTable:
    """The tables of trial.toml."""

    structure: StructureTable
    format: Literal[1] = 1
    name: str | None = None
    kind: str | None = None
    provenance: str | None = None
    recorded_utc: str | None = None
    body: list[BodyTable] = field(default_factory=list)
    mechanics: MechanicsTable | None = None
    rest: RestTable = field(default_factory=RestTable)
    ground: GroundTable | None = None
    imu: list[ImuTable] = field(default_factory=list)
    range: list[RangeTable] = field(default_factory=list)
    position: list[PositionTable] = field(default_factory=list)
    motor: list[MotorTable] = field(default_factory=list)
    factor: list[dict[str, Any]] = field(default_factory=list)
    adc: AdcTable | None = None
    sensors: SensorsTable | None = None
    board: list[BoardTable] = field(default_factory=list)
    link: LinkTable = field(default_factory=LinkTable)
    resistance: ResistanceTable | None = None
    lengths: LengthsTable | None = None
    truth: TruthTable | None = None
