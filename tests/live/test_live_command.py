"""Live sessions as a user types them: from a replay, from boards on ptys, from emulated boards."""

import filecmp
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
import tty
from pathlib import Path

import numpy as np
import pytest

import tensegraph
import undrawn_command
from command_line import start
from pipelines import pipeline_of
from plan_edits import PLANS, SHORT_REST, replaced
from tensegraph import BoardReading, open_trial
from tensegraph.cli import main
from tensegraph.commands.live import LiveSource
from tensegraph.estimator.smoother import LiveSmoother
from tensegraph.io.boards.protocol import frame
from tensegraph.io.result import write_tables
from tensegraph.models.values.aids import ImuReading
from tensegraph.pipeline import ESTIMATORS

pytestmark = pytest.mark.usefixtures("undrawn")

TABLES = ["shape.csv", "ellipsoids.csv", "lengths.csv", "status.csv"]


@pytest.fixture
def typed(monkeypatch, capfd):
    """Runs the command line in a directory, in this process; gives exit code, output and errors."""

    def run(*arguments, cwd: Path) -> tuple[int, str, str]:
        monkeypatch.chdir(cwd)
        monkeypatch.setenv("COLUMNS", "120")
        monkeypatch.setattr(sys, "argv", ["tensegraph", *map(str, arguments)])
        monkeypatch.setattr("tensegraph.live.rig.PATIENCE_S", 1.5)  # no board of these tests takes a Mega's two seconds
        with pytest.raises(SystemExit) as ended:
            main()
        return (ended.value.code or 0, *capfd.readouterr())

    return run


def test_a_replay_is_the_offline_result_to_the_last_digit(trial_copy, typed, monkeypatch) -> None:
    """As fast as it goes, where no frame is called late. Recorded again it is the trial."""
    monkeypatch.setattr("tensegraph.live.activity.LATE_S", np.inf)
    path = trial_copy(rows=110)
    folder = path.parent
    (folder / "offline").mkdir()
    write_tables(tensegraph.reconstruct(path, "live"), 0.95, folder / "offline")
    code, said, error = typed(
        "live", "--replay", path, "--speed", 1000, "--out", "replay", "--record", "again", cwd=folder
    )
    assert code == 0, error
    assert tomllib.loads((folder / "replay" / "run.toml").read_text())["skipped_frames"] == 0
    tables = [p.name for p in (folder / "offline").iterdir()]
    assert set(TABLES) <= set(tables)
    _, different, errors = filecmp.cmpfiles(folder / "offline", folder / "replay", tables, shallow=False)
    assert not different
    assert not errors
    written = {p.name for p in (folder / "replay").iterdir()}
    assert written >= {*(p.name for p in (folder / "offline").iterdir()), "run.toml", "lengths.png", "shape.png"}
    assert "220 rows recorded in again" in said
    for words in ("board 0", "rate", "lost rows", "latency", "largest sigma", "flagged"):
        assert words in said
    trials = open_trial(path), open_trial(folder / "again")
    read, again = ([(r.board, r.host_s, *r.counts) for r in trial.readings()] for trial in trials)
    assert read == again
    assert "truth" not in trials[1].toml


class Slow:
    """The live estimator on a computer that takes 60 ms longer for a frame."""

    def __init__(self, *arguments) -> None:
        self._live = LiveSmoother(*arguments)

    def estimate(self, frames):
        for shape in self._live.estimate(frames):
            time.sleep(0.06)
            yield shape


