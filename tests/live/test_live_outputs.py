"""Shapes of a live session in the viewer and for other programs, of which the estimate takes no notice."""

import filecmp
import json
import signal
import socket
import sys

import numpy as np
import pytest

import tensegraph as tg
from command_line import run, start

pytestmark = pytest.mark.usefixtures("undrawn")

TABLES = ["shape.csv", "ellipsoids.csv", "lengths.csv", "status.csv"]


def test_every_shape_is_sent_and_the_result_is_the_same(trial_copy, monkeypatch) -> None:
    """As fast as it goes, where no frame is called late."""
    monkeypatch.setattr("tensegraph.live.activity.LATE_S", np.inf)
    path = trial_copy(rows=60)
    folder = path.parent
    tg.save(tg.reconstruct(path, "live"), folder / "offline", figures=None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        listener.settimeout(1)
        address = f"udp://127.0.0.1:{listener.getsockname()[1]}"
        done = run("live", "--replay", path, "--speed", 1000, "--publish", address, "--out", "live", cwd=folder)
        assert (done.returncode, done.stderr) == (0, "")
        lines = [json.loads(listener.recv(65535)) for _ in range(20)]
    assert filecmp.cmpfiles(folder / "offline", folder / "live", TABLES, shallow=False)[1:] == ([], [])
    result = tg.load(folder / "live")
    for k, line in enumerate(lines):  # as many as any system holds for a socket
        assert line["t_s"] == pytest.approx(result.t_s[k], abs=1e-4)
        sent_m = [[node["x_m"], node["y_m"], node["z_m"]] for node in line["nodes"]]
        np.testing.assert_allclose(sent_m, result.node_position_m[k], atol=1e-6)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--publish", "udp://192.0.2.7:9870"], "is another machine: add --publish-remote if that is meant"),
        (["--publish", "tcp://127.0.0.1:9"], "expected ros2, or an address such as udp://127.0.0.1:9870"),
        (["--publish", "ros2"], "--publish ros2 needs rclpy: source the setup.bash of ROS 2 first"),
    ],
)
def test_what_cannot_be_published_is_refused_before_any_work(tmp_path, monkeypatch, options, text) -> None:
    """The trial is not even looked for."""
    monkeypatch.setitem(sys.modules, "rclpy", None)
    if options[1] == "ros2":
        pytest.importorskip("rosbags")
    refused = run("live", "--replay", "nowhere", *options, cwd=tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert text in refused.stderr
    assert refused.stderr.count("\n") == 1


@pytest.fixture
def watched(trial_copy):
    """A replay with the viewer, in real time, with the processes below it."""
    psutil = pytest.importorskip("psutil")
    pytest.importorskip("rerun_cli")
    path = trial_copy(rows=200)
    session = start("live", "--replay", path, "--viewer", "--out", "live", cwd=path.parent, COLUMNS="300")
    try:
        said = session.stdout.readline()
        assert "http://127.0.0.1:" in said, said
        yield session, psutil, path
    finally:
        session.kill()
        session.communicate()


def test_the_viewer_may_die(watched) -> None:
    """The session goes on, its result is whole, and no process is left."""
    session, psutil, path = watched
    below = psutil.Process(session.pid).children(recursive=True)
    next(child for child in below if child.name().startswith("rerun")).kill()
    _, error = session.communicate(timeout=60)
    assert (session.returncode, error) == (0, "")
    assert len(tg.load(path.parent / "live")) > 10
    assert psutil.wait_procs(below, timeout=30)[1] == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_is_left(watched, number) -> None:
    session, psutil, _ = watched
    below = psutil.Process(session.pid).children(recursive=True)
    assert any(child.name().startswith("rerun") for child in below)
    session.send_signal(number)
    session.communicate(timeout=60)
    assert psutil.wait_procs(below, timeout=30)[1] == []
