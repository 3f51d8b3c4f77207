"""Shapes by UDP: a line of JSON a datagram, and nothing that could stop an estimate."""

import json
import socket
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from tensegraph import InputError
from tensegraph.io.publish.udp import UdpPublisher, json_line, udp_address


def test_a_line_holds_the_shape(short_run) -> None:
    """Against the arrays, to seven digits; what is not known is null, which JSON has and nan it has not."""
    shape = next(s for k, s in enumerate(short_run) if k == 2)  # tendon 5 is stuck, and has no length
    line = json_line(short_run.structure, shape)
    assert line.endswith(b"}\n")
    assert line.count(b"\n") == 1
    read = json.loads(line, parse_constant=lambda name: pytest.fail(name))
    assert (read["t_s"], read["status"], read["doubt"]) == (shape.t_s, "ok", "none")
    positions_m = [[node[f"{axis}_m"] for axis in "xyz"] for node in read["nodes"]]
    np.testing.assert_allclose(positions_m, shape.node_position_m, rtol=1e-6)
    assert read["nodes"][7]["cxz_m2"] == pytest.approx(shape.node_covariance_m2[7, 0, 2], rel=1e-6)
    assert read["tendons"][5]["length_m"] is None
    assert read["tendons"][5]["sigma_m"] is None
    assert (read["tendons"][5]["mode"], read["tendons"][5]["flags"]) == ("bending", "missing|stuck")
    a, b = short_run.structure.tendons[5]
    between_m = np.linalg.norm(shape.node_position_m[b] - shape.node_position_m[a])
    assert read["tendons"][5]["predicted_m"] == pytest.approx(between_m, rel=1e-6)
    assert read["loads"][0]["fx_n"] is None or 0 not in short_run.structure.anchors


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]"])
def test_a_listener_gets_every_shape(short_run, host) -> None:
    family = socket.AF_INET6 if "[" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as listener:
        listener.bind(("::1" if "[" in host else "127.0.0.1", 0))
        listener.settimeout(5)
        address = f"udp://{host}:{listener.getsockname()[1]}"
        with UdpPublisher(address, short_run.structure) as publisher:
            for shape in short_run:
                publisher.add(shape)
        read = [json.loads(listener.recv(65535))["t_s"] for _ in range(len(short_run))]
    assert read == short_run.t_s.tolist()


def test_a_listener_that_reads_nothing_stops_nothing(short_run) -> None:
    """500 shapes are far more than the system holds for a socket: each is sent, and only the first wait there."""
    shape = next(iter(short_run))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.setblocking(False)
        with UdpPublisher(f"udp://127.0.0.1:{deaf.getsockname()[1]}", short_run.structure) as publisher:
            for k in range(500):
                publisher.add(replace(shape, t_s=float(k)))
        waiting_s = []
        with suppress(BlockingIOError):
            while True:
                waiting_s.append(json.loads(deaf.recv(65535))["t_s"])
    assert waiting_s == list(range(len(waiting_s)))
    assert 0 < len(waiting_s) < 500


def test_what_the_system_does_not_take_is_counted(short_run, monkeypatch) -> None:
    publisher = UdpPublisher("udp://127.0.0.1:9", short_run.structure)
    with publisher:
        monkeypatch.setattr("tensegraph.io.publish.udp.json_line", lambda *_: b" " * 70_000)  # more than a datagram
        publisher.add(next(iter(short_run)))
    assert publisher.left_out == 1


@pytest.mark.parametrize(
    "text",
    ["udp://127.0.0.1", "udp://:9870", "127.0.0.1:9870", "tcp://127.0.0.1:9870", "udp://127.0.0.1:99999", "ros1"],
)
def test_what_is_no_address_is_refused(text) -> None:
    with pytest.raises(InputError, match=r"expected ros2, or an address such as udp://127\.0\.0\.1:9870"):
        udp_address(text, remote=True)


@pytest.mark.parametrize("host", ["no..name", "x" * 64, "nobody.invalid"])
def test_a_name_of_no_machine_is_refused(host) -> None:
    with pytest.raises(InputError, match=f"^--publish udp://{host}:9870: {host} is no address: "):
        udp_address(f"udp://{host}:9870", remote=True)


def test_other_machines_are_refused_unless_meant() -> None:
    """Addresses of documentation, RFC 5737; 0.0.0.0 is no loopback either."""
    for host in ("192.0.2.7", "0.0.0.0"):
        with pytest.raises(InputError, match="is another machine: add --publish-remote"):
            udp_address(f"udp://{host}:9870", remote=False)
    assert udp_address("udp://192.0.2.7:9870", remote=True) == (socket.AF_INET, ("192.0.2.7", 9870))