def test_a_replay_that_is_too_fast_skips_as_it_says(trial_copy, typed, monkeypatch) -> None:
    """Three times as many frames as the estimator can do: it is never far behind, and the panel knows the rates."""
    monkeypatch.setitem(ESTIMATORS, "live", Slow)
    path = trial_copy(rows=150)
    code, said, error = typed("live", "--replay", path, "--out", "replay", cwd=path.parent)
    assert code == 0, error
    table = tomllib.loads((path.parent / "replay" / "run.toml").read_text())
    assert table["skipped_frames"] > 50
    assert table["frames"] > 3
    trial = open_trial(path)
    frames = pipeline_of(trial.description).lengths(trial.readings())
    assert table["frames"] + table["skipped_frames"] == len(list(frames))
    assert table["latency"]["median_ms"] < 1000
    latency = np.genfromtxt(path.parent / "replay" / "latency.csv", delimiter=",", names=True)
    stages_s = sum(latency[f"{stage}_s"] for stage in ("busy", "link", "lengths", "estimate"))
    np.testing.assert_allclose(latency["latency_s"], stages_s, atol=5e-6)
    assert 1e3 * np.median(latency["latency_s"]) == pytest.approx(table["latency"]["median_ms"], abs=0.002)
    slept_s = latency["estimate_s"] - latency["processor_s"]  # it does not compute while it sleeps
    assert (latency["estimate_s"] > 0.06).all()
    assert np.median(slept_s) > 0.03
    assert re.search(r"rate +│ [1-9]\d*\.\d Hz", said)
    assert re.search(r"skipped +│ [1-9]\d* frames", said)
    skipped, frames = table["skipped_frames"], table["frames"] + table["skipped_frames"]
    assert f"{skipped} of {frames} frames were skipped, which came faster than they were estimated\n" in said
    assert "nan" not in said


def test_of_a_replay_faster_than_any_computer_the_last_frame_is_left(trial_copy, typed) -> None:
    """Positions come after the last lengths, so that no frame is complete before all have arrived."""
    path = trial_copy(rows=40)
    first = open_trial(path)
    t_s = [reading.host_s for reading in first.readings()]
    rows = "".join(f"{t + 0.001:.6f},3,0.2,0.0,0.2\n" for t in t_s)
    (path / "positions0.csv").write_text(f"t_s,node,x_m,y_m,z_m\n{rows}")
    told = (path / "trial.toml").read_text()
    (path / "trial.toml").write_text(f'{told}\n[[position]]\nfile = "positions0.csv"\n')
    code, said, error = typed("live", "--replay", path, "--speed", 1e6, "--out", "replay", cwd=path.parent)
    assert code == 0, error
    table = tomllib.loads((path.parent / "replay" / "run.toml").read_text())
    frames = table["frames"] + table["skipped_frames"]
    assert table["frames"] >= 1
    assert f"{table['skipped_frames']} of {frames} frames were skipped, " in said
    assert ": a lower --speed skips fewer\n" in said


def test_a_twin_s_trial_comes_live(tmp_path, typed, monkeypatch) -> None:
    """From the plan to the recording, which is as good a trial as any, and knows no truth."""
    monkeypatch.setattr("tensegraph.live.activity.LATE_S", np.inf)
    plan = tmp_path / "short.toml"
    press, _, _ = PLANS["press"].read_text().partition("[[load.random]]")
    plan.write_text(replaced(press, ("duration_s = 30.0", "duration_s = 2.4")))
    arguments = ("--speed", 1000, "--seconds", 2, "--record", "twin", "--out", "out")
    code, _, error = typed("live", "--twin", plan, *arguments, cwd=tmp_path)
    assert code == 0, error
    trial = open_trial(tmp_path / "twin")
    assert len(list(trial.readings())) > 190
    assert trial.truth() is None
    assert (tmp_path / "out" / "shape.csv").read_text().count("\n") > 95


def test_a_twin_rolls_with_its_inertial_sensors(tmp_path, typed, monkeypatch) -> None:
    """A push after the rest: what is recorded of it is a trial with both sensors, in which the robot turns.

    The recording gives the same shapes, to the last digit.
    """
    monkeypatch.setattr("tensegraph.live.activity.LATE_S", np.inf)
    edits = (
        ("duration_s = 24.0", "duration_s = 1.8"),
        ("[load]", "[rest]\nseconds = 1.0\n\n[load]"),
        ("from_s = 2.5", "from_s = 1.0"),
        ("until_s = 23.0", "until_s = 1.8"),
        ("pause_s = [2.5, 4.0]", "pause_s = [0.05, 0.1]"),
        ("duration_s = [0.7, 1.0]", "duration_s = [0.6, 0.7]"),
    )
    (tmp_path / "press.toml").write_text(PLANS["press"].read_text())
    (tmp_path / "roll.toml").write_text(replaced(PLANS["roll"].read_text(), *edits))
    arguments = ("--speed", 1000, "--record", "twin", "--out", "out")
    code, _, error = typed("live", "--twin", "roll.toml", *arguments, cwd=tmp_path)
    assert code == 0, error
    live = tomllib.loads((tmp_path / "out" / "run.toml").read_text())
    assert [imu["samples"] for imu in live["imus"]] == [179, 179]
    assert [imu["silent_frames"] for imu in live["imus"]] == [0, 0]
    assert live["skipped_frames"] == 0
    assert live["inputs"].keys() == {"plan roll.toml", "plan press.toml"}
    rates = [r.rate_rad_per_s for r in open_trial(tmp_path / "twin").readings() if isinstance(r, ImuReading)]
    assert len(rates) == 358
    assert np.linalg.norm(rates, axis=1).max() > 0.5
    assert (tmp_path / "out" / "track.csv").read_text().count("\n") > 80
    (tmp_path / "offline").mkdir()
    write_tables(tensegraph.reconstruct(tmp_path / "twin", "live"), 0.95, tmp_path / "offline")
    names = [*TABLES, "track.csv", "contacts.csv"]
    assert filecmp.cmpfiles(tmp_path / "offline", tmp_path / "out", names, shallow=False)[0] == names


