"""The server of the viewer's page: the program of Rerun, which only this machine reaches, in the care of a process.

this process -- pipe -- keeper -- Rerun

The keeper ends Rerun when the pipe is closed, as it is when this process ends, in order or killed.
"""

import multiprocessing
import multiprocessing.connection
import signal
import socket
import subprocess
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Self

from ...models.values.errors import TensegraphError, needs_extra

LOOPBACK = "127.0.0.1"
"""The address at which only this machine listens; Rerun's own default is all addresses."""
PAGE_PORT, DATA_PORT = 9090, 9876
"""Rerun's own ports; where one is taken, a free one stands in."""
START_S = 30.0
"""Longest time for Rerun to listen."""
ALIVE_S = 0.1
"""Time between two looks at whether Rerun and the other process are there."""
PROGRAMS = ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun")
"""Where the package `rerun_cli` has the program. The script `rerun` starts it too, but leaves it when it is killed."""


class ViewerServer:
    """Serves the viewer's page and takes data for it; a context manager, at whose end no process is left.

    Raises:
        InputError: when Rerun is not installed.
        TensegraphError: when it does not start.
    """

    def __init__(self) -> None:
        program = _program()
        page_port, data_port = free_port(PAGE_PORT), free_port(DATA_PORT)
        self.data_url = f"rerun+http://{LOOPBACK}:{data_port}/proxy"
        """Where a recording is sent."""
        self.page_url = f"http://{LOOPBACK}:{page_port}/?url={self.data_url.replace('+', '%2B')}"
        """What a browser opens."""
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._keeper = context.Process(target=_keep, args=(program, page_port, data_port, theirs), daemon=True)
        self._keeper.start()
        theirs.close()

    def __enter__(self) -> Self:
        try:
            error = self._pipe.recv()
        except (EOFError, OSError):
            error = "ended by itself"
        except BaseException:
            self._end()
            raise
        if error:
            self._end()
            raise TensegraphError(f"the viewer Rerun does not start: {error}")
        return self

    def __exit__(self, *raised: object) -> None:
        self._end()

    def wait(self) -> None:
        """Wait until the server ends by itself.

        Raises:
            TensegraphError: when it has.
        """
        multiprocessing.connection.wait([self._keeper.sentinel])
        raise TensegraphError("the viewer Rerun ended by itself")

    def _end(self) -> None:
        self._pipe.close()
        self._keeper.join()


def free_port(preferred: int) -> int:
    """Return a port on which this machine can listen: the preferred one, or else any."""
    for port in (preferred, 0):
        with socket.socket() as listener:
            try:
                listener.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(listener.getsockname()[1])
    raise TensegraphError("no free port on this machine")


def _program() -> Path:
    with needs_extra("the viewer", "rerun"):
        import rerun_cli
    folder = Path(str(rerun_cli.__file__)).parent
    for name in PROGRAMS:
        if (folder / name).is_file():
            return folder / name
    raise TensegraphError(f"{folder}: expected the program of Rerun in it, as {PROGRAMS[0]}")


def _keep(program: Path, page_port: int, data_port: int, pipe: Connection) -> None:
    """Run Rerun until the other process closes the pipe, or Rerun ends; report once whether it listens."""
    for name in ("SIGINT", "SIGHUP"):  # the other process decides what these end
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    command = [program, "--serve-web", "--bind", LOOPBACK, "--port", data_port, "--web-viewer-port", page_port]
    with tempfile.TemporaryFile() as said:
        rerun = subprocess.Popen([*map(str, command), "--hide-welcome-screen"], stdout=said, stderr=said)
        try:
            pipe.send(_start_error(rerun, (page_port, data_port), said))
            while rerun.poll() is None and not pipe.poll(ALIVE_S):
                pass
        except (EOFError, OSError):  # the other process has ended
            pass
        finally:
            rerun.kill()
            rerun.wait()


def _start_error(rerun: subprocess.Popen[bytes], ports: tuple[int, int], said: IO[bytes]) -> str:
    """Wait until Rerun listens on its ports; return why it does not, or nothing."""
    until_s = time.monotonic() + START_S
    while time.monotonic() < until_s:
        if rerun.poll() is not None:
            said.seek(0)
            lines = said.read().decode(errors="replace").split("\n")
            return next((line.strip() for line in reversed(lines) if line.strip()), f"exit code {rerun.returncode}")
        if all(_listens(port) for port in ports):
            return ""
        time.sleep(ALIVE_S)
    return f"it does not listen on ports {ports[0]} and {ports[1]} within {START_S:g} s"


def _listens(port: int) -> bool:
    with socket.socket() as caller:
        caller.settimeout(1.0)
        return caller.connect_ex((LOOPBACK, port)) == 0
