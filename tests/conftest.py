"""What the tests share: the example trial, a six-strut at rest, and the one check of derivatives."""

import os
import shutil
import subprocess
import threading
import time
import tomllib
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tensegraph import Structure, open_trial, six_strut
from tensegraph.io.boards.protocol import Row, frame
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.structure.rest_shape import RestShape
from tensegraph.models.structure.rigidity import find_rest_shape
from tensegraph.models.values.link import Hello
from tensegraph.models.values.readings import Mode, TendonLengths

EXAMPLE = Path(__file__).parents[1] / "examples" / "press_01"


@pytest.fixture(scope="session")
def example() -> Path:
    """The example trial's directory."""
    return EXAMPLE


@pytest.fixture(scope="session")
def model() -> SensorModel:
    """The sensor model that ships with the package."""
    return read_sensor_model()


@pytest.fixture(scope="session")
def structure() -> Structure:
    """The paper's structure with rods of 0.3 m."""
    return six_strut(0.3)


@pytest.fixture(scope="session")
def rest(structure: Structure) -> RestShape:
    """Its rest shape, known to 0.3 mm."""
    variance = np.full((structure.node_count, 3), 0.0003**2)
    variance[structure.anchors] = 0
    return RestShape(find_rest_shape(structure), np.diag(variance.ravel()), "measured")


@pytest.fixture(scope="session")
def true_positions() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(frames,) t_s and (frames, nodes, 3) positions of the example trial."""
    truth = open_trial(EXAMPLE).truth()
    assert truth is not None
    return truth.t_s, truth.node_position_m


@pytest.fixture(scope="session")
def example_structure() -> Structure:
    """The structure of the example trial."""
    return open_trial(EXAMPLE).description.structure


@pytest.fixture(scope="session")
def lengths_of() -> Callable[..., TendonLengths]:
    """Makes the measurement that a shape would give, exact or with white noise."""

    def make(
        structure: Structure,
        position_m: NDArray[np.float64],
        t_s: float = 0.0,
        sigma_m: float = 0.0005,
        noise: NDArray[np.float64] | float = 0.0,
    ) -> TendonLengths:
        length_m = structure.tendon_length_m(position_m) + noise
        count = len(length_m)
        stretching = np.full(count, int(Mode.STRETCHING))
        return TendonLengths(t_s, length_m, np.full(count, sigma_m), stretching, np.zeros(count, dtype=np.int64))

    return make


@pytest.fixture(scope="session")
def check_jacobian() -> Callable[..., None]:
    """Compare a Jacobian with central differences of its function."""

    def check(
        function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
        jacobian: NDArray[np.float64],
        x: NDArray[np.float64],
        step: float = 1e-6,
        tolerance: float = 1e-6,
    ) -> None:
        columns = []
        for k in range(x.size):
            shift = np.zeros(x.size)
            shift[k] = step
            shift = shift.reshape(x.shape)
            columns.append((function(x + shift) - function(x - shift)).ravel() / (2 * step))
        numerical = np.stack(columns, axis=-1)
        np.testing.assert_allclose(np.asarray(jacobian).reshape(numerical.shape), numerical, atol=tolerance, rtol=1e-5)

    return check


@pytest.fixture
def trial_copy(tmp_path: Path) -> Callable[..., Path]:
    """Makes a copy of the first rows of the example trial, with its files rewritten by functions of their text."""

    def copy(rows: int = 120, name: str = "trial", **edits: Callable[[str], str]) -> Path:
        target = tmp_path / name
        target.mkdir()
        for source in EXAMPLE.iterdir():
            lines = source.read_text().splitlines(keepends=True)
            text = "".join(lines if source.suffix == ".toml" else lines[: rows + 1])
            edit = edits.get(source.stem)
            (target / source.name).write_text(edit(text) if edit else text)
        tomllib.loads((target / "trial.toml").read_text())
        return target

    return copy


TOOLS = ["avr-gcc", "avr-g++", "gcc", "make"]
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")


@pytest.fixture(scope="session")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the firmware of boards 0 and 1, and the emulator that runs it."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    missing += [str(path) for path in (ARDUINO, Path("/usr/include/simavr")) if not path.exists()]
    if missing:
        pytest.skip(f"no emulated boards: {', '.join(missing)} not found; .ci/run names the packages")
    folder = tmp_path_factory.mktemp("firmware")
    command = ["make", "-s", "-C", str(Path(__file__).parent / "emulator"), f"OUT={folder}", f"ARDUINO={ARDUINO}"]
    subprocess.run(command, check=True, timeout=120)
    return folder


class EmulatedBoard:
    """A Mega that runs the firmware, its pins at the voltages that gave a trial's codes; on a pty of its own.

    The trial's two seconds of rest come several times over, so that there is time to tare on them.
    """

    def __init__(
        self, firmware: Path, number: int, trial: Path, folder: Path, rate_ppm: float = 0.0, rests: int = 1
    ) -> None:
        self.port = folder / f"board{number}"
        self.log = folder / f"board{number}.log"
        self._command = [firmware / "board", firmware / f"board{number}.elf", self.port, folder / f"mv{number}.csv"]
        self._command += [rate_ppm, folder / f"board{number}.eeprom", self.log]
        rows = np.loadtxt(trial / f"board{number}.csv", delimiter=",", skiprows=1)
        resting = rows[rows[:, 0] < 2.0]
        rows = np.concatenate([*[resting] * (rests - 1), rows])
        millivolt = (rows[:, 3:] + 0.5) * 5000 / 1024
        np.savetxt(
            self._command[3], np.column_stack([0.02 * np.arange(len(rows)), millivolt]), delimiter=",", fmt="%.4f"
        )
        self._process: subprocess.Popen[bytes] | None = None

    def plug(self) -> None:
        """Start, and wait for the port."""
        self._process = subprocess.Popen([str(part) for part in self._command], stdout=subprocess.DEVNULL)
        while not self.port.is_symlink():
            assert self._process.poll() is None
            time.sleep(0.01)

    def unplug(self) -> None:
        """Stop: the port goes, the boot counter stays."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait(10)
            self._process = None