def rows_on_disk(trial: Path) -> int:
    """Rows recorded of the board that has fewer."""
    files = (trial / "board0.csv", trial / "board1.csv")
    return min(file.read_bytes().count(b"\n") if file.exists() else 0 for file in files)


def began(process: subprocess.Popen, trial: Path, rows: int = 0) -> None:
    """Wait until a trial is being recorded, with so many rows of each board."""
    until_s = time.monotonic() + 120
    while not trial.exists() or rows_on_disk(trial) < rows:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until_s
        time.sleep(0.05)


def test_ctrl_c_leaves_a_whole_result_and_trial(tmp_path, rig, emulated) -> None:
    """Emulated boards at 50 Hz: recorded without a gap, and offline gives the same shapes as live did."""
    ports = [word for board in emulated for word in ("--port", board.port)]
    rig.write_text(replaced(rig.read_text(), SHORT_REST))
    process = start("live", "--rig", rig, *ports, "--record", "first", "--out", "live", cwd=tmp_path)
    began(process, tmp_path / "first", rows=110)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of the group
    out, error = process.communicate(timeout=60)
    for board in emulated:  # an emulation takes half of a core
        board.unplug()
    assert process.returncode == 0, error
    assert "tared: tendons changed by" in out
    live = tomllib.loads((tmp_path / "live" / "run.toml").read_text())
    trial = open_trial(tmp_path / "first")
    assert [board.firmware for board in trial.table.board] == ["tensegraph_mega 2"] * 2
    rows = list(trial.readings())
    assert len(rows) == live["recorded_rows"]
    for board in (0, 1):
        seqs = [row.seq for row in rows if row.board == board]
        assert len(seqs) > 100
        assert (np.diff(seqs) == 1).all()
    assert all(port["bad_crc"] == port["garbage"] == 0 for port in live["ports"].values())
    offline = tensegraph.reconstruct(tmp_path / "first", "live")
    assert live["frames"] + live["skipped_frames"] == len(offline)
    shapes = np.genfromtxt(tmp_path / "live" / "shape.csv", delimiter=",", skip_header=1)
    assert len(shapes) == live["frames"]
    assert np.isin(shapes[:, 0], np.round(offline.t_s, 4)).all()
    if live["skipped_frames"] == 0:
        (tmp_path / "offline").mkdir()
        write_tables(offline, 0.95, tmp_path / "offline")
        _, different, _ = filecmp.cmpfiles(tmp_path / "live", tmp_path / "offline", TABLES, shallow=False)
        assert not different


