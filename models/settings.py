"""All settings of a run, with their defaults and the source of each default."""

from dataclasses import dataclass, field

from .estimation import BranchSettings, DoubtSettings, HealthSettings, NoiseSettings, SmootherSettings
from .pose.pose_settings import PoseSettings
from .sensor.clock import ClockSettings
from .sensor.frames import FrameSettings
from .sensor.front_end import FrontEndSettings
from .sensor.gate import GateSettings
from .sensor.reference_drift import DriftSettings
from .structure.external_loads import LOAD_THRESHOLD_N
from .structure.rest_shape import RestSettings
from .values.tables import Positive, Probability


@dataclass(frozen=True, slots=True)
class Settings:
    """All settings of a run; each may be set in the file given by --config."""

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
