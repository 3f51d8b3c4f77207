"""What the table of a run says of its rest, loads, slips, pauses and sensors, in one line each."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ...models.structure.floor import EstimatedNormal
from ...models.structure.reconstruction import Reconstruction
from ...models.structure.rest_shape import RestShape, WrongPart
from ...models.structure.shape import Reason
from ...models.trial_description import TrialDescription
from ...models.values.readings import LEFT_OUT, SENSOR_FLAGS, Flag
from ...models.values.slip import Slip
from ...models.values.time_series import median_step_s

MOST_PAUSES = 10
"""Largest number of pauses that are listed."""
COLUMNS_SHOWN = 3
"""Largest number of columns that are listed."""
LONG_S = 1.0
"""Total time under load above which a node is named, and time without readings above which that is told."""


def pauses(t_s: NDArray[np.float64]) -> list[str]:
    """Return from when to when nothing was read, of (frames,) times; of many pauses, how many and how long."""
    before = np.flatnonzero(np.diff(t_s) > LONG_S)
    if len(before) <= MOST_PAUSES:
        return [f"from {t_s[k]:.2f} to {t_s[k + 1]:.2f} s" for k in before]
    median_s = float(np.median(np.diff(t_s)[before]))
    return [f"{len(before)} times, for {median_s:.3g} s in the median: are stamps in seconds?"]


def position_counts(contradicted: Sequence[Sequence[int]]) -> dict[str, int]:
    """Return the number of positions of each node that were left out, see `Shape.contradicted_positions`."""
    nodes = Counter(node for frame in contradicted for node in frame)
    return {f"position of node {node}: contradicted": nodes[node] for node in sorted(nodes)}


def rest_complaints(
    wrong: Sequence[WrongPart], exchanged: Sequence[tuple[int, int]], *, misfits: bool, moved: bool
) -> Iterator[tuple[str, str]]:
    """Yield what looks wrong at rest, and what to do: the name of a row of the table and its text.

    Args:
        wrong: the parts of the geometry that were told wrongly.
        exchanged: pairs of tendons whose sensors seem to be exchanged.
        misfits: whether sensors do not fit the rest shape.
        moved: whether the structure moved while it was to stand still.
    """
    yield from (("geometry", line) for line in _wrong_geometry(wrong))
    if misfits:
        yield "rest in doubt", Reason.REST.advice
    if moved:
        yield "moved at rest", "the structure moved while it was to stand still, sigmas are widened: rest it again"
    for a, b in exchanged:
        yield "wiring", f"the sensors of tendons {a} and {b} look exchanged: see tendon_of_channel"


def _wrong_geometry(wrong: Sequence[WrongPart]) -> list[str]:
    """Return what the evidence at rest says of each part of the geometry that was told wrongly, and what to do."""
    told = {
        "rods": "the rods have other lengths than trial.toml says; those estimated are used",
        "anchors": "the anchors are elsewhere than trial.toml says; those estimated are used",
        "natural lengths": "they are not those of trial.toml; those estimated are used",
        "rest shape": "the measured rest shape does not balance: was it measured in this state?; sigmas are widened",
        "axes": "the rest shape seems to be measured in other axes than the anchors: measure both in the same",
        "hubs": "forces do not balance in the rest shape: stiffnesses, masses or the shape are others, mirrored ones, "
        "too, or tendons end beside the ends of the rods (give structure.hub_radius_m); sigmas are widened",
        "mirror": "nothing shows which of two mirror images it is: give structure.node_position_m, about as at rest",
        "several": "rods, anchors, natural lengths and what was measured at rest contradict each other, whichever of "
        "them is wrong: check each",
        "floor": "the lowest nodes at rest are off the floor: are height_m, normal and the rest shape right?",
    }
    together = ["several parts are wrong at once, so that all frames are in doubt: measure them again"]
    return [told[part] for part in wrong] + (together if len(wrong) > 1 else [])


def rest_source(rest: RestShape, trial: TrialDescription) -> str:
    """Return what tells the rest shape, and on which side of the anchors it was searched for."""
    if rest.source == "measured" or trial.near_position_m is not None or not trial.structure.is_held:
        return rest.source
    return f"{rest.source}, above the anchors; if it is below, give structure.node_position_m"


def rest_balance(rest: RestShape) -> list[tuple[str, str]]:
    """Return the imbalance of forces at rest, if the stiffness is known."""
    if rest.mechanics is None:
        return []
    nominal_n, tared_n = rest.unbalanced_n
    return [("forces at rest", f"{nominal_n:.3f} N rms unbalanced as given, {tared_n:.3f} N after taring")]


def load_rows(r: Reconstruction, threshold_n: float) -> list[tuple[str, str]]:
    """Return the largest load, and the nodes that were loaded longer than `LONG_S`."""
    if r.loads is None:
        return []
    load_n = np.nan_to_num(np.linalg.norm(r.loads.force_n, axis=-1))
    k, node = np.unravel_index(load_n.argmax(), load_n.shape)
    step_s = median_step_s(r.t_s, of_one=0.0)
    loaded_s = step_s * (load_n > threshold_n).sum(axis=0)
    long = [f"{node} ({loaded_s[node]:.1f} s)" for node in np.flatnonzero(loaded_s > LONG_S)]
    return [
        ("largest load", f"{load_n[k, node]:.2f} N at node {node}, t = {r.t_s[k]:.2f} s"),
        (f"nodes above {threshold_n:g} N for {LONG_S:g} s", ", ".join(long) or "none"),
    ]


def normal_line(normal: EstimatedNormal) -> str:
    """Return the estimated normal, how far it is from the vertical, and its standard deviation."""
    x, y, z = normal.direction
    tilt, sigma = np.rad2deg([np.arccos(min(z, 1.0)), normal.sigma_rad])
    return f"[{x:.4f}, {y:.4f}, {z:.4f}], {tilt:.2f} ± {sigma:.2f} degrees from the vertical"


def slip_line(slides: Sequence[Slip]) -> str:
    """Return how often nodes slipped on the floor, which, and how far at most."""
    if not slides:
        return "none"
    furthest = max(slides, key=lambda slip: slip.distance_m)
    nodes = ", ".join(str(node) for node in sorted({slip.node for slip in slides}))
    distance = f"{1e3 * furthest.distance_m:.0f} ± {1e3 * furthest.sigma_m:.0f} mm"
    return f"{len(slides)}, of node {nodes}; at most {distance}, node {furthest.node} at t = {furthest.t_s:.2f} s"


def flagged_sensors(r: Reconstruction) -> list[str]:
    """Return one line for each group of sensors with the same flags: tendons, flags, first times, frames left out."""
    tendons: dict[str, list[str]] = {}
    for e in np.flatnonzero((r.flags & SENSOR_FLAGS).any(axis=0) & r.structure.is_sensed):
        seen = {flag: np.flatnonzero(r.flags[:, e] & flag) for flag in SENSOR_FLAGS}
        parts = [
            f"{flag.names()} from {r.t_s[frames[0]]:.2f} s"
            for flag, frames in seen.items()
            if len(frames) and flag != Flag.MISSING
        ]
        left_out = np.flatnonzero(r.flags[:, e] & LEFT_OUT)
        if len(left_out):
            parts.append(f"left out of {frames_text(len(left_out))} from {r.t_s[left_out[0]]:.2f} s")
        tendons.setdefault(", ".join(parts), []).append(str(e))
    return [f"tendon {', '.join(names)}: {text}" for text, names in tendons.items()]


def frames_text(number: int) -> str:
    """Return a number of frames in words."""
    return "1 frame" if number == 1 else f"{number} frames"


def columns_text(names: Sequence[str]) -> str:
    """Return the names of columns; of many, the first ones and how many more there are."""
    more = len(names) - COLUMNS_SHOWN
    return f"columns {', '.join(names[:COLUMNS_SHOWN])}" + (f" and {more} more" if more > 0 else "")
