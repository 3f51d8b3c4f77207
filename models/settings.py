"""Every setting of a run, with its default and where the default comes from."""

from dataclasses import dataclass, field

from .estimation import BranchSettings, HealthSettings, NoiseSettings, SmootherSettings
from .sensor.clock import ClockSettings
from .sensor.drift import DriftSettings
from .sensor.frames import FrameSettings
from .sensor.front_end import FrontEndSettings
from .sensor.gate import GateSettings
from .structure.external_loads import LOAD_THRESHOLD_N
from .structure.rest_shape import RestSettings
from .values.tables import Positive, Probability


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of a run; each may be set in the file given by --config."""

    probability: Probability = 0.95
    """Of the ellipsoids."""
    load_threshold_n: Positive = LOAD_THRESHOLD_N
    """Above it a node is called loaded, in tables and figures; no estimate depends on it."""
    clock: ClockSettings = field(default_factory=ClockSettings)
    gate: GateSettings = field(default_factory=GateSettings)
    frames: FrameSettings = field(default_factory=FrameSettings)
    drift: DriftSettings = field(default_factory=DriftSettings)
    front_end: FrontEndSettings = field(default_factory=FrontEndSettings)
    rest: RestSettings = field(default_factory=RestSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    smoother: SmootherSettings = field(default_factory=SmootherSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    branch: BranchSettings = field(default_factory=BranchSettings)
