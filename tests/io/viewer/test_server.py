"""The server of the viewer's page: reached from this machine alone, and gone with the one who started it."""

import contextlib
import multiprocessing
import signal
import socket
import subprocess
import sys
import urllib.request
from unittest import mock

import pytest

from tensegraph import TensegraphError
from tensegraph.io.viewer import server
from tensegraph.io.viewer.server import ViewerServer, free_port

psutil = pytest.importorskip("psutil")
pytest.importorskip("rerun_cli")

SERVE = """
from tensegraph.io.viewer.server import ViewerServer
if __name__ == "__main__":
    with ViewerServer() as server:
        print(server.page_url, flush=True)
        server.wait()
"""


@pytest.fixture
def serving(tmp_path):
    """A process that serves, and the processes below it."""
    script = tmp_path / "serve.py"
    script.write_text(SERVE)
    process = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        url = process.stdout.readline()
        assert url.startswith("http://127.0.0.1:"), "the server does not start"
        yield process, url.strip(), psutil.Process(process.pid).children(recursive=True)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def alive(processes) -> list:
    """Return those that still run after at most five seconds."""
    return psutil.wait_procs(processes, timeout=5)[1]


def test_the_page_is_served_to_this_machine_alone(serving) -> None:
    _, url, children = serving
    (rerun,) = (child for child in children if child.name().startswith("rerun"))
    listening = [c.laddr for c in rerun.net_connections() if c.status == psutil.CONN_LISTEN]
    assert len(listening) == 2
    assert {address.ip for address in listening} == {"127.0.0.1"}
    with urllib.request.urlopen(url, timeout=10) as page:
        assert b"Rerun" in page.read()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_no_process_is_left(serving, number) -> None:
    process, _, children = serving
    assert len(children) >= 2  # the keeper, and Rerun
    process.send_signal(number)
    assert alive([psutil.Process(process.pid), *children]) == []


def test_the_session_goes_on_when_rerun_is_killed(serving) -> None:
    process, _, children = serving
    next(child for child in children if child.name().startswith("rerun")).kill()
    assert process.wait(timeout=5) == 1  # of the error that `wait` raises
    assert alive(children) == []


def test_a_program_that_does_not_start_says_why(tmp_path) -> None:
    program = tmp_path / "rerun"
    program.write_text("#!/bin/sh\necho one >&2\necho 'no such option' >&2\nexit 3\n")
    program.chmod(0o755)
    with (
        mock.patch.object(server, "_program", return_value=program),
        pytest.raises(TensegraphError, match="does not start: no such option"),
        ViewerServer(),
    ):
        pass
    assert not multiprocessing.active_children()


def test_a_port_that_is_taken_is_left_alone() -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        port = taken.getsockname()[1]
        assert free_port(port) != port