def test_one_board_and_no_disk_are_enough_to_go_on_with(tmp_path, rig, pty_boards, typed) -> None:
    """Twelve sensors are missing, then the recording's directory vanishes: both are said, the shapes go on."""
    board = pty_boards("one", 0)
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 0.0"))

    def vanish() -> None:
        file = tmp_path / "gone" / "board0.csv"
        while not file.exists() or file.read_bytes().count(b"\n") < 20:
            time.sleep(0.02)
        shutil.rmtree(tmp_path / "gone")

    threading.Thread(target=vanish, daemon=True).start()
    arguments = ("--port", board.port, "--record", "gone", "--out", "out", "--seconds", 2.5)
    code, said, error = typed("live", "--rig", rig, *arguments, cwd=tmp_path)
    assert code == 2
    assert error == "tensegraph: gone: the recording ended: its files are gone\n"
    assert "1 of 2 boards answered: going on" in said
    status = (tmp_path / "out" / "status.csv").read_text().splitlines()[1:]
    assert float(status[-1].split(",")[0]) > 1.5
    assert len(status) > 5  # however busy the machine is
    lengths = [line.split(",") for line in (tmp_path / "out" / "lengths.csv").read_text().splitlines()[1:]]
    missing = {int(tendon) for _, tendon, _, _, _, flags, *_ in lengths if "missing" in flags}
    assert missing >= set(range(12, 24))
    assert all("missing" in flags for _, tendon, _, _, _, flags, *_ in lengths if int(tendon) >= 12)
    assert not all("missing" in flags for _, tendon, _, _, _, flags, *_ in lengths if int(tendon) < 12)
    assert not any(",ok," in line for line in status)


def test_why_a_board_is_missing_is_said_before_the_taring(tmp_path, rig, pty_boards, typed) -> None:
    rig.write_text(rig.read_text().replace("seconds = 2.0", "seconds = 0.0"))
    ports = [str(pty_boards(name, 0).port) for name in ("one", "other")]
    given = [part for port in ports for part in ("--port", port)]
    code, said, _ = typed("live", "--rig", rig, *given, "--out", "out", "--seconds", 1.0, cwd=tmp_path)
    assert code == 0
    assert re.search(r"1 of 2 boards answered \(.*: board 0 is on .* too: flash one with another BOARD_ID\)", said)


def test_record_and_ports(tmp_path, rig, two_boards, typed) -> None:
    ports = [str(board.port) for board in two_boards]
    code, said, error = typed("ports", *ports, tmp_path / "none", cwd=tmp_path)
    assert code == 0, error
    assert re.search(r"│ 0 +│ pty 1 +│ 0 +│ 50 Hz │ 12", said)
    assert "not there" in said
    rig.write_text(rig.read_text().replace("ports = []", f"ports = {ports}"))
    code, said, error = typed("record", "--rig", rig, "--out", "trials/first", "--seconds", 1, cwd=tmp_path)
    assert code == 0, error
    rows = int(re.search(r"(\d+) rows recorded in trials/first", said)[1])
    assert not re.search(r"│ port +│ - ", said)
    trial = open_trial(tmp_path / "trials" / "first")
    assert len(list(trial.readings())) == rows > 90
    assert trial.name == "first"
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00", trial.table.recorded_utc)


def test_a_rate_that_no_port_has_is_told(tmp_path, rig, pty_boards, typed) -> None:
    rig.write_text(replaced(rig.read_text(), ("baud = 500000", "baud = 5000000000")))
    code, _, error = typed("record", "--rig", rig, "--port", pty_boards("a", 0).port, "--out", "t", cwd=tmp_path)
    assert code == 2
    assert error.count("\n") == 1
    assert "cannot be opened: 5000000000 baud" in error


@pytest.mark.parametrize("verb", ["ports", "record"])
def test_a_sketch_whose_lines_cannot_be_read_is_not_called_silent(tmp_path, rig, typed, verb) -> None:
    """It puts blanks between its numbers."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    port, ended = os.ttyname(theirs), threading.Event()

    def send() -> None:
        while not ended.wait(0.02):
            os.write(ours, b"0, 1, 20000, 512, 513\n")

    sketch = threading.Thread(target=send, daemon=True)
    sketch.start()
    arguments = ("ports", port) if verb == "ports" else ("record", "--rig", rig, "--port", port, "--out", "t")
    code, said, error = typed(*arguments, cwd=tmp_path)
    ended.set()
    sketch.join()
    os.close(ours)
    os.close(theirs)
    assert code == (0 if verb == "ports" else 2)
    words = " ".join((said + error).replace("│", " ").split())
    assert "sends what cannot be" in words
    assert "silent" not in words


@pytest.mark.parametrize("verb", ["record", "live"])
def test_a_run_ends_in_time_although_the_boards_are_silent(tmp_path, rig, two_boards, two_ports, typed, verb) -> None:
    """Both cables are out after some rows, and stay out; the panel says so, and result and recording are whole."""

    def unplug() -> None:
        while not (tmp_path / "t").exists() or rows_on_disk(tmp_path / "t") < 20:
            time.sleep(0.02)
        for board in two_boards:
            board.unplug()

    threading.Thread(target=unplug, daemon=True).start()
    out = ("--record", "t", "--out", "out") if verb == "live" else ("--out", "t")
    code, said, error = typed(verb, "--rig", rig, *two_ports, *out, "--seconds", 3, cwd=tmp_path)
    assert code == 0, error
    assert re.search(r"newest reading +│ [12]\d{3} ms ago +│ [12]\d{3} ms ago", said)
    assert re.search(r"board 0: no row for [1-3] s: its sensors are missing", said)
    rows = list(open_trial(tmp_path / "t").readings())
    assert f"{len(rows)} rows recorded in t" in said
    assert rows[-1].host_s < 2.5
    if verb == "live":
        live = tomllib.loads((tmp_path / "out" / "run.toml").read_text())
        assert live["frames"] > 0
        assert live["frames"] + live["skipped_frames"] > 10  # however busy the machine is


SENSORS = """
[[imu]]
board = 0
rod = 0
axis = [0, 0, 1]

