"""Shapes as lines of JSON, each a datagram of UDP: for PlotJuggler, and whatever reads JSON."""

import ipaddress
import json
import math
import socket
from collections.abc import Iterable
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from ...models.structure.shape import Shape
from ...models.structure.structure import Structure
from ...models.values.errors import InputError
from ...models.values.readings import Flag, Mode
from ..result import COVARIANCE_CELLS, COVARIANCE_COLUMNS

FORM = "udp://127.0.0.1:9870"


class UdpPublisher:
    """Sends each shape to an address; a context manager.

    Nothing waits: a datagram that the system does not take at once is left out, and counted. Whether anybody listens is
    not known.
    """

    def __init__(self, address: str, structure: Structure, *, remote: bool = False) -> None:
        """Find the address.

        Args:
            address: such as `FORM`.
            structure: whose shapes are sent.
            remote: whether the address may be of another machine.

        Raises:
            InputError: for what is no such address, or of another machine without `remote`.
        """
        self.address = address
        self._structure = structure
        family, self._to = udp_address(address, remote=remote)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.left_out = 0
        """Number of shapes that could not be sent."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._socket.close()

    def add(self, shape: Shape) -> None:
        """Send a shape."""
        try:
            self._socket.sendto(json_line(self._structure, shape), self._to)
        except OSError:  # the buffer is full, the datagram too long, or the network gone: the estimate goes on
            self.left_out += 1


def udp_address(text: str, *, remote: bool) -> tuple[socket.AddressFamily, Any]:
    """Return family and address of a socket.

    Raises:
        InputError: see `UdpPublisher`.
    """
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if host is None or not port or parts.scheme != "udp" or parts.path or parts.query:
        raise InputError(f"--publish {text}: expected ros2, or an address such as {FORM}")
    try:
        family, _, _, _, to = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:  # a name that is unknown, or cannot be one
        reason = getattr(error, "strerror", "it cannot be a name")
        raise InputError(f"--publish {text}: {host} is no address: {reason}") from error
    if not (remote or ipaddress.ip_address(to[0]).is_loopback):
        raise InputError(f"--publish {text}: is another machine: add --publish-remote if that is meant")
    return family, to


def json_line(structure: Structure, shape: Shape) -> bytes:
    """Return a shape as one line of JSON; its fields are those of the result's tables, null what is not known."""
    return json.dumps(shape_fields(structure, shape), allow_nan=False, separators=(",", ":")).encode() + b"\n"


def shape_fields(structure: Structure, shape: Shape) -> dict[str, Any]:
    """Return the fields of a shape, see the page "Shapes for other programs, live"."""
    covariance_m2 = shape.node_covariance_m2[:, *COVARIANCE_CELLS]
    names = ("x_m", "y_m", "z_m", *COVARIANCE_COLUMNS)
    fields: dict[str, Any] = {
        "t_s": float(shape.t_s),
        "status": str(shape.status),
        "doubt": str(shape.doubt or "none"),
        "nodes": _rows(names, np.hstack([shape.node_position_m, covariance_m2])),
        "tendons": _tendons(structure, shape),
    }
    if shape.loads is not None:
        loads = np.column_stack([shape.loads.force_n, shape.loads.sigma_n])
        fields["loads"] = _rows(("fx_n", "fy_n", "fz_n", "sigma_n"), loads)
    if shape.contacts is not None:
        fields["contacts"] = [_number(probability) for probability in shape.contacts.tolist()]
    return fields


def _tendons(structure: Structure, shape: Shape) -> list[dict[str, Any]]:
    lengths = shape.lengths
    predicted_m = structure.tendon_length_m(shape.node_position_m)
    rows = _rows(("length_m", "sigma_m", "predicted_m"), np.stack([lengths.length_m, lengths.sigma_m, predicted_m], 1))
    return [
        row | {"mode": Mode(mode).name.lower(), "flags": Flag(flags).names()}
        for row, mode, flags in zip(rows, lengths.mode.tolist(), lengths.flags.tolist(), strict=True)
    ]


def _rows(names: Iterable[str], values: NDArray[np.float64]) -> list[dict[str, float | None]]:
    """Return a table for each row of (rows, names)."""
    return [dict(zip(names, map(_number, row), strict=True)) for row in values.tolist()]


def _number(value: float) -> float | None:
    """Return a number with the digits that a sensor could tell, None for what is not finite."""
    return float(f"{value:.7g}") if math.isfinite(value) else None
