"""What the tests share: the example trial, a six-strut at rest, boards, and the one check of derivatives."""

import os
import shutil
import signal
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from threadpoolctl import threadpool_limits

from balance import nominal
from blank_figures import no_figures
from emulated_board import EmulatedBoard
from plan_edits import PLANS, SHORT, replaced
from pty_board import PtyBoard
from tensegraph import Reconstruction, Status, Structure, Trial, open_trial, simulate, six_strut
from tensegraph.estimator.rest.rest_step import rest_step
from tensegraph.io.model_file import read_sensor_model
from tensegraph.models.sensor.sensor_model import SensorModel
from tensegraph.models.structure.external_loads import ExternalLoads
from tensegraph.models.structure.form_finding import find_rest_shape
from tensegraph.models.structure.rest_shape import GeometrySigma, RestSettings, RestShape
from tensegraph.models.structure.shape import Covariances
from tensegraph.models.values.readings import Mode, TendonLengths

Terms = Callable[[NDArray[np.float64]], NDArray[np.float64]]
EXAMPLE = Path(__file__).parents[1] / "examples" / "press_01"

for number in (signal.SIGINT, signal.SIGHUP):  # a shell that starts the tests in the background ignores them,
    if signal.getsignal(number) is signal.SIG_IGN:  # and so would all commands that the tests start and end
        signal.signal(number, signal.SIG_DFL)


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
    return RestShape(structure, find_rest_shape(structure), np.diag(variance.ravel()), "measured")


@pytest.fixture(scope="session")
def balanced(structure: Structure) -> RestShape:
    """The rest step of the six-strut with nothing measured: the shape in which forces balance."""
    return rest_step(structure, nominal(structure), None, GeometrySigma(), RestSettings())


@pytest.fixture
def loaded(structure: Structure, rest: RestShape) -> Reconstruction:
    """Two seconds at rest at 50 Hz: node 5 carries 2 N in all but the first frame, node 8 0.5 N in ten of them."""
    count, tendons = 100, len(structure.tendons)
    force = np.full((count, structure.node_count, 3), np.nan)
    force[:, structure.free_nodes] = 0.0
    force[1:, 5, 2], force[10:20, 8, 0] = -2.0, 0.5
    sigma = np.full((count, structure.node_count), np.inf)
    sigma[:, structure.free_nodes] = 0.1
    return Reconstruction(
        structure,
        np.arange(count) / 50,
        np.repeat(rest.node_position_m[None], count, axis=0),
        Covariances.of([rest.covariance_m2] * count, rest.covariance_m2.shape[0]),
        (Status.OK,) * count,
        np.full((count, tendons), 0.18),
        np.full((count, tendons), 0.001),
        np.zeros((count, tendons), dtype=np.int64),
        np.zeros((count, tendons), dtype=np.int64),
        loads=ExternalLoads(force, sigma),
    )


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


@pytest.fixture(scope="session", autouse=True)
def workers_share_the_cores() -> Iterator[None]:
    """Each worker of pytest-xdist computes in one thread, and so do the processes that its tests start.

    There are as many workers as cores. With as many threads in each, linear algebra waits for cores by computing on:
    tests of the optimisation of whole trials took twice the processor time.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        yield
        return
    with threadpool_limits(limits=1, user_api="blas"), mock.patch.dict(os.environ, {"OMP_NUM_THREADS": "1"}):
        yield


@pytest.fixture(scope="session", autouse=True)
def rest_shapes_are_found_once() -> Iterator[None]:
    """The search from eight starts takes two seconds, and most trials of these tests are of one of three structures."""
    with mock.patch("tensegraph.models.structure.form_finding.least_squares", remembered(least_squares)):
        yield


def remembered(search: Callable[..., OptimizeResult]) -> Callable[..., OptimizeResult]:
    """Return scipy's search, which answers at once where it began from the same point with the same values before."""
    found: dict[tuple[object, ...], OptimizeResult] = {}

    def search_once(residual: Terms, start: NDArray[np.float64], jacobian: Terms, **options: object) -> OptimizeResult:
        values = (start, residual(start), jacobian(start))
        key = (*(one.tobytes() for one in values), *options.items())
        if key not in found:
            found[key] = search(residual, start, jacobian, **options)
        return found[key]

    return search_once


@pytest.fixture
def undrawn() -> Iterator[None]:
    """For tests that do not look at figures: those of this process are files without content, and not composed."""
    with no_figures():
        yield


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    """Six seconds of the press plan."""
    folder = tmp_path_factory.mktemp("plans")
    (folder / "press.toml").write_text(replaced(PLANS["press"].read_text(), *SHORT))
    return simulate(folder / "press.toml", folder / "press_01")


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