[[imu]]
board = 1
sensor = 2
rod = 2
axis = [0, 0, 1]
"""


@pytest.fixture
def with_sensors(rig, two_boards):
    """A rig with an inertial sensor on each board; the second board has one more, which the rig does not name."""
    two_boards[0].sensors, two_boards[1].sensors = (0,), (1, 2)
    ports = [str(board.port) for board in two_boards]
    rig.write_text(rig.read_text().replace("ports = []", f"ports = {ports}") + SENSORS)
    return rig, two_boards


def test_record_writes_the_samples_of_inertial_sensors(tmp_path, with_sensors, typed) -> None:
    """Every sample once, laid onto the host's clock between the rows of its board; one frame is damaged on its way."""
    rig, boards = with_sensors
    boards[0].interference.append(frame(boards[0].sample(0, 77))[:-3] + b"\0")
    code, said, error = typed("record", "--rig", rig, "--out", "first", "--seconds", 1, cwd=tmp_path)
    assert code == 0, error
    assert re.search(r"│ samples +│ [1-9]\d+ +│ [1-9]\d+", said)
    assert re.search(r"│ lost samples +│ 0 +│ 0 ", said)
    assert "inertial sensor 1 is not in the rig: its samples are left out" in " ".join(said.split())
    trial = open_trial(tmp_path / "first")
    assert [(imu.file, imu.board, imu.sensor) for imu in trial.table.imu] == [("imu0.csv", 0, 0), ("imu1.csv", 1, 2)]
    readings = list(trial.readings())
    for imu, board in enumerate(boards):
        samples = [r for r in readings if isinstance(r, ImuReading) and r.imu == imu]
        count = np.round([1e3 * r.rate_rad_per_s[0] for r in samples]).astype(int)  # the sensor's counter
        assert len(samples) > 80
        assert (np.diff(count) % 1000 == 1).all()
        assert [r.specific_force_m_per_s2.tolist() for r in samples[:1]] == [[0.0, 0.002 * board.sensors[-1], 9.81]]
        rows = {r.seq: r.host_s for r in readings if isinstance(r, BoardReading) and r.board == imu}
        late_s = [
            rows[k // 2] + 0.01 * (k % 2 - 1) - r.t_s for k, r in zip(count, samples, strict=True) if k // 2 in rows
        ]
        assert len(late_s) > 80
        assert 0.0 < np.median(late_s) < 0.01  # a row arrives by a delay after the time that is told for it


def test_a_silent_inertial_sensor_is_named_and_the_shapes_go_on(tmp_path, with_sensors, typed) -> None:
    """One of two is unplugged after some rows. The structure is anchored, so that frames are cheap."""
    rig, boards = with_sensors

    def unplug() -> None:
        while not (tmp_path / "first" / "imu1.csv").exists():
            time.sleep(0.02)
        time.sleep(0.3)
        boards[1].sensors = ()

    threading.Thread(target=unplug, daemon=True).start()
    code, said, error = typed("live", "--rig", rig, "--record", "first", "--out", "out", "--seconds", 2.4, cwd=tmp_path)
    assert code == 0, error
    assert re.search(r"imu 1: no sample for \d+ s: nothing is taken from it", said)
    live = tomllib.loads((tmp_path / "out" / "run.toml").read_text())
    silent = [imu["silent_frames"] for imu in live["imus"]]
    assert silent[0] == 0
    assert silent[1] > 5  # however busy the machine is
    assert live["frames"] > 5
    assert live["frames"] + live["skipped_frames"] > 60
    offline = tensegraph.reconstruct(tmp_path / "first", "live")
    assert live["frames"] + live["skipped_frames"] == len(offline)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"replay": "trials/press_01"}, "press_01_replayed"),
        ({"twin": "plans/prism.toml"}, "prism_session"),
        ({"rig": "rig.toml", "record": "trials/first"}, "first_session"),
    ],
)
def test_a_session_replaces_no_other_result(given, name) -> None:
    """`results/press_01` is that of batch, `results/press_01_live` that of `reconstruct --live`."""
    paths = {key: Path(given[key]) if key in given else None for key in ("rig", "replay", "twin", "record")}
    assert LiveSource(**paths, speed=1.0, ports=(), seconds=np.inf).name == name


