"""The format of a test rig's files: the meaning and the unit of each column."""

from dataclasses import dataclass, field
from typing import Literal

from ..values.errors import InputError
from ..values.tables import AtLeastOne, Positive

TIME_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
RESISTANCE_OHM = {"ohm": 1.0, "kohm": 1e3, "Mohm": 1e6}
STRAIN = {"1": 1.0, "%": 0.01}
LENGTH_MM = {"mm": 1.0, "m": 1e3, "inch": 25.4}


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns, by their names in the header, or by numbers from 1 on in files without a header."""

    time: str | int = "t_s"
    """Time at which the resistance was measured."""
    resistance: str | int = "resistance_ohm"
    """Resistance of the strip. Its sign is ignored, because it depends on the polarity of the source."""
    strain: str | int = "strain"
    """Strain of the strip; not used when `displacement` is given."""
    displacement: str | int | None = None
    """Displacement of the rig, which is divided by the gauge length to get strain."""
    strain_time: str | int | None = None
    """Time at which strain or displacement was measured, if that is a separate column."""


@dataclass(frozen=True, slots=True)
class Units:
    """The units of the columns."""

    time: Literal["s", "ms", "us"] = "s"
    resistance: Literal["ohm", "kohm", "Mohm"] = "ohm"
    strain: Literal["1", "%"] = "1"
    displacement: Literal["mm", "m", "inch"] = "mm"


@dataclass(frozen=True, slots=True)
class StripRig:
    """A test rig, as in the file given by --rig; the defaults are those of the project's recordings."""

    columns: Columns = field(default_factory=Columns)
    units: Units = field(default_factory=Units)
    gauge_length_mm: Positive | None = None
    """Length of the strip between the clamps at zero displacement."""
    natural_resistance_ohm: Positive | Literal["header", "start"] = "header"
    """R0 as a number; `header` reads it from a line `# natural_resistance_ohm = ...` in each file, and `start` is the
    mean of the first second of each file."""
    magnitude: bool = False
    """Whether all motion is stretching, so that the sign of strain or displacement is ignored."""
    average: AtLeastOne = 1
    """Number of readings in a running mean: 2 for a source with alternating current."""

    def __post_init__(self) -> None:
        if self.columns.displacement is not None and self.gauge_length_mm is None:
            raise InputError("gauge_length_mm: is missing: expected the strip's length, since displacement is given")
        kinds = {type(column) for column in self.needed_columns}
        if len(kinds) > 1:
            raise InputError("columns: expected all by name or all by number, got both")
        if int in kinds and min(column for column in self.needed_columns if isinstance(column, int)) < 1:
            raise InputError("columns: expected numbers from 1 on")

    @property
    def numbered(self) -> bool:
        """Whether the files have no header, so that columns are given by number."""
        return isinstance(self.columns.time, int)

    @property
    def needed_columns(self) -> tuple[str | int, str | int, str | int, str | int]:
        """The columns of time, resistance, time of strain, and strain or displacement, in this order."""
        c = self.columns
        motion = c.strain if c.displacement is None else c.displacement
        return c.time, c.resistance, c.time if c.strain_time is None else c.strain_time, motion

    @property
    def strain_scale(self) -> float:
        """The factor that converts the column of strain or displacement to strain."""
        if self.columns.displacement is None or self.gauge_length_mm is None:
            return STRAIN[self.units.strain]
        return LENGTH_MM[self.units.displacement] / self.gauge_length_mm
