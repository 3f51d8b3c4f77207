"""A plan of the twin: one structure, what is done to it, and what measures it. A plan states every constant."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge

from ..structure_description import (
    BodyTable,
    DescribedStructure,
    MechanicsTable,
    StructureFile,
    StructureTable,
    described,
)
from ..trial_tables import AdcTable
from ..values.tables import Fraction, NotNegative, Positive
from .carried_sensors import ImuPlan, PositionPlan, RangePlan
from .emulated_boards import BoardPhysics, Faults
from .geometry_error import GeometryError
from .loads import Hold, Press, RandomPresses, Squeeze
from .motors import MotorPlan
from .slow_drift import DriftPlan
from .specimens import HysteresisPlan, SensorPhysics
from .spread_loads import RandomHugs, RandomLifts, RandomShakes, RandomTips, WindPlan


@dataclass(frozen=True, slots=True)
class MechanicsPlan:
    """`[mechanics]` of a plan."""

    rod_mass_kg: Positive | list[Positive]
    rod_radius_m: Positive | list[Positive]
    """Of the rod, and of the round ends that touch the ground."""
    rod_drag_n_s_per_m: NotNegative
    """Of one rod that moves sideways: air, and whatever else stops a sway."""
    tendon_stiffness_n_per_m: Positive | list[Positive]
    """As one pull test gives it; trial.toml says this."""
    tendon_stiffness_spread: NotNegative
    """Relative standard deviation over tendons."""
    tendon_damping_n_s_per_m: NotNegative
    push_back: Fraction | list[Fraction]
    """Stiffness of a bent tendon over that of a stretched one; 0 for a cable, which goes slack."""
    natural_length_spread_m: NotNegative
    """Standard deviation over tendons, which trial.toml says tendon by tendon, as measured."""
    gravity_m_per_s2: NotNegative
    step_s: Positive
    """Of the integration."""
    tendon_mass_kg: NotNegative | list[NotNegative] = 0.0
    """As in trial.toml."""
    knot_mass_kg: NotNegative | list[NotNegative] = 0.0
    """As in trial.toml; a node that moves and is on no rod needs some."""


@dataclass(frozen=True, slots=True)
class GroundPlan:
    """`[ground]`: the structure lies on it, and nothing holds the anchors; without the table they are held."""

    friction: NotNegative
    """Coulomb's coefficient."""


@dataclass(frozen=True, slots=True)
class RestPlan:
    """`[rest]`: how the trial starts."""

    seconds: Positive
    """Unloaded, at rest."""
    node_position_sigma_m: NotNegative | None = None
    """Error, per axis, with which the rest shape is measured for trial.toml; left out: it is not measured."""


@dataclass(frozen=True, slots=True)
class LoadPlan:
    """`[load]`: lists of each kind, none if not named."""

    press: tuple[Press, ...] = ()
    squeeze: tuple[Squeeze, ...] = ()
    hold: tuple[Hold, ...] = ()
    random: tuple[RandomPresses, ...] = ()
    hug: tuple[RandomHugs, ...] = ()
    shake: tuple[RandomShakes, ...] = ()
    wind: tuple[WindPlan, ...] = ()
    tip: tuple[RandomTips, ...] = ()
    lift: tuple[RandomLifts, ...] = ()


@dataclass(frozen=True, slots=True)
class TruthPlan:
    """`[truth]`: what is written for evaluation."""

    rate_hz: Positive


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan as it stands."""

    name: str
    """The trial's name is this and the seed: press_01."""
    kind: str
    """As in trial.toml."""
    seed: Annotated[int, Ge(0)]
    duration_s: Positive
    structure: StructureTable
    """Nominal; as in trial.toml."""
    mechanics: MechanicsPlan
    rest: RestPlan
    sensors: SensorPhysics
    adc: AdcTable
    boards: BoardPhysics
    truth: TruthPlan
    format: Literal[1] = 1
    body: list[BodyTable] = field(default_factory=list)
    ground: GroundPlan | None = None
    imu: list[ImuPlan] = field(default_factory=list)
    range: list[RangePlan] = field(default_factory=list)
    position: list[PositionPlan] = field(default_factory=list)
    motor: list[MotorPlan] = field(default_factory=list)
    load: LoadPlan = field(default_factory=LoadPlan)
    fault: Faults = field(default_factory=Faults)
    drift: DriftPlan | None = None
    hysteresis: HysteresisPlan | None = None
    geometry_error: GeometryError = field(default_factory=GeometryError)

    def described(self) -> DescribedStructure:
        """Return the nominal structure and mechanics.

        Raises:
            InputError: when the tables do not describe any; the text names the key.
        """
        mechanics = MechanicsTable(
            tendon_stiffness_n_per_m=self.mechanics.tendon_stiffness_n_per_m,
            rod_mass_kg=self.mechanics.rod_mass_kg,
            push_back=self.mechanics.push_back,
            tendon_mass_kg=self.mechanics.tendon_mass_kg,
            knot_mass_kg=self.mechanics.knot_mass_kg,
        )
        return described(StructureFile(self.structure, self.body, mechanics))

    @property
    def steps(self) -> int:
        """How many steps the integration takes."""
        return round(self.duration_s / self.mechanics.step_s)