def test_a_session_that_nobody_records_has_its_time_in_its_name() -> None:
    source = LiveSource(rig=Path("rig.toml"), replay=None, twin=None, record=None, speed=1.0, ports=(), seconds=np.inf)
    assert re.fullmatch(r"session_\d{8}_\d{6}", source.name)


REFUSED = [
    (["live"], "expected one of --rig, --replay and --twin"),
    (["live", "--twin", "rig.toml"], "rig.toml: line"),
    (["live", "--rig", "rig.toml", "--speed", "2"], "--speed goes with --replay and --twin, --port with --rig"),
    (["live", "--replay", "nothing"], "nothing/trial.toml: no such file"),
    (["live", "--replay", "trial", "--record", "trial"], "trial: exists: expected a new name"),
    (["live", "--replay", "trial", "--record", "x/trial", "--out", "x"], "x: expected another place for the result"),
    (["live", "--replay", "trial", "--out", "trial"], "trial: exists and is no earlier result"),
    (["live", "--rig", "rig.toml", "--port", "nowhere", "--view", "--out", "x"], "no window can be opened"),
    (["record", "--rig", "rig.toml", "--out", "trial"], "trial: exists: expected a new name"),
    (
        ["record", "--rig", "twice.toml", "--out", "x"],
        "board[1].board_id: expected a number from 0 to 255, each once, got '0'",
    ),
    (
        ["record", "--rig", "rig.toml", "--out", "x", "--port", "."],
        "no board answers on .: a directory, not a port: see",
    ),
    (["record", "--rig", "rig.toml", "--out", "x", "--port", "nowhere"], "no board answers on nowhere: not there"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED)
def test_what_can_not_be_is_one_line_and_exit_code_2(trial_copy, rig, typed, arguments, message) -> None:
    trial_copy(rows=40)
    (rig.parent / "twice.toml").write_text(rig.read_text().replace("board_id = 1", "board_id = 0"))
    code, _, error = typed(*arguments, cwd=rig.parent)
    assert code == 2
    assert error.count("\n") == 1
    assert message in error
    assert not (rig.parent / "x").exists()


@pytest.mark.parametrize(
    ("number", "send"), [(signal.SIGHUP, os.killpg), (signal.SIGTERM, os.kill), (signal.SIGTERM, os.killpg)]
)
def test_a_closed_terminal_or_a_termination_leaves_a_whole_trial(tmp_path, rig, two_ports, number, send) -> None:
    """A terminal sends it to all of the group, and so does `timeout`; settings are read from a file, too."""
    (tmp_path / "settings.toml").write_text("[clock]\nwindow_s = 30.0\n")
    process = start("record", "--rig", rig, *two_ports, "--out", "t", "--config", "settings.toml", cwd=tmp_path)
    began(process, tmp_path / "t", rows=30)
    send(process.pid, number)
    out, error = process.communicate(timeout=30)
    assert process.returncode == 0, error
    rows = list(open_trial(tmp_path / "t").readings())
    assert f"{len(rows)} rows recorded in t" in out
    assert len(rows) > 50


def test_ctrl_c_before_the_first_shape_ends_a_session_in_order(tmp_path, rig, two_ports) -> None:
    """The recording has begun, and what estimates is still being made."""
    process = start("live", "--rig", rig, *two_ports, "--record", "t", "--out", "out", cwd=tmp_path)
    began(process, tmp_path / "t")
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=60)
    rows = list(open_trial(tmp_path / "t").readings())
    assert f"{len(rows)} rows recorded in t" in out, error
    live = tomllib.loads((tmp_path / "out" / "run.toml").read_text())
    assert live["recorded_rows"] == len(rows)
    assert process.returncode == 0


