"""All settings of a run, with their defaults and the source of each default."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np

from .estimation import BranchSettings, DoubtSettings, HealthSettings, NoiseSettings, SmootherSettings
from .pose.pose_settings import PoseSettings
from .sensor.clock import ClockSettings
from .sensor.frames import FrameSettings
from .sensor.front_end import FrontEndSettings
from .sensor.gate import GateSettings
from .sensor.reference_drift import DriftSettings
from .structure.external_loads import LOAD_THRESHOLD_N
from .structure.mechanics import Mechanics
from .structure.rest_shape import RestSettings
from .structure.structure import Structure
from .values.errors import InputError
from .values.tables import Positive, Probability, parse_table

FARTHEST = 500.0
"""Ratio of a setting to its default beyond which it is in another unit: in millimetres or milliseconds, a thousandfold.
"""
LEAST = 1e-4
"""The least such ratio: a setting may be small where a robot or its sensors are exact, and a share or a probability as
small as it likes."""


STRETCHED_N = 68.0
"""Force of a tendon that is stretched by its own length, of the robot for which the defaults are."""
ROD_M = 0.3
"""Length of its rods."""
MOST_DOUBLINGS = 8
"""Power of two up to which sigmas grow: beyond it they would be as of another unit."""
MOST_HALVINGS = 4
"""Power of two down to which sigmas of forces shrink: weight and touch do not get smaller with the stiffness."""


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of a run; each may be set in the file given by --config. See also `of_size`."""

    probability: Probability = 0.95
    """Probability with which an ellipsoid contains its node."""
    load_threshold_n: Positive = LOAD_THRESHOLD_N
    """Load above which a node counts as loaded in tables and figures. No estimate depends on it."""
    clock: ClockSettings = field(default_factory=ClockSettings)
    gate: GateSettings = field(default_factory=GateSettings)
    frames: FrameSettings = field(default_factory=FrameSettings)
    drift: DriftSettings = field(default_factory=DriftSettings)
    front_end: FrontEndSettings = field(default_factory=FrontEndSettings)
    rest: RestSettings = field(default_factory=RestSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    smoother: SmootherSettings = field(default_factory=SmootherSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    doubt: DoubtSettings = field(default_factory=DoubtSettings)
    branch: BranchSettings = field(default_factory=BranchSettings)
    pose: PoseSettings = field(default_factory=PoseSettings)

    def __post_init__(self) -> None:
        for part in fields(self):
            value, default = getattr(self, part.name), part.default_factory
            if is_dataclass(default) and not isinstance(value, default):
                raise InputError(
                    f"settings.{part.name}: expected {default.__name__}({_example(value)}), got {type(value).__name__}"
                )
            _check_scale(part.name, value, default() if is_dataclass(default) else part.default)

    def for_robot(self, structure: Structure, mechanics: Mechanics | None) -> "Settings":
        """Return the settings of a robot, see `sizes_of` and `of_size`."""
        return self.of_size(*sizes_of(structure, mechanics))

    def of_size(self, force: float, length: float) -> "Settings":
        """Return the settings of a robot whose forces and lengths are so many times those of the defaults.

        The standard deviations of forces, of the shape prior, of a shape that was found, and of a pose grow with them,
        but for those that are not at their defaults; told at its default, one grows, too.
        """
        of_pose = ("motion_m_per_s", "floor_m", "lifted_m", "creep_m_per_s05", "slip_m_per_rad05")
        return replace(
            self,
            rest=_grown(_grown(self.rest, force, "force_sigma_n"), length, "found_sigma_m"),
            noise=_grown(_grown(self.noise, force, "force_n"), length, "shape_prior_m"),
            doubt=_grown(self.doubt, force, "load_n", "quiet_n", "many_loads_n", "shaken_n"),
            pose=_grown(self.pose, length, *of_pose),
        )


def sizes_of(structure: Structure, mechanics: Mechanics | None) -> tuple[float, float]:
    """Return how many times as large forces and lengths are as those of the defaults, in powers of two.

    The force is that of a tendon that is stretched by its own length, k L0, in the median; the length is that of a rod.
    Sigmas of lengths keep their defaults for a smaller robot. One of a sixteenth of the stiffness would be 3.2 mm off
    with the defaults of forces, and is 0.9 mm off with its own.
    """
    force = 1.0
    if mechanics is not None:
        elastic = np.setdiff1d(np.arange(len(structure.tendons)), mechanics.stiff_cables)
        if len(elastic):
            of_tendon_n = mechanics.stiffness_n_per_m * mechanics.natural_length_m
            force = _power_of_two(float(np.median(of_tendon_n[elastic])) / STRETCHED_N, MOST_HALVINGS)
    return force, _power_of_two(float(structure.rod_length_m.mean()) / ROD_M)


def _power_of_two(ratio: float, most_halvings: int = 0) -> float:
    return float(2.0 ** np.clip(np.round(np.log2(ratio)), -most_halvings, MOST_DOUBLINGS))


def _grown(part: Any, factor: float, *names: str) -> Any:
    """Return a part of the settings with some sigmas times a factor, where they are at their defaults."""
    default = type(part)()
    at_default = [name for name in names if getattr(part, name) == getattr(default, name)]
    return replace(part, **{name: factor * getattr(part, name) for name in at_default})


def _check_scale(name: str, value: object, default: object) -> None:
    """Check the numbers of a setting, or of a part of them, against their defaults; zero and infinity may be allowed.

    Raises:
        InputError: with the name of the setting.
    """
    if isinstance(value, float) and isinstance(default, float) and default > 0:
        is_share = name.endswith(("share", "probability"))
        least, most = 0.0 if is_share else default * LEAST, default * FARTHEST
        if 0 < value < least or most < value < math.inf:
            raise InputError(f"{name}: expected {least:g} to {most:g}, got {value:g}: is the unit right?")
    elif is_dataclass(default):
        for part in fields(default):
            _check_scale(f"{name}.{part.name}", getattr(value, part.name), getattr(default, part.name))


def _example(value: object) -> str:
    """Return the values of a mapping as arguments."""
    return ", ".join(f"{name}={item!r}" for name, item in value.items()) if isinstance(value, Mapping) else "..."


def checked_settings(settings: Any) -> Settings:
    """Return settings that were made in Python, or the defaults for None, after the checks that a file gets.

    Raises:
        InputError: for what is no `Settings`, or a value that is not allowed.
    """
    if settings is None:
        return Settings()
    if not isinstance(settings, Settings):
        allowed = ", ".join(part.name for part in fields(Settings))
        raise InputError(f"settings: expected Settings(...) with {allowed}, got {type(settings).__name__}")
    return parse_table(Settings, asdict(settings), "settings")
