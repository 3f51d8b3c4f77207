"""The mechanical twin: the engine that moves a structure under loads (MuJoCo)."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..structure.lengths import member_length_m
from ..values.errors import InputError, TensegraphError
from .loads import Loads
from .mjcf import Body, mjcf

SETTLED_M_PER_S = 1e-6
"""A structure at rest: a node that still moves this fast for the rest seconds moves by a few micrometres."""
TOLD_EVERY = 200
"""Number of steps from one report of the progress to the next: a tenth of a second at 0.5 ms."""
COMING_TO_REST_S = 300.0
"""How long to wait for that; the examples take 2 to 4 s."""
FASTEST_AT_REST = 0.01
"""Speed of its rods, in m/s and rad/s, above which it is not at rest: one that swings, by itself or because the steps
of the integration are too long, may be in the same place after 0.1 s."""


@dataclass(frozen=True, slots=True, eq=False)
class TwinMotion:
    """What the structure did."""

    t_s: NDArray[np.float64]
    """(steps,)"""
    node_position_m: NDArray[np.float64]
    """(steps, nodes, 3)"""
    load_n: NDArray[np.float64]
    """(steps, nodes, 3) external force at each node, gravity and the ground's left out."""
    tendon_length_m: NDArray[np.float64]
    """(steps, tendons) between the two ends of a tendon, which are its nodes if there are no hubs."""
    rod_turn: NDArray[np.float64] | None = None
    """(steps, rods, 3, 3) from each rod's axes to the world, z along the rod; None where it was not asked for. Not of
    distances in rigid bodies."""


class Twin:
    """One structure, its state, and the engine that moves it.

    Args:
        body: what it is made of.
        step_s: of the integration.
        node_position_m: (nodes, 3) from which it starts, at rest.

    Raises:
        TensegraphError: when MuJoCo is not installed, or takes no such structure.
    """

    def __init__(self, body: Body, step_s: float, node_position_m: NDArray[np.float64]) -> None:
        try:
            import mujoco  # half a second
        except ImportError as error:
            raise TensegraphError("the twin needs MuJoCo: pip install 'tensegraph[twin]'") from error
        self._engine: Any = mujoco
        try:
            self._model = mujoco.MjModel.from_xml_string(mjcf(body, node_position_m, step_s))
        except ValueError as error:  # a mass or a radius so small that an inertia is none
            raise InputError(f"MuJoCo refuses the structure: {' '.join(str(error).split())}") from error
        self._data = mujoco.MjData(self._model)
        self._site = np.array([self._model.site(f"n{node}").id for node in range(body.structure.node_count)])
        self._body = self._model.site_bodyid[self._site]
        self._rod_body = np.array([self._model.body(f"r{rod}").id for rod in range(body.own_rods)], dtype=np.int64)
        tendons = range(len(body.structure.tendons))
        names = [[body.end_site(tendon, end) for end in (0, 1)] for tendon in tendons]
        self._end = np.array([[self._model.site(name).id for name in pair] for pair in names])
        self._slack_m = self._model.tendon_lengthspring.copy()
        self._step_s = step_s
        mujoco.mj_forward(self._model, self._data)

    @property
    def node_position_m(self) -> NDArray[np.float64]:
        """(nodes, 3) where the nodes are."""
        return np.array(self._data.site_xpos[self._site])

    @property
    def tendon_length_m(self) -> NDArray[np.float64]:
        """(tendons,) between the two ends of a tendon."""
        return member_length_m(self._data.site_xpos, self._end)

    def settle(self) -> None:
        """Wait, without loads, until nothing moves.

        Raises:
            TensegraphError: when it does not come to rest.
        """
        period = max(round(0.1 / self._step_s), 1)
        before = self.node_position_m
        for _ in range(round(COMING_TO_REST_S / self._step_s / period)):
            with self._unlogged():
                self._engine.mj_step(self._model, self._data, period)
            self._check_stable()
            now = self.node_position_m
            speed = np.abs(self._data.qvel).max(initial=0.0)
            if np.abs(now - before).max() < SETTLED_M_PER_S * period * self._step_s and speed < FASTEST_AT_REST:
                break
            before = now
        else:
            raise TensegraphError(
                f"the structure does not come to rest in {COMING_TO_REST_S:g} s: try more drag, or a smaller step_s"
            )
        self._data.qvel[:] = 0.0
        self._engine.mj_forward(self._model, self._data)

    def run(
        self,
        loads: Loads,
        steps: int,
        *,
        wound_m: NDArray[np.float64] | None = None,
        with_turns: bool = False,
        progress: Callable[[float], None] = lambda share: None,
    ) -> TwinMotion:
        """Return what happens from now on, which is t = 0.

        Args:
            loads: on the nodes.
            steps: of the integration.
            wound_m: (steps, tendons) change of the natural lengths; None where no motor changes any.
            with_turns: whether to return the turns of the rods.
            progress: called now and then with the share of the steps that is done.
        """
        position_m = np.empty((steps, len(self._site), 3))
        load_n = np.empty_like(position_m)
        length_m = np.empty((steps, len(self._end)))
        turn = np.empty((steps, len(self._rod_body), 3, 3)) if with_turns else None
        with self._unlogged():
            for k in range(steps):
                if k % TOLD_EVERY == 0:
                    progress(k / steps)
                position_m[k] = self.node_position_m
                length_m[k] = self.tendon_length_m
                if turn is not None:
                    turn[k] = self._data.xmat[self._rod_body].reshape(-1, 3, 3)
                if wound_m is not None:
                    self._wind(wound_m[k])
                load_n[k] = loads.force_n(k * self._step_s, position_m[k])
                self._push(load_n[k], position_m[k])
                self._engine.mj_step(self._model, self._data)
        self._check_stable()
        return TwinMotion(self._step_s * np.arange(steps, dtype=np.float64), position_m, load_n, length_m, turn)

    def _wind(self, wound_m: NDArray[np.float64]) -> None:
        """Change the natural lengths by (tendons,); each tendon is two springs, stretched and bent, see `mjcf`."""
        slack_m = self._model.tendon_lengthspring
        slack_m[::2, 1] = self._slack_m[::2, 1] + wound_m
        slack_m[1::2, 0] = self._slack_m[1::2, 0] + wound_m

    @contextmanager
    def _unlogged(self) -> Iterator[None]:
        """Keep the engine from writing its warnings to the terminal and into a file; `_check_stable` tells them."""
        self._engine.set_mju_user_warning(lambda text: None)
        try:
            yield
        finally:
            self._engine.set_mju_user_warning(None)

    def _check_stable(self) -> None:
        """Refuse what the engine would only log: it starts anew when the numbers run away.

        Raises:
            TensegraphError: when they did.
        """
        kinds = self._engine.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        if any(self._data.warning[kind].number for kind in bad):
            raise TensegraphError("the motion runs away from the integration: expected a smaller step_s")

    def _push(self, force_n: NDArray[np.float64], position_m: NDArray[np.float64]) -> None:
        """Apply node forces as MuJoCo takes them: force and moment about each body's centre of mass."""
        wrench = self._data.xfrc_applied
        wrench[:] = 0.0
        for node in np.flatnonzero(force_n.any(axis=1)):
            body = self._body[node]
            arm_m = position_m[node] - self._data.xipos[body]
            wrench[body, :3] += force_n[node]
            wrench[body, 3:] += np.cross(arm_m, force_n[node])