@pytest.mark.parametrize("screen", ["terminal", "pipe"])
def test_a_screen_that_is_gone_takes_no_result_with_it(tmp_path, trial_copy, screen) -> None:
    """A window is closed, of which shell and system both tell; or Ctrl-C ends `tee`, which had shown the output."""
    ours, theirs = os.openpty() if screen == "terminal" else os.pipe()
    command = [sys.executable, undrawn_command.__file__, "live", "--replay", trial_copy(rows=150), "--out", "out"]
    environment = os.environ | {"COLUMNS": "120", "MPLBACKEND": "agg"}
    process = subprocess.Popen(
        list(map(str, command)), cwd=tmp_path, env=environment, stdout=theirs, stderr=subprocess.PIPE, text=True
    )
    os.close(theirs)
    until_it_estimates(process, tmp_path)
    os.close(ours)
    for number in (signal.SIGHUP, signal.SIGHUP) if screen == "terminal" else (signal.SIGINT,):
        process.send_signal(number)
        time.sleep(0.1)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    assert not error
    assert tomllib.loads((tmp_path / "out" / "run.toml").read_text())["frames"] > 0


def test_a_signal_while_figures_are_drawn_takes_no_result_with_it(tmp_path, trial_copy, typed, monkeypatch) -> None:
    """Ctrl-C when all rows have come, and then the window is closed."""

    def draw(*_) -> None:
        for number in (signal.SIGINT, signal.SIGHUP):
            os.kill(os.getpid(), number)

    monkeypatch.setattr("tensegraph.io.figures.shape_figures.write_figures", draw)
    before = [signal.signal(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGHUP)]
    code, _, error = typed("live", "--replay", trial_copy(rows=20), "--out", "out", cwd=tmp_path)
    for number, handler in zip((signal.SIGINT, signal.SIGHUP), before, strict=True):
        signal.signal(number, handler)
    assert code == 0, error
    assert tomllib.loads((tmp_path / "out" / "run.toml").read_text())["frames"] > 0


def test_a_second_termination_gives_the_result_up_and_says_so(tmp_path, trial_copy, typed, monkeypatch) -> None:
    """While figures are drawn; nothing unfinished is left."""

    def draw(*_) -> None:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr("tensegraph.io.figures.shape_figures.write_figures", draw)
    before = signal.getsignal(signal.SIGTERM)
    code, _, error = typed("live", "--replay", trial_copy(rows=20), "--out", "out", cwd=tmp_path)
    assert signal.signal(signal.SIGTERM, before) == before
    assert code == 130
    assert "tensegraph: out: not written: interrupted" in error
    assert not list(tmp_path.glob("*out*"))


def check_all_rows(trial: Path, boards: list) -> None:
    """Every row that a port took between the first and the last that is recorded is recorded once."""
    rows = list(open_trial(trial).readings())
    for number, board in enumerate(boards):
        seqs = [row.seq for row in rows if row.board == number]
        assert seqs == [seq for _, seq in board.sent if seqs[0] <= seq <= seqs[-1]]


@pytest.mark.parametrize("verb", ["record", "live"])
def test_a_process_that_stood_still_goes_on(tmp_path, rig, two_boards, two_ports, verb) -> None:
    """SIGSTOP to all of the group for 1.5 s: what the ports kept meanwhile is read, and shapes are in time."""
    out = ("--record", "t", "--out", "out") if verb == "live" else ("--out", "t")
    process = start(verb, "--rig", rig, *two_ports, *out, cwd=tmp_path)
    began(process, tmp_path / "t")
    if verb == "live":
        until_it_estimates(process, tmp_path)
    sent = [len(board.sent) for board in two_boards]
    for number, wait_s in ((signal.SIGSTOP, 1.5), (signal.SIGCONT, 1.2), (signal.SIGINT, 0.0)):
        os.killpg(process.pid, number)
        time.sleep(wait_s)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    assert all(len(board.sent) - before > 2.0 / 0.02 for board, before in zip(two_boards, sent, strict=True))
    check_all_rows(tmp_path / "t", two_boards)
    if verb == "live":
        latency = np.genfromtxt(tmp_path / "out" / "latency.csv", delimiter=",", names=True)
        assert latency["latency_s"][-1] < 1.0
        shape_s = np.genfromtxt(tmp_path / "out" / "shape.csv", delimiter=",", skip_header=1)[:, 0]
        assert shape_s[-1] > list(open_trial(tmp_path / "t").readings())[-1].host_s - 0.2
        assert (np.diff(shape_s) > 0).all()


