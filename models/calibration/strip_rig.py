"""How a test rig's files are to be read: which column is what, in which unit."""

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
    """Names in the header, or numbers from 1 on in files without one."""

    time: str | int = "t_s"
    """When the resistance was read."""
    resistance: str | int = "resistance_ohm"
    """Of the strip; its sign, the source's polarity, does not count."""
    strain: str | int = "strain"
    """Of the strip, where the rig tells it; else ..."""
    displacement: str | int | None = None
    """... how far the rig has moved, which over the gauge length is strain."""
    strain_time: str | int | None = None
    """When strain or displacement was read, if that has a clock reading of its own."""


@dataclass(frozen=True, slots=True)
class Units:
    """Of the columns."""

    time: Literal["s", "ms", "us"] = "s"
    resistance: Literal["ohm", "kohm", "Mohm"] = "ohm"
    strain: Literal["1", "%"] = "1"
    displacement: Literal["mm", "m", "inch"] = "mm"


@dataclass(frozen=True, slots=True)
class StripRig:
    """A test rig, as in the file given by --rig; the defaults are the project's own recordings."""

    columns: Columns = field(default_factory=Columns)
    units: Units = field(default_factory=Units)
    gauge_length_mm: Positive | None = None
    """Length of the strip between the clamps at zero displacement."""
    natural_resistance_ohm: Positive | Literal["header", "start"] = "header"
    """R0: from a line `# natural_resistance_ohm = ...` in each file, or the mean of each file's first second."""
    magnitude: bool = False
    """Whether all motion is stretching, whatever its sign."""
    average: AtLeastOne = 1
    """Readings in a running mean: 2 for a source whose current alternates."""

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
        """Whether the files have no header."""
        return isinstance(self.columns.time, int)

    @property
    def needed_columns(self) -> tuple[str | int, str | int, str | int, str | int]:
        """Time and resistance, time of strain and strain or displacement."""
        c = self.columns
        motion = c.strain if c.displacement is None else c.displacement
        return c.time, c.resistance, c.time if c.strain_time is None else c.strain_time, motion

    @property
    def strain_scale(self) -> float:
        """By what to multiply the column of strain or displacement to get strain."""
        if self.columns.displacement is None or self.gauge_length_mm is None:
            return STRAIN[self.units.strain]
        return LENGTH_MM[self.units.displacement] / self.gauge_length_mm