@pytest.fixture
def emulated(firmware: Path, tmp_path: Path) -> Iterator[list[EmulatedBoard]]:
    """Both boards of the example trial, plugged in; their clocks differ by 2000 ppm, as two resonators' do."""
    boards = [
        EmulatedBoard(firmware, b, EXAMPLE, tmp_path, rate_ppm, rests=20) for b, rate_ppm in enumerate((0.0, 2000.0))
    ]
    for board in boards:
        board.plug()
    yield boards
    for board in boards:
        board.unplug()


class PtyBoard:
    """A board of ours by its bytes alone, on a pty: for what firmware would never do. One row each 20 ms."""

    def __init__(self, port: Path, board_id: int, channels: int = 12) -> None:
        self.port, self.board_id, self.channels = port, board_id, channels
        self.boot, self.seq = 0, 0
        self.interfere: bytes = b""
        """Put on the line once, between two frames."""
        self.sent: list[tuple[int, int]] = []
        """(boot, seq) of every row that a port took."""
        self._stop, self._thread = threading.Event(), threading.Thread()

    def plug(self) -> None:
        """Make the port, and begin to send."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port.symlink_to(os.ttyname(self._slave))
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        """Take the port away; the board starts anew when it is plugged in again."""
        if self._thread.is_alive():
            self._stop.set()
            self._thread.join()
            self.port.unlink()
            os.close(self._master)
            os.close(self._slave)
            self.boot, self.seq = self.boot + 1, 0

    def _run(self) -> None:
        start_s = time.perf_counter()
        while not self._stop.wait(max(start_s + 0.02 * self.seq - time.perf_counter(), 0)):
            codes = tuple((self.seq + 31 * c) % 1024 for c in range(self.channels))
            data = frame(Row(self.board_id, self.boot, self.seq, 20_000 * self.seq, codes))
            if self.seq % 50 == 0:
                data += frame(Hello(self.board_id, self.boot, 20_000 * self.seq, 50, self.channels, "pty 1"))
            try:
                os.write(self._master, self.interfere + data)
                self.sent.append((self.boot, self.seq))
            except BlockingIOError:  # nobody reads
                pass
            self.interfere = b""
            self.seq += 1


@pytest.fixture
def pty_boards(tmp_path: Path) -> Iterator[Callable[..., PtyBoard]]:
    """Makes boards on ptys, plugged in."""
    made = []

    def make(name: str, board_id: int, channels: int = 12) -> PtyBoard:
        made.append(PtyBoard(tmp_path / name, board_id, channels))
        made[-1].plug()
        return made[-1]

    yield make
    for board in made:
        board.unplug()