def until_it_estimates(process: subprocess.Popen, folder: Path) -> None:
    """Wait until the first shapes are written, which is in a hidden directory as long as a session lasts."""
    until_s = time.monotonic() + 120
    while not list(folder.glob(".out-*/out/shape.csv")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until_s
        time.sleep(0.05)


def ended_on_a_full_disk(words: list[object], folder: Path, most_bytes: int) -> subprocess.CompletedProcess[str]:
    """Return a command that has ended in a folder where no file may grow beyond some bytes."""
    return subprocess.run(
        list(map(str, words)),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes)),
    )


def test_a_full_disk_ends_a_recording_from_boards(tmp_path, rig, two_ports) -> None:
    """No file may grow beyond 9000 bytes: the error is one line, and the rows before it are a trial."""
    words = [sys.executable, "-m", "tensegraph", "record", "--rig", rig, *two_ports, "--out", "t"]
    ended = ended_on_a_full_disk(words, tmp_path, 9000)
    assert ended.returncode == 2
    assert ended.stderr == "tensegraph: t: the recording ended: File too large\n"
    rows = list(open_trial(tmp_path / "t").readings())
    assert len(rows) > 100
    for board in (0, 1):
        assert (np.diff([row.seq for row in rows if row.board == board]) == 1).all()


def test_a_disk_that_is_full_of_the_result_ends_no_session(tmp_path, trial_copy) -> None:
    """No file may grow beyond 25 kB, as tables do within half a second of frames: all rows come, and are recorded."""
    command = [sys.executable, undrawn_command.__file__, "live", "--replay", trial_copy(rows=300), "--record", "again"]
    ended = ended_on_a_full_disk([*command, "--speed", 2, "--out", "out"], tmp_path, 25_000)
    full = "tensegraph: out: cannot be written: File too large"
    assert ended.stderr.splitlines() == [f"{full}; the session goes on", full]
    assert ended.returncode == 2
    assert not list(tmp_path.glob("*out*"))
    assert len(list(open_trial(tmp_path / "again").readings())) == 600


def test_settings_of_record_are_checked(tmp_path, rig, typed) -> None:
    (tmp_path / "settings.toml").write_text("[clock]\nwindow = 30.0\n")
    code, _, error = typed("record", "--rig", rig, "--out", "t", "--config", "settings.toml", cwd=tmp_path)
    assert code == 2
    said = "clock.window: is no setting; a run's run.toml lists them all: did you mean window_s?"
    assert error == f"tensegraph: settings.toml: {said}\n"


def test_exchanged_wires_and_inputs_are_told_live(tmp_path, trial_copy, typed) -> None:
    """Two plugs are in each other's places; run.toml says of what the result was made, and `evaluate` checks it."""
    swapped = trial_copy(trial=lambda text: replaced(text, ("[0, 1, 2, 3, 4, 5,", "[3, 1, 2, 0, 4, 5,")))
    code, said, error = typed("live", "--replay", swapped, "--speed", 1000, "--out", "live", cwd=tmp_path)
    assert code == 0, error
    assert "the sensors of tendons 0 and 3 look exchanged: see tendon_of_channel" in said
    written = tomllib.loads((tmp_path / "live" / "run.toml").read_text())
    assert written["inputs"] == open_trial(swapped).hashes()
    assert written["wrong_geometry"] == "none"
    with (swapped / "board0.csv").open("a") as file:
        file.write("\n")
    code, _, error = typed("evaluate", "live", cwd=tmp_path)
    assert code == 2
    assert "board0.csv: is not what live was made from" in error
