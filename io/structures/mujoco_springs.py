"""Springs of MuJoCo models: spatial tendons, and actuators whose force depends on the length of a tendon.

A tendon of stiffness k pulls with k (l - high) beyond the upper of its two lengths, and pushes with k (low - l) below
the lower one. An actuator with affine bias and gear g acts on the tendon, of length l, with the force

    f = gain u + b0 + b1 g l,    pull -g f = k (l - L0),    k = -b1 g^2,    L0 = -(gain u + b0) / (b1 g)

where b1 < 0 and its control u is zero, or as near to zero as its range allows. One whose force is limited to pulling
does not push, and the other way round. One that integrates its control has no length of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...models.values.errors import InputError
from .mujoco_model import MujocoModel

NEVER_M = 100.0
"""Upper length of a spring beyond which it never pulls: longer than any laboratory."""


@dataclass(frozen=True, slots=True)
class Spring:
    """A spring between two sites, with one natural length."""

    name: str
    """Of its tendon."""
    sites: tuple[int, int]
    stiffness_n_per_m: float
    natural_m: float
    pulls: bool
    """Whether it pulls where it is longer than that."""
    pushes: bool
    """Whether it pushes where it is shorter."""


def springs_of(of: MujocoModel) -> list[Spring]:
    """Return the springs of all spatial tendons.

    Raises:
        InputError: for tendons over several sites, or without a spring, and for a model without tendons.
    """
    springs = []
    for tendon in range(of.model.ntendon):
        name, sites = of.name("tendon", tendon), _sites(of, tendon)
        own = list(_own(of, tendon, name, sites))
        own += [_driven(of, actuator, name, sites) for actuator in _actuators(of, tendon) if _is_spring(of, actuator)]
        if not own and of.model.tendon_lengthspring[tendon, 1] < NEVER_M:
            raise InputError(f"{of.path}: {name}: {_missing(of, tendon)}")
        springs += own
    if not springs:
        raise InputError(f"{of.path}: expected spatial tendons between sites, got none")
    return springs


def _sites(of: MujocoModel, tendon: int) -> tuple[int, int]:
    model = of.model
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    if model.wrap_type[first : first + count].tolist() != [int(of.mujoco.mjtWrap.mjWRAP_SITE)] * 2:
        raise InputError(f"{of.path}: {of.name('tendon', tendon)}: expected a spatial tendon from one site to another")
    return int(model.wrap_objid[first]), int(model.wrap_objid[first + 1])


def _own(of: MujocoModel, tendon: int, name: str, sites: tuple[int, int]) -> Iterator[Spring]:
    """Yield the spring of a tendon itself; two where it pulls and pushes with a gap between."""
    stiffness = float(of.model.tendon_stiffness[tendon])
    _check_linear(of, tendon, name)
    low_m, high_m = of.model.tendon_lengthspring[tendon].tolist()
    if stiffness > 0 and high_m < NEVER_M:
        yield Spring(name, sites, stiffness, high_m, pulls=True, pushes=low_m == high_m)
    if stiffness > 0 and 0 < low_m < high_m:
        yield Spring(name, sites, stiffness, low_m, pulls=False, pushes=True)


def _check_linear(of: MujocoModel, tendon: int, name: str) -> None:
    """Raise InputError for a stiffness that changes with the length; MuJoCo has had such since version 4."""
    further = getattr(of.model, "tendon_stiffnesspoly", np.zeros((of.model.ntendon, 0)))[tendon]
    if further.any():
        told = " ".join(f"{value:g}" for value in [of.model.tendon_stiffness[tendon], *further])
        raise InputError(
            f"{of.path}: {name}: stiffness: expected one number, a spring whose force is linear, got {told}"
        )


def _actuators(of: MujocoModel, tendon: int) -> list[int]:
    drives = of.model.actuator_trntype == of.mujoco.mjtTrn.mjTRN_TENDON
    return [int(number) for number in np.flatnonzero(drives & (of.model.actuator_trnid[:, 0] == tendon))]


def _is_spring(of: MujocoModel, actuator: int) -> bool:
    model, kinds = of.model, of.mujoco.mjtDyn
    settles = [int(kinds.mjDYN_NONE), int(kinds.mjDYN_FILTER), int(kinds.mjDYN_FILTEREXACT)]
    return bool(
        int(model.actuator_dyntype[actuator]) in settles
        and model.actuator_gaintype[actuator] == of.mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == of.mujoco.mjtBias.mjBIAS_AFFINE
        and model.actuator_biasprm[actuator, 1] < 0
        and model.actuator_gear[actuator, 0] != 0
    )


def _driven(of: MujocoModel, actuator: int, name: str, sites: tuple[int, int]) -> Spring:
    """Return the spring that an actuator is to its tendon, while nothing controls it."""
    model = of.model
    control = float(np.clip(0.0, *model.actuator_ctrlrange[actuator])) if model.actuator_ctrllimited[actuator] else 0.0
    gear, by_length = float(model.actuator_gear[actuator, 0]), float(model.actuator_biasprm[actuator, 1])
    limited, reach_n = model.actuator_forcelimited[actuator], gear * model.actuator_forcerange[actuator]
    force_n = float(model.actuator_gainprm[actuator, 0] * control + model.actuator_biasprm[actuator, 0])
    return Spring(
        name=name,
        sites=sites,
        stiffness_n_per_m=-by_length * gear**2,
        natural_m=-force_n / (by_length * gear),
        pulls=not limited or bool(reach_n.min() < 0),
        pushes=not limited or bool(reach_n.max() > 0),
    )


def _missing(of: MujocoModel, tendon: int) -> str:
    """Return what a tendon without a spring lacks."""
    needed = "expected a stiffness above 0, or an actuator whose force falls with the length (biasprm), got 0 and"
    for actuator in _actuators(of, tendon):
        return f"{needed} {of.name('actuator', actuator)}, which is no spring while nothing controls it"
    return f"{needed} no actuator"
